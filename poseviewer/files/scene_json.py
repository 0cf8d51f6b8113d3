"""Scene files: JSON that says which models are where in which photos (``scene.schema.json``).

The structs are what a file of version 2 holds, and what the program hands about: there, files are
absolute paths.
"""

from __future__ import annotations

import os
from base64 import b64decode
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct, structs

from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import PoseFileError, printable
from poseviewer.files import structs as s
from poseviewer.files.checks import Reading, is_there, kind_of
from poseviewer.files.masks import INLINE, load_mask, mask_text
from poseviewer.files.mesh.named import bare_name
from poseviewer.files.photo import load_photo, undistorted
from poseviewer.files.pose import PoseRecord, check_against
from poseviewer.files.symmetry import SymmetryTurns
from poseviewer.files.writing import json_bytes, write_whole
from poseviewer.geometry.camera import Camera, Perspective, Pose
from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.transform import RigidTransform, Similarity
from poseviewer.geometry.world_pose import View, pose_in_view, world_from_pose

KIND = "scene file"
AS_IN_POSE = ("loss", "unexplained", "verdict", "uncertainty", "chart", "settings", "notes")
"""Fields that results share with pose files."""


class PhotoFile(Struct, frozen=True, omit_defaults=True):
    """The photo's file, seen from the scene's folder, its size in px, and its fingerprint."""

    file: str
    width: s.Pixels
    height: s.Pixels
    sha256: s.Sha256 | None = None


class ModelFile(Struct, frozen=True, omit_defaults=True):
    """The model's file, seen from the scene's folder, its fingerprint and length unit."""

    file: str
    sha256: s.Sha256 | None = None
    unit: str | None = None


class Place(s.Transform, frozen=True, omit_defaults=True):
    """x_in_world = scale * rotation @ x_in_model + translation, in the world's unit."""

    scale: s.Positive = 1.0

    @property
    def similarity(self) -> Similarity:
        """The place as the program has it."""
        return Similarity(self.rigid, self.scale)


def place_of(place: Similarity) -> Place:
    """The place as files say it."""
    return Place.of(place.rigid, scale=float(place.scale))


class ViewRecord(s.CameraRecord, frozen=True, kw_only=True, omit_defaults=True):
    """A photo, its camera (of the undistorted photo where there is a distortion) and where that
    stands: x_in_camera = rotation @ x_in_world + translation; left out for a camera in which the
    world's frame is. mask: a picture of the photo's size, black where something stands in front.
    """

    photo: PhotoFile
    place: s.Transform = msgspec.field(
        name="camera_from_world", default=s.Transform.of(RigidTransform.identity())
    )

    @classmethod
    def of(
        cls,
        photo: Path,
        camera: Camera,
        sha256: str | None = None,
        lens: Lens | Undistortion | None = None,
        place: RigidTransform | None = None,
        mask: Mask | Path | None = None,
    ) -> ViewRecord:
        """The view of a camera (pixel centres at i + 0.5) that stands in the world at a ``place``,
        ``camera_from_world``; a ``lens`` is one of the photo as taken by that camera.
        """
        if isinstance(lens, Lens) and isinstance(camera, Perspective):
            lens = Undistortion.of(lens, camera)
        return cls(
            photo=PhotoFile(str(photo), camera.width, camera.height, sha256),
            projection=s.projection_of(camera),
            numbers=s.CameraNumbers.of(camera),
            distortion=s.Distortion.of(lens) if isinstance(lens, Undistortion) else None,
            place=s.Transform.of(place or RigidTransform.identity()),
            mask=mask_text(mask),
        )

    @property
    def path(self) -> Path:
        """The photo's file."""
        return Path(self.photo.file)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the photo in px; 0 where a tool's file does not say it."""
        return self.photo.width, self.photo.height

    def resized(self, width: int, height: int) -> ViewRecord:
        """The view of a photo of another size, in px."""
        photo = structs.replace(self.photo, width=width, height=height)
        return structs.replace(self, photo=photo)

    @property
    def reference(self) -> s.PhotoReference:
        """The photo as pose files name it."""
        name, photo = printable(self.path.name) or None, self.photo
        return s.PhotoReference(name, photo.width, photo.height, photo.sha256)


def view_record(view: View) -> ViewRecord:
    """The record of a view."""
    photo, path = view.photo, view.path or Path(view.photo.name)
    more = photo.undistortion, view.camera_from_world, view.mask
    return ViewRecord.of(path, view.camera, photo.sha256, *more)


def open_view(record: ViewRecord) -> tuple[View, tuple[str, ...]]:
    """The view with its photo, undistorted; and what the user should know. The photo may be of any
    size where the record's is 0x0 px.
    """
    photo, size = load_photo(record.path), record.size
    if size not in ((0, 0), (photo.width, photo.height)):
        found = f"{photo.width}x{photo.height} px, and its camera is for {size[0]}x{size[1]} px"
        wanted = "name the photo that the camera was found with"
        raise PoseFileError(f"{photo.name}: {found}; {wanted}.")
    record = record.resized(photo.width, photo.height)
    notes = check_against(record.reference, photo.sha256)
    if record.undistortion is not None:
        photo = undistorted(photo, record.undistortion)
    mask = None if record.mask is None else load_mask(record.mask, photo.width, photo.height)
    view = View(photo.name, photo, record.camera, record.place.rigid, mask, record.path)
    return view, notes


class InViewRecord(Struct, frozen=True, omit_defaults=True):
    """An object's own part in a view: a mask besides the view's, a region (left, top,
    width, height, px) in which pixels count, and whether a search reads the view.
    """

    mask: str | None = None
    region: Annotated[tuple[s.Number, ...], Meta(min_length=4, max_length=4)] | None = None
    is_compared: bool = True


class Result(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Result of the last search for an object. view: index of the view that chart and uncertainty
    are of; seen: for each view, the share of the model's pixels that count, null where it was not
    compared; settings: those of the search. The rest is as in pose files.
    """

    loss: s.Number | None = None
    unexplained: s.Number | None = None
    seen: tuple[s.Number | None, ...] = ()
    verdict: Verdict | None = None
    view: Annotated[int, Meta(ge=0)] = 0
    uncertainty: s.Uncertainty | None = None
    chart: s.ChartParameters | None = None
    settings: dict[str, Any] | None = None
    notes: tuple[str, ...] = ()


class ObjectRecord(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A model in the scene. id: of this object alone, the same model may be there several times;
    name: for people; start: where the last search began; in_views: one for each view, or none;
    start_cameras: the views' then, where a focal length was another; locked: placed by the user,
    searches leave it; placed: whether anybody has said where it is;
    without: names of the model's parts that are left out; symmetry: as in pose files.
    """

    id: Annotated[str, Meta(min_length=1)]
    name: str = ""
    model: ModelFile
    place: Place = msgspec.field(name="world_from_model")
    start: Place | None = None
    start_cameras: tuple[s.CameraNumbers, ...] = ()
    settings: dict[str, Any] | None = None
    in_views: tuple[InViewRecord, ...] = ()
    locked: bool = False
    hidden: bool = False
    is_placed: bool = msgspec.field(name="placed", default=True)
    without: tuple[str, ...] = ()
    turns: SymmetryTurns | None = msgspec.field(name="symmetry", default=None)
    result: Result | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, object_id: str, model: Path, record: PoseRecord, view: ViewRecord, name: str = ""
    ) -> ObjectRecord:
        """The object of a scene of one view that a pose file says."""
        known, camera = record.model or s.ModelReference(), view.camera
        result = Result(
            seen=() if record.seen is None else (record.seen,),
            **{name: getattr(record, name) for name in AS_IN_POSE},
        )
        return cls(
            id=object_id,
            name=name,
            model=ModelFile(str(model), known.sha256, known.unit),
            place=place_of(world_from_pose(camera, view.place.rigid, record.pose)),
            without=record.without,
            turns=record.turns,
            result=None if result == Result() else result,
        )

    @property
    def path(self) -> Path:
        """The model's file."""
        return Path(self.model.file)

    @property
    def label(self) -> str:
        """The object's name, or else its id."""
        return self.name or self.id


class SceneRecord(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Views times objects; without objects, a set of photos. Camera axes are OpenCV's (x right, y
    down, z forward); pixel centres are at integers; paths start from the scene's folder. unit: of
    the world; free_scale: nothing tells the world's unit in the model's, it is to be searched for.
    """

    format: Literal["poseviewer-scene"] = s.SCENE
    version: Literal[2] = 2
    unit: str | None = None
    free_scale: bool = False
    views: Annotated[
        tuple[Annotated[ViewRecord, Meta(extra_json_schema=s.PROJECTIONS)], ...], Meta(min_length=1)
    ]
    objects: tuple[ObjectRecord, ...] = ()
    software: dict[str, Any] | None = None
    warnings: tuple[str, ...] = ()

    def index(self, object_id: str) -> int:
        """Number of the object that has an id."""
        ids = [item.id for item in self.objects]
        if object_id not in ids:
            found = f"There is no object {object_id!r} in the scene"
            raise PoseFileError(f"{found}; there are {', '.join(ids)}.")
        return ids.index(object_id)

    def pose(self, index: int, view: int = 0) -> Pose:
        """The pose of an object in a view, in the model's unit."""
        own, item = self.views[view], self.objects[index]
        return pose_in_view(own.camera, own.place.rigid, item.place.similarity)

    def pose_record(self, index: int, view: int = 0) -> PoseRecord:
        """All that a pose file says of an object in a view."""
        item, own = self.objects[index], self.views[view]
        result = item.result or Result(settings=item.settings)
        said = {name: getattr(result, name) for name in AS_IN_POSE}
        if result.view != view:
            said |= {"chart": None, "uncertainty": None}
        file = printable(item.path.name) or None
        model = s.ModelReference(file, item.model.sha256, item.model.unit)
        return PoseRecord.of(
            self.pose(index, view),
            own.reference,
            model=None if model == s.ModelReference() else model,
            **said,
            software=self.software,
            distortion=own.distortion,
            without=item.without,
            seen=result.seen[view] if view < len(result.seen) else None,
            turns=item.turns,
            warnings=self.warnings,
        )


Named = Callable[[str, str], str]
"""A file's name in another place; the second argument says where in the scene it stands."""


def load_scene(path: str | Path, inside: Path | None = None) -> SceneRecord:
    """The scene in a file; its photos, models and masks are there, but not yet read.

    ``inside``: a folder in which all of them have to lie.

    Raises:
        PoseFileError: there is no such file, it does not hold a scene, or names a file that is not
            there or not ``inside``; two objects have one id; the scale is not known, and there are
            several objects; a pose file is by another camera.
    """
    reading = Reading(Path(path).absolute(), kind=KIND)

    def find(name: str, what: str) -> str:
        file, wanted = reading.path.parent / name, "drop one folder of the scene with all its files"
        if not name or not is_there(file):
            found = f"{what} is {name or 'empty'}, and there is no such file"
            raise reading.error(found, f"put it there, seen from the scene; on a page, {wanted}")
        if inside is not None and inside.resolve() not in file.resolve().parents:
            raise reading.error(f"{what} is {name}, outside of the folder that was dropped", wanted)
        return str(file)

    with reading.naming_errors():
        data = reading.load_object()
        if data.get("format") != s.SCENE:
            raise reading.error(f"format is {kind_of(data.get('format'))}", f"wanted {s.SCENE!r}")
        reading.require_format(data, s.SCENE, wanted=2)
        scene = reading.decoded(data, SceneRecord, raw=("file", "mask"))
        require_whole(reading, scene)
        warnings = tuple(dict.fromkeys(reading.warnings))
        return structs.replace(with_files(scene, find), warnings=warnings)


def scene_of_pose(path: Path, record: PoseRecord) -> SceneRecord:
    """The scene of a pose file, whose photo, model and mask lie beside it, or not."""
    model, view = record.model or s.ModelReference(), _view_of_pose(path, record)
    item = ObjectRecord.of("1", _beside(path, model.file), record, view, model.file or "")
    more: dict[str, Any] = {"software": record.software, "warnings": record.warnings}
    return SceneRecord(views=(view,), objects=(item,), **more)


def _view_of_pose(path: Path, record: PoseRecord) -> ViewRecord:
    known = record.photo or s.PhotoReference()
    size = known.width or 0, known.height or 0
    photo = PhotoFile(str(_beside(path, known.file)), *size, known.sha256)
    mask = record.mask and str(_beside(path, record.mask))
    camera = {name: getattr(record, name) for name in ("projection", "numbers", "distortion")}
    return ViewRecord(photo=photo, mask=mask, **camera)


def _beside(path: Path, name: str | None) -> Path:
    """The file of a name in the folder of a pose; a name is no path."""
    folder = path if path.is_dir() else path.parent
    return folder / bare_name(name) if name else Path()


def with_files(scene: SceneRecord, name: Named, name_inline: Named | None = None) -> SceneRecord:
    """The scene with its files under other names; masks that stand in it stay, or become files by
    ``name_inline``.
    """

    def named(mask: str | None, where: str) -> str | None:
        change = name_inline if mask and mask.startswith(INLINE) else name
        return change(mask, f"{where}.mask") if mask and change else mask

    views, objects = [], []
    for number, view in enumerate(scene.views):
        where = f"views[{number}]"
        photo = structs.replace(view.photo, file=name(view.photo.file, f"{where}.photo.file"))
        views.append(structs.replace(view, photo=photo, mask=named(view.mask, where)))
    for number, item in enumerate(scene.objects):
        where = f"objects[{number}]"
        model = structs.replace(item.model, file=name(item.model.file, f"{where}.model.file"))
        in_views = tuple(
            structs.replace(own, mask=named(own.mask, f"{where}.in_views[{index}]"))
            for index, own in enumerate(item.in_views)
        )
        objects.append(structs.replace(item, model=model, in_views=in_views))
    return structs.replace(scene, views=tuple(views), objects=tuple(objects))


def save_scene(path: str | Path, scene: SceneRecord) -> None:
    """Write a scene file and, beside it, the masks that the scene has itself; each whole or not.

    Raises:
        PoseFileError: as of ``load_scene``; a photo or a model is no file; a number is not finite;
            a file cannot be written.
    """
    for file, content in scene_contents(Path(path), scene).items():
        write_whole(file, content, PoseFileError)


def scene_contents(path: Path, scene: SceneRecord) -> dict[Path, bytes]:
    """The files that ``save_scene`` writes; raises as that does."""
    reading, contents = Reading(path, kind=KIND), dict[Path, bytes]()
    require_whole(reading, scene)

    def name(file: str, where: str) -> str:
        if not is_there(Path(file)):
            found = f"{where} is {Path(file).name}, and there is no such file"
            raise reading.error(found, "a scene's photos and models are files, save them first")
        return relative_name(path, Path(file))

    def beside(mask: str, _: str) -> str:
        file = path.with_name(f"{path.stem}.{len(contents) + 1}.mask.png")
        contents[file] = b64decode(mask.removeprefix(INLINE))
        return file.name

    data = with_files(structs.replace(scene, warnings=()), name, beside)
    contents[path] = json_bytes(path, data, PoseFileError, format=s.SCENE, version=2)
    return contents


def require_whole(reading: Reading, scene: SceneRecord) -> None:
    """Raise the reading's error where parts of a scene do not fit together."""
    ids = [item.id for item in scene.objects]
    for number, item in enumerate(scene.objects):
        if item.id in ids[:number]:
            raise reading.error(f"two objects have the id {item.id!r}", "give each its own")
        if len(item.in_views) not in (0, len(scene.views)):
            found = f"objects[{number}].in_views is a list of {len(item.in_views)}"
            raise reading.error(found, f"wanted one for each of {len(scene.views)} views, or none")
    if scene.free_scale and len(ids) > 1:
        wanted = "say free_scale: false and the objects' scales, or leave one object alone"
        raise reading.error(f"its scale is not known, and it has {len(ids)} objects", wanted)


def relative_name(path: Path, file: Path) -> str:
    """A file as the one at ``path`` names it: from the folder of that, if there is a way."""
    try:
        return Path(os.path.relpath(file.resolve(), path.resolve().parent)).as_posix()
    except ValueError:  # on another drive
        return str(file.resolve())
