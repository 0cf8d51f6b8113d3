"""Colour classes and edges of a photo, which are there whatever the light.

- *Classes.* To the colours F adds the memberships in a few classes of colours, found by k-means in
  CIE Lab. With memberships alone the loss of the paper is the correlation ratio of Roche et al.
  (MICCAI 1998) for a vector of model attributes: the share of their variance within the classes.
  With the colours it is exact where the affine light of the paper holds, too.
- *Edges.* Attributes a_1 ... a_q give the structure tensor ``J = sum grad a_i grad a_i^T`` and the
  orientation field ``e = (J_xx - J_yy, 2 J_xy) / (J_xx + J_yy + noise^2)``, a vector in the unit
  disc at twice the angle of the gradient, without its sign and strength. The cosine between the
  photo's field and the model's over P tells how well they agree.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2, vq

from poseviewer.geometry.arrays import FloatArray

CLASSES = 16
"""Twice as many make no difference on real photos; with a few, things of other colours are one."""
SAMPLES, FEW = 20_000, 200
"""Pixels that the classes are found from, and those of them that are looked at first."""
SMOOTHING_PX, REACH_PX = 1.0, 2.0
"""Standard deviations of the blur of the photo, before its gradients, and of both fields."""
PHOTO_NOISE, MODEL_NOISE = 0.02, 0.1
"""Gradients below this, per px, of the lightened photo and of model attributes are no edges."""
BLUR_TAPS = cv2.getGaussianKernel(17, REACH_PX)[8:, 0].astype(np.float32)
"""The right half of the blur of the fields, from its middle: OpenCV's own for that deviation."""
LIGHTENING = 1.0 / 2.2
"""Exponent on the photo's values: edges in the shade are edges."""
STEP_PX, PLATEAU_PX = 5, 9
"""Sides of the square whose extremes make an edge steep, and of that where it must be level."""
STEP_SHARE = 0.8
"""Least share of the larger square's range in the smaller one: else it goes on beside the edge."""
CLEAR_SHARE, CLEAR_STEP = 0.3, 0.05
"""Share of their sum, and that much more, by which the extremes of a steep edge differ."""
MARGIN_PX = 10
"""The model's field reaches no farther beyond it: the gradient's 1 px and the blur's 8."""


@dataclass(frozen=True, slots=True, eq=False)
class PhotoStructure:
    """Classes and edges of a photo's region P."""

    labels: NDArray[np.uint8]
    """(height, width): the class of each pixel."""
    shares: FloatArray
    """(K,): sum of the weights of each class; K is the number of classes."""
    field: NDArray[np.float32]
    """(height, width, 2): the orientation field, scaled so that its weighted square sum is 1."""
    is_steep: bool = False
    """Whether blurred edges were made steep, see ``make_structure``."""

    def sums(
        self, channels: NDArray[np.float32], weights: NDArray[np.float32]
    ) -> tuple[FloatArray, FloatArray]:
        """Weighted sums of ``channels`` (height, width, n) and memberships, and of their products.

        (n + K,) and (n + K, n + K).
        """
        counts, classes = weights > 0.0, len(self.shares)
        colours, weight = channels[counts].astype(float), weights[counts].astype(float)
        weighted, labels = weight[:, None] * colours, self.labels[counts]
        by_class = np.array([np.bincount(labels, column, classes) for column in weighted.T])
        second = np.block([[weighted.T @ colours, by_class], [by_class.T, np.diag(self.shares)]])
        return np.concatenate([weighted.sum(axis=0), self.shares]), second


def make_structure(
    channels: NDArray[np.float32], weights: NDArray[np.float32], is_steep: bool = False
) -> PhotoStructure:
    """Classes and edges of a photo (height, width, 1 or 3) in [0, 1], over ``weights`` > 0.

    ``is_steep``: a pixel that a blurred edge runs through is of the class on its own side of it.
    """
    rows, columns = bounding_slices(weights)
    seen = np.clip(channels[rows, columns], 0.0, 1.0)
    light = seen ** np.float32(LIGHTENING)
    sides = _steepened(seen) ** np.float32(LIGHTENING) if is_steep else light
    inside = weights[rows, columns]
    labels = np.zeros(weights.shape, np.uint8)
    labels[rows, columns] = _classes(_as_lab(sides), inside > 0.0)
    count = int(labels.max(initial=0)) + 1
    shares = np.bincount(labels.ravel(), weights.ravel(), count).astype(float)
    field = np.zeros((*weights.shape, 2), np.float32)
    field[rows, columns] = _blurred(orientation_field(light, PHOTO_NOISE, SMOOTHING_PX))
    length = float(np.sqrt(np.einsum("vu,vuk,vuk->", weights, field, field, dtype=float)))
    if length > 0.0:
        field /= np.float32(length)
    for array in (labels, shares, field):
        array.flags.writeable = False
    return PhotoStructure(labels, shares, field, is_steep)


def _steepened(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w, n): blurred edges made steps by toggle mapping (Kramer and Bruckner, 1975)."""
    # Not of lightened values, where half way is not the edge: dark things would look too small.
    squares = [np.ones((side, side), np.uint8) for side in (STEP_PX, PLATEAU_PX)]
    # OpenCV drops the axis of a single channel.
    least, lowest = (cv2.erode(light, s).reshape(light.shape) for s in squares)
    greatest, highest = (cv2.dilate(light, s).reshape(light.shape) for s in squares)
    nearer = np.where(light - least <= greatest - light, least, greatest)
    is_step = greatest - least > STEP_SHARE * (highest - lowest)
    is_clear = greatest - least > CLEAR_SHARE * (greatest + least) + CLEAR_STEP
    return np.where(is_step & is_clear, nearer, light)


def orientation_field(
    attributes: NDArray[np.float32], noise: float, smoothing_px: float = 0.0
) -> NDArray[np.float32]:
    """(h, w, 2): e of attributes (h, w, q), smoothed before; not yet blurred by ``REACH_PX``.

    Beyond the picture the attributes go on as at its border where they are smoothed, else are 0.
    """
    smooth, border = attributes, cv2.BORDER_CONSTANT
    if smoothing_px > 0.0:
        smooth, border = cv2.GaussianBlur(attributes, (0, 0), smoothing_px), cv2.BORDER_REPLICATE
    smooth = np.asarray(smooth, np.float32).reshape(attributes.shape)
    across, down = (
        cv2.Sobel(smooth, cv2.CV_32F, *step, scale=0.125, borderType=border).reshape(smooth.shape)
        for step in ((1, 0), (0, 1))
    )
    xx = np.einsum("vuk,vuk->vu", across, across)
    yy = np.einsum("vuk,vuk->vu", down, down)
    xy = np.einsum("vuk,vuk->vu", across, down)
    share = 1.0 / (xx + yy + np.float32(noise * noise))
    return np.dstack([(xx - yy) * share, 2.0 * xy * share]).astype(np.float32)


def edge_agreement(
    photo_field: NDArray[np.float32], weights: NDArray[np.float32], field: NDArray[np.float32]
) -> float:
    """Cosine in [-1, 1] between the fields (h, w, 2) of photo and model over P; 0 without edges.

    The model's ``field`` is not yet blurred, and 0 beside this part of the photo.
    """
    field = _blurred(field)
    weighted = field * weights[..., None]
    length = float(np.vdot(weighted, field))
    if length <= 0.0:
        return 0.0
    return float(np.vdot(weighted, photo_field)) / length**0.5


def _blurred(field: NDArray[np.float32]) -> NDArray[np.float32]:
    blurred = cv2.GaussianBlur(field, (0, 0), REACH_PX, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(blurred, np.float32)


def _as_lab(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w, 3): CIE Lab."""
    rgb = light if light.shape[2] == 3 else np.repeat(light, 3, axis=2)
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2Lab), np.float32)


def _classes(lab: NDArray[np.float32], counts: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(h, w): the classes of the pixels that count; 0 for the others."""
    labels = np.zeros(counts.shape, np.uint8)
    colours = lab[counts]
    if not len(colours):
        return labels
    step = -(-len(colours) // SAMPLES)
    samples = colours[::step].astype(float)
    # A few tell mostly that there are more colours than classes: to sort all takes long.
    few = len(np.unique(samples[:: max(len(samples) // FEW, 1)], axis=0)) <= CLASSES
    different = np.unique(samples, axis=0) if few else samples
    if len(different) > CLASSES:
        centres, of_sample = kmeans2(samples, CLASSES, minit="++", rng=0, missing="raise")
        different = centres[np.unique(of_sample)]
    labels[counts] = vq(colours.astype(float), different)[0]
    return labels


def bounding_slices(mask: NDArray, margin: int = 0) -> tuple[slice, slice]:
    """Rows and columns that hold all of ``mask`` > 0, and a margin as far as the picture goes."""
    left, top, width, height = cv2.boundingRect((mask > 0).view(np.uint8))
    rows, columns = (
        slice(max(first - margin, 0), min(first + length + margin, size))
        for first, length, size in zip((top, left), (height, width), mask.shape, strict=True)
    )
    return rows, columns
