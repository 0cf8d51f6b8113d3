"""The document: a scene, and the object and view that are worked on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.app.state.camera_change import with_camera
from poseviewer.errors import SingularChartError
from poseviewer.fit.compared_pixels import box_near
from poseviewer.fit.problem import FitProblem, pose_to_params, with_params
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Perspective, Pose
from poseviewer.geometry.charts import Chart
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_chart import ViewChart
from poseviewer.render.renderers import RendererName
from poseviewer.scene.assets import ModelFile
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import InView, Scene, SceneObject, View
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.wheel_pose import MIN_RIM_POINTS, Ellipse, ellipse_through

UNLOCK = "unlock it in the list of objects"

WHEELS = 2


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """Marks on the photo for a quick start."""

    points: tuple[FloatArray, ...] = ()
    """Points (3,) of the model, in its frame, of point pairs."""
    pixels: tuple[FloatArray, ...] = ()
    """Pixels (2,) that show them; the last one may still have to be clicked."""
    box: Rectangle | None = None
    """Rectangle (left, top, width, height) about the object, px."""
    rims: tuple[FloatArray, ...] = ()
    """Points (2,), px, on wheels' rims: five on the rear one, then five on the front one."""
    hubs: tuple[FloatArray, ...] = ()
    """The rear wheel's point (3,) on the model, where the front one's is still to be pressed."""
    note: str = ""
    """Why no pose follows from them, as far as it was asked; a sentence."""

    @property
    def waits_for_pixel(self) -> bool:
        """Whether a model point was picked whose place in the photo comes next."""
        return len(self.points) > len(self.pixels)

    @property
    def correspondences(self) -> tuple[FloatArray, FloatArray]:
        """(n, 3) and (n, 2): model points and pixels of the pairs that are done."""
        points, pixels = self.points[: len(self.pixels)], self.pixels
        return np.array(points).reshape(-1, 3), np.array(pixels).reshape(-1, 2)

    @property
    def ellipses(self) -> tuple[Ellipse, ...]:
        """Ellipses of the rear and the front wheel, as far as they have their points."""
        count = len(self.rims) // MIN_RIM_POINTS
        pieces = [self.rims[i * MIN_RIM_POINTS :][:MIN_RIM_POINTS] for i in range(count)]
        return tuple(ellipse_through(piece) for piece in pieces)


@dataclass(frozen=True, slots=True, eq=False)
class ObjectState:
    """State of an object that the app keeps beside the scene."""

    pins: tuple[FloatArray, ...] = ()
    """Points (3,) on the model's surface, in its frame, that the user has pinned."""
    marks: Mapping[int, Marks] = field(default_factory=dict)
    """Marks by the indices of the views."""


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """A scene, and the object and the view that all edits are about."""

    scene: Scene
    """Its objects' ids are whole numbers, by which they are coloured."""
    states: tuple[ObjectState, ...]
    """For each object."""
    active: int = 0
    """Index of the object that is worked on."""
    at: int = 0
    """Index of the view that is shown large."""

    @classmethod
    def of(cls, scene: Scene, active: int = 0, at: int = 0) -> Document:
        """The document of a scene, started where all is. Regions in the settings become the
        objects' own: so each can be edited.
        """
        objects, are_numbers = [], all(one.id.isdecimal() for one in scene.objects)
        for index, one in enumerate(scene.objects):
            in_views = []
            for number in range(len(scene.views)):
                own = scene.in_view(index, number)
                region = own.region or one.settings.region
                in_views.append(replace(own, region=region))
            named = {} if are_numbers else {"id": str(index + 1), "name": one.name or one.id}
            settings = replace(one.settings, region=None)
            cameras = one.start_cameras or tuple(view.camera for view in scene.views)
            started = {"start": one.start or one.world_from_model, "start_cameras": cameras}
            named |= {"in_views": tuple(in_views), "settings": settings}
            objects.append(replace(one, **started, **named))
        states = (ObjectState(),) * len(objects)
        return cls(replace(scene, objects=tuple(objects)), states, active, at)

    @property
    def object(self) -> SceneObject:
        """The active object."""
        return self.scene.objects[self.active]

    @property
    def state(self) -> ObjectState:
        """State of the active object."""
        return self.states[self.active]

    @property
    def view(self) -> View:
        """The view that is shown large."""
        return self.scene.views[self.at]

    @property
    def photo(self) -> Photo:
        """The view's photo."""
        return self.view.photo

    @property
    def model(self) -> ModelFile:
        """The active object's model."""
        return self.object.model

    @property
    def mesh(self) -> Mesh:
        """The active object's surface."""
        return self.object.mesh

    @property
    def settings(self) -> FitSettings:
        """The active object's settings."""
        return self.object.settings

    @property
    def pose(self) -> Pose:
        """The active object's pose in the view."""
        return self.scene.pose(self.active, self.at)

    @property
    def start(self) -> Pose:
        """The active object's start pose in the view, by the camera of that time."""
        view = replace(self.view, camera=self.object.start_cameras[self.at])
        return view.pose(self.object.start or self.object.world_from_model)

    @property
    def own(self) -> InView:
        """The view's own mask and region of the active object."""
        return self.scene.in_view(self.active, self.at)

    @property
    def marks(self) -> Marks:
        """Marks in the view for the active object."""
        return self.state.marks.get(self.at, Marks())

    @property
    def number(self) -> int:
        """The active object's own number; its colour goes by it."""
        return int(self.object.id)

    @property
    def others(self) -> tuple[int, ...]:
        """Indices of the objects that are not active and are to be seen in the photos."""
        objects = enumerate(self.scene.objects)
        return tuple(i for i, one in objects if i != self.active and stands(one))

    def with_active(self, index: int) -> Document:
        """The document with another object active."""
        return self if index == self.active else replace(self, active=index)._in_front

    def with_view(self, index: int) -> Document:
        """The document with another view large."""
        return self if index == self.at else replace(self, at=index)

    def with_object(self, index: int | None = None, **changes: Any) -> Document:
        """The document with changed fields of an object, by default the active one."""
        index = self.active if index is None else index
        return replace(self, scene=self.scene.with_object(index, **changes))

    def without_parts(self, names: Sequence[str]) -> Document:
        """The document whose active object lacks these parts alone, and is not searched for."""
        mesh = self.model.content.mesh_without(tuple(names))
        return self.with_object(without=mesh.left_out, result=None)

    def with_renderer(self, name: RendererName) -> Document:
        """The document with another renderer of all objects; ``auto``: with their own."""
        document = self
        for index, item in enumerate(self.scene.objects if name != "auto" else ()):
            document = document.with_object(index, settings=replace(item.settings, renderer=name))
        return document

    def with_own(self, **changes: Any) -> Document:
        """The document with changed fields of what the view has of the active object alone."""
        in_views = list(self.object.in_views)
        in_views[self.at] = replace(in_views[self.at], **changes)
        return self.with_object(in_views=tuple(in_views))

    @property
    def mask(self) -> Mask | None:
        """Pixels of the view that count by hand, by its mask and the active object's own one, as
        far as its settings let these hide.
        """
        if self.settings.in_front == "nothing":
            return None
        return self.scene.with_object(self.active, result=None).mask(self.active, self.at)

    def with_mask(self, mask: Mask | None, own: bool = False) -> Document:
        """The document with another mask of the view, or of the active object alone there, without
        results of searches that compared other pixels.
        """
        before = self.own.mask if own else self.view.mask
        old, new = (1.0 if weights is None else weights.weights for weights in (before, mask))
        changed = np.broadcast_to(np.not_equal(old, new), (self.photo.height, self.photo.width))
        document, views = self.with_own(mask=mask) if own else self, list(self.scene.views)
        if not own:
            views[self.at] = replace(self.view, mask=mask)
            document = replace(self, scene=replace(self.scene, views=tuple(views)))
        for index in (self.active,) if own else range(len(self.states)):
            if self._compares(index, changed):
                document = document.with_object(index, result=None)
        return document

    def _compares(self, index: int, where: NDArray[np.bool_]) -> bool:
        """Whether a search for an object compares pixels ``where`` (height, width) of the view."""
        if self.scene.objects[index].settings.pixels == "whole":
            return bool(where.any())
        near = box_near(self.scene.objects[index].mesh, self.scene.pose(index, self.at))
        return bool(np.any(near.mask(*where.shape)[where]))

    def with_state(self, **changes: Any) -> Document:
        """The document with changed fields of the active object's state."""
        states = list(self.states)
        states[self.active] = replace(states[self.active], **changes)
        return replace(self, states=tuple(states))

    def with_marks(self, **changes: Any) -> Document:
        """The document with changed fields of the marks in the view."""
        marks = replace(self.marks, **changes)
        return self.with_state(marks={**self.state.marks, self.at: marks})

    def at_pose(self, pose: Pose, scale: float | None = None) -> Document:
        """The document with the active object where the large view shows it at a pose, without a
        result; other objects stay where the photo shows them.
        """
        scene = self.scene.with_pose(self.active, pose, self.at, scale)
        return self._placed(scene, self.active, self.at)

    def at_numbers(
        self, problem: FitProblem, numbers: FloatArray, index: int | None = None
    ) -> Document:
        """The document with an object, by default the active one, at numbers (d,) of its problem;
        raises ``OutsideChartError``.
        """
        index = self.active if index is None else index
        scene = with_params(self.scene, index, problem, numbers)
        return self._placed(scene, index, problem.views[0].view_index)

    def _placed(self, scene: Scene, index: int, view: int) -> Document:
        """Document with an object where ``scene`` has it; others stay as a view shows them."""
        scene = scene.with_object(index, is_placed=True)
        if scene.views != self.scene.views:
            for other, one in enumerate(self.scene.objects):
                if other != index:
                    camera, centre = scene.views[view].camera, one.mesh.centre
                    kept = with_camera(self.scene.pose(other, view), camera, centre)
                    scene = scene.with_pose(other, kept, view)
        return replace(self, scene=scene)

    def numbers_in(self, problem: FitProblem) -> FloatArray:
        """(d,): the active object's pose in the chart of a problem; raises as the chart."""
        pose = self.scene.pose(self.active, problem.views[0].view_index)
        return pose_to_params(problem.chart, pose, self.object.world_from_model.scale)

    @property
    def started(self) -> Document:
        """The document whose active object starts where it is."""
        cameras = tuple(view.camera for view in self.scene.views)
        start = {"start": self.object.world_from_model, "start_cameras": cameras}
        return self.with_object(is_placed=True, **start)

    @property
    def reset(self) -> Document:
        """The document with the active object at its start."""
        pairs = zip(self.scene.views, self.object.start_cameras, strict=True)
        views = tuple(replace(view, camera=camera) for view, camera in pairs)
        at_start = {"world_from_model": self.object.start, "result": None}
        scene = replace(self.scene, views=views).with_object(self.active, **at_start)
        return self._placed(scene, self.active, self.at)

    @property
    def chart(self) -> Chart:
        """The chart whose numbers are shown: the vehicle's where that can be, else the free-body
        chart about the start pose, of several views with the size where that is free.
        """
        is_perspective = isinstance(self.pose.camera, Perspective)
        free_focal = self.settings.free_focal and is_perspective
        free_principal = self.settings.free_principal_point and is_perspective
        keypoints, has_one_view = self.model.keypoints, len(self.scene.views) == 1
        if has_one_view and keypoints is not None and self.settings.chart != "free-body":
            with suppress(SingularChartError):
                chart = VehicleChart.near(keypoints, self.pose, free_focal, free_principal)
                known = self._with_start_principal(chart.camera)
                return replace(chart, camera=known) if free_principal else chart
        start = self._start_seen_now(free_focal, free_principal and not has_one_view)
        if has_one_view:
            return FreeBodyChart.near(self.mesh, start, free_focal)
        now, begun = self.object.world_from_model, self.object.start
        place = now if start is self.pose or begun is None else begun
        reference, turn = FreeBodyChart.near(self.mesh, start), RigidTransform.identity()
        assert isinstance(start.camera, Perspective)  # those of several views are
        free_scale, scale = (
            self.scene.free_scale,
            1.0 / place.scale,
        )
        free = {"free_focals": int(free_focal), "free_principal_points": int(free_principal)}
        return ViewChart(reference, start.camera, turn, free_scale, scale, **free)

    def _with_start_principal(self, camera: Camera) -> Camera:
        first = self.object.start_cameras[self.at]
        return replace(camera, cx=first.cx, cy=first.cy)

    def _start_seen_now(self, free_focal: bool, free_principal: bool) -> Pose:
        """The start pose by the camera at hand: by its own, a number of the chart would bring its
        intrinsics back. A focal length or principal point that is a number itself stays the
        start's.
        """
        start = self.start
        camera = self.pose.camera
        camera = self._with_start_principal(camera) if free_principal else camera
        centre = self.mesh.centre
        behind = not start.camera_from_model.apply(centre)[2] > 0.0
        if behind and Perspective in (type(start.camera), type(camera)):
            return self.pose
        if free_focal and isinstance(camera, Perspective) and isinstance(start.camera, Perspective):
            fx = start.camera.fx
            camera = replace(camera, fx=fx, fy=camera.fy * fx / camera.fx)
        return start if camera == start.camera else with_camera(start, camera, centre)

    @property
    def parameters(self) -> FloatArray:
        """(d,): the active object's pose in ``chart``."""
        return pose_to_params(self.chart, self.pose, self.object.world_from_model.scale)

    def without(self, index: int) -> Document:
        """The document without one of several objects; where it was active, the next one is."""
        objects, states = (
            (*all_of[:index], *all_of[index + 1 :]) for all_of in (self.scene.objects, self.states)
        )
        active = self.active - 1 if self.active > index else min(self.active, len(objects) - 1)
        scene = replace(self.scene, objects=objects)
        return replace(self, scene=scene, states=states, active=active)._in_front

    @property
    def _in_front(self) -> Document:
        """The document with another view large where the active object is behind this camera."""
        if self.pose.camera_from_model.apply(self.mesh.centre)[2] > 0.0:
            return self
        return self.with_view(reference_view(self.scene, self.active, self.at))

    @property
    def shown(self) -> tuple[object, ...]:
        """Large photo, active object, its model, and all photos."""
        return self.at, self.number, self.mesh, *(view.photo for view in self.scene.views)

    @property
    def placement(self) -> tuple[object, ...]:
        """Poses and notes that files keep; equal where none of them has changed."""
        views = ((view.photo, view.camera, view.mask) for view in self.scene.views)
        objects = self.scene.objects
        models = ((o.mesh, o.model.keypoints, o.in_views) for o in objects)
        return *views, *models, *((o.world_from_model, o.note) for o in objects)


def is_alone(document: Document) -> bool:
    """Whether there is one object in one view: a pose file says all of it."""
    return len(document.scene.views) == len(document.scene.objects) == 1


def label_of(one: SceneObject) -> str:
    """Name of an object: the user's, or its file's."""
    return one.name.strip() or one.model.name


def stands(one: SceneObject) -> bool:
    """Whether an object is to be seen in the photos: neither hidden, nor still to be placed."""
    return one.is_placed and not one.hidden


def verdict_of(one: SceneObject) -> str:
    """The end of the search for an object in a word."""
    if one.result is None:
        return "not searched" if one.is_placed else "not placed"
    return "searched" if one.result.verdict is None else one.result.verdict.label


def scale_at(chart: Chart, numbers: FloatArray) -> float | None:
    """Lengths of the world's unit to one of the model's, as far as the numbers (d,) say it."""
    return 1.0 / chart.scale_at(numbers) if isinstance(chart, ViewChart) else None


def reference_view(scene: Scene, index: int, view: int) -> int:
    """The view whose chart an object is searched by: ``view``, or else the first compared one."""
    for number in (view, *range(len(scene.views))):
        is_compared = scene.in_view(index, number).is_compared
        if is_compared and scene.model_at(index, number).is_seen:
            return number
    return view


def compared(scene: Scene, index: int) -> tuple[object, ...]:
    """Everything that the loss of an object about its pose depends on; equal for equal losses."""
    one, objects = scene.objects[index], enumerate(scene.objects)
    firm = ((o.mesh, o.world_from_model) for i, o in objects if i != index and o.is_occluder)
    return scene.views, one.mesh, one.world_from_model, one.in_views, one.settings, *firm
