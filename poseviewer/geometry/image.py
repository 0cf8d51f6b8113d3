"""A photo in memory, and the encoding of its colours."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import freeze_array
from poseviewer.geometry.camera import DEFAULT_FIELD_OF_VIEW_DEG, Camera, Parallel, Perspective
from poseviewer.geometry.lens import STRIP_PIXELS, Undistortion

ASSUMED_FOCAL = "The focal length is assumed"
"""Beginning of the note on a focal length that had to be assumed."""
GREY_WEIGHTS = freeze_array([0.299, 0.587, 0.114], (3,))
"""RGB to grey (ITU-R BT.601), display-encoded, for photo and reflectance alike."""


@dataclass(frozen=True, slots=True, eq=False)
class Photo:
    """A photo, upright, in its file's own 8 or 16 bits: as floats it may fill the memory."""

    pixels: NDArray[np.uint8] | NDArray[np.uint16]
    """(height, width, channels): grey (1) or RGB (3), display-encoded, read-only."""
    name: str
    """The file's name, without its folder."""
    sha256: str
    """Hash of the file's bytes, hexadecimal."""
    focal_length_35mm: float | None = None
    """From EXIF: 35-mm-equivalent focal length, mm."""
    notes: tuple[str, ...] = ()
    """Notes for the user on how the file was read."""
    camera: Perspective | None = None
    """The calibrated camera of these pixels; None where it is not known."""
    undistortion: Undistortion | None = None
    """Map from these pixels to the file's; None: they are the file's."""
    covered: NDArray[np.bool_] | None = None
    """(height, width): where the undistorted photo shows anything; None: everywhere."""

    @property
    def label(self) -> str:
        """The file's name, and whether the photo is undistorted."""
        return self.name if self.undistortion is None else f"{self.name}, undistorted"

    @property
    def width(self) -> int:
        """Width, px."""
        return self.pixels.shape[1]

    @property
    def height(self) -> int:
        """Height, px."""
        return self.pixels.shape[0]

    def as_float(self) -> NDArray[np.float32]:
        """Return (height, width, 3) RGB in [0, 1]."""
        scaled = self.pixels * np.float32(1.0 / np.iinfo(self.pixels.dtype).max)
        return scaled if scaled.shape[2] == 3 else np.repeat(scaled, 3, axis=2)

    def as_rgb8(self, width: int, height: int) -> NDArray[np.uint8]:
        """Return (height, width, 3) RGB of 8 bits, for display, averaged down to the size."""
        pixels = self.pixels
        if pixels.dtype == np.uint16:
            pixels = np.right_shift(pixels, 8).astype(np.uint8)
        if (width, height) != (self.width, self.height):
            pixels = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
        pixels = np.asarray(pixels, np.uint8).reshape(height, width, -1)
        return pixels if pixels.shape[2] == 3 else np.repeat(pixels, 3, axis=2)

    def grey(self) -> NDArray[np.float32]:
        """Return (height, width) in [0, 1]."""
        top = np.float32(1.0 / np.iinfo(self.pixels.dtype).max)
        if self.pixels.shape[2] == 1:
            return self.pixels[..., 0] * top
        weights = top * GREY_WEIGHTS[None].astype(np.float32)
        grey = np.empty(self.pixels.shape[:2], np.float32)
        rows = max(1, STRIP_PIXELS // self.width)
        for start in range(0, self.height, rows):
            strip = self.pixels[start : start + rows].astype(np.float32)
            grey[start : start + rows] = cv2.transform(strip, weights).reshape(-1, self.width)
        return grey

    def default_camera(self) -> Perspective:
        """Return the calibrated camera, else EXIF's, else the one of the default field of view."""
        if self.camera is not None:
            return self.camera
        size = self.width, self.height
        if self.focal_length_35mm is not None:
            return Perspective.from_focal_length_35mm(self.focal_length_35mm, *size)
        return Perspective.from_field_of_view(DEFAULT_FIELD_OF_VIEW_DEG, *size)

    def focal_note(self, camera: Camera) -> str:
        """Return a sentence on a focal length that had to be assumed, else ""."""
        known = self.camera is not None or self.focal_length_35mm is not None
        if known or isinstance(camera, Parallel) or camera.fx != self.default_camera().fx:
            return ""
        return (
            f"{ASSUMED_FOCAL} (a view of {DEFAULT_FIELD_OF_VIEW_DEG:g} degrees), and "
            "with it the distance: a calibration, six point pairs or `free_focal` tell them."
        )


def srgb_from_linear(linear: NDArray) -> NDArray:
    """Encode linear colours for display, both in [0, 1] (IEC 61966-2-1)."""
    linear = np.clip(linear, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def linear_from_srgb(colours: NDArray) -> NDArray:
    """Decode display-encoded colours to linear ones, both in [0, 1]."""
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
