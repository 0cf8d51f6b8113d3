"""Coarser levels of a photo: the same poses judged on fewer, larger pixels and triangles."""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.camera import Pose, level_pose, level_size
from poseviewer.render.structure import bounding_slices, make_structure
from poseviewer.render.types import PhotoAttributes, Renderer

MAX_FACTOR = 16
FACES_PER_PIXEL = 1.0
"""Triangles for each pixel that the model covers: half of a closed surface is seen."""


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """A photo with pixels ``factor`` times larger along each side, and a model to match."""

    factor: int
    photo: PhotoAttributes
    renderer: Renderer
    """Not for two threads at once."""


def make_level(photo: PhotoAttributes, renderer: Renderer, factor: int, pixels: float) -> Level:
    """Level of a photo in which the model covers ``pixels``, with a model decimated to match."""
    # Powers of 2: a pose a little nearer or farther does not ask for another model.
    most = max(FACES_PER_PIXEL * pixels / factor**2, 1.0)
    faces = 1 << math.ceil(math.log2(most))
    return Level(factor, downsample(photo, factor), renderer.decimate(faces))


def lighter_level(photo: PhotoAttributes, renderer: Renderer, pose: Pose) -> Level:
    """The photo as it is, with a model of half as many triangles as it shows pixels of."""
    return make_level(photo, renderer, 1, int(_counting(photo, renderer, pose).sum()) / 2)


def coarsest_level(photo: PhotoAttributes, renderer: Renderer, pose: Pose, fewest: float) -> Level:
    """The coarsest level, by a power of 2, at which the model at ``pose`` still covers ``fewest``
    px; with a factor of 1, photo and renderer as they are.
    """
    pixels, factor = int(_counting(photo, renderer, pose).sum()), 1
    while factor < MAX_FACTOR and pixels / (2 * factor) ** 2 >= fewest:
        factor *= 2
    return Level(1, photo, renderer) if factor == 1 else make_level(photo, renderer, factor, pixels)


def model_mask(photo: PhotoAttributes, renderer: Renderer, pose: Pose) -> NDArray[np.bool_]:
    """(height, width): the pixels of a level that show the model."""
    return renderer.render_mask(level_pose(pose, photo.factor))


def visible_fraction(photo: PhotoAttributes, renderer: Renderer, pose: Pose) -> float:
    """The share of the model's pixels that count, in [0, 1]; 0 where it is not in sight."""
    counting = _counting(photo, renderer, pose)
    return float(counting.mean()) if len(counting) else 0.0


def _counting(photo: PhotoAttributes, renderer: Renderer, pose: Pose) -> NDArray[np.bool_]:
    """(N,): which of the pixels that show the model have weight."""
    return photo.weights[model_mask(photo, renderer, pose)] > 0.0


STRIP_PIXELS = 1_000_000
"""Pixels of a photo that are averaged at a time."""


def downsample(photo: PhotoAttributes, factor: int) -> PhotoAttributes:
    """The photo reduced ``factor`` times along each side by weighted means; it takes the same
    poses.

    Beyond the photo's end pixels have weight 0. The weights are averaged plainly.
    """
    if factor == 1:
        return photo
    height, width, n = photo.channels.shape
    rows, columns = level_size(height, factor), level_size(width, factor)
    weights = np.zeros((rows, columns), np.float32)
    channels = np.zeros((rows, columns, n), np.float32)
    # What does not count costs nothing: only the box of the pixels that do is looked at.
    down, across = (
        range(box.start // factor, max(box.stop - 1, 0) // factor + 1)
        for box in bounding_slices(photo.weights)
    )
    strip = max(1, STRIP_PIXELS // (factor * width))
    for top in down[::strip]:  # all of a large photo at once would take gigabytes
        small = slice(top, min(top + strip, down.stop)), slice(across.start, across.stop)
        pixels = tuple(slice(box.start * factor, box.stop * factor) for box in small)
        counts = photo.weights[pixels]
        seen = np.where(counts[..., None] > 0.0, photo.channels[pixels], np.float32(0.0))
        mean = weights[small] = _averaged(counts, factor)
        sums = _averaged(seen * counts[..., None], factor)
        known = mean[..., None] > 0.0
        channels[small] = np.divide(sums, mean[..., None], where=known, out=np.zeros_like(sums))
    structure = None if photo.structure is None else make_structure(channels, weights)
    factor *= photo.factor
    return replace(photo, channels=channels, weights=weights, structure=structure, factor=factor)


def with_structure(
    photo: PhotoAttributes, factor: int = 1, is_steep: bool = False
) -> PhotoAttributes:
    """The photo ``factor`` times smaller, with its classes and edges; ``is_steep`` as of
    ``make_structure``.
    """
    photo = downsample(photo, factor)
    return replace(photo, structure=make_structure(photo.channels, photo.weights, is_steep))


def _averaged(image: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """The means over squares of ``factor`` px of (height, width) or (height, width, n)."""
    height, width = (level_size(size, factor) for size in image.shape[:2])
    missing = [(0, height * factor - image.shape[0]), (0, width * factor - image.shape[1])]
    if missing != [(0, 0), (0, 0)]:
        image = np.pad(image, missing + [(0, 0)] * (image.ndim - 2))
    small = cv2.resize(np.ascontiguousarray(image), (width, height), interpolation=cv2.INTER_AREA)
    return small.reshape(height, width, *image.shape[2:]).astype(np.float32)
