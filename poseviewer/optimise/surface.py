"""Quadratic functions fitted to losses by least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from poseviewer.geometry.arrays import FloatArray

LEAST_CURVATURE = 1e-2
"""As a share of the greatest; smaller ones cannot be told from none."""


@dataclass(frozen=True, slots=True, eq=False)
class QuadraticSurface:
    """``constant + slope z + z hessian z / 2`` of z (d,)."""

    constant: float
    slope: FloatArray
    """(d,)."""
    hessian: FloatArray
    """(d, d): symmetric."""

    def __call__(self, z: FloatArray) -> FloatArray:
        """(n,): at ``z`` (n, d)."""
        return self.constant + z @ self.slope + 0.5 * ((z @ self.hessian) * z).sum(axis=1)

    def principal(self) -> tuple[FloatArray, FloatArray]:
        """(d, d), columns: the principal directions; (d,): the curvatures along them, made positive
        and none much smaller than the greatest.
        """
        curvatures, directions = np.linalg.eigh(self.hessian)
        curvatures = np.abs(curvatures)
        return directions, np.maximum(curvatures, LEAST_CURVATURE * curvatures.max() + 1e-300)

    def least(self, radius: float) -> FloatArray:
        """(d,): where it would be least with these curvatures, or on the way there so far off."""
        directions, curvatures = self.principal()
        step = -directions @ ((directions.T @ self.slope) / curvatures)
        return step * min(1.0, radius / max(float(np.linalg.norm(step)), 1e-300))


def coefficients(size: int) -> int:
    """How many a quadratic function of ``size`` numbers has."""
    return (size + 1) * (size + 2) // 2


def fit_surface(
    z: FloatArray, losses: FloatArray, weights: FloatArray, stiffness: float = 0.1
) -> QuadraticSurface:
    """That of the losses (n,) at ``z`` (n, d), by ``weights`` (n,). ``stiffness``: how many points
    it counts for that the Hessian is a multiple of the identity; so of few points it is a round one
    (cf. M. Powell, *The NEWUOA software for unconstrained optimization without derivatives*, 2006:
    the least change), and z is to be in units in which the losses are about round.

    Raises:
        numpy.linalg.LinAlgError: a loss is not finite.
    """
    if not np.isfinite(losses).all():
        raise np.linalg.LinAlgError("losses that are not finite have no surface")
    size = z.shape[1]
    rows, columns = np.triu_indices(size)
    bends = z[:, rows] * z[:, columns] * np.where(rows == columns, 0.5, 1.0)
    terms = np.hstack([np.ones((len(z), 1)), z, 0.5 * (z**2).sum(axis=1, keepdims=True), bends])
    weighted = weights[:, None] * terms
    normal = terms.T @ weighted
    bent = np.arange(size + 2, terms.shape[1])
    normal[bent, bent] += stiffness * normal.diagonal()[bent].mean() / len(z)
    found = np.asarray(np.linalg.lstsq(normal, losses @ weighted, rcond=None)[0], dtype=float)
    hessian = found[size + 1] * np.eye(size)
    hessian[rows, columns] += found[bent]
    hessian[columns, rows] = hessian[rows, columns]
    return QuadraticSurface(float(found[0]), found[1 : size + 1], hessian)
