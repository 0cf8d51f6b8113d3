"""Occlusion of the model by unknown things, from the photo alone.

At a pose, each pixel of the model shows either the model, ``A M + b`` under some light, or an
occluder, whose colour is distributed as in the photo beside the model. Expectation maximisation,
begun with robust weights, estimates the light and which pixels are occluded; their log odds are
smoothed over neighbours. A connected piece counts as an occluder if the photo has an edge between
it and the rest of the model, and none where it crosses the model's outline: a highlight, or paint
that the model lacks, ends at the outline. Pixels beside the model that are nearest to an occluded
one are left out too, within the occluder's width, as the outline there is the occluder's.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.fit.outline import outline_support
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose, level_pose
from poseviewer.losses.loss import min_pixels
from poseviewer.render.attributes import PhotoAttributes, Renderer
from poseviewer.render.moments import model_attributes

ROBUST_ROUNDS = 12
"""Rounds of robust weights: their scale reaches the last one after six."""
MIXTURE_ROUNDS = 4
"""Rounds of expectation maximisation: few, as robust weights begin it near its end."""
FIRST_SCALE = 16.0
"""First scale of the robust weights over the last: the light must not settle too soon."""
NARROWING = 0.6
"""Factor from one scale of the robust weights to the next."""
LIGHT_NOISE = 0.03
"""Standard deviation of colours, in [0, 1], about the light: sensor noise, what models lack."""
CLASS_NOISE = 0.02
"""Least standard deviation of colours, in [0, 1], in a class beside the model."""
ANY_COLOUR = 1e-3
"""Density of colours that no class beside the model has."""
MAX_LOG_ODDS = 5.0
"""Log odds of a single pixel at most: noise must not outweigh its neighbours."""
SMOOTHING_PX = 2.5
"""Standard deviation, in px, of the blur that smooths log odds over neighbours."""
MIN_WIDTH = 0.03
"""Width of a piece, in square roots of the model's area: an outline a bit off leaves less."""
MIN_AREA_FRACTION = 0.02
"""Area of a piece, as a fraction of the model's: an outline a bit off leaves less."""
MIN_CROSSING = 1.0
"""Length of outline in a piece, in square roots of its area: few occluders end at the outline."""
EDGE_GAP = 0.3
"""Edge support of a piece's border inside the model, above that of the outline that it crosses."""
MAX_CROSSED = 0.35
"""Edge support of the outline where an occluder crosses it at a pose that may be wrong, at most: of
wrong poses it has 0.4 and more, and of patterned occluders, too."""
REACH = 1.5
"""Reach beside the model, in square roots of the occluded area; more lets the model grow."""
MIN_VISIBLE_FRACTION = 0.2
"""Fraction of the model that must be left: with less, any light explains it."""

OcclusionMask = NDArray[np.bool_] | None
"""(height, width): occluded pixels; None where nothing is occluded."""


def find_occluded(
    photo: PhotoAttributes, renderer: Renderer, pose: Pose, is_known: bool = False
) -> OcclusionMask:
    """Find the pixels of a photo with structure on which something occludes the model at a pose,
    and those beside the model where its outline is occluded.

    Args:
        photo: the photo.
        renderer: renderer of the model.
        pose: where the model may be.
        is_known: whether it is there to a few px, as in the next photo of a film.
    """
    image = renderer.render(level_pose(pose, photo.factor))
    covered = image.mask & (photo.weights > 0.0)
    beside = ~image.mask & (photo.weights > 0.0)
    needed = min_pixels(photo.photo_channels + photo.model_channels)
    if np.count_nonzero(covered) < needed or np.count_nonzero(beside) < needed:
        return None
    model = model_attributes(image.at(np.flatnonzero(covered)), photo)
    odds = _log_odds(photo, covered, beside, model)
    occluded = np.zeros(covered.shape, bool)
    for piece in _pieces(odds > 0.0, covered):
        if _is_occluder(photo, piece, image.mask, 1.0 if is_known else MAX_CROSSED):
            occluded |= piece
    left = np.count_nonzero(covered & ~occluded)
    if not occluded.any() or left < MIN_VISIBLE_FRACTION * covered.sum():
        return None
    return occluded | (beside & _nearest_to(occluded, image.mask))


def _log_odds(
    photo: PhotoAttributes, covered: NDArray[np.bool_], beside: NDArray[np.bool_], model: FloatArray
) -> FloatArray:
    """(height, width): smoothed log odds that ``covered`` pixels are occluded."""
    colours = photo.channels[covered].astype(float)
    other = _log_density_beside(photo, beside, colours)
    variance = float(photo.channels[photo.weights > 0.0].var(0).mean())
    weights = _robust_weights(colours, model, variance)
    odds = np.zeros(covered.shape)
    reach = cv2.GaussianBlur(covered.astype(float), (0, 0), SMOOTHING_PX)
    for _ in range(MIXTURE_ROUNDS):
        if weights.sum() < min_pixels(model.shape[1]):
            return np.zeros(covered.shape)
        residuals = colours - model @ _light(colours, model, weights)
        spread = (residuals * weights[:, None]).T @ residuals / weights.sum()
        own = other - _log_normal(residuals, spread, LIGHT_NOISE)
        own = np.clip(own, -MAX_LOG_ODDS, MAX_LOG_ODDS)
        odds[covered] = own
        blurred = np.asarray(cv2.GaussianBlur(odds, (0, 0), SMOOTHING_PX))
        smooth = blurred / np.maximum(reach, 1e-6)
        weights = np.where(smooth[covered] > 0.0, 0.0, 1.0 / (1.0 + np.exp(own)))
    return np.where(covered, smooth, 0.0)


def _robust_weights(colours: FloatArray, model: FloatArray, variance: float) -> FloatArray:
    """(N,): weights of Geman and McClure, by graduated non-convexity."""
    weights = np.ones(len(colours))
    for turn in range(ROBUST_ROUNDS):
        residuals = colours - model @ _light(colours, model, weights)
        squares = (residuals**2).sum(axis=1)
        last = max(4.0 * float(np.median(squares)), 0.02 * variance, np.finfo(float).tiny)
        scale = last * max(1.0, FIRST_SCALE * NARROWING**turn)
        weights = (scale / (scale + squares)) ** 2
    return weights


def _light(colours: FloatArray, model: FloatArray, weights: FloatArray) -> FloatArray:
    """(m, n): the map of the model's attributes, of which one is 1, to the colours."""
    weighted = model * weights[:, None]
    normal = model.T @ weighted
    ridge = 1e-4 * np.trace(normal) / len(normal)
    return np.linalg.solve(normal + ridge * np.eye(len(normal)), weighted.T @ colours)


def _log_density_beside(
    photo: PhotoAttributes, beside: NDArray[np.bool_], colours: FloatArray
) -> FloatArray:
    """(N,): log density of ``colours`` (N, n) beside the model, a normal density for each class."""
    assert photo.structure is not None
    labels, around = photo.structure.labels[beside], photo.channels[beside].astype(float)
    density = np.full(len(colours), ANY_COLOUR)
    for label in range(len(photo.structure.class_weights)):
        own = around[labels == label]
        if len(own) <= colours.shape[1]:
            continue
        spread = np.atleast_2d(np.cov(own.T))
        log_density = _log_normal(colours - own.mean(axis=0), spread, CLASS_NOISE)
        density += len(own) / len(around) * np.exp(log_density)
    return np.log(density)


def _log_normal(away: FloatArray, spread: FloatArray, noise: float) -> FloatArray:
    """(N,): the logarithm of the normal density at ``away`` (N, n) from its mean."""
    spread = spread + noise**2 * np.eye(len(spread))
    distance = np.einsum("ij,ij->i", away @ np.linalg.inv(spread), away)
    return -0.5 * (distance + np.linalg.slogdet(2.0 * np.pi * spread)[1])


def _pieces(mask: NDArray[np.bool_], covered: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """Connected parts of a mask (height, width) that are neither thin nor small."""
    area = int(np.count_nonzero(covered))
    radius = max(1, round(MIN_WIDTH * area**0.5 / 2.0))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, disc)
    count, labels, sizes, _ = cv2.connectedComponentsWithStats(opened)
    large = sizes[:, cv2.CC_STAT_AREA] >= MIN_AREA_FRACTION * area
    return [labels == label for label in range(1, count) if large[label]]


def _is_occluder(
    photo: PhotoAttributes,
    piece: NDArray[np.bool_],
    model: NDArray[np.bool_],
    max_crossed: float,
) -> bool:
    """Tell whether the photo has edges about a ``piece``, but none where it crosses the outline."""
    square = np.ones((3, 3), np.uint8)
    outline = model & (cv2.erode(model.astype(np.uint8), square) == 0)
    if np.count_nonzero(piece & outline) < MIN_CROSSING * np.count_nonzero(piece) ** 0.5:
        return False
    inside = cv2.erode(model.astype(np.uint8), square, iterations=2)
    near = cv2.dilate(piece.astype(np.uint8), square)
    own = outline_support(photo.channels, photo.weights * inside, piece)
    crossed = outline_support(photo.channels, photo.weights * near, model)
    return crossed <= max_crossed and own - crossed >= EDGE_GAP


def _nearest_to(occluded: NDArray[np.bool_], model: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(height, width): pixels within reach whose nearest pixel of the ``model`` is occluded."""
    away = (~model).astype(np.uint8)
    distance, nearest = cv2.distanceTransformWithLabels(
        away, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    labels = np.asarray(nearest, np.intp)
    of_label = np.zeros(int(labels.max()) + 1, bool)
    of_label[labels[model]] = occluded[model]
    return of_label[labels] & (distance <= REACH * np.count_nonzero(occluded) ** 0.5)
