"""The pixels that a fit compares: the attributes F of a photo and their weights P."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import SettingsError
from poseviewer.fit.loss import Loss, fewest_pixels, registration_loss, whole_photo_loss
from poseviewer.fit.visibility import Hiding
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import Chart
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mesh import Mesh, hull_in_photo
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.pyramid.levels import downsample, with_structure
from poseviewer.render.types import PhotoAttributes
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene

MIN_COLOUR = 0.02
"""Standard deviation across the main line of a photo's colours, of 1: less is their noise."""
NEAR_MARGIN = 0.25
"""Reach of the pixels ``near`` the start, as a share of the diagonal of its box."""
WORKING_PIXELS = 20_000
"""Pixels of the start's outline to which a photo is reduced: half of one is 1/100 of the model."""
FINE_PIXELS = 150_000
"""Those of the photo that a search is refined on, whose minimum is nearer to the truth."""


@dataclass(frozen=True, slots=True, eq=False)
class ComparedView:
    """A photo that the pose is judged by."""

    photo: PhotoAttributes
    chart: Chart
    """The pose in this view, by the problem's parameters."""
    loss: Loss = registration_loss
    """Function that is minimised, from the moments of a pose on ``photo``."""
    fine_photo: PhotoAttributes | None = None
    """Finer pyramid level, without structure, on which a search is refined, if any."""
    index: int = 0
    """Number of the view in the scene."""
    fewest: float = 0.0
    """Pixels, of the photo's own size, that a pose must show to be better than the worst."""
    behind: Hiding | None = None
    """Pixels that other objects hide, which do not count; None: there are none."""
    hidden: NDArray[np.bool_] | None = None
    """(height, width): pixels of ``photo`` left out as something else is in front of the model
    there; None: there was nothing."""

    def without(self, hidden: NDArray[np.bool_] | None) -> ComparedView:
        """The view without the pixels that are ``hidden``, on both levels; None: as it is."""
        photo, fine = self.photo, self.fine_photo
        if hidden is None:
            return self
        assert photo.structure is not None  # something was seen in front of the model by it
        left = replace(photo, weights=photo.weights * ~hidden)
        if fine is not None:
            height, width = fine.weights.shape
            larger = enlarged(hidden, photo.factor / fine.factor, width, height)
            fine = replace(fine, weights=fine.weights * ~larger)
        photo = with_structure(left, is_steep=photo.structure.is_steep)
        return replace(self, photo=photo, fine_photo=fine, hidden=hidden)


def enlarged(
    hidden: NDArray[np.bool_], factor: float, width: int, height: int
) -> NDArray[np.bool_]:
    """(height, width): a mask on a photo ``factor`` times larger."""
    rows, columns = (
        np.minimum(((np.arange(size) + 0.5) / factor).astype(int), most - 1)
        for size, most in zip((height, width), hidden.shape, strict=True)
    )
    return hidden[rows[:, None], columns]


def compared_view(
    scene: Scene,
    index: int,
    number: int,
    settings: FitSettings,
    chart: Chart,
    behind: Hiding | None,
    is_alone: bool,
) -> ComparedView:
    """The view ``number`` as poses of an object are compared on it.

    Several views tell the pose more exactly than one that ``is_alone``: their search is refined on
    models of less reach even where the photos are no finer. Raises ``SettingsError`` where too few
    pixels count.
    """
    own = scene.views[number].photo
    weights = _weights(scene, index, number, settings, behind)
    is_clipped = settings.pixels == "clip"
    coloured = not settings.grey and _has_colour(own, weights)
    photo = plain = PhotoAttributes(
        own.as_float() if coloured else own.grey()[..., None],  # by no name: it is gigabytes
        weights,
        is_clipped,
        settings.colour_reflectance,
    )
    counted = np.count_nonzero(weights)
    mesh, pose = scene.objects[index].mesh, scene.pose(index, number)
    factor, finest = (working_factor(mesh, pose, most) for most in (WORKING_PIXELS, FINE_PIXELS))
    if counted and not is_clipped and settings.loss == "default":
        photo = with_structure(plain, factor, is_steep=factor == finest)
    fewest = fewest_pixels(photo.photo_channels + photo.model_channels)
    if counted < fewest:
        outline, wanted = (
            hull_in_photo(mesh, pose),
            "use a larger photo or region, or hide less of it",
        )
        if len(outline) and np.ptp(outline, axis=0).max() ** 2 < fewest:
            wanted = "the model is smaller than that: are the pose and the model in one unit?"
        raise SettingsError(
            f"{own.name}: {counted} pixels count, and a fit needs at least {fewest}; {wanted}"
        )
    is_refined = photo.structure is not None and (finest < factor or not is_alone)
    fine = downsample(plain, finest) if is_refined else None
    is_papers = settings.loss == "paper" and not is_clipped
    loss = whole_photo_loss if is_papers else registration_loss
    return ComparedView(photo, chart, loss, fine, number, behind=behind)


def _weights(
    scene: Scene, index: int, number: int, settings: FitSettings, behind: Hiding | None
) -> NDArray[np.float32]:
    """(height, width): P at the photo's own size."""
    photo, own = scene.views[number].photo, scene.in_view(index, number)
    shape = photo.height, photo.width
    weights = np.ones(shape, np.float32)
    for mask in () if settings.in_front == "nothing" else scene.masks(index, number):
        weights = weights * mask.weights
    if photo.covered is not None:
        weights = weights * photo.covered
    if behind is not None:
        weights = weights * ~behind.with_margin
    for rectangle in filter(None, (settings.region, own.region)):
        inside = rectangle.mask(*shape)
        if not inside.any():
            raise SettingsError(
                f"--region {','.join(map(str, rectangle))} has no pixel in the photo of "
                f"{photo.width}x{photo.height} px; give left,top,width,height in px"
            )
        weights = weights * inside
    if settings.pixels == "near" and np.any(weights > 0.0):
        near = box_near(scene.objects[index].mesh, scene.pose(index, number))
        weights = weights * near.mask(*shape)
        if not np.any(weights > 0.0):
            raise SettingsError(
                "no pixel that counts lies near the start pose: bring the start onto the photo "
                "and the region, mask less, or use --pixels whole"
            )
    return weights


ENOUGH_COLOURS = 1_000_000
"""Pixels that tell well whether a photo has colours."""


def _has_colour(photo: Photo, weights: NDArray[np.float32]) -> bool:
    """Whether the colours of the pixels that count leave a line in RGB by more than noise."""
    counts = weights > 0.0
    if photo.pixels.shape[2] == 1 or np.count_nonzero(counts) < 2:
        return False
    few = photo.pixels[counts][:: 1 + np.count_nonzero(counts) // ENOUGH_COLOURS]
    colours = few / np.iinfo(photo.pixels.dtype).max
    return bool(np.linalg.eigvalsh(np.cov(colours.T))[1] > MIN_COLOUR**2)


def box_near(mesh: Mesh, start: Pose) -> Rectangle:
    """The box of the model at the start, with a margin around it, px."""
    outline, reach = hull_in_photo(mesh, start), np.array([start.camera.width, start.camera.height])
    if not len(outline):
        return Rectangle(0.0, 0.0, 0.0, 0.0)
    # Where the start fills the photo and more, the photo is all there is to look at.
    low, high = np.clip([outline.min(axis=0), outline.max(axis=0)], -reach, 2 * reach)
    margin = NEAR_MARGIN * float(np.linalg.norm(high - low))
    return Rectangle.from_corners(np.floor(low - margin), np.ceil(high + margin))


def working_factor(mesh: Mesh, start: Pose, most: float = WORKING_PIXELS) -> int:
    """Factor by which a photo is reduced so that the model at the start has ``most`` pixels."""
    outline = hull_in_photo(mesh, start).astype(np.float32)
    if len(outline) < 3:
        return 1
    whole = float(start.camera.width * start.camera.height)
    area = min(float(cv2.contourArea(cv2.convexHull(outline))), whole)
    return max(1, math.ceil(math.sqrt(area / most)))
