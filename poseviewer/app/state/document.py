"""The document: photo, model, pose, settings and marks, as undo and files see them; its history."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from poseviewer.app.state.cameras import with_camera
from poseviewer.errors import SettingsError, SingularChartError
from poseviewer.fit.problem import choose_chart
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.arrays import FloatArray, frozen_array
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.charts import Chart
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.ellipses import FEWEST_RIM_POINTS, Ellipse, ellipse_through

MOST_STEPS = 200
MOST_REGISTRATIONS = 4
"""Undo reaches back over no more opened photos and models than this: they fill the memory."""

WHEELS = 2


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """A point of the model, and where the photo shows it."""

    point: FloatArray
    """(3,), in the model's frame."""
    pixel: FloatArray | None = None
    """(2,), px; None: still to be clicked."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", frozen_array(self.point, (3,)))
        if self.pixel is not None:
            object.__setattr__(self, "pixel", frozen_array(self.pixel, (2,)))


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """What is marked on the photo for a quick start; only the last pair may be half done."""

    pairs: tuple[Pair, ...] = ()
    box: Rectangle | None = None
    """Rectangle (left, top, width, height) about the object, px."""
    rims: tuple[FloatArray, ...] = ()
    """Points (2,), px, on wheels' rims: five on the rear one, then five on the front one."""
    note: str = ""
    """Why no pose follows from them, as far as it was asked; a sentence."""

    @property
    def waits_for_pixel(self) -> bool:
        """Whether a model point was picked whose place in the photo comes next."""
        return bool(self.pairs) and self.pairs[-1].pixel is None

    @property
    def correspondences(self) -> tuple[FloatArray, FloatArray]:
        """(n, 3) and (n, 2): model points and pixels of the pairs that are done."""
        done = [pair for pair in self.pairs if pair.pixel is not None]
        points, pixels = [pair.point for pair in done], [pair.pixel for pair in done]
        return np.array(points).reshape(-1, 3), np.array(pixels).reshape(-1, 2)

    @property
    def ellipses(self) -> tuple[Ellipse, ...]:
        """Of the rear wheel, and of the front wheel, as far as they have their points.

        Raises:
            QuickStartError: the points of a wheel lie on no ellipse.
        """
        count = len(self.rims) // FEWEST_RIM_POINTS
        pieces = [self.rims[i * FEWEST_RIM_POINTS :][:FEWEST_RIM_POINTS] for i in range(count)]
        return tuple(ellipse_through(piece) for piece in pieces)


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """All that a pose file is made from."""

    registration: Registration
    """Photo, model, and the start pose that ``reset`` goes back to."""
    pose: Pose
    settings: FitSettings = field(default_factory=FitSettings)
    pins: tuple[FloatArray, ...] = ()
    """Points (3,) on the model's surface, in its frame, that the user has pinned."""
    photo_path: Path | None = None
    model_path: Path | None = None
    marks: Marks = field(default_factory=Marks)
    """Point pairs and wheels, from which a quick start follows."""

    @property
    def chart(self) -> Chart:
        """The chart whose numbers are shown and searched: as ``settings`` want it where that can
        be, else the free-body chart about the start pose, seen by the camera at hand.
        """
        mesh, settings, free_focal = self.registration.mesh, self.settings, self.settings.free_focal
        try:
            chart, _ = choose_chart(
                settings.chart, mesh, self.registration.keypoints, self.pose, free_focal
            )
            if isinstance(chart, VehicleChart):
                return chart
        except (SingularChartError, SettingsError):
            free_focal = free_focal and isinstance(self.pose.camera, Perspective)
        return FreeBodyChart.near(mesh, self._start_seen_now(free_focal), free_focal)

    def _start_seen_now(self, free_focal: bool) -> Pose:
        """The start pose by the camera at hand: by its own, a number of the chart would bring its
        intrinsics back. A focal length that is a number itself stays the start's.
        """
        start, camera = self.registration.start, self.pose.camera
        centre = self.registration.mesh.centre
        behind = not start.camera_from_model.apply(centre)[2] > 0.0
        if behind and Perspective in (type(start.camera), type(camera)):
            return self.pose
        if free_focal and isinstance(camera, Perspective) and isinstance(start.camera, Perspective):
            fx = start.camera.fx
            camera = replace(camera, fx=fx, fy=camera.fy * fx / camera.fx)
        return start if camera == start.camera else with_camera(start, camera, centre)

    @property
    def parameters(self) -> FloatArray:
        """(d,): the pose in ``chart``."""
        return self.chart.from_pose(self.pose)

    def shows_same(self, other: Document) -> bool:
        """Whether both have the same photo and the same model."""
        own, its = self.registration, other.registration
        return own.photo is its.photo and own.mesh is its.mesh

    @property
    def paths(self) -> frozenset[Path]:
        """The files of photo and model, as far as they have one."""
        return frozenset(path for path in (self.photo_path, self.model_path) if path is not None)

    def started_from(self, pose: Pose) -> Document:
        """The same with another start pose, which is the pose as well."""
        registration = replace(self.registration, start=pose, start_is_guess=False)
        return replace(self, registration=registration, pose=pose)

    @property
    def awaits_place(self) -> bool:
        """Whether nobody has said yet where the model is: then a press on the photo does."""
        own = self.registration
        return own.start_is_guess and self.pose is own.start


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """The documents before and after the one at hand."""

    past: tuple[Document, ...] = ()
    future: tuple[Document, ...] = ()

    def with_step(self, before: Document) -> History:
        """One more step, from ``before``; what was undone is gone."""
        return History(_bounded((*self.past, before)))

    def undo(self, now: Document) -> tuple[History, Document]:
        """The history and the document one step back; unchanged where there is none."""
        if not self.past:
            return self, now
        return History(self.past[:-1], (now, *self.future)), self.past[-1]

    def redo(self, now: Document) -> tuple[History, Document]:
        """The history and the document one step on again; unchanged where there is none."""
        if not self.future:
            return self, now
        return History(_bounded((*self.past, now)), self.future[1:]), self.future[0]


def _bounded(past: tuple[Document, ...]) -> tuple[Document, ...]:
    """The last steps, over no more than the allowed number of photos and of models."""
    past = past[-MOST_STEPS:]
    photos, meshes = set(), set()
    for index in reversed(range(len(past))):
        photos.add(id(past[index].registration.photo))
        meshes.add(id(past[index].registration.mesh.whole))
        if max(len(photos), len(meshes)) > MOST_REGISTRATIONS:
            return past[index + 1 :]
    return past
