"""Ends of searches that need not be searched for."""

from __future__ import annotations

import numpy as np

from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.unexplained import LossScale
from poseviewer.geometry.camera import Pose


def ended(pose: Pose, loss: float) -> FitProgress:
    """A search that ended at a pose; its loss is the paper's, between 0 and 1."""
    none, scale = np.zeros((0, 6)), LossScale(1, 1, has_edges=False)
    return FitProgress(
        np.zeros(6), pose, loss, 1.0, scale, none, np.zeros(0), 1, 0, 0.1, Status.CONVERGED
    )
