"""Real photos to put behind a rendered car."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import PhotoFileError
from poseviewer.files.demo import demo_case
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo.load import load_photo
from poseviewer.files.pose.file import load_pose
from poseviewer.render.software.renderer import SoftwareRenderer

ENDINGS = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp")
MARGIN_PX, REACH_PX = (81, 141), 5
"""Width and height of the ellipse by which the demo's car is widened before its photo is painted
over, and how far the painter looks."""


def load_backgrounds(folder: Path | None) -> Sequence[NDArray[np.uint8]]:
    """(h, w, 3) RGB each: the photos of a folder by name, or the bundled one without its car.

    Raises:
        PhotoFileError: there is no photo in the folder, or one cannot be read.
    """
    if folder is None:
        return [_demo_without_its_car()]
    found = sorted(path for path in background_files(folder))
    return [_rgb8(path) for path in found]


def background_files(folder: Path) -> list[Path]:
    """The photos in a folder, by name.

    Raises:
        PhotoFileError: there is none.
    """
    if not folder.is_dir():
        raise PhotoFileError(f"{folder}: is no folder; name one of photos for --backgrounds")
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in ENDINGS)
    if not found:
        raise PhotoFileError(f"{folder}: holds no photo; name a folder that does")
    return found


def _rgb8(path: Path) -> NDArray[np.uint8]:
    photo = load_photo(path)
    return photo.as_rgb8(photo.width, photo.height)


def _demo_without_its_car() -> NDArray[np.uint8]:
    """Half as large; where the car was, its surroundings go on smoothly."""
    case = demo_case()
    picture = _rgb8(case.photo)
    height, width = picture.shape[:2]
    truth = load_pose(case.truth, width, height).pose
    covered = SoftwareRenderer(load_mesh(case.model)).covers(truth).astype(np.uint8)
    # With its shadow, which lies around and below it.
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, MARGIN_PX)
    covered = cv2.dilate(covered, disc)
    half = width // 2, height // 2
    small = cv2.resize(picture, half, interpolation=cv2.INTER_AREA)
    hole = cv2.resize(covered, half, interpolation=cv2.INTER_NEAREST)
    return np.asarray(cv2.inpaint(small, hole, REACH_PX, cv2.INPAINT_TELEA), np.uint8)
