"""Run poseviewer with a loss of your own: own_loss.py fit PHOTO MODEL START --loss correlation."""

import sys

import numpy as np

from poseviewer.cli.main import main
from poseviewer.losses.known_losses import LOSSES
from poseviewer.losses.loss import Loss, LossScale, min_pixels


def cross_correlation(moments):
    """Return 1 - r, with the correlation r of the photo's grey and the model's; 2 is the worst."""
    grey = [0, moments.photo_channels]  # the first attributes of photo and model
    (photo, both), (_, model) = moments.covariance[np.ix_(grey, grey)]
    if moments.pixels < min_pixels(len(moments.mean)) or photo * model <= 0.0:
        return 2.0
    return float(1.0 - both / np.sqrt(photo * model))


CORRELATION = Loss(
    name="correlation",
    label="Correlation of grey",
    hint="Correlation: what normalised cross-correlation of grey leaves.",
    of_moments=cross_correlation,
    scale=lambda _photo: LossScale(2.0),
    is_grey=True,
)
LOSSES[CORRELATION.name] = CORRELATION
"""In the package, this is the row of ``known_losses.py``."""

if __name__ == "__main__":
    sys.exit(main())
