"""How much each number of the evidence weighs; written by
``python -m poseviewer.evaluation.calibrate_verdict --write`` from 78 trials, 39 of them right.
"""

FEATURES: dict[str, tuple[float, float, float]] = {
    "light_margin": (2.317, 0.7229, 0.482),
    "spread_percent": (1.704, 0.5707, -0.5825),
    "outline": (0.8318, 0.1505, 0.9296),
}
"""Of each number: mean and standard deviation among the trials, and its weight."""
OFFSET = -0.154
FOUND_FROM, LOST_BELOW = 0.83, 0.43
"""Probabilities from which on, and below which, the verdict is ``found`` and ``lost``."""
