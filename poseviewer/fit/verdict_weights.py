"""How much each number of the evidence weighs: provisional, from 26 trials of real photos alone,
11 of them right. ``python -m poseviewer.evaluation.calibrate_verdict --write`` makes this file.
"""

FEATURES: dict[str, tuple[float, float, float]] = {
    "loss_margin": (2.224, 0.4711, 0.02325),
    "edge_margin": (1.886, 0.433, 0.1365),
    "rival_margin": (0.5923, 1.312, 0.2367),
    "spread_percent": (1.738, 0.5498, -0.4471),
    "edges": (0.3282, 0.1468, -0.1333),
    "outline": (0.8169, 0.1575, 0.2824),
    "outline_excess": (0.2589, 0.158, 0.6486),
}
"""Of each number: mean and standard deviation among the trials, and its weight."""
OFFSET = -0.5143
FOUND_FROM, LOST_BELOW = 0.9, 0.4
"""Probabilities from which on, and below which, the verdict is ``found`` and ``lost``."""
