"""Sort files that came together (a drop, a zip, a folder): photos, models, poses, cameras.

What belongs to what is found by the names inside the files; ``set_questions`` asks about the rest.
"""

from __future__ import annotations

import os
import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Literal

from poseviewer.errors import FileSetError, PoseViewerError
from poseviewer.files.cameras import load_cameras
from poseviewer.files.checks import read_json
from poseviewer.files.colmap_model import model_file
from poseviewer.files.formats.bop import CAMERAS, MODEL_NAME, BopImage, load_bop_images
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.reconstructions import colmap_photos, read_colmap
from poseviewer.files.keypoints import FORMAT as KEYPOINTS
from poseviewer.files.keypoints import keypoints_path
from poseviewer.files.mesh.load import READERS
from poseviewer.files.mesh.named import bare_name, find_named, plain_name
from poseviewer.files.mesh.references import names_in
from poseviewer.files.photo import ENDINGS as PICTURES
from poseviewer.files.photo import was_taken_by_a_camera
from poseviewer.files.scene import is_scene_file
from poseviewer.files.symmetry import symmetry_path
from poseviewer.files.view_set import SetChoice, is_view_set_file, photos_of_frames, says_world
from poseviewer.geometry.transform import RigidTransform

Kind = Literal["photo", "model", "pose"]

MOST_FILES = 10_000
"""Of a set: a scene of a thousand photos with depths and masks has some thousand."""
TEXTS = (".json", ".yml", ".yaml", ".xml", ".txt")
"""Files of cameras, poses and key points."""
KINDS_OF_TEXT = ("pose", "camera", "keypoints")
"""That are of use."""
OF_MODELS = (".mtl", ".bin")
"""Of files that are nothing without their model."""
NO_PICTURES = (*OF_MODELS, ".json")
"""Of what models name."""
COLMAP_STEMS = ("cameras", "images", "points3D", "frames", "rigs", "project")
"""Of the files of a COLMAP model."""
SYSTEM_NAMES = ("__macosx", "thumbs.db", "desktop.ini")
"""What systems leave in folders and zips, beside all that begins with a dot."""

ByName = Mapping[str, Sequence[Path]]
"""Files by their plain names."""


@dataclass(frozen=True, slots=True)
class ModelFiles:
    """A model and the files that it is read with."""

    path: Path
    named: Mapping[str, Path] = field(default_factory=dict)
    """What it or its material file names, as it writes it, and where that lies."""
    missing: tuple[str, ...] = ()
    """What it names and would be read with, and is not there."""
    scattered: bool = False
    """Whether something it names lies where its reader would not look."""

    @property
    def has_pictures(self) -> bool:
        """Whether it names pictures, there or not."""
        return any(not n.lower().endswith(NO_PICTURES) for n in (*self.named, *self.missing))


@dataclass(frozen=True, slots=True)
class SceneFolder:
    """A BOP scene's folder, or that of a COLMAP model, and its photos."""

    cameras: Path
    """``scene_camera.json``, ``cameras.txt`` or ``cameras.bin``."""
    photos: Mapping[Path, str]
    """What the scene calls each."""
    images: Mapping[Path, BopImage] = field(default_factory=dict)
    """BOP alone."""

    def has(self, photo: Path, model: Path) -> bool:
        """Whether the model may be seen in the photo."""
        image = self.images.get(photo)
        return image is None or any(one.object_id == _number(model) for one in image.objects)

    def place(self, photo: Path, model: Path) -> RigidTransform | None:
        """Camera from model; None where the scene does not say it, or of several such objects.

        Raises:
            PoseFileError: the scene is damaged.
        """
        image = self.images.get(photo)
        if image is None:
            request = ConvertOptions(image=self.photos[photo])
            return read_colmap(self.cameras.parent, request).pose.camera_from_model
        found = [one.place for one in image.objects if one.object_id == _number(model)]
        return found[0] if len(found) == 1 else None


@dataclass(frozen=True, slots=True)
class KnownCameras:
    """Several photos that came with the poses of their cameras: they can be a set."""

    path: Path
    """What says the cameras, as ``load_view_set`` takes it."""
    photos: Mapping[Path, str]
    """What it calls each."""
    folder: Path | None = None
    """Of COLMAP's photos."""
    rigs: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    """BOP's objects whose poses may tell how the camera moved, and the photos that they do it for;
    empty where the scene says it."""

    def choice(self, rig: int | None = None) -> SetChoice:
        """What the file leaves open, with the ``rig`` that was chosen of several."""
        photos = tuple(self.photos.values()) if rig is None else self.rigs[rig]
        return SetChoice(photos, self.folder, rig)


@dataclass(frozen=True, slots=True)
class FileSet:
    """Files that came together, by what they are."""

    root: Path
    """The innermost folder that they all lie in, or deeper."""
    models: tuple[ModelFiles, ...] = ()
    photos: tuple[Path, ...] = ()
    """What can be nothing else; of scenes, where there are some."""
    pictures: tuple[Path, ...] = ()
    """Photos or textures: nothing in the files says which."""
    cameras: tuple[Path, ...] = ()
    poses: tuple[Path, ...] = ()
    keypoints: tuple[Path, ...] = ()
    """Of no model here, by their names."""
    scenes: tuple[SceneFolder, ...] = ()
    leftovers: tuple[Path, ...] = ()
    """Of no use, as far as can be told."""
    scene_files: tuple[Path, ...] = ()
    """poseviewer's own, which say what all the others are."""
    set_files: tuple[Path, ...] = ()
    """Of sets of photos, which say what the photos are."""
    known_cameras: tuple[KnownCameras, ...] = ()

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing in it to open."""
        of_them = self.models, self.photos, self.pictures, self.cameras, self.poses
        return not (any(of_them) or self.scene_files or self.set_files)

    def scene_of(self, photo: Path | None) -> SceneFolder | None:
        """The scene that a photo is from."""
        return next((scene for scene in self.scenes if photo in scene.photos), None)

    def label(self, path: Path) -> str:
        """What a file is called: its path in the set."""
        inside = path.is_relative_to(self.root)
        return path.relative_to(self.root).as_posix() if inside else path.name


def nothing_to_open(found: FileSet, kind: Kind | None = None) -> FileSetError:
    """Why an empty set (of a pose, where ``kind`` says so) opens nothing."""
    files = (*found.leftovers, *found.keypoints)
    what = found.label(files[0]) if len(files) == 1 else f"{len(files):,} files"
    if files and all(path.suffix.lower() in OF_MODELS or path in found.keypoints for path in files):
        return FileSetError(f"{what}: of a model that did not come along; drop them together.")
    wanted, endings = "a photo, a model or a pose", (*PICTURES, *READERS, ".json")
    if kind == "pose":
        wanted, endings = "a pose", (".json",)
    found_text = f"not the name of {wanted} file" if len(files) == 1 else f"none is {wanted} file"
    return FileSetError(f"{what}: {found_text}; wanted one that ends in {', '.join(endings)}.")


def files_below(root: Path) -> tuple[Path, ...]:
    """All files in a folder and below, sorted, without what systems leave there.

    Raises:
        FileSetError: there are more than ``MOST_FILES``.
    """
    found = tuple(islice(_walk(root), MOST_FILES + 1))
    if len(found) > MOST_FILES:
        raise FileSetError(
            f"{root}: more than {MOST_FILES:,} files; name a folder inside it, or PHOTO and MODEL."
        )
    return tuple(sorted(found))


def is_of_system(name: str) -> bool:
    """Whether a file or a folder of this name is one that systems leave behind."""
    return name.startswith(".") or name.lower() in SYSTEM_NAMES


def sort_set(
    files: Sequence[Path], kind: Kind | None = None, at_hand: Path | None = None
) -> FileSet:
    """Sort ``files`` by kind.

    ``kind``: what the user called them, if so: of a photo all pictures that no model names are
    photos, of a model none is, and of a pose every JSON file is one. ``at_hand``: a model that is
    open already; where it misses what is here, it is one of the models.

    Raises:
        PoseViewerError: a scene in it is damaged.
    """
    root = Path(os.path.commonpath([path.parent for path in files] or ["."]))
    scene_files = tuple(p for p in files if p.suffix.lower() == ".json" and is_scene_file(p))
    if scene_files:
        return FileSet(root, scene_files=scene_files)
    texts_of = [path for path in files if path.suffix.lower() == ".json"]
    set_files = tuple(path for path in texts_of if is_view_set_file(path))
    if set_files and kind != "pose":
        models = tuple(model_files(p, files) for p in files if p.suffix.lower() in READERS)
        poses = [path for path in texts_of if _kind_of_text(path, sole=False) == "pose"]
        return FileSet(root, models, poses=tuple(poses), set_files=set_files)
    if kind == "pose":
        poses = [path for path in files if path.suffix.lower() == ".json"]
        used = {*poses, *_masks_of(poses)}
        return FileSet(root, poses=tuple(poses), leftovers=_without(files, used))
    scenes = (*_bop_scenes(files), *_colmap_scenes(files))
    loose = _without(files, _inside(scenes, files))
    models = [model_files(path, loose) for path in files if path.suffix.lower() in READERS]
    if not models and at_hand is not None:
        joined = model_files(at_hand, loose)
        models = [joined] if set(joined.named.values()) & set(loose) else []
    taken = {path for model in models for path in (model.path, *model.named.values())}
    rest = _without(loose, taken)
    texts: dict[str, list[Path]] = defaultdict(list)
    for path in rest:
        if path.suffix.lower() in TEXTS:
            texts[_kind_of_text(path, sole=len(files) == 1)].append(path)
    masks = _masks_of(texts["pose"])
    rest = _without(rest, masks)
    pictures = [path for path in rest if path.suffix.lower() in PICTURES]
    framed = [known for path in rest for known in _of_frames(path, pictures)]
    known_cameras = (*framed, *(known for scene in scenes for known in _of_scene(scene)))
    photos = [path for scene in scenes for path in scene.photos]
    if photos or kind == "model":
        pictures = []
    else:
        unclear = kind is None and any(model.has_pictures for model in models)
        sure = {path for known in framed for path in known.photos}
        photos = [
            path for path in pictures if not unclear or path in sure or was_taken_by_a_camera(path)
        ]
        pictures = [path for path in pictures if unclear and path not in photos]
    return FileSet(
        root,
        tuple(models),
        tuple(photos),
        tuple(pictures),
        tuple(texts["camera"]),
        tuple(texts["pose"]),
        tuple(texts["keypoints"]),
        scenes,
        _without(rest, [*photos, *pictures, *(p for k in KINDS_OF_TEXT for p in texts[k])]),
        known_cameras=known_cameras,
    )


def model_files(
    path: Path, others: Sequence[Path], given: Mapping[str, Path] | None = None
) -> ModelFiles:
    """A model with what it names: where its reader looks, else by its name among ``others``; some
    of it may be ``given``, whatever its name.
    """
    by_name: dict[str, list[Path]] = defaultdict(list)
    for other in others:
        by_name[plain_name(other.name)].append(other)
    named: dict[str, Path] = {}
    missing: list[str] = []
    scattered, waiting = False, [path]
    while waiting:
        file = waiting.pop()
        for written, is_read in names_in(file).items():
            beside = find_named(file.parent, written)
            found = (given or {}).get(written) or beside or _alike(written, by_name)
            if found is None:
                missing += [written] if is_read else []
            elif written not in named:
                named[written] = found
                scattered = scattered or found is not beside
                if found.suffix.lower() == ".mtl":
                    waiting.append(found)
    for own in (keypoints_path(path), symmetry_path(path)):
        found = (given or {}).get(own.name) or (own if own.is_file() else _alike(own.name, by_name))
        if found is not None:
            named[own.name] = found
            scattered = scattered or found != own
    return ModelFiles(path, named, tuple(dict.fromkeys(missing)), scattered)


def _alike(written: str, by_name: ByName) -> Path | None:
    """Of the files of this name, the one whose folders are most like those written."""
    folders = [plain_name(part) for part in written.replace("\\", "/").split("/")][::-1]

    def shared_folders(path: Path) -> int:
        parts = [plain_name(part) for part in path.parts][::-1]
        pairs = zip(folders, parts, strict=False)
        return next((i for i, (a, b) in enumerate(pairs) if a != b), len(folders))

    return max(by_name.get(plain_name(bare_name(written)), ()), key=shared_folders, default=None)


def _without(files: Sequence[Path], those: Collection[Path]) -> tuple[Path, ...]:
    known = set(those)
    return tuple(path for path in files if path not in known)


def _walk(root: Path) -> Iterator[Path]:
    for folder, folders, names in os.walk(root):
        folders[:] = sorted(name for name in folders if not is_of_system(name))
        for name in sorted(names):
            path = Path(folder, name)
            if not is_of_system(name) and path.is_file():
                yield path


def _masks_of(poses: Sequence[Path]) -> set[Path]:
    """The pictures beside pose files that these name as their masks."""
    found = set()
    for path in poses:
        with suppress(PoseViewerError):
            data = read_json(path)
            if isinstance(data, dict) and isinstance(data.get("mask"), str):
                found.add(path.parent / bare_name(data["mask"]))
    return found - set(poses)


def _kind_of_text(path: Path, sole: bool) -> str:
    """``pose``, ``camera``, ``keypoints`` or ``none``; a ``sole`` file is a pose if nothing else,
    so that it is said why it is none.
    """
    sole = sole and path.suffix.lower() == ".json"
    if path.suffix.lower() == ".json":
        try:
            data = read_json(path)
        except PoseViewerError:
            return "pose" if sole else "none"
        if isinstance(data, dict) and "camera_from_model" in data:
            return "pose"
        if isinstance(data, dict) and (
            data.get("format") == KEYPOINTS or {"left", "right"} <= data.keys()
        ):
            return "keypoints"
    try:
        load_cameras(path)
    except PoseViewerError:
        return "pose" if sole else "none"
    return "camera"


def _bop_scenes(files: Sequence[Path]) -> Iterator[SceneFolder]:
    there = set(files)
    for path in files:
        if path.name == CAMERAS:
            images = load_bop_images(path.parent).images
            found = {path.parent / image.photo: image for image in images}
            found = {photo: image for photo, image in found.items() if photo in there}
            if found:
                names = {photo: str(image.number) for photo, image in found.items()}
                yield SceneFolder(path, names, found)


def _colmap_scenes(files: Sequence[Path]) -> Iterator[SceneFolder]:
    by_name: dict[str, list[Path]] = defaultdict(list)
    for path in files:
        if path.suffix.lower() in PICTURES:
            by_name[plain_name(path.name)].append(path)
    for path in files:
        if path == model_file(path.parent, "cameras") and path.with_stem("images") in files:
            names = colmap_photos(path.parent)
            found = {_alike(name, by_name): name for name in sorted(names)}
            photos = {photo: name for photo, name in found.items() if photo is not None}
            if photos:
                yield SceneFolder(path, photos)


def _of_frames(path: Path, pictures: Collection[Path]) -> Iterator[KnownCameras]:
    """The photos of ``transforms.json`` that came along."""
    photos = {photo: name for photo, name in photos_of_frames(path).items() if photo in pictures}
    if len(photos) > 1:
        yield KnownCameras(path, photos)


def _of_scene(scene: SceneFolder) -> Iterator[KnownCameras]:
    """Those of a scene, where it says how its cameras stand, or an object may tell it."""
    folder = scene.cameras.parent
    if not scene.images:  # COLMAP's
        ends = {photo: photo.as_posix().removesuffix(name) for photo, name in scene.photos.items()}
        above = Counter(ends.values()).most_common(1)[0][0]
        photos = {photo: name for photo, name in scene.photos.items() if ends[photo] == above}
        if len(photos) > 1:
            yield KnownCameras(folder, photos, Path(above))
        return
    rigs: dict[int, list[str]] = defaultdict(list)
    is_said = says_world(folder / CAMERAS)
    if not is_said:
        for photo, image in scene.images.items():
            for number, count in Counter(one.object_id for one in image.objects).items():
                if count == 1:
                    rigs[number].append(scene.photos[photo])
    several = {number: tuple(names) for number, names in sorted(rigs.items()) if len(names) > 1}
    if len(scene.photos) > 1 and (is_said or several):
        yield KnownCameras(folder, scene.photos, rigs=several)


def _inside(scenes: Sequence[SceneFolder], files: Sequence[Path]) -> Collection[Path]:
    """What belongs to scenes: all of a BOP scene's folder but models, the files and photos of a
    COLMAP model.
    """
    found: set[Path] = set()
    for scene in scenes:
        folder = scene.cameras.parent
        found |= set(scene.photos)
        for path in files:
            if scene.images and path.is_relative_to(folder):
                found |= set() if path.suffix.lower() in READERS else {path}
            elif not scene.images and path.parent == folder and path.stem in COLMAP_STEMS:
                found.add(path)
    return found


def _number(model: Path) -> int | None:
    """Of a BOP object's model, by its name."""
    found = re.fullmatch(MODEL_NAME, model.name)
    return int(found[1]) if found else None
