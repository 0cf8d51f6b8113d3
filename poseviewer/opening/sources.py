"""Sources of a scene: files that were named, or that came together (a drop, a zip, a
folder) and are sorted by what they are.
"""

import os
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, Literal

from poseviewer.errors import FileSetError, PoseViewerError, list_names
from poseviewer.files.camera_trees import TREES
from poseviewer.files.cameras import Calibration, load_cameras
from poseviewer.files.checks import InputFile
from poseviewer.files.colmap_model import colmap_file
from poseviewer.files.formats.bop import CAMERAS
from poseviewer.files.image_sequence import ImageSequence, sort_frames
from poseviewer.files.keypoints import keypoints_path
from poseviewer.files.masks import MaskFile
from poseviewer.files.mesh.load import ELSEWHERE, READERS
from poseviewer.files.mesh.named import bare_name, find_named, plain_name
from poseviewer.files.mesh.parts import MAX_TEXTURES
from poseviewer.files.mesh.references import names_in
from poseviewer.files.photo import ENDINGS as PICTURES
from poseviewer.files.photo import RAW_ENDINGS, was_taken_by_a_camera
from poseviewer.files.structs import SCENE
from poseviewer.files.symmetry import symmetry_path
from poseviewer.files.video import RECORD, VIDEOS, is_kept_of
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mask import Mask
from poseviewer.opening.photo_sets import LoadedViews, SetChoice
from poseviewer.scene.assets import ModelFile
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene
from poseviewer.starts.start import FindStart

Kind = Literal["photo", "model", "pose"]

MAX_FILES = 10_000
"""Limit of a set: a scene of a thousand photos with depths and masks has some thousand."""
MAX_BELOW = 100_000
"""Limit of a folder on the disk, whose files are listed alone."""
MAX_MODELS = 200
MAX_NAMED = 5
OF_MODELS = (".mtl", ".bin")
"""Files that are nothing without their model."""
OF_SEVERAL = (
    "the file that says where their cameras stood; or frames of a sequence, numbered, in one folder"
)
"""Demand of errors: how several photos belong together."""
NO_PICTURES = (*OF_MODELS, ".json")
"""Files that models name, beside pictures."""
SYSTEM_NAMES = ("__macosx", "thumbs.db", "desktop.ini")
"""Files that systems leave in folders and zips, beside all that begins with a dot."""


@dataclass(frozen=True, slots=True)
class ModelFiles:
    """A model and the files that it is read with."""

    path: Path
    named: Mapping[str, Path] = field(default_factory=dict)
    """Files that it or its material file names: by the name as written, their paths."""
    names_pictures: bool = False
    """Whether it names pictures, there or not."""
    scattered: bool = False
    """Whether something it names lies where its reader would not look."""


@dataclass(frozen=True, slots=True)
class Sources:
    """What a scene is opened from: a photo, frames, a set of photos or a scene, and what goes with
    it, as files or loaded.
    """

    photo: Path | Photo | None = None
    frames: tuple[Path, ...] | ImageSequence = ()
    """Photos of a sequence in order, or its video, as ``load_sequence`` takes them."""
    views: Path | LoadedViews | None = None
    """A set of photos, as ``photo_sets.load_views`` takes it."""
    scene: Path | Scene | None = None
    """A scene, or its file, which says all by itself."""
    model: Path | ModelFile | None = None
    """The model; None: the first of ``models``."""
    models: tuple[ModelFiles, ...] = ()
    """Models that came together."""
    start: Path | Pose | FindStart | None = None
    """Pose file, pose, or what finds one on the photo; None: the model is still to be placed."""
    calibration: Calibration | None = None
    """Camera and lens of the photo or of all frames."""
    mask: MaskFile | Mask | None = None
    """Weight of each pixel, or its file; None: that of the pose file, with what was found in
    front."""
    choice: SetChoice | None = None
    """What a set leaves open."""
    key: int = 0
    """Index of the frame that start and mask are of."""
    keys: Mapping[int, Path | Pose] = field(default_factory=dict)
    """Poses in further frames, by the frames' indices."""
    mask_all_frames: bool = False
    """Whether the mask holds for all frames; what a search found in front, as the pose file says
    it, belongs to the frame ``key`` in any case."""
    settings: FitSettings | None = None
    """Settings of the objects; None: those of the scene, or the default. Parts ``without`` are
    left out; those of a scene's objects are named ``ID:PART``."""
    inside: Path | None = None
    """Folder that must contain all files that a scene names."""
    unused: tuple[Path, ...] = ()
    """Files that fit nothing."""

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence that names the files that fit nothing, or none."""
        if not self.unused:
            return ()
        hint = any(path.suffix.lower() in PICTURES for path in self.unused)
        more = " A picture alone is opened as the photo." if hint else ""
        return (f"Not used: {_list_paths(self.unused)}.{more}",)


def name_sources(
    photo: str | Path | LoadedViews,
    model: str | Path | ModelFile | None = None,
    start: str | Path | Pose | FindStart | None = None,
    **more: Any,
) -> Sources:
    """Return sources of files that were named each for what it is, with ``more`` fields.

    Args:
        photo: a photo; a set of photos, known by a choice in it, as JSON or a folder; or, alone, a
            scene file.
        model: file, or loaded model.
        start: pose file, pose, or what finds one.
        **more: other fields of ``Sources``.
    """
    model = Path(model) if isinstance(model, str) else model
    start = Path(start) if isinstance(start, str) else start
    own = Sources(model=model, start=start, **more)
    if isinstance(photo, LoadedViews):
        return replace(own, views=photo)
    path = Path(photo)
    if model is None and start is None:
        return replace(own, scene=path)
    is_set = own.choice is not None or path.suffix.lower() == ".json" or path.is_dir()
    return replace(own, views=path) if is_set else replace(own, photo=path)


def files_below(root: Path) -> tuple[Path, ...]:
    """List all files in a folder and below, sorted, without what systems leave there."""
    files = tuple(islice(_walk(root), MAX_BELOW + 1))
    if len(files) > MAX_BELOW:
        wanted = "name a folder inside it, or PHOTO and MODEL"
        raise FileSetError(f"{root}: more than {MAX_BELOW:,} files; {wanted}.")
    return tuple(sorted(files))


def is_of_system(name: str) -> bool:
    """Tell whether a file or a folder of this name is one that systems leave behind."""
    return name.startswith(".") or name.lower() in SYSTEM_NAMES


def sort_set(
    files: Sequence[Path], kind: Kind | None = None, at_hand: Path | None = None
) -> Sources:
    """Sort files, which the user calls of a ``kind``, by what they are.

    A picture that a model names is a texture. Beside such a model, another picture is the photo if
    a camera has taken it. Several photos in one folder, of which no file says where their cameras
    stood, are a sequence; those that were read from a video beside them are left to the video.
    ``at_hand``: open model, which may miss what is here.

    Raises:
        FileSetError: several of a kind, or nothing that can be opened.
    """
    of_kind: dict[str, list[Path]] = defaultdict(list)
    for path in files:
        of_kind[_kind_of(path, kind == "pose", sole=len(files) == 1)].append(path)
    if scene := _only(of_kind["scene"], "scene files"):
        return Sources(scene=scene)
    if len(of_kind["model"]) > MAX_MODELS:
        _only(of_kind["model"], "models", f" to {MAX_MODELS}")
    models = [model_files(path, files) for path in of_kind["model"]]
    if not models and at_hand is not None:
        joined = model_files(at_hand, files)
        models = [joined] if set(joined.named.values()) & set(files) else []
    used = {path for model in models for path in (model.path, *model.named.values())}
    poses = [path for path in of_kind["pose"] if path not in used]
    cameras = [path for path in of_kind["camera"] if path not in used]
    masks = [(path.parent, _json_of(path).get("mask")) for path in poses]
    used |= {folder / bare_name(name) for folder, name in masks if isinstance(name, str)}
    videos = of_kind["video"]
    used |= {path for path in files if any(is_kept_of(video, path) for video in videos)}
    pictures = [path for path in of_kind["picture"] if path not in used]
    sets = of_kind["set"]
    if len(pictures) > 1:
        sets += [path.parent for path in of_kind["reconstruction"]]
    else:
        cameras += of_kind["reconstruction"]
    pose, views = _only(poses, "pose files"), _only(sets, "sets of photos")
    pose = pose if len(models) < 2 else None  # it does not say of which of them it is
    photo = camera = None
    frames = tuple[Path, ...]()
    if views is not None:
        _only([model.path for model in models], "models of one set of photos")
        used |= {views, *pictures, *(path for path in files if views in path.parents)}
    else:
        if kind in ("model", "pose"):
            pictures = videos = []
        elif kind is None and any(model.names_pictures for model in models):
            pictures = [path for path in pictures if was_taken_by_a_camera(path)]
        is_numbered = all(any(map(str.isdigit, path.stem)) for path in pictures)
        if is_numbered and len({path.parent for path in pictures}) == 1 < len(pictures):
            frames = tuple(sort_frames(pictures))
        elif video := _only(videos, "videos"):
            frames = (video,)
        else:
            photo = _only(pictures, "photos", f" (or with them {OF_SEVERAL})")
        camera = _only(cameras, "files of cameras")
    if not (photo or frames or camera or models or pose or views):
        raise _nothing_to_open(files, kind)
    used |= {path for path in (photo, camera, pose, *frames) if path is not None}
    used |= {path.with_name(RECORD) for path in frames[:1]}
    unused = tuple(path for path in files if path not in used)
    calibration = None if camera is None else Calibration(camera)
    return Sources(
        photo, frames, views, models=tuple(models), start=pose, calibration=calibration,
        unused=unused,
    )  # fmt: skip


def model_files(path: Path, others: Sequence[Path]) -> ModelFiles:
    """A model with what it names: where its reader looks, else by its name among ``others``."""
    by_name: dict[str, list[Path]] = defaultdict(list)
    for other in others:
        by_name[plain_name(other.name)].append(other)
    named, waiting = dict[str, Path](), [path]
    names_pictures, scattered = False, False
    while waiting:
        file = waiting.pop()
        for written, is_read in islice(names_in(file).items(), MAX_TEXTURES):
            beside = find_named(file.parent, written)
            match = beside or _alike(written, by_name)
            is_picture = not written.lower().endswith(NO_PICTURES)
            names_pictures |= is_picture and (is_read or match is not None)
            if match is not None and written not in named:
                named[written] = match
                scattered |= match is not beside
                if match.suffix.lower() == ".mtl":
                    waiting.append(match)
    for own in (keypoints_path(path), symmetry_path(path)):
        if match := own if own.is_file() else _alike(own.name, by_name):
            named[own.name] = match
            scattered |= match != own
    return ModelFiles(path, named, names_pictures, scattered)


def _alike(written: str, by_name: dict[str, list[Path]]) -> Path | None:
    """The file of this name; of several the one that has the written folders above it."""
    paths, end = by_name.get(plain_name(written), []), written.replace("\\", "/")
    return max(paths, key=lambda path: path.as_posix().endswith(end), default=None)


def _walk(root: Path) -> Iterator[Path]:
    for folder, folders, names in os.walk(root):
        folders[:] = sorted(name for name in folders if not is_of_system(name))
        for name in sorted(names):
            path = Path(folder, name)
            if not is_of_system(name) and path.is_file():
                yield path


def _kind_of(path: Path, as_pose: bool, sole: bool) -> str:
    """Kind of a file, or ""; of a ``sole`` one that is none, what its reader says why it is not."""
    suffix = path.suffix.lower()
    if suffix in READERS or (sole and suffix in ELSEWHERE):
        return "model"
    if suffix in PICTURES or (sole and suffix in RAW_ENDINGS):
        return "picture"
    if suffix in VIDEOS:
        return "video"
    is_json = suffix == ".json"
    if is_json and is_scene_file(path):
        return "scene"
    if as_pose:
        return "pose" if is_json else ""
    of_colmap = path == colmap_file(path.parent, "cameras")
    if path.name == CAMERAS or (of_colmap and colmap_file(path.parent, "images").is_file()):
        return "reconstruction"
    data = _json_of(path) if is_json else {}
    if data.get("format") == SCENE or isinstance(data.get("frames"), list):
        return "set"
    if "camera_from_model" in data:
        return "pose"
    if suffix in TREES:
        for lens_model in (None, "fisheye"):  # a lens of no said model is for the user to say
            with suppress(PoseViewerError):
                load_cameras(path, lens_model)
                return "camera"
    return "pose" if sole and is_json else ""


def is_scene_file(path: Path) -> bool:
    """Tell whether a file is JSON of a scene of objects, or is called ``.scene.json``."""
    data = _json_of(path)
    if data.get("format") == SCENE:
        return data.get("version") != 2 or bool(data.get("objects"))
    return path.name.lower().endswith(".scene.json")


def is_pose_file(path: Path) -> bool:
    """Tell whether a file is JSON of one pose of ours."""
    return "camera_from_model" in _json_of(path)


def _json_of(path: Path) -> dict[str, object]:
    with suppress(PoseViewerError):
        data = InputFile(path).load_json()
        if isinstance(data, dict):
            return data
    return {}


def _only(paths: Sequence[Path], what: str, instead: str = "") -> Path | None:
    if len(paths) > 1:
        found = f"{len(paths):,} {what}: {_list_paths(paths)}"
        raise FileSetError(f"{found}; wanted one{instead}, nothing was opened.")
    return paths[0] if paths else None


def _list_paths(paths: Sequence[Path]) -> str:
    root = Path(os.path.commonpath([path.parent for path in paths]))
    return list_names([path.relative_to(root).as_posix() for path in paths], MAX_NAMED)


def _nothing_to_open(files: Sequence[Path], kind: Kind | None) -> FileSetError:
    what = files[0].name if len(files) == 1 else f"{len(files):,} files"
    if files and all(path.suffix.lower() in OF_MODELS for path in files):
        return FileSetError(f"{what}: of a model that did not come along; drop them together.")
    wanted, endings = "a photo, a model or a pose", (*PICTURES, *READERS, ".json", *VIDEOS)
    if kind == "pose":
        wanted, endings = "a pose", (".json",)
    found = "not the name of" if len(files) == 1 else "none is"
    return FileSetError(f"{what}: {found} {wanted} file; wanted one of {', '.join(endings)}.")
