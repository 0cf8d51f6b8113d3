"""The light of synthetic photographs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray, frozen_array

OVER_THE_SHOULDER = (0.0, -0.6, -0.8)
"""Camera frame (y down, z away): from behind and above the photographer."""
WIDEST_ANGLE_DEG = 65.0


@dataclass(frozen=True, slots=True, eq=False)
class DirectionalLight:
    """A light so far away that it comes from one direction."""

    towards: FloatArray
    """(3,): unit vector towards the light, in the camera frame."""
    intensity: FloatArray
    """(3,): RGB that a white surface facing the light gains; 1 is the photo's white."""

    def __post_init__(self) -> None:
        towards = np.asarray(self.towards, dtype=float)
        towards = towards / np.linalg.norm(towards)
        object.__setattr__(self, "towards", frozen_array(towards, (3,)))
        object.__setattr__(self, "intensity", frozen_array(self.intensity, (3,)))


@dataclass(frozen=True, slots=True, eq=False)
class Lighting:
    """Light from everywhere and light from a few directions."""

    ambient: FloatArray
    """(3,): RGB of a white surface that no directional light reaches."""
    lights: tuple[DirectionalLight, ...] = ()
    """At most four."""

    def __post_init__(self) -> None:
        if len(self.lights) > 4:
            raise ValueError(f"{len(self.lights)} directional lights; at most 4 can be drawn")
        object.__setattr__(self, "ambient", frozen_array(self.ambient, (3,)))


def random_lighting(rng: np.random.Generator) -> Lighting:
    """Daylight-like: some ambient light, one strong light and often a weak one, slightly tinted.

    The strong light comes from within 65 degrees of over the photographer's shoulder.
    """
    ambient = rng.uniform(0.15, 0.4) * _tint(rng)
    key = DirectionalLight(_direction(rng), rng.uniform(0.4, 0.7) * _tint(rng))
    if rng.random() < 0.4:
        return Lighting(ambient, (key,))
    fill = DirectionalLight(_direction(rng), rng.uniform(0.05, 0.2) * _tint(rng))
    return Lighting(ambient, (key, fill))


def _tint(rng: np.random.Generator) -> FloatArray:
    return rng.uniform(0.9, 1.1, 3)


def _direction(rng: np.random.Generator) -> FloatArray:
    """Uniform on the spherical cap around ``OVER_THE_SHOULDER``."""
    cosine = rng.uniform(np.cos(np.radians(WIDEST_ANGLE_DEG)), 1.0)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    sine = np.sqrt(1.0 - cosine**2)
    on_cap = np.array([sine * np.cos(angle), sine * np.sin(angle), cosine])
    turn = Rotation.align_vectors([OVER_THE_SHOULDER], [(0.0, 0.0, 1.0)])[0]
    return turn.apply(on_cap)
