"""The document: photo, model, pose and settings, as undo and files see them; and its history."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from poseviewer.app.state.marks import Marks
from poseviewer.errors import SettingsError, SingularChartError
from poseviewer.fit.chart_choice import choose_chart
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.charts import Chart
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.transform import RigidTransform
from poseviewer.vehicle.chart import VehicleChart

MOST_STEPS = 200
MOST_REGISTRATIONS = 4
"""Undo reaches back over no more opened photos and models than this: they fill the memory."""


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
        if not start.camera_from_model.apply(centre)[2] > 0.0 and _is_perspective(start, self.pose):
            return self.pose
        if free_focal and isinstance(camera, Perspective) and isinstance(start.camera, Perspective):
            fx = start.camera.fx
            camera = replace(camera, fx=fx, fy=camera.fy * fx / camera.fx)
        return start if camera == start.camera else with_camera(start, camera, centre)

    @property
    def parameters(self) -> FloatArray:
        """(d,): the pose in ``chart``."""
        return self.chart.from_pose(self.pose)

    @property
    def paths(self) -> frozenset[Path]:
        """The files of photo and model, as far as they have one."""
        return frozenset(path for path in (self.photo_path, self.model_path) if path is not None)

    def started_from(self, pose: Pose) -> Document:
        """The same with another start pose, which is the pose as well."""
        return replace(self, registration=replace(self.registration, start=pose), pose=pose)


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


def with_camera(pose: Pose, camera: Camera, centre: FloatArray) -> Pose:
    """``pose`` seen by another camera, with the model's ``centre`` (3,) in the same place of the
    photo and as large as it was.
    """
    old, at = pose.camera, pose.camera_from_model.apply(centre)
    pixel = old.project(at)
    now_per_unit = old.scale if isinstance(old, Parallel) else old.fx / at[2]
    if isinstance(camera, Parallel):
        camera = replace(camera, scale=now_per_unit)
        place = [*((pixel - [camera.cx, camera.cy]) / camera.scale), at[2]]
    else:
        place = camera.rays(pixel) * (camera.fx / now_per_unit)
    rotation = pose.camera_from_model.rotation
    return Pose(camera, RigidTransform(rotation, place - rotation @ centre))


def with_projection(pose: Pose, projection: str, fallback: Perspective, centre: FloatArray) -> Pose:
    """The pose under ``perspective`` (``fallback``, where it was parallel) or ``parallel``."""
    camera = pose.camera
    if projection == "parallel" and isinstance(camera, Perspective):
        flat = Parallel(1.0, camera.cx, camera.cy, camera.width, camera.height)
        return with_camera(pose, flat, centre)
    if projection == "perspective" and isinstance(camera, Parallel):
        return with_camera(pose, fallback, centre)
    return pose


def _is_perspective(*poses: Pose) -> bool:
    return any(isinstance(pose.camera, Perspective) for pose in poses)


def _bounded(past: tuple[Document, ...]) -> tuple[Document, ...]:
    """The last steps, over no more than the allowed number of photos and of models."""
    past = past[-MOST_STEPS:]
    photos: set[int] = set()
    meshes: set[int] = set()
    for index in range(len(past) - 1, -1, -1):
        photos.add(id(past[index].registration.photo))
        meshes.add(id(past[index].registration.mesh))
        if max(len(photos), len(meshes)) > MOST_REGISTRATIONS:
            return past[index + 1 :]
    return past
