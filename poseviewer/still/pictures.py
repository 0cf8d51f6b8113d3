"""Pictures of a still scene, read one at a time, and what is found of each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from poseviewer.errors import PoseViewerError
from poseviewer.files.photo import load_photo
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.frames import points_from_integer_centres
from poseviewer.geometry.lens import Lens, Undistortion, opencv_matrix
from poseviewer.geometry.transform import RigidTransform

Tell = Callable[[str], object]
"""Takes a line on how far the work is."""
Grey = NDArray[np.uint8]
ENOUGH = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
"""Iterations and change at which the inverse of a lens is exact; OpenCV's own are too few."""
MIN_PICTURES = 2
"""Pictures without which nothing tells how a camera moved."""


@dataclass(frozen=True, slots=True)
class Placed:
    """A picture whose camera was found."""

    camera: Perspective
    """Pixel centres at i + 0.5."""
    undistortion: Undistortion | None
    """From the picture as taken; None: it has no lens."""
    camera_from_world: RigidTransform
    residual_px: float
    """Median distance of what was seen from where the camera would show it."""


@dataclass(frozen=True, slots=True)
class Placement:
    """Cameras of pictures, by the pictures' indices, and why others have none."""

    placed: dict[int, Placed]
    left_out: dict[int, str]
    """Reasons."""
    sha256s: dict[int, str]
    focals_px: dict[int, float]
    """Focal lengths that EXIF says, px."""
    unit_known: bool = False
    """Whether the world's lengths are those of a length that was given."""
    notes: tuple[str, ...] = ()


@dataclass
class Pictures:
    """Pictures of one camera, or of a camera each size and focal length of EXIF."""

    paths: Sequence[Path]
    known: Perspective | Undistortion | None = None
    """The camera, with its lens; None: found with the others."""
    left_out: dict[int, str] = field(default_factory=dict)
    sha256s: dict[int, str] = field(default_factory=dict)
    focals_px: dict[int, float] = field(default_factory=dict)
    cameras: list[Perspective] = field(default_factory=list)
    """A guess each, by EXIF or the default field of view, unless it is ``known``."""
    camera_of: dict[int, int] = field(default_factory=dict)
    """Index of each picture's camera."""

    def read(self, index: int) -> Grey | None:
        """Return a picture (height, width), upright; None: it is left out, with the reason."""
        path = self.paths[index]
        try:
            photo = load_photo(path)
        except PoseViewerError as error:
            self.left_out[index] = str(error).removeprefix(f"{path.name}: ").rstrip(".")
            return None
        size = photo.width, photo.height
        same = next((at for at, own in self.sha256s.items() if own == photo.sha256), index)
        if same != index:
            self.left_out[index] = f"the same picture as {self.paths[same].name}"
            return None
        known = self.known.taken if isinstance(self.known, Undistortion) else self.known
        if known is not None and (known.width, known.height) != size:
            wanted = f"the camera is for {known.width}x{known.height}"
            self.left_out[index] = f"{size[0]}x{size[1]} px, and {wanted}"
            return None
        self.sha256s[index] = photo.sha256
        guess = photo.default_camera()
        if photo.focal_length_35mm is not None:
            self.focals_px[index] = guess.fx
        own = known or guess
        if own not in self.cameras:
            self.cameras.append(own)
        self.camera_of[index] = self.cameras.index(own)
        return np.rint(255.0 * photo.grey()).astype(np.uint8)

    def straighten(self, pixels: ArrayLike) -> FloatArray:
        """Return points (n, 2) of a picture as taken, OpenCV's pixels, where a pinhole would show
        them, pixel centres at i + 0.5; where the lens is not known, as taken.
        """
        pixels = np.asarray(pixels, float).reshape(-1, 2)
        if isinstance(self.known, Undistortion) and len(pixels):
            lens, matrix = self.known.lens, opencv_matrix(self.known.camera)
            taken = opencv_matrix(self.known.taken)
            undone = lens.module.undistortPoints(
                pixels[:, None], taken, lens.array, P=matrix, criteria=ENOUGH
            )
            pixels = np.asarray(undone, float)[:, 0]
        return points_from_integer_centres(pixels)

    @property
    def pinhole(self) -> Perspective | None:
        """The known camera, as of ``straighten``."""
        return self.known.camera if isinstance(self.known, Undistortion) else self.known

    def placed(
        self, camera: Perspective, coefficients: Sequence[float],
        camera_from_world: RigidTransform, residual_px: float,
    ) -> Placed:  # fmt: skip
        """Return what was found of a picture.

        Args:
            camera: pixel centres at i + 0.5.
            coefficients: OpenCV's first ones of the lens, at most four; not of the known one.
            camera_from_world: pose of the world.
            residual_px: median residual.
        """
        lens = Lens.of("opencv", (*coefficients, 0.0, 0.0, 0.0, 0.0)[:4])
        undone = None if lens is None else Undistortion.of(lens, camera)
        known = self.known if isinstance(self.known, Undistortion) else None
        return Placed(camera, known or undone, camera_from_world, residual_px)


def resized(grey: Grey, longest: int) -> tuple[Grey, FloatArray]:
    """Return a picture of up to ``longest`` px a side, and its px (2,) in one of the original's."""
    scale = min(1.0, longest / max(grey.shape))
    if scale == 1.0:
        return grey, np.ones(2)
    size = [max(1, round(side * scale)) for side in grey.shape[::-1]]
    small = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)
    return small, np.divide(size, grey.shape[::-1])
