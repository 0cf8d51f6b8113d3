"""What is all around a vehicle: it lights it, and glossy paint shows it."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.files.mesh.load import linear_from_srgb
from poseviewer.geometry.arrays import FloatArray

WIDTH, HEIGHT = 1024, 512
"""Of the equirectangular picture: a turn about the vertical, and from zenith to nadir."""
LOWEST_DEG, HIGHEST_DEG = -30.0, 50.0
"""Between which a photo is stretched; above and below, its first and last row go on."""
GLARE, GLARE_FROM = 3.0, 0.8
"""How much brighter than its photo shows it a clipped sky is, and from which light on."""


def of_photo(photo: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(512, 1024, 3) linear RGB, rows from the zenith down: a photo (h, w, 3) and its mirror image
    side by side, closing the circle.
    """
    both = np.concatenate([photo, photo[:, ::-1]], axis=1)
    top, bottom = (round((90.0 - edge) / 180.0 * HEIGHT) for edge in (HIGHEST_DEG, LOWEST_DEG))
    small = cv2.resize(both, (WIDTH, bottom - top), interpolation=cv2.INTER_AREA)
    band = linear_from_srgb(small / 255.0)
    rows = np.clip(np.arange(HEIGHT) - top, 0, bottom - top - 1)
    # The sky above and the ground below are as bright all around, or streaks would meet there.
    band[0], band[-1] = band[0].mean(axis=0), band[-1].mean(axis=0)
    light = band[rows]
    return _glaring(light).astype(np.float32)


def of_a_plain(ground: FloatArray, random: np.random.Generator) -> NDArray[np.float32]:
    """(512, 1024, 3) linear RGB: a plain of ``ground`` (3,), linear RGB, hills, a clear sky."""
    rise = 90.0 - (np.arange(HEIGHT) + 0.5) / HEIGHT * 180.0
    haze, zenith = np.array([0.75, 0.80, 0.88]), np.array([0.22, 0.38, 0.72])
    share = np.clip(rise / 60.0, 0.0, 1.0)[:, None] ** 0.6
    rows = np.where(rise[:, None] < 0.0, ground, (1.0 - share) * haze + share * zenith)
    light = np.repeat(rows[:, None], WIDTH, axis=1)
    hills = np.array([0.10, 0.13, 0.08]) * random.uniform(0.6, 1.4)
    is_hill = (rise[:, None] >= 0.0) & (rise[:, None] < _skyline(random))
    light[is_hill] = hills
    return light.astype(np.float32)


def scaled_to(light: NDArray[np.float32], ambient: float) -> NDArray[np.float32]:
    """The same, so bright that a white ground is lit to ``ambient`` by its upper half alone."""
    rise = np.pi * (0.5 - (np.arange(HEIGHT // 2) + 0.5) / HEIGHT)
    # Of Lambert's cosine and the solid angle of a row's pixels: their sum is 1.
    weights = np.sin(rise) * np.cos(rise)
    grey = light[: HEIGHT // 2].mean(axis=(1, 2))
    return np.float32(ambient / max(float(grey @ weights / weights.sum()), 1e-6)) * light


def _glaring(light: NDArray) -> NDArray:
    over = np.clip((light - GLARE_FROM) / (1.0 - GLARE_FROM), 0.0, 1.0)
    return light * (1.0 + (GLARE - 1.0) * over)


def _skyline(random: np.random.Generator) -> FloatArray:
    """(w,): degrees above the horizon, once around without a step."""
    turn = np.linspace(0.0, 2.0 * math.pi, WIDTH, endpoint=False)
    waves = [random.uniform(0.3, 2.5) / n * np.sin(n * turn + random.uniform(0, 6.3))
             for n in range(1, 12)]  # fmt: skip
    return 6.0 + np.sum(waves, axis=0)
