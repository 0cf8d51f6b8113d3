"""Sets of photos whose cameras know their poses to one another: our own JSON
(``view_set.schema.json``), COLMAP's models, ``transforms.json`` of nerfstudio and NeRF, BOP scenes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from poseviewer.errors import PhotoFileError
from poseviewer.files.cameras import lens_of
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
from poseviewer.files.masks import load_mask, mask_as_png, mask_path
from poseviewer.files.mesh.named import bare_name
from poseviewer.files.photo import load_photo, undistorted
from poseviewer.files.pose import (
    MODELS,
    PoseRecord,
    camera_from_json,
    record_as_json,
    save_pose,
    transform_as_json,
    transform_from_json,
)
from poseviewer.files.writing import write_whole
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.symmetry import NO_SYMMETRY, Symmetry
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_set import View, ViewSet

FORMAT = "poseviewer-views"
KIND = "set of photos"
COLMAP_FOLDERS = ("", "sparse/0", "sparse")
"""Where a project's model is."""
PHOTO_FOLDERS = ("", "images", "../images", "../../images", "..", "../..")
"""Where its photos are, from the model's folder."""
NERF_ENDINGS = ("", ".png", ".jpg", ".jpeg")
"""NeRF's own sets leave them out."""
OF_VIEW = (
    *("photo", "projection", "camera", "distortion", "camera_from_model", "loss", "unexplained"),
    *("seen", "verdict"),
)
"""What a pose file says of each photo of a set."""


@dataclass(frozen=True, slots=True)
class SetChoice:
    """What a set's file does not say."""

    photos: tuple[str, ...] = ()
    """Which of its photos, by their files' names, with or without ending; empty: all."""
    folder: Path | None = None
    """Of COLMAP's photos; None: looked for beside the model."""
    rig_object: int | None = None
    """The object of a BOP scene whose annotations tell how the cameras moved, where the scene does
    not say it."""


@dataclass(frozen=True, slots=True)
class _Shot:
    """A photo of a set before it is read."""

    path: Path
    camera_from_set: RigidTransform
    camera: Perspective | dict[str, Any]
    """As taken, 0x0 px where the size is not said; or what is to be read for the photo's size."""
    lens: Lens | None = None
    mask: Path | None = None


def load_view_set(path: str | Path, choice: SetChoice | None = None) -> ViewSet:
    """The set in a file or a folder, with its photos, undistorted.

    Raises:
        PoseViewerError: it is none, or of fewer than two photos; a photo or a mask is not there, is
            there twice, or has another size than its camera says.
    """
    path, choice = Path(path), choice or SetChoice()
    reading = Reading(path, kind=KIND)
    with reading.naming_errors():
        shots, unit, scale = _shots(reading, choice)
        shots = _chosen(reading, shots, choice.photos)
        views = [_view(reading, shot) for shot in shots]
        _require_different(reading, views)
        names = [shot.path.name for shot in shots]
        if len(set(names)) < len(names):  # of folders, a camera each
            names = [f"{shot.path.parent.name}/{shot.path.name}" for shot in shots]
        named = tuple(replace(one, name=name) for one, name in zip(views, names, strict=True))
        return ViewSet(path.name, named, unit, scale)


def set_as_json(
    views: ViewSet,
    records: Sequence[PoseRecord],
    scale: float,
    free_size: bool,
    symmetry: Symmetry,
) -> dict[str, Any]:
    """What the pose file of the first view says of the set: the pose in its frame, by ``scale``,
    and in each view, all of them the equal one that is written.
    """
    place, size = records[0].pose.camera_from_model, 1.0 / scale
    equal = symmetry.canonical(records[0].pose).camera_from_model
    turn, entries = place.inverse() @ equal, []
    for view, record in zip(views.views, records, strict=True):
        pose = replace(record.pose, camera_from_model=record.pose.camera_from_model @ turn)
        said = record_as_json(replace(record, pose=pose, symmetry=NO_SYMMETRY))
        entries.append({"name": view.name, **{key: said[key] for key in OF_VIEW if key in said}})
    scaled = RigidTransform(equal.rotation, size * equal.translation)
    set_from_model = transform_as_json(views.views[0].camera_from_set.inverse() @ scaled)
    return {
        "file": views.name,
        **({} if views.unit is None else {"unit": views.unit}),
        "set_from_model": {"size": size, "size_was_free": free_size, **set_from_model},
        "views": entries,
    }


def with_masks(
    path: Path, record: PoseRecord, masks: Mapping[str, Mask]
) -> tuple[PoseRecord, dict[Path, bytes]]:
    """A set's pose file at ``path`` that names a mask for each photo that has one, by the photos'
    names, and what lies in these files beside it: ``car.b.mask.png`` for photo ``b.jpg`` and
    ``car.pose.json``.
    """
    beside, entries, files = mask_path(path), [], {}
    assert record.in_set is not None  # it is a set's
    for entry in record.in_set["views"]:
        mask = masks.get(entry["name"])
        if mask is not None:
            photo = PurePosixPath(entry["name"]).with_suffix("").as_posix().replace("/", "-")
            name = f"{beside.name.removesuffix('.mask.png')}.{photo}.mask.png"
            files[beside.with_name(name)] = mask_as_png(mask)
            entry = {**entry, "mask": name}
        entries.append(entry)
    in_set = {**record.in_set, "views": entries}
    return replace(record, mask=entries[0].get("mask"), in_set=in_set), files


def save_in_set(path: Path, record: PoseRecord, masks: Mapping[str, Mask]) -> None:
    """Write a set's pose file and the masks of its photos; each whole or not at all.

    Raises:
        PoseViewerError: the folder is missing or cannot be written to.
    """
    record, files = with_masks(path, record, masks)
    for beside, content in files.items():
        write_whole(beside, content, PhotoFileError)
    save_pose(path, record)


def recorded_masks(path: Path, record: PoseRecord, views: ViewSet) -> dict[int, Mask]:
    """The masks that a set's pose file names, by the numbers of the photos.

    Raises:
        PhotoFileError: one is missing, or of another size than its photo.
    """
    entries = (record.in_set or {}).get("views")
    named = {
        entry.get("name"): entry.get("mask")
        for entry in (entries if isinstance(entries, list) else ())
        if isinstance(entry, dict)
    }
    found = {}
    for index, view in enumerate(views.views):
        name = named.get(view.name)
        if isinstance(name, str):
            size = view.photo.width, view.photo.height
            found[index] = load_mask(path.parent / bare_name(name), *size)
    return found


def _shots(reading: Reading, choice: SetChoice) -> tuple[list[_Shot], str | None, float | None]:
    """The photos, the unit of the set's lengths, and its scale."""
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
    if data.get("format") != FORMAT:
        found = f"format is {kind_of(data.get('format'))}"
        raise reading.error(found, f"wanted {FORMAT!r}, or nerfstudio's frames")
    reading.require_format(data, FORMAT)
    unit, scale = reading.text(data.get("unit"), "unit"), data.get("scale", 1.0)
    if "scale" not in data and unit is not None:
        scale = None  # the units tell it
    scale = None if scale is None else reading.positive(scale, "scale")
    return _of_views(reading, data), unit, scale


def _of_views(reading: Reading, data: dict[str, Any]) -> list[_Shot]:
    entries = data.get("views")
    if not isinstance(entries, list):
        raise reading.error(f"views is {kind_of(entries)}", "wanted a list of photos")
    found = []
    for number, entry in enumerate(entries):
        own = replace(reading, path=Path(f"{reading.path.name}, views[{number}]"))
        photo, mask = own.fields(entry, "", photo=Reading.text, mask=Reading.text)
        if not photo:
            raise own.error("photo is missing", "wanted the name of a file")
        place, folder = transform_from_json(own, entry, "camera_from_set"), reading.path.parent
        lens, distortion = None, entry.get("distortion")
        if distortion is not None:
            model = own.object(distortion, "distortion").get("model")
            if model not in MODELS:
                wanted = " or ".join(map(repr, MODELS))
                raise own.error(f"distortion.model is {kind_of(model)}", f"wanted {wanted}")
            numbers = own.flat_numbers(distortion.get("coefficients"), "distortion.coefficients")
            lens = lens_of(own, MODELS[model], numbers)
        said = {"projection": "perspective", "camera": own.object(entry.get("camera"), "camera")}
        mask_file = None if mask is None else folder / mask
        found.append(_Shot(folder / photo, place, said, lens, mask_file))
    return found


def _of_colmap(reading: Reading, model: Path, choice: SetChoice) -> list[_Shot]:
    taken = colmap_images(model)
    named = [one for one in taken if _is_chosen(one[0], choice.photos)]
    folders = [model / name for name in PHOTO_FOLDERS]
    folders = folders if choice.folder is None else [choice.folder]
    most = max(folders, key=lambda folder: sum(is_there(folder / one[0]) for one in named))
    missing = [one[0] for one in named if not is_there(most / one[0])]
    if missing:
        where = f"in {most}" if len(missing) < len(named) or choice.folder else "beside it"
        raise reading.error(
            f"{len(missing)} of the {len(named)} photos that it names are not {where}, such as "
            f"{missing[0]}",
            "name their folder with --photo-folder, or those that are there with --photos",
        )
    return [_Shot(most / name, place, camera, lens) for name, place, camera, lens in named]


def _of_frames(reading: Reading, data: dict[str, Any], choice: SetChoice) -> list[_Shot]:
    found = []
    for frame in data["frames"]:
        own = data | reading.object(frame, "a frame")
        name = reading.text(own.get("file_path"), "file_path") or ""
        if not _is_chosen(name, choice.photos):
            continue
        path = _of_frame(reading.path, name)
        place = frame_taken(reading, {"fl_x": 1.0, "cx": 0.0, "cy": 0.0, **own}, 1, 1)[1]
        found.append(_Shot(path, place, own))
    return found


def _of_frame(path: Path, name: str) -> Path:
    """The photo that a ``transforms.json`` calls so, there or not."""
    tried = [path.parent / f"{name}{ending}" for ending in NERF_ENDINGS]
    return next((path for path in tried if is_there(path)), tried[0])


def _of_bop(reading: Reading, choice: SetChoice) -> list[_Shot]:
    """By the scene's world; else by where the cameras see one of its objects."""
    folder = reading.path
    cameras, images = load_scene_file(folder / CAMERAS), load_bop_images(folder)
    own = replace(reading, path=folder / CAMERAS)
    found = []
    for image in images:
        if not _is_chosen(image.photo, choice.photos):
            continue
        entry = next(v for key, v in cameras.items() if int(key) == image.number)
        if choice.rig_object is not None:
            places = [one.place for one in image.objects if one.object_id == choice.rig_object]
            if len(places) != 1:
                if not choice.photos:
                    continue  # it is hidden there, or there are several
                raise own.error(
                    f"image {image.number} has {len(places)} poses of object {choice.rig_object}",
                    f"wanted one in {POSES}, choose another with --rig-object",
                )
            place = places[0]
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
        found.append(_Shot(folder / image.photo, place, image.camera))
    return found


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


def _chosen(reading: Reading, shots: list[_Shot], photos: Sequence[str]) -> list[_Shot]:
    for wanted in photos:
        if not any(_is_chosen(shot.path.as_posix(), [wanted]) for shot in shots):
            raise reading.error(f"it has no photo {wanted}", "choose others with --photos")
    shots = [shot for shot in shots if _is_chosen(shot.path.as_posix(), photos)]
    if len(shots) < 2:
        found = f"{len(shots)} photo{'' if len(shots) == 1 else 's'}"
        raise reading.error(found, "a set has two or more; fit one photo without --views")
    return shots


def _view(reading: Reading, shot: _Shot) -> View:
    photo = load_photo(shot.path)
    camera, lens = shot.camera, shot.lens
    if isinstance(camera, dict) and "projection" in camera:
        camera = camera_from_json(reading, camera, photo.width, photo.height)
        assert isinstance(camera, Perspective)  # as it says
    elif isinstance(camera, dict):
        sizes = [reading.size(camera.get(key), key) for key in ("w", "h")]
        width, height = sizes[0] or photo.width, sizes[1] or photo.height
        _, _, camera, lens = frame_taken(reading, camera, width, height)
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
    mask = None if shot.mask is None else load_mask(shot.mask, photo.width, photo.height)
    return View(photo.name, opened, shot.camera_from_set, mask, shot.path)


def _require_different(reading: Reading, views: Sequence[View]) -> None:
    known: dict[str, str] = {}
    for view in views:
        if view.photo.sha256 in known:
            raise reading.error(
                f"{known[view.photo.sha256]} and {view.name} are one photo twice",
                "a set has each photo once, leave one of them out",
            )
        known[view.photo.sha256] = view.name
