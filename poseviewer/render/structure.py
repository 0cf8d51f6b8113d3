"""Colour classes and edges of a photo, which do not depend on the light.

- *Classes.* Beside the colours, F has the memberships in a few classes of colours, found by
  k-means in CIE Lab. With memberships alone, the paper's loss is the correlation ratio of Roche et
  al. (MICCAI 1998) for a vector of model attributes: the fraction of their variance within classes.
  With the colours, it is exact under the paper's affine light, too.
- *Edges.* Attributes a_1 ... a_q give the structure tensor ``J = sum grad a_i grad a_i^T`` and the
  orientation field ``e = (J_xx - J_yy, 2 J_xy) / (J_xx + J_yy + noise^2)``, a vector in the unit
  disc at twice the angle of the gradient, without its sign and strength. The cosine between the
  photo's field and the model's over P measures their agreement.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2, vq

from poseviewer.geometry.arrays import FloatArray

CLASSES = 16
"""Number of colour classes: fewer merge things of different colours, more change nothing."""
MAX_COLOUR_SAMPLES = 20_000
"""Pixels from which the classes are found, at most: more take longer and change nothing."""
FEW_SAMPLES = 200
"""Samples that are first searched for more colours than classes: sorting all takes long."""
SMOOTHING_PX = 1.0
"""Standard deviation, in px, of the blur of the photo before its gradients: sensor noise."""
REACH_PX = 2.0
"""Standard deviation, in px, of the blur of both fields: edges this near to each other agree."""
PHOTO_NOISE = 0.02
"""Gradient, per px, of the photo's lightened values below which there is no edge."""
MODEL_NOISE = 0.1
"""Gradient, per px, of the model's attributes below which there is no edge."""
BLUR_TAPS = cv2.getGaussianKernel(17, REACH_PX)[8:, 0].astype(np.float32)
"""The right half of the fields' blur, from its middle, as in OpenCV."""
LIGHTENING = 1.0 / 2.2
"""Exponent on the photo's values, so that edges in the shade are as strong."""
STEP_PX = 5
"""Side, in px, of the square whose extremes replace a blurred edge."""
PLATEAU_PX = 9
"""Side, in px, of the square in which both sides of a blurred edge must be level."""
MIN_STEP_FRACTION = 0.8
"""Range in the smaller square over that in the larger one, at least: both sides are level."""
MIN_CONTRAST = 0.3
"""Difference of a steep edge's extremes, over their sum, at least."""
MIN_STEP = 0.05
"""Difference of a steep edge's extremes beyond ``MIN_CONTRAST``, at least, in [0, 1]."""
MARGIN_PX = 10
"""Reach, in px, of the model's field beyond the model: 1 by the gradient, 8 by the blur."""


@dataclass(frozen=True, slots=True, eq=False)
class PhotoStructure:
    """Classes and edges of a photo's region P."""

    labels: NDArray[np.uint8]
    """(height, width): the class of each pixel."""
    class_weights: FloatArray
    """(K,): sum of the weights of each class; K is the number of classes."""
    field: NDArray[np.float32]
    """(height, width, 2): the orientation field, scaled so that its weighted square sum is 1."""
    is_steep: bool = False
    """Whether blurred edges are steepened, as by ``make_structure``."""

    def sums(
        self, channels: NDArray[np.float32], weights: NDArray[np.float32]
    ) -> tuple[FloatArray, FloatArray]:
        """Sum ``channels`` (height, width, n) and memberships, weighted.

        Returns:
            Sums (n + K,), and sums of products (n + K, n + K).
        """
        counts, classes = weights > 0.0, len(self.class_weights)
        colours, weight = channels[counts].astype(float), weights[counts].astype(float)
        weighted, labels = weight[:, None] * colours, self.labels[counts]
        by_class = np.array([np.bincount(labels, column, classes) for column in weighted.T])
        members = np.diag(self.class_weights)
        second = np.block([[weighted.T @ colours, by_class], [by_class.T, members]])
        return np.concatenate([weighted.sum(axis=0), self.class_weights]), second


def make_structure(
    channels: NDArray[np.float32], weights: NDArray[np.float32], is_steep: bool = False
) -> PhotoStructure:
    """Find classes and edges of a photo (height, width, 1 or 3) in [0, 1], over ``weights`` > 0.

    ``is_steep`` puts each pixel of a blurred edge into the class of the side it lies on.
    """
    rows, columns = bounding_slices(weights)
    values = np.clip(channels[rows, columns], 0.0, 1.0)
    light = values ** np.float32(LIGHTENING)
    sides = _steepen(values) ** np.float32(LIGHTENING) if is_steep else light
    inside = weights[rows, columns]
    labels = np.zeros(weights.shape, np.uint8)
    labels[rows, columns] = _classes(_as_lab(sides), inside > 0.0)
    count = int(labels.max(initial=0)) + 1
    class_weights = np.bincount(labels.ravel(), weights.ravel(), count).astype(float)
    field = np.zeros((*weights.shape, 2), np.float32)
    field[rows, columns] = _blur_field(orientation_field(light, PHOTO_NOISE, SMOOTHING_PX))
    length = float(np.sqrt(np.einsum("vu,vuk,vuk->", weights, field, field, dtype=float)))
    if length > 0.0:
        field /= np.float32(length)
    for array in (labels, class_weights, field):
        array.flags.writeable = False
    return PhotoStructure(labels, class_weights, field, is_steep)


def _steepen(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w, n): turn blurred edges into steps by toggle mapping (Kramer and Bruckner, 1975)."""
    # Of linear values: halfway between lightened ones, dark things would look too small.
    squares = [np.ones((side, side), np.uint8) for side in (STEP_PX, PLATEAU_PX)]
    # OpenCV drops the axis of a single channel.
    least, lowest = (cv2.erode(light, s).reshape(light.shape) for s in squares)
    greatest, highest = (cv2.dilate(light, s).reshape(light.shape) for s in squares)
    nearer = np.where(light - least <= greatest - light, least, greatest)
    is_step = greatest - least > MIN_STEP_FRACTION * (highest - lowest)
    is_clear = greatest - least > MIN_CONTRAST * (greatest + least) + MIN_STEP
    return np.where(is_step & is_clear, nearer, light)


def orientation_field(
    attributes: NDArray[np.float32], noise: float, smoothing_px: float = 0.0
) -> NDArray[np.float32]:
    """Return the orientation field e (h, w, 2) of attributes (h, w, q).

    Attributes are smoothed first; beyond the picture they are as at its border, or 0 without
    smoothing. The field is not yet blurred by ``REACH_PX``.
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
    """Return the cosine in [-1, 1] between the fields (h, w, 2) of photo and model over P.

    The model's ``field`` is not yet blurred, and 0 beside this part of the photo. Without edges the
    cosine is 0.
    """
    field = _blur_field(field)
    weighted = field * weights[..., None]
    length = float(np.vdot(weighted, field))
    if length <= 0.0:
        return 0.0
    return float(np.vdot(weighted, photo_field)) / length**0.5


def _blur_field(field: NDArray[np.float32]) -> NDArray[np.float32]:
    blurred = cv2.GaussianBlur(field, (0, 0), REACH_PX, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(blurred, np.float32)


def _as_lab(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w, 3): CIE Lab."""
    rgb = light if light.shape[2] == 3 else np.repeat(light, 3, axis=2)
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2Lab), np.float32)


def _classes(lab: NDArray[np.float32], counts: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(h, w): classes of the pixels that count; 0 for the others."""
    labels = np.zeros(counts.shape, np.uint8)
    colours = lab[counts]
    if not len(colours):
        return labels
    step = -(-len(colours) // MAX_COLOUR_SAMPLES)
    samples = colours[::step].astype(float)
    every = max(len(samples) // FEW_SAMPLES, 1)
    few = len(np.unique(samples[::every], axis=0)) <= CLASSES
    different = np.unique(samples, axis=0) if few else samples
    if len(different) > CLASSES:
        centres, of_sample = kmeans2(samples, CLASSES, minit="++", rng=0, missing="raise")
        different = centres[np.unique(of_sample)]
    labels[counts] = vq(colours.astype(float), different)[0]
    return labels


def bounding_slices(mask: NDArray, margin: int = 0) -> tuple[slice, slice]:
    """Return the rows and columns about ``mask`` > 0, with a margin within the picture."""
    left, top, width, height = cv2.boundingRect((mask > 0).view(np.uint8))
    rows, columns = (
        slice(max(first - margin, 0), min(first + length + margin, size))
        for first, length, size in zip((top, left), (height, width), mask.shape, strict=True)
    )
    return rows, columns
