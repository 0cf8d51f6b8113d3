"""Pyramid levels of a photo: the same poses on fewer, larger pixels and triangles."""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.camera import Pose, level_pose, level_size
from poseviewer.render.attributes import PhotoAttributes, Renderer
from poseviewer.render.structure import bounding_slices, make_structure

MAX_FACTOR = 16
"""Factor by which a photo is reduced, at most: beyond it, little is left of its edges."""
FACES_PER_PIXEL = 1.0
"""Triangles for each pixel that the model covers: half of a closed surface faces the camera."""
STRIP_PIXELS = 1_000_000
"""Pixels of a photo that are averaged at a time: all of a large photo would take gigabytes."""


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """A photo reduced ``factor`` times along each side, and a renderer of a model to match."""

    factor: int
    photo: PhotoAttributes
    renderer: Renderer
    """Renderer for one thread at a time."""


def make_level(photo: PhotoAttributes, renderer: Renderer, factor: int, pixels: float) -> Level:
    """Make a level of a photo, with a model decimated to match.

    Args:
        photo: the photo, in which the model covers ``pixels``.
        renderer: renderer of the model.
        factor: factor by which the photo is reduced.
        pixels: number of pixels that the model covers.
    """
    # Powers of 2, so that poses near by use the same model.
    needed = max(FACES_PER_PIXEL * pixels / factor**2, 1.0)
    faces = 1 << math.ceil(math.log2(needed))
    return Level(factor, downsample(photo, factor), renderer.decimate(faces))


def lighter_level(photo: PhotoAttributes, renderer: Renderer, pose: Pose) -> Level:
    """Return the photo as it is, with half as many triangles as the model has pixels."""
    return make_level(photo, renderer, 1, int(_counting(photo, renderer, pose).sum()) / 2)


def coarsest_level(
    photo: PhotoAttributes, renderer: Renderer, pose: Pose, min_pixels: float
) -> Level:
    """Make the coarsest level, by a power of 2, at which the model still covers enough pixels.

    Args:
        photo: the photo; with a factor of 1 it is returned as it is, with the renderer.
        renderer: renderer of the model.
        pose: pose of the model.
        min_pixels: number of pixels that the model must cover.
    """
    pixels, factor = int(_counting(photo, renderer, pose).sum()), 1
    while factor < MAX_FACTOR and pixels / (2 * factor) ** 2 >= min_pixels:
        factor *= 2
    return Level(1, photo, renderer) if factor == 1 else make_level(photo, renderer, factor, pixels)


def model_mask(photo: PhotoAttributes, renderer: Renderer, pose: Pose) -> NDArray[np.bool_]:
    """(height, width): draw the pixels of a level that show the model."""
    return renderer.render_mask(level_pose(pose, photo.factor))


def visible_fraction(photo: PhotoAttributes, renderer: Renderer, pose: Pose) -> float:
    """Return the fraction of the model's pixels that count, in [0, 1]; 0 out of sight."""
    counting = _counting(photo, renderer, pose)
    return float(counting.mean()) if len(counting) else 0.0


def _counting(photo: PhotoAttributes, renderer: Renderer, pose: Pose) -> NDArray[np.bool_]:
    """(N,): whether the pixels that show the model count."""
    return photo.weights[model_mask(photo, renderer, pose)] > 0.0


def downsample(photo: PhotoAttributes, factor: int) -> PhotoAttributes:
    """Reduce a photo ``factor`` times along each side by weighted means; poses stay the same.

    Pixels beyond the photo have weight 0. The weights are averaged without weights.
    """
    if factor == 1:
        return photo
    height, width, n = photo.channels.shape
    rows, columns = level_size(height, factor), level_size(width, factor)
    weights = np.zeros((rows, columns), np.float32)
    channels = np.zeros((rows, columns, n), np.float32)
    # Only the box of the pixels that count is averaged.
    down, across = (
        range(box.start // factor, max(box.stop - 1, 0) // factor + 1)
        for box in bounding_slices(photo.weights)
    )
    strip = max(1, STRIP_PIXELS // (factor * width))
    for top in down[::strip]:
        small = slice(top, min(top + strip, down.stop)), slice(across.start, across.stop)
        pixels = tuple(slice(box.start * factor, box.stop * factor) for box in small)
        counts = photo.weights[pixels]
        values = np.where(counts[..., None] > 0.0, photo.channels[pixels], np.float32(0.0))
        mean = weights[small] = _block_means(counts, factor)
        sums = _block_means(values * counts[..., None], factor)
        known = mean[..., None] > 0.0
        channels[small] = np.divide(sums, mean[..., None], where=known, out=np.zeros_like(sums))
    structure = None if photo.structure is None else make_structure(channels, weights)
    factor *= photo.factor
    return replace(photo, channels=channels, weights=weights, structure=structure, factor=factor)


def with_structure(
    photo: PhotoAttributes, factor: int = 1, is_steep: bool = False
) -> PhotoAttributes:
    """Reduce a photo ``factor`` times, and find its classes and edges by ``make_structure``."""
    photo = downsample(photo, factor)
    return replace(photo, structure=make_structure(photo.channels, photo.weights, is_steep))


def _block_means(image: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """Means over squares of ``factor`` px of (height, width) or (height, width, n)."""
    height, width = (level_size(size, factor) for size in image.shape[:2])
    missing = [(0, height * factor - image.shape[0]), (0, width * factor - image.shape[1])]
    if missing != [(0, 0), (0, 0)]:
        image = np.pad(image, missing + [(0, 0)] * (image.ndim - 2))
    small = cv2.resize(np.ascontiguousarray(image), (width, height), interpolation=cv2.INTER_AREA)
    return small.reshape(height, width, *image.shape[2:]).astype(np.float32)
