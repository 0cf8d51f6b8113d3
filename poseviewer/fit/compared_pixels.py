"""The pixels that a fit compares: the attributes F of a photo and their weights P."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import SettingsError
from poseviewer.fit.visibility import Occlusion
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import Chart
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mesh import Mesh, hull_in_photo
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.losses.loss import Loss, LossScale, min_pixels
from poseviewer.render.attributes import PhotoAttributes
from poseviewer.render.pyramid.levels import downsample, with_structure
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene

MIN_COLOUR = 0.02
"""Standard deviation of colours, in [0, 1], across their main line in RGB; noise has less."""
NEAR_MARGIN = 0.25
"""Margin of the region ``near`` the start, as a fraction of the diagonal of its box."""
WORKING_PIXELS = 20_000
"""Pixels of the model at the start on a reduced photo: half a pixel is 1/100 of the model."""
FINE_PIXELS = 150_000
"""Pixels of the model on the refining level: its minimum is nearer to the truth."""
MAX_COLOUR_SAMPLES = 1_000_000
"""Pixels from which a photo is told to be grey: more give the same answer."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewResidual:
    """One view's term of the loss."""

    photo: PhotoAttributes
    chart: Chart
    """The pose in this view, by the problem's parameters."""
    loss: Loss
    """Loss that is minimised, of the moments of a pose on ``photo``."""
    fine_photo: PhotoAttributes | None = None
    """Finer pyramid level, without structure, on which a search is refined, if any."""
    view_index: int = 0
    """Index of the view in the scene."""
    min_pixels: float = 0.0
    """Pixels, at the photo's own size, that a pose must cover to be better than the worst."""
    occlusion: Occlusion | None = None
    """Pixels that other objects occlude, which do not count; None: there are no other objects."""
    occluded: NDArray[np.bool_] | None = None
    """(height, width): pixels of ``photo`` left out because the search found something in front of
    the model there; None: it found nothing."""

    @property
    def scale(self) -> LossScale:
        """Scale of the losses on ``photo``."""
        return self.loss.scale(self.photo)

    def without(self, occluded: NDArray[np.bool_] | None) -> ViewResidual:
        """Leave ``occluded`` pixels out on both levels; None leaves the view as it is."""
        photo, fine = self.photo, self.fine_photo
        if occluded is None:
            return self
        assert photo.structure is not None  # the occlusion was found by it
        left = replace(photo, weights=photo.weights * ~occluded)
        if fine is not None:
            height, width = fine.weights.shape
            larger = enlarge_mask(occluded, photo.factor / fine.factor, width, height)
            fine = replace(fine, weights=fine.weights * ~larger)
        photo = with_structure(left, is_steep=photo.structure.is_steep)
        return replace(self, photo=photo, fine_photo=fine, occluded=occluded)


def enlarge_mask(
    mask: NDArray[np.bool_], factor: float, width: int, height: int
) -> NDArray[np.bool_]:
    """Resample a mask to a photo ``factor`` times larger, by the nearest pixel.

    Args:
        mask: mask on the smaller photo.
        factor: size of the larger photo in that of the smaller one.
        width: width of the larger photo, px.
        height: height of the larger photo, px.

    Returns:
        (height, width): mask on the larger photo.
    """
    rows, columns = (
        np.minimum(((np.arange(size) + 0.5) / factor).astype(int), small - 1)
        for size, small in zip((height, width), mask.shape, strict=True)
    )
    return mask[rows[:, None], columns]


def make_view_term(
    scene: Scene,
    object_index: int,
    view_index: int,
    settings: FitSettings,
    chart: Chart,
    occlusion: Occlusion | None,
    is_only_view: bool,
) -> ViewResidual:
    """Make the term of the loss that compares an object in one view.

    Args:
        scene: scene with the object at its start.
        object_index: index of the object.
        view_index: index of the view.
        settings: settings of the fit; they stand in for the object's own.
        chart: pose parameterisation of the object in this view.
        occlusion: pixels that other objects occlude; None: there are none.
        is_only_view: whether no other view is compared. Several views tell the pose more exactly,
            so their search is refined on lighter models even where the photos are no finer.

    Raises:
        SettingsError: too few pixels count.
    """
    own = scene.views[view_index].photo
    weights = _weights(scene, object_index, view_index, settings, occlusion)
    loss = settings.minimised
    coloured = not settings.grey and _has_colour(own, weights)
    photo = plain = PhotoAttributes(
        own.as_float() if coloured else own.grey()[..., None],  # unnamed: it takes gigabytes
        weights,
        settings.pixels == "clip",
        settings.colour_reflectance,
    )
    counted = np.count_nonzero(weights)
    mesh, pose = scene.objects[object_index].mesh, scene.pose(object_index, view_index)
    factor, finest = (working_factor(mesh, pose, most) for most in (WORKING_PIXELS, FINE_PIXELS))
    if counted and loss.has_structure:
        photo = with_structure(plain, factor, is_steep=factor == finest)
    needed = min_pixels(photo.photo_channels + photo.model_channels)
    if counted < needed:
        outline = hull_in_photo(mesh, pose)
        wanted = "use a larger photo or region, or hide less of it"
        if len(outline) and np.ptp(outline, axis=0).max() ** 2 < needed:
            wanted = "the model is smaller than that: are the pose and the model in one unit?"
        raise SettingsError(
            f"{own.name}: {counted} pixels count, and a fit needs at least {needed}; {wanted}"
        )
    is_refined = loss.has_structure and (finest < factor or not is_only_view)
    fine = downsample(plain, finest) if is_refined else None
    return ViewResidual(photo, chart, loss, fine, view_index, occlusion=occlusion)


def _weights(
    scene: Scene,
    object_index: int,
    view_index: int,
    settings: FitSettings,
    occlusion: Occlusion | None,
) -> NDArray[np.float32]:
    """(height, width): P at the photo's own size."""
    photo = scene.views[view_index].photo
    shape = photo.height, photo.width
    weights = np.ones(shape, np.float32)
    at = object_index, view_index
    painted = () if settings.in_front == "nothing" else scene.masks(*at)
    found = scene.earlier_occluders(*at) if settings.in_front == "find" else ()
    for mask in (*painted, *found):
        weights = weights * mask.weights
    if photo.covered is not None:
        weights = weights * photo.covered
    if occlusion is not None:
        weights = weights * ~occlusion.with_margin
    own_region = scene.in_view(object_index, view_index).region
    for rectangle in filter(None, (settings.region, own_region)):
        inside = rectangle.mask(*shape)
        if not inside.any():
            raise SettingsError(
                f"region {','.join(map(str, rectangle))} has no pixel in the photo of "
                f"{photo.width}x{photo.height} px; give left,top,width,height in px"
            )
        weights = weights * inside
    if settings.pixels == "near" and np.any(weights > 0.0):
        near = box_near(scene.objects[object_index].mesh, scene.pose(object_index, view_index))
        weights = weights * near.mask(*shape)
        if not np.any(weights > 0.0):
            raise SettingsError(
                "no pixel that counts lies near the start pose: bring the start onto the photo "
                'and the region, mask less, or use pixels="whole"'
            )
    return weights


def _has_colour(photo: Photo, weights: NDArray[np.float32]) -> bool:
    """Tell whether the colours of the pixels that count leave a line in RGB by more than noise."""
    counts = weights > 0.0
    if photo.pixels.shape[2] == 1 or np.count_nonzero(counts) < 2:
        return False
    few = photo.pixels[counts][:: 1 + np.count_nonzero(counts) // MAX_COLOUR_SAMPLES]
    colours = few / np.iinfo(photo.pixels.dtype).max
    return bool(np.linalg.eigvalsh(np.cov(colours.T))[1] > MIN_COLOUR**2)


def box_near(mesh: Mesh, start: Pose) -> Rectangle:
    """Return the box of the model at the start, with a margin around it, px."""
    outline, reach = hull_in_photo(mesh, start), np.array([start.camera.width, start.camera.height])
    if not len(outline):
        return Rectangle(0.0, 0.0, 0.0, 0.0)
    # A start may reach far beyond the photo; what lies there cannot be compared.
    low, high = np.clip([outline.min(axis=0), outline.max(axis=0)], -reach, 2 * reach)
    margin = NEAR_MARGIN * float(np.linalg.norm(high - low))
    return Rectangle.from_corners(np.floor(low - margin), np.ceil(high + margin))


def working_factor(mesh: Mesh, start: Pose, pixels: float = WORKING_PIXELS) -> int:
    """Return the factor that reduces a photo so that the model at the start has ``pixels``."""
    outline = hull_in_photo(mesh, start).astype(np.float32)
    if len(outline) < 3:
        return 1
    whole = float(start.camera.width * start.camera.height)
    area = min(float(cv2.contourArea(cv2.convexHull(outline))), whole)
    return max(1, math.ceil(math.sqrt(area / pixels)))
