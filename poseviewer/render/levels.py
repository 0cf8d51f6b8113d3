"""A coarser level of the photo: the same poses judged on fewer, larger pixels.

``replace(problem, photo=coarser(problem.photo, 4))`` with ``LevelRenderer(renderer, 4)`` is the
same search over the same chart, at a fraction of the time.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.camera import Pose, scaled_size
from poseviewer.render.attributes import AttributeImage, Renderer
from poseviewer.render.moments import Moments, PhotoAttributes


def coarser(photo: PhotoAttributes, factor: int) -> PhotoAttributes:
    """The photo reduced ``factor`` times along each side, each pixel the mean of those it covers.

    Its size (height, width) is that of ``Pose.scaled(1 / factor)``. F is averaged by weight, so
    that what does not count does not show; the weights are averaged plainly.

    Raises:
        ValueError: ``factor`` is less than 1.
    """
    if factor < 1:
        raise ValueError(f"a photo is reduced 1 time or more, not {factor}")
    if factor == 1:
        return photo
    height, width = photo.weights.shape
    size = scaled_size(width, height, 1.0 / factor)
    weights = _averaged(photo.weights, size)
    seen = np.where(photo.weights[..., None] > 0.0, photo.channels, np.float32(0.0))
    sums = _averaged(seen * photo.weights[..., None], size)
    counts = weights[..., None] > 0.0
    channels = np.divide(sums, weights[..., None], where=counts, out=np.zeros_like(sums))
    return replace(photo, channels=channels, weights=weights)


def _averaged(image: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """``image`` (height, width) or (height, width, n), averaged to ``size`` (width, height)."""
    small = cv2.resize(np.ascontiguousarray(image), size, interpolation=cv2.INTER_AREA)
    return small.reshape(size[1], size[0], *image.shape[2:]).astype(np.float32)


class LevelRenderer:
    """A ``Renderer`` that takes poses of the full photo and shows them ``factor`` times smaller.

    It goes with a photo from ``coarser`` of the same factor.
    """

    def __init__(self, renderer: Renderer, factor: int) -> None:
        self._renderer = renderer
        self._scale = 1.0 / factor

    def render(self, pose: Pose) -> AttributeImage:
        """Visibility, reflectance and normals at the centres of the level's pixels."""
        return self._renderer.render(pose.scaled(self._scale))

    def covers(self, pose: Pose) -> NDArray[np.bool_]:
        """Where the model is seen, at the level."""
        return self._renderer.covers(pose.scaled(self._scale))

    def moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """The joint moments at ``pose``, a pose of the full photo; ``photo`` is the coarse one.

        Raises:
            ValueError: the photo is not of this level.
        """
        return self._renderer.moments(pose.scaled(self._scale), photo)
