"""How much each number of the evidence weighs; written by
``python -m poseviewer.evaluation.calibrate_verdict``.
"""

FEATURES: dict[str, tuple[float, float, float]] = {
    "loss_margin": (2.4, 0.6, 0.3),
    "edges": (0.3, 0.1, 1.0),
    "outline_excess": (0.35, 0.15, 0.8),
}
"""Of each number: mean and standard deviation among the trials, and its weight."""
OFFSET = 0.0
FOUND_FROM, LOST_BELOW = 0.7, 0.3
"""Probabilities."""
