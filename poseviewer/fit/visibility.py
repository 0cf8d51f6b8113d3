"""Which pixels show which of several models: the nearest one, by the depth of each.

All are seen by one camera, and their lengths are in one unit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import Mesh
from poseviewer.scene.types import PlacedModel

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.software_renderer import SoftwareRenderer

DepthImage = NDArray[np.float32]
"""(height, width): z in the camera, in the models' unit; inf where there is nothing."""
Pixels = NDArray[np.bool_]
NOTHING = -1
MARGIN_PX = 2
"""Around what is in front: lenses and pixels mix its colour with that of what is behind."""


@dataclass(frozen=True, slots=True, eq=False)
class Visibility:
    """The pixels of a photo that show each of several models."""

    nearest: NDArray[np.int32]
    """(height, width): the index of the model that a pixel shows; ``NOTHING`` where none is."""
    drawn: tuple[Pixels, ...]
    """For each model, (height, width): where it would be seen if it were alone."""

    def seen(self, index: int) -> Pixels:
        """(height, width): where a model is seen."""
        return self.nearest == index

    @property
    def shares(self) -> FloatArray:
        """(n,): the share of each model within the photo that the others leave to be seen, in
        [0, 1]; 0 for one that lies outside.
        """
        seen = [np.count_nonzero(self.seen(index)) for index in range(len(self.drawn))]
        whole = [max(np.count_nonzero(drawn), 1) for drawn in self.drawn]
        return np.array(seen) / np.array(whole)


def visibility(models: Sequence[PlacedModel]) -> Visibility:
    """Which pixel shows which of one or more models."""
    return visibility_of_depths(depth_image(model) for model in models)


def visibility_of_depths(depths: Iterable[DepthImage]) -> Visibility:
    """Which pixel shows which model, by their depth images; of two as near, the first is shown."""
    nearest = np.int32(NOTHING)
    least = np.float32(np.inf)
    drawn = []
    for index, depth in enumerate(depths):  # one by one: those of large photos are large
        nearest = np.where(depth < least, np.int32(index), nearest)
        least = np.minimum(depth, least)
        drawn.append(np.isfinite(depth))
    return Visibility(np.asarray(nearest), tuple(drawn))


@dataclass(frozen=True, slots=True, eq=False)
class Hiding:
    """The pixels (height, width) that other models hide of one."""

    drawn: Pixels
    """Pixels that would show the model if it were alone."""
    hidden: Pixels
    """Pixels in which another stands in front of it, or would, were it there."""
    others: Pixels
    """Pixels that would show another if it were alone, in front or behind."""

    @property
    def with_margin(self) -> Pixels:
        """``hidden``, and ``MARGIN_PX`` around it."""
        square = np.ones((2 * MARGIN_PX + 1,) * 2, np.uint8)
        return np.asarray(cv2.dilate(self.hidden.astype(np.uint8), square), bool)

    @property
    def is_whole(self) -> bool:
        """Whether nothing is left to be seen of a model that lies in the photo."""
        return bool(self.drawn.any() and self.hidden[self.drawn].all())


def hiding(model: PlacedModel, others: Sequence[PlacedModel]) -> Hiding:
    """Pixels in which the ``others`` stand in front of a model, by depth where both are drawn.

    Where another is drawn alone, it hides the model, which may be found there yet, if it is in
    front in most pixels that they share, or, without any, if its centre is nearer.
    """
    own = depth_image(model)
    drawn = np.isfinite(own)
    hidden = np.zeros(own.shape, bool)
    anywhere = np.zeros(own.shape, bool)
    for other in others:
        depth = depth_image(other)
        anywhere |= np.isfinite(depth)
        in_front, shared = depth < own, drawn & np.isfinite(depth)
        if shared.any():
            is_nearer = float(np.mean(in_front[shared])) > 0.5
        else:
            is_nearer = other.depth < model.depth
        hidden |= in_front if is_nearer else in_front & drawn
    return Hiding(drawn, hidden, anywhere)


def depth_image(model: PlacedModel) -> DepthImage:
    """The depth of a model alone, in the size of its pose's picture."""
    return _renderer(model.mesh).clone().depth(model.pose)


@lru_cache(maxsize=16)
def _renderer(mesh: Mesh) -> SoftwareRenderer:
    """To be cloned: it may be asked for by several threads."""
    from poseviewer.render.software.software_renderer import SoftwareRenderer

    return SoftwareRenderer(mesh)
