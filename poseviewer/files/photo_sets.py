"""Views from files: of scene files, and of sets of photos whose cameras know their poses to one
another: COLMAP's models, ``transforms.json`` of nerfstudio and NeRF, BOP scenes, and our own JSON
of earlier versions (``SetFile``).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from poseviewer.errors import PoseFileError
from poseviewer.files.checks import Reading, checked_rotation, is_there, kind_of
from poseviewer.files.colmap_model import model_file
from poseviewer.files.formats.bop import (
    CAMERAS,
    POSES,
    UNIT,
    WORLD,
    load_bop_images,
    load_scene_file,
)
from poseviewer.files.formats.reconstructions import colmap_images, frame_taken
from poseviewer.files.masks import load_mask
from poseviewer.files.photo import load_photo, undistorted
from poseviewer.files.pose import check_against
from poseviewer.files.scene_file import ViewRecord, load_scene
from poseviewer.files.structs import (
    SCENE,
    VIEWS,
    CameraNumbers,
    LensNumbers,
    Positive,
    Transform,
)
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.image import Photo
from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view import View

KIND = "set of photos"
COLMAP_FOLDERS = ("", "sparse/0", "sparse")
"""Folders of a project in which its model may lie."""
PHOTO_FOLDERS = ("", "images", "../images", "../../images", "..", "../..")
"""Folders of its photos, from the model's folder."""
NERF_ENDINGS = ("", ".png", ".jpg", ".jpeg")
"""NeRF's own sets leave them out."""


class SetView(Struct, frozen=True):
    """A photo of a set, its camera as taken, and its lens."""

    photo: Annotated[str, Meta(min_length=1)]
    camera: CameraNumbers
    camera_from_set: Transform
    distortion: LensNumbers | None = None
    mask: str | None = None

    def __post_init__(self) -> None:
        self.camera.perspective(1, 1)


class SetFile(Struct, frozen=True):
    """A set of photos as earlier versions say it."""

    views: tuple[SetView, ...]
    unit: str | None = None
    scale: Positive | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LoadedViews:
    """Views of one thing, before it is known what that is."""

    name: str
    """Name of the file or folder."""
    views: tuple[View, ...]
    unit: str | None = None
    """Unit of the world; None: not said."""
    scale: float | None = None
    """Lengths of the model's unit in one of the world's; None: not known."""


@dataclass(frozen=True, slots=True)
class SetChoice:
    """Choices that a set's file leaves open."""

    photos: tuple[str, ...] = ()
    """Which of its photos, by their files' names, with or without ending; empty: all."""
    folder: Path | None = None
    """Folder of COLMAP's photos; None: looked for beside the model."""
    rig_object: int | None = None
    """The object of a BOP scene whose annotations tell how the cameras moved, where the scene does
    not say it."""


def load_views(path: str | Path, choice: SetChoice | None = None) -> LoadedViews:
    """Load the set in a file or a folder, with its photos, undistorted.

    Raises:
        PoseViewerError: it is none, or of fewer than two photos; a photo or a mask is not there, is
            there twice, or has another size than its camera says.
    """
    path, choice = Path(path), choice or SetChoice()
    reading = Reading(path, kind=KIND)
    with reading.naming_errors():
        loaded, unit, scale = _views(reading, choice)
        views = list(loaded)
        for wanted in choice.photos:
            if not any(_is_chosen(str(view.path), [wanted]) for view in views):
                raise reading.error(f"it has no photo {wanted}", "choose others with --photos")
        if len(views) < 2:
            found = f"{len(views)} photo{'' if len(views) == 1 else 's'}"
            raise reading.error(found, "a set has two or more; fit one photo without --views")
        _require_different(reading, views)
        return LoadedViews(path.name, with_names(views), unit, scale)


def with_names(views: Sequence[View]) -> tuple[View, ...]:
    """The views named by their files, with the folders where two would share a name."""
    paths = [view.path or Path(view.name) for view in views]
    names = [path.name for path in paths]
    if len(set(names)) < len(names):  # of folders, a camera each
        names = [f"{path.parent.name}/{path.name}" for path in paths]
    return tuple(replace(view, name=name) for view, name in zip(views, names, strict=True))


def open_view(record: ViewRecord) -> tuple[View, tuple[str, ...]]:
    """The view of a scene file, its photo undistorted; and what the user should know."""
    photo, size = load_photo(record.path), (record.photo.width, record.photo.height)
    if (photo.width, photo.height) != size:
        raise PoseFileError(
            f"{photo.name}: {photo.width}x{photo.height} px, and the scene is one for "
            f"{size[0]}x{size[1]} px; name the photo that it was made with."
        )
    notes = check_against(record.reference, photo.sha256)
    if record.undistortion is not None:
        photo = undistorted(photo, record.undistortion)
    mask = None if record.mask is None else load_mask(record.mask, *size)
    view = View(photo.name, photo, record.camera, record.place.rigid, mask, record.path)
    return view, notes


def _views(reading: Reading, choice: SetChoice) -> tuple[Iterable[View], str | None, float | None]:
    """The chosen photos, the unit of the set's lengths, and its scale."""
    path = reading.path
    if path.is_dir():
        for name in COLMAP_FOLDERS:
            if model_file(path / name, "images").is_file():
                return _of_colmap(reading, path / name, choice), None, None
        if (path / CAMERAS).is_file():
            return _of_bop(reading, choice), UNIT, None
        wanted = f"wanted COLMAP's model (images.bin or .txt) or a BOP scene ({CAMERAS})"
        raise reading.error("a folder without a set of photos", wanted)
    data = reading.load_object()
    if isinstance(data.get("frames"), list):
        return _of_frames(reading, data, choice), None, None
    if data.get("format") == SCENE:
        scene = load_scene(path)
        chosen = [view for view in scene.views if _is_chosen(view.photo.file, choice.photos)]
        scale = None if scene.free_scale or scene.unit else 1.0
        return [open_view(view)[0] for view in chosen], scene.unit, scale
    if data.get("format") != VIEWS:
        found = f"format is {kind_of(data.get('format'))}"
        raise reading.error(found, f"wanted {SCENE!r} or {VIEWS!r}, or nerfstudio's frames")
    reading.require_format(data, VIEWS)
    said = reading.decoded(data, SetFile, raw=("photo", "mask"))
    # The units tell the scale where it is left out; null says that it is not known.
    scale = said.scale if "scale" in data or said.unit is not None else 1.0
    return _of_version_1(reading, said, choice), said.unit, scale


def _of_version_1(reading: Reading, said: SetFile, choice: SetChoice) -> Iterator[View]:
    folder = reading.path.parent
    for entry in said.views:
        if _is_chosen(entry.photo, choice.photos):
            known, place, camera = entry.distortion, entry.camera_from_set.rigid, entry.camera
            lens = known.lens if known and any(known.coefficients) else None
            mask = None if entry.mask is None else folder / entry.mask
            path = folder / entry.photo
            pinhole = camera.perspective(0, 0)
            yield _view(reading, path, load_photo(path), place, pinhole, lens, mask)


def _of_colmap(reading: Reading, model: Path, choice: SetChoice) -> list[View]:
    taken = colmap_images(model)
    named = [image for image in taken if _is_chosen(image[0], choice.photos)]
    folders = [model / name for name in PHOTO_FOLDERS]
    folders = folders if choice.folder is None else [choice.folder]
    most = max(folders, key=lambda folder: sum(is_there(folder / image[0]) for image in named))
    missing = [image[0] for image in named if not is_there(most / image[0])]
    if missing:
        where = f"in {most}" if len(missing) < len(named) or choice.folder else "beside it"
        raise reading.error(
            f"{len(missing)} of the {len(named)} photos that it names are not {where}, such as "
            f"{missing[0]}",
            "name their folder with --photo-folder, or those that are there with --photos",
        )
    return [
        _view(reading, most / name, load_photo(most / name), place, camera, lens)
        for name, place, camera, lens in named
    ]


def _of_frames(reading: Reading, data: dict[str, Any], choice: SetChoice) -> Iterator[View]:
    for frame in data["frames"]:
        own = data | reading.object(frame, "a frame")
        name = reading.text(own.get("file_path"), "file_path") or ""
        if not _is_chosen(name, choice.photos):
            continue
        tried = [reading.path.parent / f"{name}{ending}" for ending in NERF_ENDINGS]
        path = next((path for path in tried if is_there(path)), tried[0])
        photo, sizes = load_photo(path), [reading.size(own.get(key), key) for key in ("w", "h")]
        width, height = sizes[0] or photo.width, sizes[1] or photo.height
        _, place, camera, lens = frame_taken(reading, own, width, height)
        yield _view(reading, path, photo, place, camera, lens)


def _of_bop(reading: Reading, choice: SetChoice) -> Iterator[View]:
    """Views by the scene's world; else by where the cameras see one of its objects."""
    folder = reading.path
    cameras, images = load_scene_file(folder / CAMERAS), load_bop_images(folder)
    own = replace(reading, path=folder / CAMERAS)
    for image in images:
        if not _is_chosen(image.photo, choice.photos):
            continue
        entry = next(v for key, v in cameras.items() if int(key) == image.number)
        if choice.rig_object is not None:
            poses = [pose for pose in image.objects if pose.object_id == choice.rig_object]
            if len(poses) != 1:
                if not choice.photos:
                    continue  # it is hidden there, or there are several
                raise own.error(
                    f"image {image.number} has {len(poses)} poses of object {choice.rig_object}",
                    f"wanted one in {POSES}, choose another with --rig-object",
                )
            place = poses[0].place
        elif all(name in entry for name in WORLD):
            rotation = own.flat_numbers(entry[WORLD[0]], WORLD[0], 9)
            rotation = checked_rotation(own, np.reshape(rotation, (3, 3)))
            place = RigidTransform(rotation, np.array(own.numbers(entry[WORLD[1]], WORLD[1])))
        else:
            raise own.error(
                f"image {image.number} has no {WORLD[0]}",
                "name an object that stands still, whose poses tell how the camera moved, with "
                "--rig-object",
            )
        path = folder / image.photo
        yield _view(reading, path, load_photo(path), place, image.camera)


def _is_chosen(name: str, photos: Sequence[str]) -> bool:
    """Whether a photo is one of those wanted, by its name with or without folders, by stem, or by
    number (BOP).
    """
    path = PurePosixPath(name)
    numbers = {str(int(path.stem))} if path.stem.isdecimal() else set()
    if not photos or not {path.stem, *numbers}.isdisjoint(photos):
        return True
    ends = tuple(PurePosixPath("/", wanted).as_posix() for wanted in photos)
    return any(f"/{whole}".endswith(ends) for whole in (path, path.with_suffix("")))


def _view(
    reading: Reading,
    path: Path,
    photo: Photo,
    place: RigidTransform,
    camera: Perspective,
    lens: Lens | None = None,
    mask: Path | None = None,
) -> View:
    """The view of a camera as taken, 0x0 px where its size is not said."""
    if not camera.width:
        camera = replace(camera, width=photo.width, height=photo.height)
    if (camera.width, camera.height) != (photo.width, photo.height):
        raise reading.error(
            f"the camera of {photo.name} is for {camera.width}x{camera.height} px, and the photo "
            f"has {photo.width}x{photo.height} px",
            "use the photos that the cameras were found with",
        )
    opened = replace(photo, camera=camera)
    if lens is not None:
        opened = undistorted(photo, Undistortion.of(lens, camera))
    weights = None if mask is None else load_mask(mask, photo.width, photo.height)
    return View(photo.name, opened, opened.camera or camera, place, weights, path)


def _require_different(reading: Reading, views: Sequence[View]) -> None:
    known: dict[str, str] = {}
    for view in views:
        if view.photo.sha256 in known:
            raise reading.error(
                f"{known[view.photo.sha256]} and {view.name} are one photo twice",
                "a set has each photo once, leave one of them out",
            )
        known[view.photo.sha256] = view.name
