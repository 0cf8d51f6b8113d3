"""Scene files: JSON that says which models are where in which photos (``scene.schema.json``).

Each type of ``scene.types`` has a form in files, a struct that msgspec checks and whose schema it
writes, made here from the type's fields. Paths in files start from the scene's folder.
"""

import os
from base64 import b64decode
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass, replace
from functools import cache, lru_cache, partial, reduce
from importlib.metadata import version
from operator import or_
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta, Struct, defstruct, structs

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.errors import PoseFileError, printable
from poseviewer.files import structs as s
from poseviewer.files.checks import MAX_DATA_BYTES, InputFile, Number, Pixels, Positive, is_there
from poseviewer.files.masks import INLINE, load_mask, mask_text
from poseviewer.files.mesh.named import bare_name
from poseviewer.files.pose import PoseRecord
from poseviewer.files.scene_assets import frame_file, model_file, view_of_file
from poseviewer.files.symmetry import SymmetryTurns
from poseviewer.files.writing import json_bytes, write_whole
from poseviewer.geometry.camera import Camera
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.symmetry_group import NO_SYMMETRY, Symmetry
from poseviewer.geometry.transform import RigidTransform, Similarity
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.settings import FitSettings, settings_as_json, settings_from_json
from poseviewer.scene.types import (
    DEFAULTS,
    NOT_IN_FILES,
    OBJECT_TEXTS,
    ChartParameters,
    Frame,
    FramePose,
    InView,
    Scene,
    SceneObject,
    SearchResult,
    View,
    require_size,
)

KIND = "scene file"
VERSION = 2
SOFTWARE = {"name": "poseviewer", "version": version("poseviewer")}
"""The program, as files name what wrote them."""
Region = Annotated[tuple[Number, ...], Meta(min_length=4, max_length=4)]
Named = Callable[[str, str], str]
"""A file's name in another place; the second argument says where in the scene it stands."""
FILES = ("file", "mask", "masks", "occluders")
"""Fields that name files, or have pictures in them."""
OF_OBJECTS = ("poses", "masks", "occluders")
"""Fields of frames that have an entry for an object, by its id."""
MAX_FRAMES_KEPT = 256
"""Frames with occluders whose saved form is kept, so that an autosave writes no frame twice."""


class PhotoPath(Struct, frozen=True, omit_defaults=True):
    """The photo's file, seen from the scene's folder, its size in px, and its fingerprint."""

    file: str
    width: Pixels
    height: Pixels
    sha256: s.Sha256 | None = None

    @classmethod
    def of(cls, file: PhotoFile) -> "PhotoPath":
        """The form of a photo."""
        return cls(str(file.path or file.name), file.width, file.height, file.sha256)


class ModelPath(Struct, frozen=True, omit_defaults=True):
    """The model's file, seen from the scene's folder, its fingerprint and length unit."""

    file: str
    sha256: s.Sha256 | None = None
    unit: str | None = None

    @classmethod
    def of(cls, model: ModelFile) -> "ModelPath":
        """The form of a model."""
        return cls(str(model.path or model.name), model.sha256, model.unit)


class Place(s.Transform, frozen=True, omit_defaults=True):
    """x_in_world = scale * rotation @ x_in_model + translation, in the world's unit."""

    scale: Positive = 1.0


class ViewJson(s.CameraRecord, frozen=True, kw_only=True, omit_defaults=True):
    """A photo, its camera (of the undistorted photo where there is a distortion) and where that
    stands: x_in_camera = rotation @ x_in_world + translation; left out for a camera in which the
    world's frame is. mask: a picture of the photo's size, black where something stands in front.
    """

    photo: PhotoPath
    camera_from_world: s.Transform = s.Transform.of(RigidTransform.identity())

    @classmethod
    def of(cls, view: View) -> "ViewJson":
        """The form of a view."""
        file, undistortion = view.file, view.file.undistortion
        return cls(
            photo=PhotoPath.of(file),
            projection=s.projection_of(view.camera), numbers=s.CameraNumbers.of(view.camera),
            distortion=undistortion and s.Distortion.of(undistortion),
            camera_from_world=s.Transform.of(view.camera_from_world), mask=mask_text(view.mask),
        )  # fmt: skip

    @property
    def view(self) -> View:
        """The view, its photo not yet read."""
        path, mask = Path(self.photo.file), None if self.mask is None else load_mask(self.mask)
        where = self.undistortion, self.camera_from_world.rigid, mask
        return view_of_file(path, self.camera, self.photo.sha256, *where)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the photo in px."""
        return self.photo.width, self.photo.height


class JsonForm(NamedTuple):
    """The type that msgspec checks for a type of the program, and the ways there and back."""

    kind: Any
    encode: Callable[[Any], Any]
    decode: Callable[[Any], Any]

    def inside(self, kind: Any, change: Callable[[Callable[[Any], Any], Any], Any]) -> "JsonForm":
        """Return the form of a type that holds values of this one, in which ``change`` changes each
        by a function.
        """
        return JsonForm(kind, partial(change, self.encode), partial(change, self.decode))


def _same(value: Any) -> Any:
    return value


def _each(change: Callable[[Any], Any], values: Any) -> Any:
    return tuple(map(change, values))


def _by_key(change: Callable[[Any], Any], values: Any) -> Any:
    return {key: change(value) for key, value in values.items()}


def _unless_none(change: Callable[[Any], Any], value: Any) -> Any:
    return None if value is None else change(value)


FORMS: dict[Any, JsonForm] = {
    float: JsonForm(Number, _same, _same),
    # A camera is one of a photo, whose size ``_complete`` gives it.
    Camera: JsonForm(
        s.CameraNumbers, s.CameraNumbers.of,
        lambda form: form.camera("perspective" if form.scale is None else "parallel", (0, 0))),
    ChartParameters: JsonForm(
        s.ChartJson, lambda chart: s.ChartJson(chart.name, chart.names, chart.parameters),
        lambda form: ChartParameters(form.name, form.names, form.parameters)),
    FitSettings: JsonForm(
        dict[str, Any] | None, lambda own: None if own is DEFAULTS else settings_as_json(own),
        lambda data: DEFAULTS if data is None else settings_from_json(data)),
    Mask: JsonForm(str, mask_text, load_mask),
    ModelFile: JsonForm(
        ModelPath, ModelPath.of, lambda form: model_file(Path(form.file), form.sha256, form.unit)),
    # A frame's photo has the lens of the view, which ``_complete`` gives it.
    PhotoFile: JsonForm(PhotoPath, PhotoPath.of, _same),
    # A covariance is one about a pose, which ``_complete`` gives it.
    PoseCovariance: JsonForm(s.Uncertainty, s.Uncertainty.of, _same),
    Rectangle: JsonForm(Region, lambda own: tuple(map(float, own)), lambda form: Rectangle(*form)),
    Similarity: JsonForm(
        Place, lambda place: Place.of(place.rigid, scale=float(place.scale)),
        lambda form: Similarity(form.rigid, form.scale)),
    Symmetry: JsonForm(
        SymmetryTurns | None, SymmetryTurns.of,
        lambda form: NO_SYMMETRY if form is None else form.symmetry),
    View: JsonForm(
        Annotated[ViewJson, Meta(extra_json_schema=s.PROJECTIONS)], ViewJson.of, lambda f: f.view),
}  # fmt: skip
"""Types whose form is not made of their fields."""
DESCRIPTIONS: dict[type, str] = {
    InView: """An object's own part in a view: a mask besides the view's, a region (left, top,
        width, height, px) in which pixels count, and whether a search reads the view. occluders: a
        picture that is black where a search found something in front; masks are the user's.""",
    SearchResult: """Result of the last search for an object. view: index of the view that chart and
        uncertainty are of; seen: for each view, the share of the model's pixels that count, null
        where it was not compared; residuals_px: for each view of a large set, how far in
        its photo the view's own best pose is off; settings: those of the search. The rest is as in
        pose files.""",
    SceneObject: """A model in the scene. id: of this object alone, the same model may be there
        several times; name: for people; start: where the last search began; in_views: one for each
        view, or none; start_cameras: the views' then, where a focal length was another; locked:
        placed by the user, searches leave it; placed: whether anybody has said where it is;
        without: names of the model's parts that are left out; symmetry: as in pose files.""",
    Frame: """A photo of a sequence, by the view's camera and lens: its time stamp from the first
        frame (s), and the objects' poses by their ids; an object without a pose is left out. mask:
        for all objects, masks: for single ones by their ids, occluders: what a search found in
        front of them; all three in this frame alone, while masks of the view and of objects hold
        for all frames.""",
    FramePose: """Pose of an object in a frame: key, placed by the user, or propagated from keys;
        stale: a pose beside it has changed since; result: as of an object.""",
    Scene: """Views times objects; without objects, a set of photos. Camera axes are OpenCV's (x
        right, y down, z forward); pixel centres are at integers; paths start from the scene's
        folder. unit: of the world; free_scale: nothing tells the world's unit in the model's, it is
        to be searched for; frames: of a sequence, of which the only view shows frame_index.""",
}
HEADS: dict[type, list[tuple[str, Any, Any]]] = {
    Scene: [("format", Literal["poseviewer-scene"], s.SCENE), ("version", Literal[2], VERSION)]
}
"""Fields of files that name their format."""


@cache
def form_of(kind: Any) -> JsonForm:
    """Return the form of a type: of ``FORMS``, or made of its parts."""
    if kind in FORMS:
        return FORMS[kind]
    if is_dataclass(kind):
        return _form_of_fields(kind)
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        inner = form_of(parts[0])
        return inner._replace(kind=Annotated[inner.kind, *kind.__metadata__])
    if origin is tuple:
        inner = form_of(parts[0])
        return inner.inside(tuple[inner.kind, ...], _each)
    if origin is Mapping and parts[1] is not Any:
        inner = form_of(parts[1])
        return inner.inside(dict[str, inner.kind], _by_key)
    if origin in (Union, UnionType) and NoneType in parts:
        inner = form_of(reduce(or_, (part for part in parts if part is not NoneType)))
        return inner.inside(inner.kind | None, _unless_none)
    return JsonForm(kind, _same, _same)


def _form_of_fields(kind: Any) -> JsonForm:
    """Return the form of a dataclass: a struct of the forms of its fields that are in files."""
    hints = get_type_hints(kind, include_extras=True)
    in_files = [item for item in fields(kind) if item.metadata != NOT_IN_FILES]
    forms = {item.name: form_of(hints[item.name]) for item in in_files}
    declared = [
        (item.name, forms[item.name].kind, _declared(item, forms[item.name])) for item in in_files
    ]
    struct = defstruct(
        f"{kind.__name__}Json", [*HEADS.get(kind, []), *declared], kw_only=True, frozen=True,
        omit_defaults=True, namespace={"__doc__": DESCRIPTIONS.get(kind, kind.__doc__)},
    )  # fmt: skip

    def encode(value: Any) -> Any:
        return struct(**{name: form.encode(getattr(value, name)) for name, form in forms.items()})

    def decode(value: Any) -> Any:
        made = kind(**{name: form.decode(getattr(value, name)) for name, form in forms.items()})
        return _complete(made) if kind is Scene else made

    return JsonForm(struct, encode, decode)


def _declared(item: Field[Any], form: JsonForm) -> Any:
    """Return a field as its struct declares it, with its name and default in files."""
    name = item.metadata.get("key", item.name)
    if item.default_factory is not MISSING:
        return msgspec.field(name=name, default_factory=item.default_factory)
    if item.default is not MISSING:
        return msgspec.field(name=name, default=form.encode(item.default))
    return msgspec.field(name=name)


SceneJson: Any = form_of(Scene).kind
SearchResultJson: Any = form_of(SearchResult).kind
OF_OBJECT = ("without", *OBJECT_TEXTS)
"""Fields that objects share with pose files."""
AS_IN_POSE = ("loss", "unexplained", "verdict", "settings", "notes")
"""Fields that results share with pose files, which are of one view."""


def _complete(scene: Scene) -> Scene:
    """Add to objects what follows from the views: sizes of cameras, poses of covariances."""
    objects = []
    for item in scene.objects:
        cameras = tuple(
            replace(camera, width=view.file.width, height=view.file.height)
            for camera, view in zip(item.start_cameras, scene.views, strict=False)
        )
        result = result_in_view(scene, item)
        objects.append(replace(item, start_cameras=cameras, result=result))
    frames = []
    for frame in scene.frames:
        photo: Any = frame.file
        file = frame_file(Path(photo.file), scene.views[0], photo.sha256)
        for mask in (frame.mask, *frame.masks.values(), *frame.occluders.values()):
            require_size(mask, file)
        poses = {
            name: replace(own, result=result_in_view(scene, own))
            for name, own in frame.poses.items()
        }
        frames.append(replace(frame, file=file, poses=poses))
    return replace(scene, objects=tuple(objects), frames=tuple(frames))


def result_in_view(scene: Scene, item: SceneObject | FramePose) -> SearchResult | None:
    """Return a result that was read, with its covariance about the pose in its view."""
    result = item.result
    if result is None or not isinstance(result.covariance, s.Uncertainty):
        return result
    at = min(result.view, len(scene.views) - 1)
    covariance = result.covariance.about(scene.views[at].pose(item.world_from_model))
    return replace(result, view=at, covariance=covariance)


def load_scene(
    path: str | Path, inside: Path | None = None, *, photos_may_miss: bool = False
) -> Scene:
    """Load a scene whose files are there, but not yet read.

    Args:
        path: scene file.
        inside: folder in which its files have to be; None: anywhere.
        photos_may_miss: whether photos that are not there are told of only where they are read.

    Raises:
        PoseFileError: it is no scene, its parts do not fit together, or it names a file that is not
            there or not ``inside``.
        PoseViewerError: a mask cannot be used; settings make no sense.
    """
    file = InputFile(Path(path).absolute(), kind=KIND, largest=MAX_DATA_BYTES)

    def find(name: str, what: str) -> str:
        full, wanted = file.path.parent / name, "drop one folder of the scene with all its files"
        is_known = photos_may_miss and what.endswith("photo.file")
        if not name or not (is_known or is_there(full)):
            found = f"{what} is {name or 'empty'}, and there is no such file"
            raise file.error(found, f"put it there, seen from the scene; on a page, {wanted}")
        if inside is not None and inside.resolve() not in full.resolve().parents:
            raise file.error(f"{what} is {name}, outside of the folder that was dropped", wanted)
        return str(full)

    with file.naming_errors():
        data = file.load_object()
        file.require_format({"format": None, **data}, s.SCENE, VERSION)
        form: Any = file.decode(data, SceneJson, raw=FILES)
        require_whole(file, form)
        scene: Scene = form_of(Scene).decode(_with_files(form, find))
        return replace(scene, name=file.path.name, notes=tuple(dict.fromkeys(file.warnings)))


def _with_files(form: Any, name: Named, name_inline: Named | None = None) -> Any:
    """Rename the files of a ``SceneJson``; masks in it become files by ``name_inline``."""

    def rename(mask: str | None, where: str) -> str | None:
        change = name_inline if mask and mask.startswith(INLINE) else name
        return change(mask, f"{where}.mask") if mask and change else mask

    def rename_photo(photo: Any, where: str) -> Any:
        return structs.replace(photo, file=name(photo.file, f"{where}.photo.file"))

    views, objects, frames = [], [], []
    for number, view in enumerate(form.views):
        where = f"views[{number}]"
        photo = rename_photo(view.photo, where)
        views.append(structs.replace(view, photo=photo, mask=rename(view.mask, where)))
    for number, frame in enumerate(form.frames):
        where = f"frames[{number}]"
        of_objects = {
            key: {each: rename(mask, where) for each, mask in getattr(frame, key).items()}
            for key in OF_OBJECTS[1:]
        }
        photo, mask = rename_photo(frame.file, where), rename(frame.mask, where)
        frames.append(structs.replace(frame, file=photo, mask=mask, **of_objects))
    for number, item in enumerate(form.objects):
        where = f"objects[{number}]"
        model = structs.replace(item.model, file=name(item.model.file, f"{where}.model.file"))
        in_views = []
        for index, own in enumerate(item.in_views):
            at = f"{where}.in_views[{index}]"
            masks = {"mask": rename(own.mask, at), "occluders": rename(own.occluders, at)}
            in_views.append(structs.replace(own, **masks))
        objects.append(structs.replace(item, model=model, in_views=tuple(in_views)))
    return structs.replace(form, views=tuple(views), objects=tuple(objects), frames=tuple(frames))


def as_saved(scene: Scene, *, canonical: bool = True) -> Scene:
    """Return the scene as files have it: with occluders apart from results, and without starts.

    A pose of a symmetric model is a ``canonical`` one of those that show the same. In a sequence it
    stays, as the motion between frames has to.
    """
    canonical = canonical and not scene.frames
    objects = tuple(_object_as_saved(scene, i, canonical) for i in range(len(scene.objects)))
    frames, ids = [], {item.id for item in objects}
    for frame in map(_frame_as_saved, scene.frames):
        if {*frame.poses, *frame.masks, *frame.occluders} - ids:  # of objects that were removed
            kept = {
                key: {name: own for name, own in getattr(frame, key).items() if name in ids}
                for key in OF_OBJECTS
            }
            frame = replace(frame, **kept)
        frames.append(frame)
    return replace(scene, objects=objects, software=SOFTWARE, frames=tuple(frames))


def _frame_as_saved(frame: Frame) -> Frame:
    results = (pose.result for pose in frame.poses.values() if pose.result is not None)
    is_occluded = any(mask is not None for result in results for mask in result.hidden)
    return _with_occluders(frame) if is_occluded else frame


@lru_cache(maxsize=MAX_FRAMES_KEPT)
def _with_occluders(frame: Frame) -> Frame:
    occluders = dict(frame.occluders)
    for name, pose in frame.poses.items():
        (hidden,) = (pose.result and pose.result.hidden) or (None,)
        if hidden is not None:
            earlier = occluders[name].weights if name in occluders else 1.0
            occluders[name] = Mask.of(earlier * ~hidden)
    return replace(frame, occluders=occluders)


def _object_as_saved(scene: Scene, index: int, canonical: bool) -> SceneObject:
    item = scene.objects[index]
    result, symmetry = item.result, item.symmetry
    place, at = item.world_from_model, 0 if result is None else result.view
    pose = scene.pose(index, at)
    equal = symmetry.canonical(pose) if canonical else pose
    if equal is not pose:
        place = scene.views[at].world_from_model(equal, place.scale)
    in_views = []
    for number, own in enumerate(item.in_views or [InView()] * len(scene.views)):
        if not scene.frames:  # there, they belong to the frame
            own = replace(own, occluders=scene.occluders(index, number))
        in_views.append(own)
    is_own = any(own != InView() for own in in_views)
    if result is not None:
        sure = result.covariance
        chart = result.chart if equal is pose and result.chart and result.chart.names else None
        sure = sure and sure.at_equal_pose(equal)
        result = replace(result, covariance=sure, chart=chart, hidden=())
    return replace(
        item, world_from_model=place, start=None, start_cameras=(),
        in_views=tuple(in_views) if is_own else (), said_symmetry=symmetry, result=result,
        settings=replace(item.settings),  # said, even where they are the defaults
    )  # fmt: skip


def save_scene(path: str | Path, scene: Scene) -> None:
    """Write a scene file and, beside it, its masks; each whole or not.

    Raises:
        PoseFileError: as of ``load_scene``; a photo or a model is no file; a number is not finite;
            a file cannot be written.
    """
    for file, content in scene_contents(Path(path), scene).items():
        # Masks of a scene that was read are its own.
        write_whole(file, content, PoseFileError, is_own=file != Path(path))


def scene_contents(path: Path, scene: Scene) -> dict[Path, bytes]:
    """Return the files that ``save_scene`` writes.

    Raises:
        PoseFileError: what ``save_scene`` refuses.
    """
    file = InputFile(path, kind=KIND)
    contents = dict[Path, bytes]()
    form = form_of(Scene).encode(scene)
    require_whole(file, form)

    def name(asset: str, where: str) -> str:
        if not is_there(Path(asset)):
            found = f"{where} is {Path(asset).name}, and there is no such file"
            raise file.error(found, "a scene's photos and models are files, save them first")
        return relative_name(path, Path(asset))

    def beside(mask: str, _: str) -> str:
        picture = path.with_name(f"{path.stem}.{len(contents) + 1}.mask.png")
        contents[picture] = b64decode(mask.removeprefix(INLINE))
        return picture.name

    data = _with_files(form, name, beside)
    first = {"format": s.SCENE, "version": VERSION}
    contents[path] = json_bytes(path, data, PoseFileError, rows="frames", **first)
    return contents


def require_whole(file: InputFile, form: Any) -> None:
    """Raise the file's error where parts of a ``SceneJson`` do not fit together."""
    ids = [item.id for item in form.objects]
    for number, item in enumerate(form.objects):
        if item.id in ids[:number]:
            raise file.error(f"two objects have the id {item.id!r}", "give each its own")
        for key in ("in_views", "start_cameras"):
            if (count := len(getattr(item, key))) not in (0, len(form.views)):
                found = f"objects[{number}].{key} is a list of {count}"
                raise file.error(found, f"wanted one for each of {len(form.views)} views, or none")
    if form.frames and (len(form.views) > 1 or form.frame_index >= len(form.frames)):
        found = f"it has {len(form.views)} views, and frame_index is {form.frame_index}"
        raise file.error(found, f"wanted one view, and one of its {len(form.frames)} frames")
    for number, frame in enumerate(form.frames):
        if (frame.file.width, frame.file.height) != form.views[0].size:
            found = f"frames[{number}].photo is {frame.file.width}x{frame.file.height} px"
            raise file.error(found, "wanted the size of the view's photo")
        for key in OF_OBJECTS:
            if unknown := getattr(frame, key).keys() - ids:
                found = f"frames[{number}].{key} has {min(unknown)!r}"
                raise file.error(found, f"wanted the id of an object, one of {', '.join(ids)}")
    if form.free_scale and len(ids) > 1:
        wanted = "say free_scale: false and the objects' scales, or leave one object alone"
        raise file.error(f"its scale is not known, and it has {len(ids)} objects", wanted)


def pose_json(scene: Scene, index: int = 0, view: int = 0) -> PoseRecord:
    """Return all that a pose file says of an object in a view of a scene ``as_saved``."""
    item, own = scene.objects[index], scene.views[view]
    result = item.result or SearchResult(settings=FORMS[FitSettings].encode(item.settings))
    form: Any = form_of(SearchResult).encode(result)
    is_of_view = result.view == view
    file, undistortion = ModelPath.of(item.model), own.file.undistortion
    model = s.ModelReference(printable(Path(file.file).name) or None, file.sha256, file.unit)
    return PoseRecord.of(
        scene.pose(index, view),
        s.PhotoReference(printable(own.file.location.name) or None, sha256=own.file.sha256),
        model=None if model == s.ModelReference() else model,
        **{name: getattr(form, name) for name in AS_IN_POSE},
        **{name: getattr(item, name) for name in OF_OBJECT},
        chart=form.chart if is_of_view else None,
        uncertainty=form.covariance if is_of_view else None,
        distortion=undistortion and s.Distortion.of(undistortion),
        seen=result.seen[view] if view < len(result.seen) else None,
        turns=SymmetryTurns.of(item.said_symmetry), software=scene.software, warnings=scene.notes,
    )  # fmt: skip


def scene_of_pose(path: Path, record: PoseRecord) -> Scene:
    """Make the scene of a pose file, without its mask; photo and model may lie beside it."""
    photo, model = record.photo or s.PhotoReference(), record.model or s.ModelReference()
    camera = replace(record.camera, width=photo.width or 0, height=photo.height or 0)
    view = view_of_file(_beside(path, photo.file), camera, photo.sha256, record.undistortion)
    if not photo.width or not photo.height:
        view = view.resize_photo(0, 0)
    result: Any = SearchResultJson(
        seen=() if record.seen is None else (record.seen,), chart=record.chart,
        covariance=record.uncertainty, **{name: getattr(record, name) for name in AS_IN_POSE},
    )  # fmt: skip
    item = SceneObject(
        id="1", name=model.file or "", world_from_model=view.world_from_model(record.pose),
        model=model_file(_beside(path, model.file), model.sha256, model.unit),
        **{name: getattr(record, name) for name in OF_OBJECT},
        said_symmetry=NO_SYMMETRY if record.turns is None else record.turns.symmetry,
        result=None if result == SearchResultJson() else form_of(SearchResult).decode(result),
    )  # fmt: skip
    notes = record.warnings
    return _complete(Scene(views=(view,), objects=(item,), software=record.software, notes=notes))


def _beside(path: Path, name: str | None) -> Path:
    return (path if path.is_dir() else path.parent) / bare_name(name) if name else Path()


def relative_name(path: Path, file: Path) -> str:
    """A file as the one at ``path`` names it: from the folder of that, if there is a way."""
    try:
        return Path(os.path.relpath(file.resolve(), path.resolve().parent)).as_posix()
    except ValueError:  # on another drive
        return str(file.resolve())
