"""A scene: views times objects.

A view is a photo with its camera and where that stands in the world; an object is a model with its
pose in the world. The world is the first view's camera frame where nothing else is given.

    camera_from_model(view, object) = view.camera_from_world @ object.world_from_model

A field stands in files (``files.scene_json``) under its own name, or the ``key`` of its metadata.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import SettingsError
from poseviewer.geometry.camera import Camera, Parallel, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh, hull_in_photo
from poseviewer.geometry.painted_model import Painting
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.symmetry_group import NO_SYMMETRY, Symmetry
from poseviewer.geometry.transform import RigidTransform, Similarity
from poseviewer.geometry.world_pose import WORLD, pose_in_view, world_from_pose
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.settings import FitSettings

DEFAULTS = FitSettings()
"""Settings of an object of which nobody has said any; files leave them out."""
NOT_IN_FILES = {"key": None}
MANY_VIEWS = 12
"""Views, above which the photos of a scene are read one at a time: no page has room for more side
by side, and hundreds fill the memory."""
OF_USER = {"is_of_user": True}
"""Metadata of an object's texts that the user writes, and that pose files have, too."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A photo of a scene."""

    file: PhotoFile
    camera: Camera
    camera_from_world: RigidTransform = WORLD
    """Pose of the world, in its unit; by default the world is the camera's frame."""
    mask: Mask | None = None
    """Weight of each pixel for all objects; None: all count."""

    @property
    def photo(self) -> Photo:
        """The photo, undistorted where a lens is known; read when first asked for."""
        return self.file.photo

    @property
    def name(self) -> str:
        """Name of the photo's file, with its folder where two views would else share a name."""
        return self.file.name

    @property
    def path(self) -> Path | None:
        """The photo's file; None: there is none."""
        return self.file.path

    def pose(self, world_from_model: Similarity) -> Pose:
        """Return the pose by which this view shows a model, as ``pose_in_view``."""
        return pose_in_view(self.camera, self.camera_from_world, world_from_model)

    def world_from_model(self, pose: Pose, scale: float = 1.0) -> Similarity:
        """Return the inverse of ``pose``, as ``world_from_pose``."""
        return world_from_pose(self.camera, self.camera_from_world, pose, scale)

    def resize_photo(self, width: int, height: int) -> View:
        """Give the photo another size, px; focal lengths and principal point stay."""
        size, undone = {"width": width, "height": height}, self.file.undistortion
        if undone is not None:
            taken, camera = (replace(one, **size) for one in (undone.taken, undone.camera))
            undone = replace(undone, taken=taken, camera=camera)
        file = replace(self.file, undistortion=undone, **size)
        return replace(self, file=file, camera=replace(self.camera, **size))


@dataclass(frozen=True, slots=True, eq=False)
class PlacedModel:
    """A mesh at a pose."""

    mesh: Mesh
    pose: Pose

    @property
    def depth(self) -> float:
        """Depth of its centre, in its unit; behind the camera below 0."""
        return float(self.pose.camera_from_model.apply(self.mesh.centre)[2])

    @property
    def is_seen(self) -> bool:
        """True if the centre is in front of the camera, and some of the model in the picture."""
        points, camera = hull_in_photo(self.mesh, self.pose), self.pose.camera
        inside = np.all((points >= 0.0) & (points < [camera.width, camera.height]), axis=1)
        return bool(self.depth > 0.0 and inside.any())


@dataclass(frozen=True, slots=True, kw_only=True)
class InView:
    """The settings of one object in one view."""

    mask: Mask | None = None
    """Weight of each pixel for this object, besides the view's mask."""
    occluders: Mask | None = None
    """0 where an earlier search found something in front; only masks are the user's."""
    region: Rectangle | None = None
    """Pixels that count lie in it, px."""
    is_compared: bool = True
    """Whether a search reads this view, where it shows the object."""


@dataclass(frozen=True, slots=True)
class ChartParameters:
    """A pose as the parameters of a chart."""

    name: str
    names: tuple[str, ...]
    parameters: tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SearchResult:
    """The result of the last search for an object, valid as long as the object stays there."""

    loss: float | None = None
    unexplained: float | None = None
    seen: tuple[float | None, ...] = ()
    """For each view, the share of the model's pixels that count, in [0, 1]; None: not compared."""
    residuals_px: tuple[float | None, ...] = ()
    """For each view of a large set, how far in its photo the view's own best pose is off, px."""
    verdict: Verdict | None = None
    view: Annotated[int, Meta(ge=0)] = 0
    """Index of the view that chart and covariance are of."""
    covariance: PoseCovariance | None = field(default=None, metadata={"key": "uncertainty"})
    """Covariance of the pose, if it is right; None for a lost one, and where it is not known."""
    chart: ChartParameters | None = None
    settings: Mapping[str, Any] | None = None
    """Settings as JSON holds them, and the photo's channels."""
    notes: tuple[str, ...] = ()
    hidden: tuple[NDArray[np.bool_] | None, ...] = field(default=(), metadata=NOT_IN_FILES)
    """For each view, (height, width): pixels taken for occluders; in files, in ``occluders``."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SceneObject:
    """A model in a scene."""

    id: Annotated[str, Meta(min_length=1)]
    """Unique in the scene."""
    name: str = ""
    """Name given by the user; "": its id is shown."""
    model: ModelFile
    world_from_model: Similarity
    """Its scale is 1 but in a world of another unit, and under parallel projection."""
    start: Similarity | None = None
    """World from model where the last search began, for a reset; None: where the object is."""
    doubt: str = field(default="", metadata=NOT_IN_FILES)
    """Sentence why the object's pose may be far off, so that no verdict is ``found``."""
    start_cameras: tuple[Camera, ...] = ()
    """The views' cameras at the start; empty: those of the views."""
    settings: FitSettings = DEFAULTS
    in_views: tuple[InView, ...] = ()
    """For each view of the scene; empty: nothing is the object's own."""
    locked: bool = False
    """Placed by the user: searches leave the object, and it hides what is behind it."""
    hidden: bool = False
    """Not drawn, and in front of nothing."""
    is_placed: bool = field(default=True, metadata={"key": "placed"})
    """Whether anybody has said yet where the object is."""
    without: tuple[str, ...] = ()
    said_symmetry: Symmetry = field(default=NO_SYMMETRY, metadata={"key": "symmetry"})
    """Symmetry of the mesh as a scene file says it, without its model."""
    result: SearchResult | None = None
    notes: tuple[str, ...] = ()
    note: Annotated[str, Meta(description="The user's.")] = field(default="", metadata=OF_USER)
    painting: Painting | None = field(default=None, metadata=NOT_IN_FILES)
    """The model painted from photos of it; None: it is compared as its file has it."""

    @property
    def texts(self) -> dict[str, Any]:
        """Texts that the user has written of the object, by the fields of ``OBJECT_TEXTS``."""
        return {name: getattr(self, name) for name in OBJECT_TEXTS}

    @property
    def mesh(self) -> Mesh:
        """The surface: the model's without the parts left out."""
        return self.model.content.mesh_without(self.without)

    @property
    def drawn_mesh(self) -> Mesh:
        """The surface that is drawn: ``mesh``, painted if it is."""
        return self.mesh if self._own_painting is None else self._own_painting.mesh

    @property
    def compared_mesh(self) -> Mesh:
        """The surface that is compared: ``mesh``, or the print of the painted one."""
        return self.mesh if self._own_painting is None else self._own_painting.contrast

    @property
    def _own_painting(self) -> Painting | None:
        """The painting, unless the model is another now, or lacks other parts."""
        is_own = self.painting is not None and self.painting.bare is self.mesh
        return self.painting if is_own else None

    @property
    def symmetry(self) -> Symmetry:
        """Symmetry of ``mesh``: poses that differ by it are one."""
        return self.model.symmetry_of(self.mesh) if self.without else self.model.symmetry

    @property
    def label(self) -> str:
        """Name to show."""
        return self.name.strip() or self.id

    @property
    def is_occluder(self) -> bool:
        """True if a search has not lost the object, so that it hides pixels of others."""
        if self.hidden or not self.is_placed:
            return False
        verdict = None if self.result is None else self.result.verdict
        return self.locked or (verdict is not None and verdict.label != "lost")


OBJECT_TEXTS = tuple(one.name for one in fields(SceneObject) if one.metadata == OF_USER)
"""Fields of an object with metadata ``OF_USER``."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FramePose:
    """The pose of an object in a frame of a sequence."""

    world_from_model: Similarity
    source: Literal["key", "propagated"] = "key"
    """Placed by the user, or found from the poses in neighbouring frames."""
    result: SearchResult | None = None
    """None for a key that no search has found."""
    is_stale: bool = field(default=False, metadata={"key": "stale"})
    """Whether a pose beside it has changed since, or a key that led to it is gone."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Frame:
    """A photo of a sequence, with the poses of the scene's objects."""

    file: PhotoFile = field(metadata={"key": "photo"})
    time_s: float | None = None
    """Time stamp from the first frame, s; None: not known."""
    poses: Mapping[str, FramePose] = field(default_factory=dict)
    """Poses by the objects' ids; an object without a pose is left out."""
    mask: Mask | None = None
    """Weight of each pixel for all objects in this frame, besides masks that hold for all frames:
    those of the view and the objects.
    """
    masks: Mapping[str, Mask] = field(default_factory=dict)
    """Weight of each pixel in this frame for single objects, by their ids."""
    occluders: Mapping[str, Mask] = field(default_factory=dict)
    """0 where a search found something in front of an object in this frame, by the ids."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """Views times objects; with ``frames``, those of the frame that the one view shows."""

    unit: str | None = None
    """Unit of the world; None: not said."""
    free_scale: bool = False
    """Whether nothing tells the world's unit in the model's: then it is searched for."""
    views: Annotated[tuple[View, ...], Meta(min_length=1)]
    objects: tuple[SceneObject, ...] = ()
    software: dict[str, Any] | None = None
    frames: tuple[Frame, ...] = ()
    """Photos of the one view's camera in order; empty: the scene is no sequence."""
    frame_index: Annotated[int, Meta(ge=0)] = 0
    """Index of the frame that the view shows."""
    name: str = field(default="", metadata=NOT_IN_FILES)
    """Name of the file or folder that the scene was read from."""
    notes: tuple[str, ...] = field(default=(), metadata=NOT_IN_FILES)

    def __post_init__(self) -> None:
        """Check views and objects.

        Raises:
            SettingsError: ids repeat, sizes differ, or the scale is free of several.
        """
        ids = [one.id for one in self.objects]
        if twice := [one for one in ids if ids.count(one) > 1]:
            raise SettingsError(f"two objects have the id {twice[0]!r}; give each its own.")
        if self.free_scale and len(ids) > 1:
            found = f"its scale is not known, and it has {len(ids)} objects"
            wanted = (
                "search for the first alone, which tells it once it is found, or give the scale"
            )
            raise SettingsError(f"{self.name or 'the scene'}: {found}; {wanted}.")
        for index, view in enumerate(self.views):
            file, camera = view.file, view.camera
            size = f"{file.width}x{file.height} px"
            if (camera.width, camera.height) != (file.width, file.height):
                found = f"is for {camera.width}x{camera.height} px, and the photo has {size}"
                wanted = "use the photo that the camera is of"
                raise SettingsError(f"the camera of {view.name} {found}; {wanted}.")
            own = [one.in_views[index] for one in self.objects if one.in_views]
            for mask in (view.mask, *(masks for one in own for masks in (one.mask, one.occluders))):
                require_size(mask, file)

    @property
    def has_many_views(self) -> bool:
        """Whether photos are read when they are shown, as there are more than ``MANY_VIEWS``."""
        return len(self.views) > MANY_VIEWS

    def index(self, object_id: str) -> int:
        """Return the index of the object that has an id.

        Raises:
            SettingsError: none has it.
        """
        ids = [one.id for one in self.objects]
        if object_id not in ids:
            found = f"There is no object {object_id!r} in the scene"
            raise SettingsError(f"{found}; there are {', '.join(ids)}.")
        return ids.index(object_id)

    def pose(self, object_index: int, view_index: int = 0) -> Pose:
        """Return the pose of an object in a view, in the model's unit."""
        return self.views[view_index].pose(self.objects[object_index].world_from_model)

    def model_at(self, object_index: int, view_index: int = 0) -> PlacedModel:
        """Return an object's mesh at its pose in a view."""
        return PlacedModel(self.objects[object_index].mesh, self.pose(object_index, view_index))

    def covariance(self, object_index: int, view_index: int = 0) -> PoseCovariance | None:
        """The covariance of an object's pose in a view; None where no search has said it."""
        item, result = self.objects[object_index], self.objects[object_index].result
        if result is None or result.covariance is None or result.view == view_index:
            return None if result is None else result.covariance
        world_from_view = self.views[result.view].camera_from_world.inverse()
        motion = self.views[view_index].camera_from_world @ world_from_view
        motion = replace(motion, translation=motion.translation / item.world_from_model.scale)
        return result.covariance.in_view_of(motion, self.pose(object_index, view_index), item.mesh)

    def compared_mesh(self, object_index: int) -> Mesh:
        """Return the surface of an object that a search compares: painted, but in the only photo of
        a scene that it was painted from, where any pose would be confirmed.
        """
        item, names = self.objects[object_index], [view.name for view in self.views]
        is_own = item.painting is not None and names[0] in item.painting.photos
        return item.mesh if is_own and len(names) == 1 else item.compared_mesh

    def relative_pose(self, object_index: int, other_index: int) -> Similarity:
        """The pose of an object in another's frame, in the other model's unit.

        Raises:
            SettingsError: the projection is parallel.
        """
        if isinstance(self.views[0].camera, Parallel):
            raise SettingsError(
                "the projection is parallel: it does not tell how far one object is behind "
                "another; choose a perspective camera."
            )
        own, frame = (self.objects[i].world_from_model for i in (object_index, other_index))
        rigid = frame.rigid.inverse() @ own.rigid
        rigid = replace(rigid, translation=rigid.translation / frame.scale)
        return Similarity(rigid, own.scale / frame.scale)

    def in_view(self, object_index: int, view_index: int = 0) -> InView:
        """Return the settings of an object in a view alone."""
        own = self.objects[object_index].in_views
        return own[view_index] if own else InView()

    def masks(self, object_index: int, view_index: int = 0) -> tuple[Mask, ...]:
        """Return the user's masks of an object in a view: the view's, and its own; of a sequence,
        also those of the shown frame.
        """
        of_all = self.views[view_index].mask, self.in_view(object_index, view_index).mask
        frame, name = self.frame, self.objects[object_index].id
        of_frame = () if frame is None else (frame.mask, frame.masks.get(name))
        return tuple(filter(None, (*of_all, *of_frame)))

    def mask(self, object_index: int, view_index: int = 0) -> Mask | None:
        """Return the user's masks of an object in a view as one; None: all pixels count."""
        return Mask.product(self.masks(object_index, view_index))

    def earlier_occluders(self, object_index: int, view_index: int = 0) -> tuple[Mask, ...]:
        """Return what searches before the object's result found in front of it in a view."""
        frame, name = self.frame, self.objects[object_index].id
        of_frame = None if frame is None else frame.occluders.get(name)
        of_view = self.in_view(object_index, view_index).occluders
        return tuple(filter(None, (of_view, of_frame)))

    def occluders(self, object_index: int, view_index: int = 0) -> Mask | None:
        """Return what all searches found in front of an object in a view as one mask."""
        result = self.objects[object_index].result
        hidden = result.hidden[view_index] if result and result.hidden else None
        found = () if hidden is None else (Mask.of(~hidden),)
        return Mask.product((*self.earlier_occluders(object_index, view_index), *found))

    @property
    def frame(self) -> Frame | None:
        """The frame of a sequence that is shown."""
        return self.frames[self.frame_index] if self.frames else None

    def with_object(self, object_index: int, **changes: Any) -> Scene:
        """Change fields of one object."""
        objects = list(self.objects)
        objects[object_index] = replace(objects[object_index], **changes)
        return replace(self, objects=tuple(objects))

    def with_pose(
        self, object_index: int, pose: Pose, view_index: int = 0, scale: float | None = None
    ) -> Scene:
        """Put an object where a view shows it at a pose, without a result.

        Args:
            object_index: of the object.
            pose: in the view; its focal length becomes that of all views of this camera.
            view_index: of the view.
            scale: lengths of the world's unit to one of the model's; None: as it is.
        """
        views, own = self.views, self.views[view_index]
        if pose.camera != own.camera and not _is_own_scale(pose, own, len(self.objects)):
            moved = (v if v.camera != own.camera else replace(v, camera=pose.camera) for v in views)
            views = tuple(moved)
        scale = self.objects[object_index].world_from_model.scale if scale is None else scale
        place = views[view_index].world_from_model(pose, scale)
        return replace(self, views=views).with_object(
            object_index, world_from_model=place, result=None
        )


def require_size(mask: Mask | None, file: PhotoFile) -> None:
    """Require that a mask has the size of its photo.

    Raises:
        SettingsError: it has another.
    """
    if mask is not None and (mask.width, mask.height) != (file.width, file.height):
        size = f"{file.width}x{file.height} px"
        found = f"has {mask.width}x{mask.height} px, the photo {file.name} has {size}"
        raise SettingsError(f"the mask {found}; make the mask in the photo's size.")


def _is_own_scale(pose: Pose, view: View, objects: int) -> bool:
    camera = view.camera
    if objects == 1 or not (isinstance(pose.camera, Parallel) and isinstance(camera, Parallel)):
        return False
    return replace(pose.camera, scale=camera.scale) == camera


def scene_at(view: View, model: ModelFile, pose: Pose, **more: Any) -> Scene:
    """Make the scene of one object, with ``more`` fields, in one view, by the pose's camera."""
    view = replace(view, camera=pose.camera)
    more["settings"] = more.get("settings") or FitSettings()
    item = SceneObject(id="1", model=model, world_from_model=view.world_from_model(pose), **more)
    return Scene(views=(view,), objects=(item,))
