"""Which pixels show which of several models, by the depth of each.

One camera shows all models, and their lengths are in one unit.
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
"""(height, width): z in the camera, in the models' unit; inf where nothing is drawn."""
Pixels = NDArray[np.bool_]
"""(height, width): a mask."""
NOTHING = -1
"""Index in ``Visibility.nearest`` of a pixel that shows no model."""
MARGIN_PX = 2
"""Margin of occluded pixels: lens and sensor mix colours across the occluder's outline."""


@dataclass(frozen=True, slots=True, eq=False)
class Visibility:
    """The pixels of a photo that show each of several models."""

    nearest: NDArray[np.int32]
    """(height, width): the index of the model that a pixel shows; ``NOTHING`` where none is."""
    silhouettes: tuple[Pixels, ...]
    """For each model, (height, width): pixels that would show it if it were alone."""

    def mask(self, index: int) -> Pixels:
        """(height, width): pixels that show a model."""
        return self.nearest == index

    @property
    def visible_fractions(self) -> FloatArray:
        """(n,): the fraction of each model's silhouette that the others do not occlude, in [0, 1];
        0 for a model outside the photo.
        """
        visible = [np.count_nonzero(self.mask(index)) for index in range(len(self.silhouettes))]
        whole = [max(np.count_nonzero(alone), 1) for alone in self.silhouettes]
        return np.array(visible) / np.array(whole)


def visibility(models: Sequence[PlacedModel]) -> Visibility:
    """Find which pixel shows which of one or more models."""
    return visibility_of_depths(depth_image(model) for model in models)


def visibility_of_depths(depths: Iterable[DepthImage]) -> Visibility:
    """Find which pixel shows which model, by their depth images; ties go to the first model."""
    nearest = np.int32(NOTHING)
    least = np.float32(np.inf)
    silhouettes = []
    for index, depth in enumerate(depths):  # lazily: depth images of large photos are large
        nearest = np.where(depth < least, np.int32(index), nearest)
        least = np.minimum(depth, least)
        silhouettes.append(np.isfinite(depth))
    return Visibility(np.asarray(nearest), tuple(silhouettes))


@dataclass(frozen=True, slots=True, eq=False)
class Occlusion:
    """The pixels (height, width) of a model that other models occlude."""

    silhouette: Pixels
    """Pixels that would show the model if it were alone."""
    occluded: Pixels
    """Pixels in which an occluder stands in front of the model, or would if the model reached
    there."""
    occluders: Pixels
    """Pixels that would show an occluder if it were alone, in front of the model or behind."""

    @property
    def with_margin(self) -> Pixels:
        """``occluded``, dilated by ``MARGIN_PX``."""
        square = np.ones((2 * MARGIN_PX + 1,) * 2, np.uint8)
        return np.asarray(cv2.dilate(self.occluded.astype(np.uint8), square), bool)

    @property
    def is_total(self) -> bool:
        """Whether a model that lies in the photo is occluded wholly."""
        return bool(self.silhouette.any() and self.occluded[self.silhouette].all())


def make_occlusion(model: PlacedModel, occluders: Sequence[PlacedModel]) -> Occlusion:
    """Find the pixels in which ``occluders`` stand in front of a model.

    Where both are drawn, their depths decide. Pixels of an occluder alone are occluded too, as the
    model may yet be found there, if the occluder is the nearer one: in most pixels that both share,
    or by its centre where they share none.
    """
    own = depth_image(model)
    silhouette = np.isfinite(own)
    occluded = np.zeros(own.shape, bool)
    anywhere = np.zeros(own.shape, bool)
    for occluder in occluders:
        depth = depth_image(occluder)
        anywhere |= np.isfinite(depth)
        in_front, shared = depth < own, silhouette & np.isfinite(depth)
        if shared.any():
            is_nearer = float(np.mean(in_front[shared])) > 0.5
        else:
            is_nearer = occluder.depth < model.depth
        occluded |= in_front if is_nearer else in_front & silhouette
    return Occlusion(silhouette, occluded, anywhere)


def depth_image(model: PlacedModel) -> DepthImage:
    """Render the depth of a model alone, at the size of its camera's picture."""
    return _renderer(model.mesh).clone().depth(model.pose)


@lru_cache(maxsize=16)
def _renderer(mesh: Mesh) -> SoftwareRenderer:
    """Renderer to be cloned: several threads may ask for it."""
    from poseviewer.render.software.software_renderer import SoftwareRenderer

    return SoftwareRenderer(mesh)
