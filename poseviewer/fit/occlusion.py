"""Things in front of the model, told by the photo alone.

At a pose, each pixel of the model shows either the model, ``A M + b`` under some light, or a colour
as the photo has them beside it: a mixture of a normal density and of one from the classes. Light
and mixture are told together (expectation and maximisation, begun with robust weights), and
neighbours speak for each other. A hidden piece counts as something in front where it borders on the
model's rest by an edge of the photo, and goes on across the model's outline without one: a
highlight, or paint that the model has not, ends there. Its nearest pixels beside the model go with
it, as far as it is wide: they tell nothing where the outline is hidden, but bound the model.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.fit.loss import fewest_pixels
from poseviewer.fit.outline import outline_support
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose, level_pose
from poseviewer.render.moments import model_attributes
from poseviewer.render.types import PhotoAttributes, Renderer

ROBUST_ROUNDS, ROUNDS = 12, 4
"""Rounds of robust weights, and then of the mixture."""
WIDEST, NARROWING = 16.0, 0.6
"""First scale of the robust weights, in that of the last, and its shrinkage: no light too soon."""
LIGHT_NOISE = 0.03
"""Standard deviation of a colour in [0, 1] that no light is told without."""
CLASS_NOISE, ANY_COLOUR = 0.02, 1e-3
"""Standard deviation of a class beside the model; and the density of colours that no class has."""
MAX_RESIDUAL_RATIO = 5.0
"""Logarithm of the odds that one pixel may give."""
SAID_PX = 2.5
"""Standard deviation of the blur by which pixels speak for their neighbours."""
MIN_WIDTH, MIN_SHARE = 0.03, 0.02
"""Width of a piece in roots of the model's area, and share of it: outlines a bit off have less."""
MIN_CROSSING = 1.0
"""Length of the outline that a piece lies on, in roots of its area: few things end there."""
EDGE_GAP = 0.3
"""Share of its border inside the model that lies on edges, above that of the outline over it."""
REACH = 1.5
"""Reach beside the model of what hides it, in roots of the hidden area; more lets a model grow."""
MIN_VISIBLE = 0.2
"""Share of the model that is left: with less, any light explains it."""

Hidden = NDArray[np.bool_] | None
"""(height, width): pixels that something in front hides; None where nothing does."""


def find_hidden(photo: PhotoAttributes, renderer: Renderer, pose: Pose) -> Hidden:
    """The pixels of a ``photo`` with structure where something is in front of the model at a pose,
    and beside it where that hides its outline.
    """
    image = renderer.render(level_pose(pose, photo.factor))
    covered = image.mask & (photo.weights > 0.0)
    beside = ~image.mask & (photo.weights > 0.0)
    fewest = fewest_pixels(photo.photo_channels + photo.model_channels)
    if np.count_nonzero(covered) < fewest or np.count_nonzero(beside) < fewest:
        return None
    model = model_attributes(image.at(np.flatnonzero(covered)), photo)
    odds = _odds(photo, covered, beside, model)
    hidden = np.zeros(covered.shape, bool)
    for piece in _pieces(odds > 0.0, covered):
        if _is_in_front(photo, piece, image.mask):
            hidden |= piece
    if not hidden.any() or np.count_nonzero(covered & ~hidden) < MIN_VISIBLE * covered.sum():
        return None
    return hidden | (beside & _nearest(hidden, image.mask))


def _odds(
    photo: PhotoAttributes,
    covered: NDArray[np.bool_],
    beside: NDArray[np.bool_],
    model: FloatArray,
) -> FloatArray:
    """(height, width): log odds, evened out, that ``covered`` pixels do not show the ``model``."""
    colours = photo.channels[covered].astype(float)
    other = _log_density_beside(photo, beside, colours)
    variance = float(photo.channels[photo.weights > 0.0].var(0).mean())
    weights = _robust_weights(colours, model, variance)
    odds = np.zeros(covered.shape)
    reach = cv2.GaussianBlur(covered.astype(float), (0, 0), SAID_PX)
    for _ in range(ROUNDS):
        if weights.sum() < fewest_pixels(model.shape[1]):
            return np.zeros(covered.shape)
        left = colours - model @ _light(colours, model, weights)
        spread = (left * weights[:, None]).T @ left / weights.sum()
        said = other - _log_normal(left, spread, LIGHT_NOISE)
        said = np.clip(said, -MAX_RESIDUAL_RATIO, MAX_RESIDUAL_RATIO)
        odds[covered] = said
        even = np.asarray(cv2.GaussianBlur(odds, (0, 0), SAID_PX)) / np.maximum(reach, 1e-6)
        weights = np.where(even[covered] > 0.0, 0.0, 1.0 / (1.0 + np.exp(said)))
    return np.where(covered, even, 0.0)


def _robust_weights(colours: FloatArray, model: FloatArray, variance: float) -> FloatArray:
    """(N,): Geman and McClure's, narrowed step by step from where all pixels count."""
    weights = np.ones(len(colours))
    for turn in range(ROBUST_ROUNDS):
        left = colours - model @ _light(colours, model, weights)
        squares = (left**2).sum(axis=1)
        last = max(4.0 * float(np.median(squares)), 0.02 * variance, np.finfo(float).tiny)
        scale = last * max(1.0, WIDEST * NARROWING**turn)
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
    """(N,): log density of ``colours`` (N, n) beside the model, a normal one for each class."""
    assert photo.structure is not None
    labels, around = photo.structure.labels[beside], photo.channels[beside].astype(float)
    density = np.full(len(colours), ANY_COLOUR)
    for label in range(len(photo.structure.shares)):
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


def _pieces(hidden: NDArray[np.bool_], covered: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """The connected parts of ``hidden`` (height, width) that are neither thin nor small."""
    area = int(np.count_nonzero(covered))
    radius = max(1, round(MIN_WIDTH * area**0.5 / 2.0))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    opened = cv2.morphologyEx(hidden.astype(np.uint8), cv2.MORPH_OPEN, disc)
    count, labels, sizes, _ = cv2.connectedComponentsWithStats(opened)
    large = sizes[:, cv2.CC_STAT_AREA] >= MIN_SHARE * area
    return [labels == label for label in range(1, count) if large[label]]


def _is_in_front(
    photo: PhotoAttributes, piece: NDArray[np.bool_], model: NDArray[np.bool_]
) -> bool:
    """Whether a ``piece`` of the ``model`` has edges about it, but where it crosses its outline."""
    square = np.ones((3, 3), np.uint8)
    outline = model & (cv2.erode(model.astype(np.uint8), square) == 0)
    if np.count_nonzero(piece & outline) < MIN_CROSSING * np.count_nonzero(piece) ** 0.5:
        return False
    inside = cv2.erode(model.astype(np.uint8), square, iterations=2)
    near = cv2.dilate(piece.astype(np.uint8), square)
    own = outline_support(photo.channels, photo.weights * inside, piece)
    crossed = outline_support(photo.channels, photo.weights * near, model)
    return own - crossed >= EDGE_GAP


def _nearest(hidden: NDArray[np.bool_], model: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(height, width): the pixels within reach whose nearest pixel of the ``model`` is hidden."""
    away = (~model).astype(np.uint8)
    distance, nearest = cv2.distanceTransformWithLabels(
        away, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    labels = np.asarray(nearest, np.intp)
    of_label = np.zeros(int(labels.max()) + 1, bool)
    of_label[labels[model]] = hidden[model]
    return of_label[labels] & (distance <= REACH * np.count_nonzero(hidden) ** 0.5)
