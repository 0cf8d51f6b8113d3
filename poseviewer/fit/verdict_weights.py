"""How much each number of the evidence weighs; written by
``python -m poseviewer.evaluation.calibrate_verdict --write`` from 156 trials, 126 of them right.
"""

FEATURES: dict[str, tuple[float, float, float]] = {
    "light_margin": (2.313, 0.7754, 0.1809),
    "spread_percent": (1.682, 0.5472, -0.9754),
    "outline": (0.8366, 0.1411, 1.267),
}
"""Of each number: mean and standard deviation among the trials, and its weight."""
OFFSET = 2.281
FOUND_FROM, LOST_BELOW = 0.91, 0.5
"""Probabilities from which on, and below which, the verdict is ``found`` and ``lost``."""
