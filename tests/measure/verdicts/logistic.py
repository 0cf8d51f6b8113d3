"""Logistic regression, and the area under the ROC curve, of a few numbers on a few trials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray

STEPS = 50
"""Of Newton's method; it takes some ten."""


@dataclass(frozen=True, slots=True, eq=False)
class LogisticModel:
    """The probability ``1 / (1 + exp(-(offset + weights . (x - mean) / deviation)))``."""

    mean: FloatArray
    deviation: FloatArray
    weights: FloatArray
    """(k,) each."""
    offset: float
    bound: float
    """Standardised numbers are cut off at so many standard deviations."""

    def probabilities(self, parameters: FloatArray) -> FloatArray:
        """(N,) for numbers (N, k)."""
        return _sigmoid(self._standardised(parameters) @ self.weights + self.offset)

    def _standardised(self, parameters: FloatArray) -> FloatArray:
        return np.clip((parameters - self.mean) / self.deviation, -self.bound, self.bound)


def fit_logistic(
    parameters: FloatArray, right: NDArray[np.bool_], penalty: float, bound: float
) -> LogisticModel:
    """The model of numbers (N, k) and answers (N,) that is most likely, with ``penalty`` times half
    the squared length of the weights against it.

    Few trials want a penalty: without one, separable trials would have weights without end.
    """
    mean, deviation = parameters.mean(axis=0), np.maximum(parameters.std(axis=0), 1e-9)
    scaled = np.clip((parameters - mean) / deviation, -bound, bound)
    design = np.column_stack([scaled, np.ones(len(scaled))])
    ridge = penalty * np.eye(design.shape[1])
    ridge[-1, -1] = 1e-6
    weights = np.zeros(design.shape[1])
    for _ in range(STEPS):
        found = _sigmoid(design @ weights)
        slope = design.T @ (found - right) + ridge @ weights
        curvature = (design.T * (found * (1.0 - found))) @ design + ridge
        step = np.linalg.solve(curvature, slope)
        # Newton's step is too far where all is nearly certain.
        weights = weights - step * min(1.0, 4.0 / max(float(np.abs(step).max()), 1e-12))
    return LogisticModel(mean, deviation, weights[:-1], float(weights[-1]), bound)


def area_under_roc(scores: FloatArray, right: NDArray[np.bool_]) -> float:
    """How often a right one has the higher score of a right and a wrong one; ties count half.

    nan where there are none of one kind.
    """
    good, bad = scores[right][:, None], scores[~right][None, :]
    if not good.size or not bad.size:
        return float("nan")
    return float(np.mean((good > bad) + 0.5 * (good == bad)))


def _sigmoid(score: FloatArray) -> FloatArray:
    return 1.0 / (1.0 + np.exp(-np.clip(score, -50.0, 50.0)))
