"""The document: a scene, and the object and view that are worked on."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import SingularChartError
from poseviewer.fit.compared_pixels import box_near
from poseviewer.fit.problem import FitProblem, pose_to_params, with_params
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.charts import Chart
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.placing import with_point_at
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_chart import ViewChart
from poseviewer.render.renderers import RendererName
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.sequence import show_frame
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import (
    MANY_VIEWS,
    Frame,
    InView,
    Scene,
    SceneObject,
    SearchResult,
    View,
)
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.wheel_pose import MIN_RIM_POINTS, Ellipse, ellipse_through

UNLOCK = "unlock it in the list of objects"

WHEELS = 2
MaskKind = Literal["photo", "object", "found"]
"""Mask of a photo: the user's for all objects, or for the active one, or what was found in front
of that.
"""
KEYS_OF_MASKS: Mapping[MaskKind, str] = {"photo": "mask", "object": "masks", "found": "occluders"}
"""Fields of a frame that hold them."""


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
    """Points (3,) on the model of the rear and then the front wheel, as far as they are pressed."""
    note: str = ""
    """Sentence: why no pose follows from the marks; "": one does, or too few are set."""

    @property
    def waits_for_pixel(self) -> bool:
        """Whether the last model point still needs its pixel."""
        return len(self.points) > len(self.pixels)

    @property
    def correspondences(self) -> tuple[FloatArray, FloatArray]:
        """(n, 3) and (n, 2): model points and pixels of the complete pairs."""
        points, pixels = self.points[: len(self.pixels)], self.pixels
        return np.array(points).reshape(-1, 3), np.array(pixels).reshape(-1, 2)

    @property
    def ellipses(self) -> tuple[Ellipse, ...]:
        """Ellipses of the rear and the front wheel, each once it has enough points."""
        count = len(self.rims) // MIN_RIM_POINTS
        pieces = [self.rims[i * MIN_RIM_POINTS :][:MIN_RIM_POINTS] for i in range(count)]
        return tuple(ellipse_through(piece) for piece in pieces)


MARKING = {"pairs": ("pixels", "points"), "wheels": ("rims",)}
"""Fields of ``Marks`` that each tool sets; the first holds pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class ObjectState:
    """State of an object that only the app has."""

    pins: tuple[FloatArray, ...] = ()
    """Points (3,) on the model's surface, in its frame, that the user has pinned."""
    marks: Mapping[int, Marks] = field(default_factory=dict)
    """Marks by the indices of the views."""


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """A scene, with the active object and the large view, which edits change."""

    scene: Scene
    """Scene whose objects' ids are whole numbers, by which they are coloured."""
    states: tuple[ObjectState, ...]
    """For each object."""
    active: int = 0
    """Index of the active object."""
    view_index: int = 0
    """Index of the view that is shown large."""

    @classmethod
    def of(cls, scene: Scene) -> Document:
        """The document of a scene. Start poses are filled in, and regions of the settings become
        the views' own, so that each can be edited. Objects whose ids are no numbers get such.
        """
        objects, are_numbers = [], all(item.id.isdecimal() for item in scene.objects)
        if not are_numbers:
            numbers = {item.id: str(index) for index, item in enumerate(scene.objects, 1)}
            frames = tuple(_renamed(frame, numbers) for frame in scene.frames)
            scene = replace(scene, frames=frames)
        for index, item in enumerate(scene.objects):
            in_views = (scene.in_view(index, view) for view in range(len(scene.views)))
            region = item.settings.region
            names = {} if are_numbers else {"id": str(index + 1), "name": item.name or item.id}
            filled_in = replace(
                item,
                start=item.start or item.world_from_model,
                start_cameras=item.start_cameras or tuple(view.camera for view in scene.views),
                in_views=tuple(replace(own, region=own.region or region) for own in in_views),
                settings=replace(item.settings, region=None),
                **names,
            )
            objects.append(filled_in)
        return cls(replace(scene, objects=tuple(objects)), (ObjectState(),) * len(objects))

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
        return self.scene.views[self.view_index]

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
    def drawn_mesh(self) -> Mesh:
        """The active object's surface as it is drawn: painted, if it is."""
        return self.object.drawn_mesh

    @property
    def compared_mesh(self) -> Mesh:
        """The active object's surface as a search compares it, as ``Scene.compared_mesh``."""
        return self.scene.compared_mesh(self.active)

    @property
    def settings(self) -> FitSettings:
        """The active object's settings."""
        return self.object.settings

    @property
    def pose(self) -> Pose:
        """The active object's pose in the view."""
        return self.scene.pose(self.active, self.view_index)

    @property
    def has_pose(self) -> bool:
        """Whether the active object has a pose, in a sequence one in the shown frame."""
        scene, item = self.scene, self.object
        return item.is_placed and (
            not scene.frames or item.id in scene.frames[scene.frame_index].poses
        )

    @property
    def start(self) -> Pose:
        """The active object's start pose in the view, by the start's camera."""
        view = replace(self.view, camera=self.object.start_cameras[self.view_index])
        return view.pose(self.object.start or self.object.world_from_model)

    @property
    def in_view(self) -> InView:
        """Mask and region of the active object in the view."""
        return self.scene.in_view(self.active, self.view_index)

    @property
    def marks(self) -> Marks:
        """Marks in the view for the active object."""
        return self.state.marks.get(self.view_index, Marks())

    @property
    def object_id(self) -> int:
        """The active object's id, which picks its colour."""
        return int(self.object.id)

    @property
    def others(self) -> tuple[int, ...]:
        """Indices of the shown objects but the active one."""
        objects = enumerate(self.scene.objects)
        return tuple(i for i, item in objects if i != self.active and is_shown(item))

    def with_active(self, object_index: int) -> Document:
        """The document with another object active."""
        if object_index == self.active:
            return self
        return replace(self, active=object_index)._with_object_in_front

    def with_view(self, view_index: int, file: PhotoFile | None = None) -> Document:
        """The document with another view large, whose photo may have been read into ``file``; of
        many, the others' are read anew when they are shown.
        """
        if view_index == self.view_index:
            return self
        document = replace(self, view_index=view_index)
        if not self.scene.has_many_views:
            return document
        files = [view.file.at_rest for view in self.scene.views]
        files[view_index] = file or self.scene.views[view_index].file
        return replace(document, scene=with_files(self.scene, files))

    @property
    def stepped(self) -> tuple[PhotoFile, ...]:
        """Photos through which the time line steps: of frames, or of many views."""
        views = self.scene.views if self.scene.has_many_views else ()
        return tuple(one.file for one in self.scene.frames or views)

    @property
    def step_index(self) -> int:
        """Index, among ``stepped``, of the photo that is shown."""
        return self.scene.frame_index if self.scene.frames else self.view_index

    def at_frame(self, frame_index: int, file: PhotoFile) -> Document:
        """The document at a frame of the sequence, whose photo has been read into ``file``."""
        return self.with_frames_of(show_frame(self.scene, frame_index), file)

    def with_frames_of(self, scene: Scene, file: PhotoFile | None = None) -> Document:
        """The document with changed frames; the shown one's photo stays read, or is in ``file``.
        Poses that came with the frame are start poses.
        """
        view = replace(scene.views[0], file=file or self.view.file)
        objects = tuple(
            replace(
                item,
                start=item.start or item.world_from_model,
                start_cameras=item.start_cameras if item.start else (view.camera,),
            )
            for item in scene.objects
        )
        return replace(self, scene=replace(scene, views=(view,), objects=objects))

    def with_object(self, object_index: int | None = None, **changes: Any) -> Document:
        """The document with changed fields of an object, by default the active one."""
        object_index = self.active if object_index is None else object_index
        return replace(self, scene=self.scene.with_object(object_index, **changes))

    def without_parts(self, names: Sequence[str]) -> Document:
        """The document whose active object lacks exactly these parts, and has no result."""
        mesh = self.model.content.mesh_without(tuple(names))
        return self.with_object(without=mesh.left_out, result=None)

    def with_renderer(self, name: RendererName) -> Document:
        """The document with another renderer for all objects; ``auto`` keeps theirs."""
        document = self
        for index, item in enumerate(self.scene.objects if name != "auto" else ()):
            document = document.with_object(index, settings=replace(item.settings, renderer=name))
        return document

    def with_in_view(self, **changes: Any) -> Document:
        """The document with changed fields of ``in_view``."""
        in_views = list(self.object.in_views)
        in_views[self.view_index] = replace(in_views[self.view_index], **changes)
        return self.with_object(in_views=tuple(in_views))

    @property
    def painted(self) -> Mask | None:
        """The user's masks of the photo and of the active object in it, unless settings ignore
        them.
        """
        is_ignored = self.settings.in_front == "nothing"
        return None if is_ignored else self.scene.mask(self.active, self.view_index)

    @property
    def occluders(self) -> tuple[Mask, ...]:
        """Masks of what searches found in front of the object, unless settings ignore it."""
        is_ignored = self.settings.in_front != "find"
        return () if is_ignored else self.scene.earlier_occluders(self.active, self.view_index)

    @property
    def mask(self) -> Mask | None:
        """The pixels that count for the active object before a search: ``painted``, and without
        ``occluders``.
        """
        return Mask.product((*filter(None, (self.painted,)), *self.occluders))

    def mask_of(self, kind: MaskKind, all_frames: bool = False) -> Mask | None:
        """The mask of a kind in the large photo; of a sequence in this frame, or in all of them."""
        frame, name = self.scene.frame, self.object.id
        if frame is None or all_frames:
            own = {"photo": self.view.mask, "object": self.in_view.mask}
            return own.get(kind, self.in_view.occluders)
        own = {"photo": frame.mask, "object": frame.masks.get(name)}
        return own.get(kind, frame.occluders.get(name))

    def put_mask(
        self, mask: Mask | None, kind: MaskKind = "photo", all_frames: bool = False
    ) -> Document:
        """The document with another ``mask_of`` a kind; results stay."""
        frame, key = self.scene.frame, KEYS_OF_MASKS[kind]
        if frame is not None and not all_frames:
            if kind == "photo":
                return self.with_frame(replace(frame, mask=mask))
            others = {i: own for i, own in getattr(frame, key).items() if i != self.object.id}
            own = {} if mask is None else {self.object.id: mask}
            return self.with_frame(replace(frame, **{key: {**others, **own}}))
        if kind != "photo":
            return self.with_in_view(**{"occluders" if kind == "found" else "mask": mask})
        views = list(self.scene.views)
        views[self.view_index] = replace(self.view, mask=mask)
        return replace(self, scene=replace(self.scene, views=tuple(views)))

    def with_mask(
        self, mask: Mask | None, kind: MaskKind = "photo", all_frames: bool = False
    ) -> Document:
        """The document with another ``mask_of`` a kind; results of searches that read a changed
        pixel are dropped.
        """
        masks = self.mask_of(kind, all_frames), mask
        old, new = (1.0 if weights is None else weights.weights for weights in masks)
        changed = np.broadcast_to(np.not_equal(old, new), (self.photo.height, self.photo.width))
        document = self.put_mask(mask, kind, all_frames)
        for index in range(len(self.states)) if kind == "photo" else (self.active,):
            if self._compares(index, changed):
                document = document.with_result(None, index)
        return document

    def with_result(self, result: SearchResult | None, object_index: int | None = None) -> Document:
        """The document with another result for the pose of an object, by default the active one; of
        a sequence also in the shown frame.
        """
        document = self.with_object(object_index, result=result)
        frame = self.scene.frame
        name = self.object.id if object_index is None else self.scene.objects[object_index].id
        if frame is None or name not in frame.poses:
            return document
        pose = replace(frame.poses[name], result=result)
        return document.with_frame(replace(frame, poses={**frame.poses, name: pose}))

    def with_frame(self, frame: Frame) -> Document:
        """The document with another content of the shown frame."""
        frames = list(self.scene.frames)
        frames[self.scene.frame_index] = frame
        return replace(self, scene=replace(self.scene, frames=tuple(frames)))

    def _compares(self, object_index: int, pixels: NDArray[np.bool_]) -> bool:
        """Whether a search for an object reads any of ``pixels`` (height, width) of the view."""
        if self.scene.objects[object_index].settings.pixels == "whole":
            return bool(pixels.any())
        model = self.scene.model_at(object_index, self.view_index)
        return bool(np.any(box_near(model.mesh, model.pose).mask(*pixels.shape)[pixels]))

    def with_state(self, **changes: Any) -> Document:
        """The document with changed fields of the active object's state."""
        states = list(self.states)
        states[self.active] = replace(states[self.active], **changes)
        return replace(self, states=tuple(states))

    def with_marks(self, **changes: Any) -> Document:
        """The document with changed fields of the marks in the view."""
        marks = replace(self.marks, **changes)
        return self.with_state(marks={**self.state.marks, self.view_index: marks})

    def at_pose(self, pose: Pose, scale: float | None = None) -> Document:
        """The document with the active object at a pose in the large view, without a result; other
        objects stay where the photo shows them.
        """
        scene = self.scene.with_pose(self.active, pose, self.view_index, scale)
        return self.placed_as_in(scene, (self.active,), self.view_index)

    def at_params(self, problem: FitProblem, params: FloatArray) -> Document:
        """The document with the active object at parameters (d,) of a problem.

        Raises:
            OutsideChartError: no pose has these parameters.
        """
        scene = with_params(self.scene, self.active, problem, params)
        return self.placed_as_in(scene, (self.active,), problem.views[0].view_index)

    def placed_as_in(
        self, scene: Scene, object_indices: Collection[int], view_index: int
    ) -> Document:
        """The document with cameras, and poses and results of some objects, as in ``scene``; others
        stay as a view shows them.
        """
        cameras = [view.camera for view in scene.views]
        is_same = cameras == [view.camera for view in self.scene.views]
        pairs = zip(self.scene.views, cameras, strict=True)
        views = tuple(view if is_same else replace(view, camera=camera) for view, camera in pairs)
        placed = replace(self.scene, views=views)
        for index, item in enumerate(self.scene.objects):
            if index in object_indices:
                own = scene.objects[index]
                place = {"world_from_model": own.world_from_model, "result": own.result}
                placed = placed.with_object(index, is_placed=True, **place)
            elif not is_same:
                pose = self.scene.pose(index, view_index)
                moved = with_camera(pose, cameras[view_index], item.mesh.centre)
                placed = placed.with_pose(index, moved, view_index)
        return replace(self, scene=placed)

    def params_in(self, problem: FitProblem) -> FloatArray:
        """(d,): parameters of the active object's pose in the chart of a problem.

        Raises:
            OutsideChartError: the chart does not hold the pose.
        """
        pose = self.scene.pose(self.active, problem.views[0].view_index)
        return pose_to_params(problem.chart, pose, self.object.world_from_model.scale)

    @property
    def with_start_here(self) -> Document:
        """The document with the active object's pose as its start pose."""
        cameras = tuple(view.camera for view in self.scene.views)
        start = {"start": self.object.world_from_model, "start_cameras": cameras}
        return self.with_object(is_placed=True, **start)

    @property
    def at_start(self) -> Document:
        """The document with the active object at its start pose."""
        pairs = zip(self.scene.views, self.object.start_cameras, strict=True)
        views = tuple(replace(view, camera=camera) for view, camera in pairs)
        changes = {"world_from_model": self.object.start, "result": None}
        scene = replace(self.scene, views=views).with_object(self.active, **changes)
        return self.placed_as_in(scene, (self.active,), self.view_index)

    @property
    def chart(self) -> Chart:
        """The chart of the parameters that are shown: the vehicle's if possible, else the free-body
        chart about the start pose; for several views the view chart, with the scale if it is free.
        """
        is_perspective = isinstance(self.pose.camera, Perspective)
        free_focal = self.settings.free_focal and is_perspective
        free_principal = self.settings.free_principal_point and is_perspective
        keypoints, has_one_view = self.model.keypoints, len(self.scene.views) == 1
        if has_one_view and keypoints is not None and self.settings.chart != "free-body":
            with suppress(SingularChartError):
                chart = VehicleChart.near(keypoints, self.pose, free_focal, free_principal)
                camera = self._with_start_principal(chart.camera)
                return replace(chart, camera=camera) if free_principal else chart
        start = self._start_by_camera(free_focal, free_principal and not has_one_view)
        if has_one_view:
            return FreeBodyChart.near(self.mesh, start, free_focal)
        assert isinstance(start.camera, Perspective)  # cameras of several views are
        now = self.object.world_from_model
        placement = now if start is self.pose else self.object.start or now
        reference, rotation = FreeBodyChart.near(self.mesh, start), RigidTransform.identity()
        scale = self.scene.free_scale, 1.0 / placement.scale
        free = {"free_focals": int(free_focal), "free_principal_points": int(free_principal)}
        return ViewChart(reference, start.camera, rotation, *scale, **free)

    def _with_start_principal(self, camera: Camera) -> Camera:
        """Camera with the principal point that the large view had at the start pose."""
        at_start = self.object.start_cameras[self.view_index]
        return replace(camera, cx=at_start.cx, cy=at_start.cy)

    def _start_by_camera(self, free_focal: bool, free_principal: bool) -> Pose:
        """Start pose by the current intrinsics, which a chart about the start's own would reset; a
        focal length or principal point that is a parameter itself stays the start's.
        """
        start, centre = self.start, self.mesh.centre
        camera = self.pose.camera
        camera = self._with_start_principal(camera) if free_principal else camera
        is_behind = not start.camera_from_model.apply(centre)[2] > 0.0
        if is_behind and Perspective in (type(start.camera), type(camera)):
            return self.pose
        if free_focal and isinstance(camera, Perspective) and isinstance(start.camera, Perspective):
            fx = start.camera.fx
            camera = replace(camera, fx=fx, fy=camera.fy * fx / camera.fx)
        return start if camera == start.camera else with_camera(start, camera, centre)

    @property
    def parameters(self) -> FloatArray:
        """(d,): the active object's pose in ``chart``."""
        return pose_to_params(self.chart, self.pose, self.object.world_from_model.scale)

    def without(self, object_index: int) -> Document:
        """The document without one of several objects; the next one becomes active in its place."""
        objects, states = list(self.scene.objects), list(self.states)
        del objects[object_index], states[object_index]
        scene = replace(self.scene, objects=tuple(objects))
        active = min(self.active - (self.active > object_index), len(objects) - 1)
        document = replace(self, scene=scene, states=tuple(states), active=active)
        return document._with_object_in_front

    @property
    def _with_object_in_front(self) -> Document:
        """Document with another large view if the active object is behind this one's camera."""
        if self.pose.camera_from_model.apply(self.mesh.centre)[2] > 0.0:
            return self
        return self.with_view(reference_view(self.scene, self.active, self.view_index))

    @property
    def shown(self) -> tuple[object, ...]:
        """Values that are equal while view, object, model and photos stay the same."""
        return (
            self.view_index,
            self.object_id,
            self.mesh,
            *self._photos,
        )

    @property
    def _photos(self) -> Iterable[Photo | PhotoFile]:
        """The views' photos; of many their files, beside the photo that is shown."""
        views = self.scene.views
        if self.scene.has_many_views:
            return self.photo, *(view.file for view in views)
        return (view.photo for view in views)

    @property
    def placement(self) -> tuple[object, ...]:
        """Values that are equal while nothing that files keep has changed."""
        views, objects = self.scene.views, self.scene.objects
        photos = self.scene.frames or (view.file for view in views)
        poses = () if self.scene.frames else (o.world_from_model for o in objects)
        models = ((o.mesh, o.model.keypoints, o.in_views, o.texts) for o in objects)
        return *photos, *((view.camera, view.mask) for view in views), *models, *poses


def with_files(scene: Scene, files: Sequence[PhotoFile]) -> Scene:
    """The scene with other handles of its views' photos."""
    pairs = zip(scene.views, files, strict=True)
    views = tuple(v if v.file is file else replace(v, file=file) for v, file in pairs)
    return replace(scene, views=views)


def in_view_alone(scene: Scene, object_index: int, view_index: int) -> Scene:
    """The scene of many views in which one of them alone is compared with an object, as it is shown
    alone; a scene of few as it is.
    """
    if not scene.has_many_views:
        return scene
    return _comparing(replace(scene, free_scale=False), object_index, [view_index])


def in_few_views(scene: Scene, object_index: int) -> Scene:
    """The scene of many views in which as many as a strip shows, spread over those that show an
    object, are compared with it, and read for this alone; a scene of few as it is.
    """
    if not scene.has_many_views:
        return scene
    seen = [
        view
        for view in range(len(scene.views))
        if scene.in_view(object_index, view).is_compared
        and scene.model_at(object_index, view).is_seen
    ]
    few = {seen[i] for i in np.linspace(0, len(seen) - 1, MANY_VIEWS).astype(int)} if seen else {0}
    scene = with_files(scene, [replace(view.file) for view in scene.views])
    return _comparing(scene, object_index, few)


def _comparing(scene: Scene, object_index: int, view_indices: Collection[int]) -> Scene:
    own = scene.objects[object_index].in_views or [InView()] * len(scene.views)
    in_views = tuple(replace(v, is_compared=i in view_indices) for i, v in enumerate(own))
    return scene.with_object(object_index, in_views=in_views)


def is_alone(document: Document) -> bool:
    """Whether a pose file holds the whole document: one object in one view, and no frames."""
    scene = document.scene
    return len(scene.views) == len(scene.objects) == 1 and not scene.frames


def label_of(item: SceneObject) -> str:
    """Name of an object: the user's, or its file's."""
    return item.name.strip() or item.model.name


def is_shown(item: SceneObject) -> bool:
    """Whether an object appears in the photos: it is placed, and not hidden."""
    return item.is_placed and not item.hidden


def _renamed(frame: Frame, new_ids: Mapping[str, str]) -> Frame:
    """A frame of objects that have new ids."""
    of_objects = {"poses": frame.poses, "masks": frame.masks, "occluders": frame.occluders}
    renamed: dict[str, Any] = {
        field: {new_ids[name]: own for name, own in known.items() if name in new_ids}
        for field, known in of_objects.items()
    }
    return replace(frame, **renamed)


def verdict_of(item: SceneObject) -> str:
    """State of the search for an object: its verdict's label, or why there is none."""
    if item.result is None:
        return "not searched" if item.is_placed else "not placed"
    return "searched" if item.result.verdict is None else item.result.verdict.label


def with_camera(pose: Pose, camera: Camera, centre: FloatArray) -> Pose:
    """The pose by another camera; ``centre`` (3,) of the model keeps its pixel and px per unit."""
    old, in_camera = pose.camera, pose.camera_from_model.apply(centre)
    depth = in_camera[2]
    px_per_unit = old.scale if isinstance(old, Parallel) else old.fx / depth
    if isinstance(camera, Parallel):
        camera = replace(camera, scale=px_per_unit)
    else:
        depth = camera.fx / px_per_unit
    return with_point_at(replace(pose, camera=camera), centre, old.project(in_camera), depth)


def scale_at(chart: Chart, params: FloatArray) -> float | None:
    """World units per model unit at parameters (d,); None: the chart does not hold the scale."""
    return 1.0 / chart.scale_at(params) if isinstance(chart, ViewChart) else None


def reference_view(scene: Scene, object_index: int, view_index: int) -> int:
    """Index of the view whose chart a search uses: the given one, or else the first compared."""
    for index in (view_index, *range(len(scene.views))):
        is_compared = scene.in_view(object_index, index).is_compared
        if is_compared and scene.model_at(object_index, index).is_seen:
            return index
    return view_index


def loss_inputs(scene: Scene, object_index: int) -> tuple[object, ...]:
    """Values that are equal if an object has the same loss about its pose in both scenes."""
    item, objects = scene.objects[object_index], enumerate(scene.objects)
    occluders = (
        (o.mesh, o.world_from_model) for i, o in objects if i != object_index and o.is_occluder
    )
    # Masks of a frame: those of the views and objects are in these.
    frame = scene.frame
    masks = () if frame is None else (frame.mask, frame.masks.get(item.id))
    found = None if frame is None else frame.occluders.get(item.id)
    own = scene.views, item.compared_mesh, item.world_from_model, item.in_views, item.settings
    return *own, *masks, found, *occluders
