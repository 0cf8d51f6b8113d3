"""The controls that place the model: camera, views, numbers, undo."""

from __future__ import annotations

import math
from typing import Any

import viser

from poseviewer.app.page.fields import Field, Post, button, choices, set_property
from poseviewer.app.page.quick_start import QuickStartPanel
from poseviewer.app.state import commands as c
from poseviewer.app.state.cameras import NARROWEST_DEG, WIDEST_DEG
from poseviewer.app.state.requests import Request
from poseviewer.app.state.session import Session
from poseviewer.geometry.camera import Parallel, Perspective
from poseviewer.geometry.chart_names import label
from poseviewer.geometry.frames import camera_as_integer_centres
from poseviewer.starts.placing import SIDES

MOST_NUMBERS = 7
SHOWN_DIGITS = 5


class PlacePanel:
    """Folder "Place"."""

    def __init__(self, gui: viser.GuiApi, post: Post) -> None:
        self._names: tuple[str, ...] = ()
        self._shown: object = None
        self._error_message = ""
        with gui.add_folder("2 · Place"):
            self._views = gui.add_dropdown("View", ("as it is", *SIDES))
            self._bind_views(post)
            choices(gui, "History", post, {"Undo (Z)": c.Undo(), "Redo (Y)": c.Redo()})
            choices(
                gui, "Start", post, {"Go there (R)": c.ResetToStart(), "Set here": c.MakeStart()}
            )
            rings = gui.add_checkbox("Rotation rings (G)", False)
            self._rings = Field(rings, post, lambda on: c.ChangeView(rings=bool(on)))
            self._quick_start = QuickStartPanel(gui, post)
            with gui.add_folder("Numbers", expand_by_default=False):
                self._numbers = [self._number(gui, post, i) for i in range(MOST_NUMBERS)]
            with gui.add_folder("Camera", expand_by_default=False):
                self._camera(gui, post)

    def show(self, session: Session) -> None:
        """Bring the controls to the session."""
        self._quick_start.show(session)
        key = (session.document, session.history, session.look.rings)
        # After a refusal the fields still hold what was typed.
        if self._shown == key and self._error_message is session.error_message:
            return
        self._shown, self._error_message = key, session.error_message
        document = session.document
        self._rings.show(session.look.rings)
        chart = document.chart
        parameters = document.parameters
        self._names = chart.names
        for index, field in enumerate(self._numbers):
            if index < len(self._names):
                set_property(field.handle, "label", label(self._names[index]))
                field.show(round(float(parameters[index]), SHOWN_DIGITS))
            else:
                field.show(0.0, visible=False)
        self._show_camera(session)

    def _number(self, gui: viser.GuiApi, post: Post, index: int) -> Field:
        handle = gui.add_number("", 0.0, step=10.0**-SHOWN_DIGITS * 50)

        def asked(value: Any) -> Request | None:
            if index >= len(self._names):
                return None
            return c.SetNumber(self._names[index], float(value))

        return Field(handle, post, asked)

    def _bind_views(self, post: Post) -> None:
        @self._views.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None and self._views.value in SIDES:
                post(c.LookFrom(self._views.value))
                self._views.value = "as it is"

    def _camera(self, gui: viser.GuiApi, post: Post) -> None:
        self._projection = Field(
            gui.add_dropdown("Projection", ("perspective", "parallel")),
            post,
            lambda value: c.SetProjection(value),
        )
        field = gui.add_number("Field of view °", 50.0, min=NARROWEST_DEG, max=WIDEST_DEG, step=0.1)
        self._view_angle = Field(field, post, lambda value: c.SetFieldOfView(float(value)))
        exif = button(gui, "From EXIF", post, lambda _: self._from_exif())
        self._exif = exif
        self._intrinsics = [
            Field(gui.add_number(name, 1.0, step=0.01), post, self._from_intrinsics)
            for name in ("fx  (px)", "fy  (px)", "cx  (px)", "cy  (px)")
        ]
        self._last: Session | None = None

    def _show_camera(self, session: Session) -> None:
        self._last = session
        camera = session.document.pose.camera
        perspective = isinstance(camera, Perspective)
        self._projection.show("perspective" if perspective else "parallel")
        photo = session.document.registration.photo
        has_exif = photo.focal_length_35mm is not None
        set_property(self._exif, "visible", perspective and has_exif)
        shown = camera_as_integer_centres(camera)
        if isinstance(shown, Parallel):
            self._view_angle.show(self._view_angle.handle.value, visible=False)
            values = [shown.scale, shown.scale, shown.cx, shown.cy]
        else:
            longer = max(photo.width, photo.height)
            focal = shown.fx if photo.width >= photo.height else shown.fy
            angle = math.degrees(2.0 * math.atan(longer / 2.0 / focal))
            self._view_angle.show(round(angle, 3))
            values = [shown.fx, shown.fy, shown.cx, shown.cy]
        for index, (field, value) in enumerate(zip(self._intrinsics, values, strict=True)):
            field.show(round(value, 4), visible=perspective or index > 1)

    def _from_exif(self) -> Request:
        assert self._last is not None  # the page is shown before it can be pressed
        camera = camera_as_integer_centres(self._last.document.registration.photo.default_camera())
        assert isinstance(camera, Perspective)
        return c.SetCamera(camera.fx, camera.fy, camera.cx, camera.cy)

    def _from_intrinsics(self, _: float) -> Request | None:
        fx, fy, cx, cy = (float(field.handle.value) for field in self._intrinsics)
        return c.SetCamera(fx, fy, cx, cy)
