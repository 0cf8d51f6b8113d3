"""The document: photo, model, pose, settings and marks, as undo and files see them; its history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from poseviewer.api import Case, FitResult
from poseviewer.app.state.cameras import has_camera, with_camera
from poseviewer.app.state.photo_set import OwnOfPhoto, PhotoSet
from poseviewer.errors import SettingsError, SingularChartError
from poseviewer.files.pose import PoseRecord
from poseviewer.fit.problem import choose_chart
from poseviewer.fit.progress import FitProgress
from poseviewer.fit.registration import PlacedModel, Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.arrays import FloatArray, frozen_array
from poseviewer.geometry.camera import Camera, Perspective, Pose
from poseviewer.geometry.charts import Chart
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.photo import Photo
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_chart import ViewChart
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.wheel_pose import FEWEST_RIM_POINTS, Ellipse, ellipse_through

MOST_STEPS = 200
MOST_REGISTRATIONS = 4
"""Undo reaches back over no more opened photos, and models beside those at hand, than this: they
fill the memory."""

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
        """Of the rear wheel, and of the front wheel, as far as they have their points."""
        count = len(self.rims) // FEWEST_RIM_POINTS
        pieces = [self.rims[i * FEWEST_RIM_POINTS :][:FEWEST_RIM_POINTS] for i in range(count)]
        return tuple(ellipse_through(piece) for piece in pieces)


@dataclass(frozen=True, slots=True, eq=False)
class SearchEnd:
    """What a search found."""

    record: PoseRecord
    in_front: NDArray[np.bool_] | None = None
    """(height, width) of the photo: what it took for something in front of the model."""
    alone: str = ""
    """The verdict's word by this photo of a set alone."""
    filed: PoseRecord | None = None
    """Of a set, what its pose file says: that of the photo that the search began in."""

    @classmethod
    def of(cls, case: Case, progress: FitProgress) -> SearchEnd:
        """Where a search of a case has ended."""
        found = FitResult(case.behind(progress.hidden), progress.pose, progress)
        return cls(found.record, found.hidden)


@dataclass(frozen=True, slots=True, eq=False)
class SceneObject:
    """A model in the photo, and all that is its own."""

    registration: Registration
    """Photo, model, and the start pose that ``reset`` goes back to."""
    pose: Pose
    settings: FitSettings = field(default_factory=FitSettings)
    pins: tuple[FloatArray, ...] = ()
    """Points (3,) on the model's surface, in its frame, that the user has pinned."""
    model_path: Path | None = None
    marks: Marks = field(default_factory=Marks)
    """Point pairs and wheels, from which a quick start follows."""
    number: int = 1
    """Its own among the objects of a document; its colour goes by it."""
    name: str = ""
    """What the user calls it; "": as its file is called."""
    hidden: bool = False
    """Not drawn, and in front of nothing."""
    locked: bool = False
    """Left where it is in the photo by presses and searches."""
    end: SearchEnd | None = None
    """Of the last search; of use as long as its pose is the one at hand."""
    views: PhotoSet | None = None
    """The set that the photo is one of: the object is then alone in it."""

    @property
    def label(self) -> str:
        """What it is called."""
        return self.name.strip() or self.registration.mesh_name

    @property
    def searched(self) -> SearchEnd | None:
        """The search that led to the pose at hand; None where none ended there."""
        return self.end if self.end is not None and self.end.record.pose is self.pose else None

    @property
    def compared_mask(self) -> Mask | None:
        """What counts of the photo at the pose at hand: also without what the search that led to it
        took for something in front.
        """
        mask = self.registration.mask
        if self.searched is None or self.searched.in_front is None:
            return mask
        seen = ~self.searched.in_front
        return Mask.of(seen if mask is None else mask.weights * seen)

    @property
    def stands(self) -> bool:
        """Whether it is to be seen in the photo: neither hidden, nor still to be put somewhere."""
        return not (self.hidden or self.awaits_place)

    def is_placed_same(self, other: SceneObject) -> bool:
        """Whether both are the same model at the same pose, and compared with the same pixels."""
        own, its = self.registration, other.registration
        if self.views is not None and other.views is not None:  # whichever photo is large
            return self.views.poses is other.views.poses and self.compares_same(other)
        same_pixels = own.photo is its.photo and own.mask is its.mask
        return same_pixels and own.mesh is its.mesh and self.pose is other.pose

    def compares_same(self, other: SceneObject) -> bool:
        """Whether both compare the same model with the same pixels, of all photos."""
        if self.views is None or other.views is None:
            same_kind = self.views is other.views
            return same_kind and self.registration.compares_same(other.registration)
        same_model = self.registration.mesh is other.registration.mesh
        if not same_model or self.views.views is not other.views.views:
            return False
        pairs = zip(self.own_of_photos, other.own_of_photos, strict=True)
        same_pixels = all(a.mask is b.mask and a.region == b.region for a, b in pairs)
        return same_pixels and self.views.compared == other.views.compared

    @property
    def own_of_photos(self) -> tuple[OwnOfPhoto, ...]:
        """What belongs to each photo of the set, the large one as it is now; empty: it is none."""
        if self.views is None:
            return ()
        own = list(self.views.own)
        large = self.registration.mask, self.settings.region, self.marks, self.end
        own[self.views.at] = OwnOfPhoto(*large)
        return tuple(own)

    @property
    def verdict(self) -> str:
        """In a word: how the search ended that led to the pose at hand."""
        if self.searched is None:
            return "not placed" if self.awaits_place else "not searched"
        verdict = self.searched.record.verdict
        return verdict.word if verdict is not None else "searched"

    def seen_by(self, photo: Photo, camera: Camera) -> SceneObject:
        """The same in a photo that a camera took, where it was and as large; the same object where
        it is that already.
        """
        own, pose = self.registration, self.pose
        if not has_camera(pose, camera):
            pose = with_camera(pose, camera, own.mesh.centre)
        if pose is self.pose and own.photo is photo:
            return self
        start = pose if own.start is self.pose else own.start
        same_pixels = own.photo.sha256 == photo.sha256
        same_pixels = same_pixels and own.photo.undistortion is photo.undistortion
        mask = own.mask if same_pixels else None
        registration = replace(own, photo=photo, start=start, mask=mask)
        return replace(self, registration=registration, pose=pose, end=None)

    @property
    def chart(self) -> Chart:
        """The chart whose numbers are shown and searched: as ``settings`` want it where that can
        be, else the free-body chart about the start pose, seen by the camera at hand; of a set,
        with its size where that is free.
        """
        if self.views is not None:
            return self._chart_in_set(self.views)
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

    def _chart_in_set(self, views: PhotoSet) -> ViewChart:
        mesh, start, scale = self.registration.mesh, self.registration.start, views.start_scale
        if not start.camera_from_model.apply(mesh.centre)[2] > 0.0:
            start, scale = self.pose, views.scale
        reference, camera = FreeBodyChart.near(mesh, start), views.views.views[views.at].camera
        return ViewChart(reference, camera, RigidTransform.identity(), views.free_size, scale)

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
        return self.numbers_in(self.chart, self.registration.photo)

    def numbers_in(self, chart: Chart, photo: Photo) -> FloatArray:
        """(d,): the pose in a chart of the poses in a photo: that at hand, or another of the set;
        raises as the chart.
        """
        views = self.views
        if views is None or not isinstance(chart, ViewChart):
            return chart.from_pose(self.pose)
        return chart.numbers_at(views.poses[views.index_of(photo)], views.scale)

    def started_from(self, pose: Pose) -> Self:
        """The same with another start pose, which is the pose as well."""
        registration = replace(self.registration, start=pose, start_is_guess=False)
        return replace(self, registration=registration, pose=pose)

    @property
    def awaits_place(self) -> bool:
        """Whether the model has no place in the photo yet: a press on the photo gives it one."""
        own = self.registration
        return own.start_is_guess and self.pose is own.start


T = TypeVar("T", bound=SceneObject)


@dataclass(frozen=True, slots=True, eq=False)
class Document(SceneObject):
    """A photo and its objects: the one that is picked, which all commands are about, and others."""

    photo_path: Path | None = None
    others: tuple[SceneObject, ...] = ()
    """In the photo and seen by the camera of the picked one; those that stand in the photo are
    among what its registration has as ``others``.
    """

    def __post_init__(self) -> None:
        photo, camera = self.registration.photo, self.pose.camera
        if self.views is not None:
            views = self.views
            is_of_set = views.views.views[views.at].photo is photo
            views = views.following(self.pose, self.registration.start) if is_of_set else None
            object.__setattr__(self, "views", views)
        others = tuple(one.seen_by(photo, camera) for one in self.others)
        object.__setattr__(self, "others", others)
        own = self.registration
        known = {(id(one.mesh), id(one.pose)): one for one in own.others}
        standing = [(one.registration.mesh, one.pose) for one in self.standing]
        placed = tuple(known.get((id(m), id(p))) or PlacedModel(m, p) for m, p in standing)
        if placed != own.others:
            object.__setattr__(self, "registration", replace(own, others=placed))

    @classmethod
    def of(
        cls, picked: SceneObject, photo_path: Path | None, others: tuple[SceneObject, ...]
    ) -> Document:
        """A document whose objects are these."""
        return cls(**_fields_of(picked), photo_path=photo_path, others=others)

    @property
    def objects(self) -> tuple[SceneObject, ...]:
        """All of them, the picked one as well, by their numbers."""
        return tuple(sorted((self, *self.others), key=lambda one: one.number))

    @property
    def standing(self) -> tuple[SceneObject, ...]:
        """The others that are to be seen in the photo."""
        return tuple(one for one in self.others if one.stands)

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Of all objects."""
        return tuple(one.pose for one in self.objects)

    def numbered(self, number: int) -> SceneObject | None:
        """The object of a number; None where there is none."""
        return next((one for one in self.objects if one.number == number), None)

    def picking(self, number: int) -> Document:
        """The same with another object picked."""
        kept = tuple(one for one in self.objects if one.number != number)
        new = self.numbered(number)
        return self if new is None or new is self else self._with(new, kept)

    def altered(self, number: int, **changes: Any) -> Document:
        """The same with changed fields of one of its objects."""
        if number == self.number:
            return replace(self, **changes)
        others = (replace(o, **changes) if o.number == number else o for o in self.others)
        return replace(self, others=tuple(others))

    def looking_at(self, index: int) -> Document:
        """The same with another photo of its set large."""
        views = self.views
        if views is None or index == views.at or not 0 <= index < len(views.own):
            return self
        own, view = self.own_of_photos[index], views.views.views[index]
        start, pose = views.starts[index], views.poses[index]
        registration = replace(self.registration, photo=view.photo, start=start, mask=own.mask)
        return replace(
            self,
            registration=registration,
            pose=pose,
            settings=replace(self.settings, region=own.region),
            marks=own.marks,
            end=own.end,
            photo_path=view.path,
            views=replace(views, own=self.own_of_photos, at=index),
        )

    def at_numbers(self, chart: Chart, numbers: FloatArray, photo: Photo) -> Document:
        """The same at the numbers (d,) of a chart of the poses in a photo: that at hand, or another
        of the set.

        Raises:
            OutsideChartError: they stand for no pose.
        """
        pose = chart.to_pose(numbers)
        if self.views is None or not isinstance(chart, ViewChart):
            return replace(self, pose=pose)
        return self.seen_in(self.views.index_of(photo), pose, chart.scale_at(numbers))

    def seen_in(self, index: int, pose: Pose, scale: float | None = None) -> Document:
        """The same where its set has a pose in one photo; None: by the scale that it has."""
        views = self.views
        assert views is not None  # who asks has a photo of it
        scale = views.scale if scale is None else scale
        poses = views.views.posed(index, pose, scale)
        return replace(self, pose=poses[views.at], views=replace(views, scale=scale, poses=poses))

    def found_in_set(self, ends: Sequence[SearchEnd], scale: float) -> Document:
        """The same where a search of the set has ended; ``ends``: one for each photo."""
        views = self.views
        assert views is not None  # whose search it was
        poses = tuple(end.record.pose for end in ends)
        pairs = zip(self.own_of_photos, ends, strict=True)
        own = tuple(replace(one, end=end) for one, end in pairs)
        views = replace(views, scale=scale, poses=poses, own=own)
        return replace(self, pose=poses[views.at], end=ends[views.at], views=views)

    @property
    def unsearched(self) -> Document:
        """The same without what searches said of it."""
        views = self.views
        if views is not None:
            views = replace(views, own=tuple(replace(one, end=None) for one in views.own))
        return replace(self, end=None, views=views)

    def compared_by(self, **changes: Any) -> Document:
        """With another mask, mesh or symmetry of the picked object, by the fields of its
        registration; what searches said was said of the ones before.
        """
        return replace(self.unsearched, registration=replace(self.registration, **changes))

    def with_poses(self, poses: Mapping[int, Pose], ends: Mapping[int, SearchEnd]) -> Document:
        """The same with its objects at other poses, by their numbers, and what was found there."""

        def at(one: T) -> T:
            pose, end = poses.get(one.number, one.pose), ends.get(one.number, one.end)
            kept = pose is one.pose and end is one.end
            return one if kept else replace(one, pose=pose, end=end)

        return at(replace(self, others=tuple(map(at, self.others))))

    def with_object(self, new: SceneObject) -> Document:
        """One object more, which is picked and has a number of its own."""
        number = 1 + max(one.number for one in self.objects)
        return self._with(replace(new, number=number), self.objects)

    def without(self, number: int) -> Document:
        """The same without one of several objects; the next one is picked where it was picked."""
        kept = tuple(one for one in self.objects if one.number != number)
        if number != self.number:
            return replace(self, others=tuple(one for one in kept if one.number != self.number))
        after = next((one for one in kept if one.number > number), kept[-1])
        return self._with(after, tuple(one for one in kept if one is not after))

    def _with(self, picked: SceneObject, others: tuple[SceneObject, ...]) -> Document:
        left = (SceneObject(**_fields_of(self)) if one is self else one for one in others)
        return Document.of(picked, self.photo_path, tuple(left))

    def shows_same(self, other: Document) -> bool:
        """Whether both have the same photo, and the same object picked, with the same model."""
        own, its = self.registration, other.registration
        same_object = own.mesh is its.mesh and self.number == other.number
        return own.photo is its.photo and same_object

    @property
    def paths(self) -> frozenset[Path]:
        """The files of photos and models, as far as they have one."""
        seen = () if self.views is None else (view.path for view in self.views.views.views)
        paths = self.photo_path, *seen, *(one.model_path for one in self.objects)
        return frozenset(path for path in paths if path is not None)


def _fields_of(one: SceneObject) -> dict[str, Any]:
    """Those that every object has."""
    return {own.name: getattr(one, own.name) for own in fields(SceneObject)}


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
    most_meshes = MOST_REGISTRATIONS + len(past[-1].others)
    for index in reversed(range(len(past))):
        document = past[index]
        views = document.views
        photos.add(id(document.registration.photo if views is None else views.views))
        meshes |= {id(one.registration.mesh.whole) for one in document.objects}
        if len(photos) > MOST_REGISTRATIONS or len(meshes) > most_meshes:
            return past[index + 1 :]
    return past
