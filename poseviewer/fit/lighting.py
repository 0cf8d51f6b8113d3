"""The lighting that explains the photo best: what the loss finds without being asked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.linear_algebra import whiten
from poseviewer.render.types import Moments


@dataclass(frozen=True, slots=True, eq=False)
class Lighting:
    """The affine map ``F = gain @ M + offset`` of least squared residual, ``A`` and ``b``."""

    gain: FloatArray
    """A (n, m)."""
    offset: FloatArray
    """b (n,): light that is there without the model (haze, sensor offset)."""

    @property
    def ambient(self) -> FloatArray:
        """(n,): ambient light of each photo channel, in photo units per unit of reflectance."""
        return self._per_reflectance()[:, :, 0].sum(axis=1)

    @property
    def diffuse(self) -> FloatArray:
        """(n, 3): strength times direction of the directed light, camera frame, per channel."""
        return self._per_reflectance()[:, :, 1:].sum(axis=1)

    @property
    def direction(self) -> FloatArray | None:
        """(3,): unit vector from the model towards the light, camera frame; None if undirected."""
        total = self.diffuse.sum(axis=0)
        length = float(np.linalg.norm(total))
        return total / length if length > 1e-9 else None

    def _per_reflectance(self) -> FloatArray:
        """(n, 1 or 3, 4): ambient and directed light for each channel of the reflectance."""
        n, m = self.gain.shape
        return self.gain[:, : m - m % 4].reshape(n, -1, 4)

    def apply(self, attributes: FloatArray) -> FloatArray:
        """The relit model ``A M + b`` (..., n) of model attributes (..., m)."""
        return attributes @ self.gain.T + self.offset


def recover_lighting(moments: Moments) -> Lighting:
    """``A = C_FM C_MM^+`` and ``b = mean(F) - A mean(M)``.

    Where the model cannot tell parts of the lighting apart (constant reflectance, a flat model),
    the pseudo-inverse gives the least such lighting. Attributes that are constant get none.
    """
    n = moments.photo_channels
    model = whiten(moments.covariance[n:, n:], moments.mean[n:])
    gain = moments.covariance[:n, n:] @ model.T @ model
    return Lighting(gain, moments.mean[:n] - gain @ moments.mean[n:])
