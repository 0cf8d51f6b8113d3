"""The lighting that explains the photo best; the loss takes it without asking for it."""

from __future__ import annotations

from dataclasses import dataclass

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.linear_algebra import whiten
from poseviewer.render.types import Moments


@dataclass(frozen=True, slots=True, eq=False)
class Lighting:
    """The affine map ``F = gain @ M + offset`` of least squared residual."""

    gain: FloatArray
    """A (n, m)."""
    offset: FloatArray
    """b (n,): light that is there without the model (haze, sensor offset)."""

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
