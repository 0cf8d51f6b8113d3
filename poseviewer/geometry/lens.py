"""Lens distortion in OpenCV's models, and the pictures that a pinhole would have taken instead.

Rays are ``(x, y)`` on the plane z = 1 of the camera frame. A lens moves them before the pinhole's
``u = fx x + cx``: https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html and, for the fisheye,
https://docs.opencv.org/4.x/db/d58/group__calib3d__fisheye.html.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.frames import AnyCamera, camera_as_integer_centres

LensModel = Literal["opencv", "fisheye"]
COEFFICIENTS: dict[LensModel, tuple[int, ...]] = {"opencv": (4, 5, 8, 12, 14), "fisheye": (4,)}
"""Counts of coefficients by model: k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]]; or the
fisheye's k1 k2 k3 k4."""
STRIP_PIXELS = 1 << 20
"""Pixels that are processed at a time: floats of all of a large photo would take gigabytes."""
MAX_SIDE_PX = 32766
"""Largest side of a photo: OpenCV's ``remap`` counts pixels in 16 bits."""
FIELD_SAMPLES = 4096
"""Radii at which the radial part is evaluated to see where it turns back."""
CAMERA_TOLERANCE = 1e-9
"""Relative difference of equal cameras: files round cx and cy in their last digit."""


@dataclass(frozen=True, slots=True)
class Lens:
    """Distortion of a lens."""

    model: LensModel
    coefficients: tuple[float, ...]
    """Coefficients in OpenCV's order, as many as ``COEFFICIENTS`` allows."""

    def __post_init__(self) -> None:
        if len(self.coefficients) not in COEFFICIENTS[self.model]:
            raise ValueError(f"{len(self.coefficients)} coefficients")

    @classmethod
    def of(cls, model: LensModel, coefficients: Sequence[float]) -> Lens | None:
        """Make the lens with these coefficients; None where nothing is distorted.

        A fisheye distorts even where all its coefficients are 0.
        """
        is_pinhole = not any(coefficients) and model == "opencv"
        return None if is_pinhole else cls(model, tuple(coefficients))

    @property
    def array(self) -> FloatArray:
        """The coefficients as OpenCV takes them."""
        return np.array(self.coefficients, dtype=float)

    @property
    def module(self) -> Any:
        """OpenCV's module of this model's functions."""
        return cv2.fisheye if self.model == "fisheye" else cv2


@dataclass(frozen=True, slots=True)
class Undistortion:
    """Map from a photo as taken to the picture that a pinhole camera would have taken there."""

    lens: Lens
    taken: Perspective
    """The camera of the photo as taken, without its lens; pixel centres at i + 0.5."""
    camera: Perspective
    """The pinhole camera of the undistorted photo."""

    @classmethod
    def of(cls, lens: Lens, taken: Perspective) -> Undistortion:
        """Make the map to a picture of the same size, principal point and focal length."""
        return cls(lens, taken, taken)


UPRIGHT = 1
"""EXIF's orientation of pixels that are stored as they are shown."""
MIRRORED = (2, 4, 5, 7)
"""Orientations that are no rotation. Above 4, width and height change places."""
WAY_BACK = {**{number: number for number in range(1, 9)}, 6: 8, 8: 6}
"""Inverses of orientations."""


def turn_axes(orientation: int) -> FloatArray:
    """Return the matrix (3, 3) from camera axes of stored pixels to those of upright ones."""
    flipped = orientation in (2, 3, 6, 7), orientation in (3, 4, 7, 8), False
    return np.diag(np.where(flipped, -1.0, 1.0))[:, [1, 0, 2] if orientation > 4 else [0, 1, 2]]


def rotate_camera(camera: AnyCamera, orientation: int) -> AnyCamera:
    """Return the camera (pixel centres at i + 0.5) of a picture turned by EXIF's orientation."""
    axes, size = turn_axes(orientation)[:2, :2], np.array([camera.width, camera.height]) / 2.0
    cx, cy = axes @ (np.array([camera.cx, camera.cy]) - size) + np.abs(axes) @ size
    changes: dict[str, Any] = {"cx": float(cx), "cy": float(cy)}
    if orientation > 4:
        changes |= {"width": camera.height, "height": camera.width}
        if isinstance(camera, Perspective):
            changes |= {"fx": camera.fy, "fy": camera.fx}
    return replace(camera, **changes)


def rotate_lens(lens: Lens, orientation: int) -> Lens:
    """Return the lens of a picture turned by EXIF's orientation.

    Raises:
        ValueError: the sensor is tilted and not turned by 180 degrees, which OpenCV cannot express.
    """
    k, axes = lens.array, turn_axes(orientation)[:2, :2]
    if lens.model == "fisheye" or orientation == UPRIGHT:
        return lens
    for x, y in ((3, 2), (8, 10), (9, 11)):  # p2 and p1, s1 and s3, s2 and s4 are vectors
        if y < len(k):
            k[[x, y]] = axes @ k[[x, y]]
    if k[12:].any() and orientation != 3:
        raise ValueError("a tilted sensor")
    k[12:] *= -1.0
    return Lens(lens.model, tuple(k.tolist()))


def same_undistortion(first: Undistortion | None, second: Undistortion | None) -> bool:
    """Tell whether two maps give the same picture, up to the rounding of files."""
    if first is None or second is None:
        return first is second
    if first.lens != second.lens:
        return False
    pairs = ((first.taken, second.taken), (first.camera, second.camera))
    return all(np.allclose(astuple(a), astuple(b), rtol=CAMERA_TOLERANCE) for a, b in pairs)


def undistort(pixels: NDArray, undistortion: Undistortion) -> tuple[NDArray, NDArray[np.bool_]]:
    """Undistort pixels (height, width, channels); returns where (height, width) it is not black."""
    camera, taken = undistortion.camera, undistortion.taken
    picture = np.zeros((camera.height, camera.width, pixels.shape[2]), pixels.dtype)
    covered = np.zeros(picture.shape[:2], bool)
    limit = _field_limit(undistortion)
    rows = max(1, STRIP_PIXELS // camera.width)
    for start in range(0, camera.height, rows):
        strip = camera.crop(0, start, (camera.width, min(rows, camera.height - start)))
        matrices = opencv_matrix(taken), undistortion.lens.array, np.eye(3), opencv_matrix(strip)
        size = strip.width, strip.height
        u, v = undistortion.lens.module.initUndistortRectifyMap(*matrices, size, cv2.CV_32FC1)
        shown = (u >= -0.5) & (u <= taken.width - 0.5) & (v >= -0.5) & (v <= taken.height - 0.5)
        shown &= _radii(strip) < limit
        part = slice(start, start + strip.height)
        drawn = cv2.remap(pixels, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        picture[part] = np.where(shown[..., None], drawn.reshape(*shown.shape, -1), 0)
        covered[part] = shown
    return picture, covered


def _radii(camera: Perspective) -> NDArray[np.float32]:
    """Return (height, width): the distance of each viewing ray from the optical axis at z = 1."""
    x = (np.arange(camera.width, dtype=np.float32) + 0.5 - camera.cx) / camera.fx
    y = (np.arange(camera.height, dtype=np.float32) + 0.5 - camera.cy) / camera.fy
    return np.hypot(x[None], y[:, None]).astype(np.float32)


def _field_limit(undistortion: Undistortion) -> float:
    """Find the radius at z = 1 beyond which the radial part turns back and shows things twice."""
    camera, coefficients = undistortion.camera, undistortion.lens.array
    if undistortion.lens.model == "opencv":
        coefficients[2:4], coefficients[8:] = 0.0, 0.0
    size = camera.width, camera.height
    corners = camera.rays([(0, 0), (size[0], 0), (0, size[1]), size])
    radii = np.linspace(0.0, float(np.linalg.norm(corners[:, :2], axis=1).max()), FIELD_SAMPLES)
    rays = np.stack([radii, np.zeros_like(radii), np.ones_like(radii)], axis=-1)[:, None]
    identity = np.zeros(3), np.zeros(3), np.eye(3)
    distorted = undistortion.lens.module.projectPoints(rays, *identity, coefficients)[0]
    turns_back = np.diff(distorted[:, 0, 0]) <= 0.0
    return float(radii[np.argmax(turns_back)]) if turns_back.any() else np.inf


def opencv_matrix(camera: Perspective) -> FloatArray:
    """Return OpenCV's camera matrix (3, 3), which counts from pixel centres."""
    camera = camera_as_integer_centres(camera)
    return np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
