"""How much each number of the evidence weighs; written by
``python -m poseviewer.evaluation.calibrate_verdict --write`` from 78 trials, 39 of them right.
"""

FEATURES: dict[str, tuple[float, float, float]] = {
    "light_margin": (2.322, 0.7149, 0.1723),
    "spread_percent": (1.738, 0.6112, -0.6491),
    "outline": (0.8318, 0.1499, 0.8628),
}
"""Of each number: mean and standard deviation among the trials, and its weight."""
OFFSET = -0.1265
FOUND_FROM, LOST_BELOW = 0.78, 0.26
"""Probabilities from which on, and below which, the verdict is ``found`` and ``lost``."""
