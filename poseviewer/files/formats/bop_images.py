"""Whole BOP scenes: all their images, with cameras and poses, in; all their poses out.

The layout is that of ``bop_scene``, which has single poses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import PoseFileError
from poseviewer.files.camera.bop import bop_cameras
from poseviewer.files.formats.bop_scene import (
    entry_of,
    load_scene_file,
    scene_text,
    transform_of,
)
from poseviewer.files.pose.checks import Reading
from poseviewer.files.writing import write_whole
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.transform import RigidTransform

CAMERAS, POSES = "scene_camera.json", "scene_gt.json"
PHOTO_FOLDERS = ("rgb", "gray")
PHOTO_ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff")


@dataclass(frozen=True, slots=True, eq=False)
class BopObject:
    """An object in an image."""

    object_id: int
    place: RigidTransform
    """Camera from model, mm."""


@dataclass(frozen=True, slots=True, eq=False)
class BopImage:
    """One image of a scene."""

    number: int
    photo: str
    """Its file, from the scene's folder; where there is none, where it was looked for."""
    camera: Perspective
    """Pixel centres at i + 0.5; 0x0 px, since a scene does not say the size."""
    objects: tuple[BopObject, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class BopScene:
    """A scene's folder as it was read."""

    images: tuple[BopImage, ...]
    """By their numbers."""
    posed: bool
    """Whether there is a ``scene_gt.json``."""


def load_bop_images(folder: Path) -> BopScene:
    """All images of a scene that have a camera.

    Raises:
        PoseViewerError: it is no scene's folder, or a file in it is damaged.
    """
    if not (folder / CAMERAS).is_file():
        raise PoseFileError(
            f"{folder}: no {CAMERAS} in it; name a BOP scene's folder, such as test/000002."
        )
    posed = (folder / POSES).is_file()
    cameras, poses = (load_scene_file(folder / name) for name in (CAMERAS, POSES))
    photos = _photos(folder)
    images = []
    if not all(isinstance(entry, dict) and "cam_K" in entry for entry in cameras.values()):
        raise PoseFileError(f"{folder / CAMERAS}: an image without cam_K; is it a scene of BOP's?")
    for found in bop_cameras(CAMERAS, cameras) if cameras else ():
        number = _number(found.name)
        photo = photos.get(number, f"{PHOTO_FOLDERS[0]}/{number:06d}.png")
        entries = _objects(poses.get(found.name, []), found.name)
        images.append(BopImage(number, photo, found.camera, entries))
    if not images:
        raise PoseFileError(f"{folder / CAMERAS}: no image in it; wanted a camera for each image.")
    return BopScene(tuple(sorted(images, key=lambda image: image.number)), posed)


def save_bop_images(
    folder: Path,
    cameras: Mapping[str, Any],
    poses: Mapping[int, Sequence[BopObject]],
) -> None:
    """Write a scene's two files: the ``cameras`` as they are (the content of another scene's
    file), and the poses of each image by its number.

    Raises:
        PoseFileError: the folder cannot be written to.
    """
    entries = {
        str(number): [entry_of(found.object_id, found.place) for found in objects]
        for number, objects in poses.items()
    }
    for name, content in ((CAMERAS, dict(cameras)), (POSES, entries)):
        write_whole(folder / name, scene_text(content).encode(), PoseFileError)


def _photos(folder: Path) -> dict[int, str]:
    """The photos by their numbers, from the scene's folder."""
    for name in PHOTO_FOLDERS:
        found = {
            int(path.stem): f"{name}/{path.name}"
            for path in sorted((folder / name).glob("*"))
            if path.stem.isdecimal() and path.suffix.lower() in PHOTO_ENDINGS
        }
        if found:
            return found
    return {}


def _objects(entries: Any, image: str) -> tuple[BopObject, ...]:
    reading = Reading(POSES, [])
    if not isinstance(entries, list):
        raise reading.error(f"image {image} is not a list", "wanted a list of poses")
    found = []
    for number, value in enumerate(entries):
        what = f"pose {number} of image {image}"
        entry = reading.object(value, what)
        object_id = reading.number(entry.get("obj_id"), f"obj_id of {what}", positive=True)
        found.append(BopObject(int(object_id), transform_of(reading, entry, 1.0)))
    return tuple(found)


def _number(key: str) -> int:
    if not key.isdecimal():
        raise PoseFileError(f"{CAMERAS}: image {key[:40]!r}; wanted images' numbers.")
    return int(key)


def same_intrinsics(one: Perspective, other: Perspective) -> bool:
    """Whether two cameras are one, up to the rounding of files."""
    numbers = [[c.fx, c.fy, c.cx, c.cy] for c in (one, other)]
    return bool(np.allclose(*numbers, rtol=1e-9, atol=1e-9))
