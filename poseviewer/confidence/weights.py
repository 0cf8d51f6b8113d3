"""Weights by ``python -m tests.measure.calibrate --write`` from 156 trials, 123 of them right."""

FEATURES: dict[str, tuple[float, float, float]] = {
    "turn_margin": (1.077, 0.6585, 1.584),
    "spread_percent": (1.679, 0.544, -0.9448),
    "outline": (0.8347, 0.1425, 0.9164),
    "seen": (1, 0.166, 1.265),
}
"""Mean and standard deviation of each feature among the trials, and its weight."""
OFFSET = 2.63
FOUND_FROM, LOST_BELOW = 0.81, 0.5
"""Probabilities from which the verdict is ``found``, and below which it is ``lost``."""
