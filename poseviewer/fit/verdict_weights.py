"""How much each number of the evidence weighs: provisional, from 24 trials of real photos alone,
8 of them right. ``python -m poseviewer.evaluation.calibrate_verdict --write`` makes this file.
"""

FEATURES: dict[str, tuple[float, float, float]] = {
    "loss_margin": (2.284, 0.6465, -0.07169),
    "rival_margin": (0.3874, 1.582, 0.4307),
    "spread_percent": (1.815, 0.7144, -1.029),
    "outline": (0.7739, 0.1754, 0.6091),
    "outline_excess": (0.2325, 0.1443, 0.2938),
}
"""Of each number: mean and standard deviation among the trials, and its weight."""
OFFSET = -1.319
FOUND_FROM, LOST_BELOW = 0.72, 0.45
"""Probabilities from which on, and below which, the verdict is ``found`` and ``lost``."""
