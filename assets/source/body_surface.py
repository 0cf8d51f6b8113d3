"""The demo car's outer skin as a smooth implicit surface.

Car frame: x forward, y left, z up, metres, origin on the ground under the car's centre.
The skin is where `skin(p) = 0` (negative inside). It is a lower body (bonnet, flanks,
bumpers) joined to a cabin (windscreen, roof, hatch), each the soft intersection of a few
curved walls, so that every edge of the car comes out as a fillet.
"""

from __future__ import annotations

import numpy as np
from curves import Spline

FRONT_AXLE_X = 1.18
REAR_AXLE_X = -1.34
WHEEL_Z = 0.312
ARCH_RADIUS = 0.352

DECK = Spline(
    [
        (-2.1, 0.955),
        (-1.4, 0.975),
        (-0.5, 0.955),
        (0.35, 0.935),
        (0.85, 0.93),
        (1.25, 0.875),
        (1.6, 0.805),
        (1.85, 0.735),
        (2.1, 0.63),
    ]
)
NOSE = Spline(
    [
        (0.1, 1.90),
        (0.2, 1.945),
        (0.32, 1.98),
        (0.45, 1.992),
        (0.56, 1.985),
        (0.66, 1.955),
        (0.76, 1.90),
        (0.9, 1.77),
    ]
)
TAIL = Spline(
    [
        (0.1, -1.83),
        (0.22, -1.92),
        (0.35, -1.975),
        (0.5, -1.992),
        (0.62, -1.985),
        (0.75, -1.955),
        (0.95, -1.90),
        (1.1, -1.82),
    ]
)
PLAN = Spline(
    [
        (-2.0, 0.80),
        (-1.5, 0.858),
        (-0.9, 0.872),
        (0.0, 0.872),
        (0.9, 0.872),
        (1.4, 0.862),
        (2.0, 0.80),
    ]
)
FLOOR = Spline([(-2.0, 0.25), (-1.6, 0.21), (-1.0, 0.185), (0.8, 0.18), (1.5, 0.185), (2.0, 0.20)])
ROOF = Spline(
    [(0.8, 1.33), (0.3, 1.415), (-0.25, 1.466), (-0.9, 1.452), (-1.5, 1.40), (-1.9, 1.345)]
)
SCREEN = Spline(
    [(0.85, 1.13), (0.97, 0.97), (1.15, 0.685), (1.3, 0.42), (1.42, 0.17), (1.6, -0.25)]
)
HATCH = Spline(
    [(0.85, -1.95), (1.0, -1.905), (1.15, -1.825), (1.3, -1.72), (1.42, -1.62), (1.6, -1.45)]
)
CREASE = Spline([(-2.0, 0.845), (-1.0, 0.815), (0.0, 0.775), (1.0, 0.735), (2.0, 0.70)])


def _soft_max(k: float, *walls: np.ndarray) -> np.ndarray:
    """Smooth maximum; two walls meeting at a right angle get a fillet of about 2.4 k."""
    stack = np.stack(walls)
    top = stack.max(axis=0)
    return top + k * np.log(np.exp((stack - top) / k).sum(axis=0))


def _ramp(v: np.ndarray, k: float) -> np.ndarray:
    """Smooth max(v, 0)."""
    return 0.5 * (v + np.sqrt(v * v + k * k))


def flank_half_width(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Half width of the lower body at side-view position (x, z)."""
    crease = CREASE(x)
    width = PLAN(x) - 0.20 * _ramp(z - crease, 0.018)
    # below the crease a hollow, then the door bulges out again towards the sill
    below = crease - z
    width -= 0.020 * np.exp(-(((below - 0.13) / 0.10) ** 2)) * np.exp(-((x / 1.25) ** 6))
    width -= 0.55 * _ramp(0.36 - z, 0.08) ** 2
    for axle in (FRONT_AXLE_X, REAR_AXLE_X):
        ring = np.hypot(x - axle, z - WHEEL_Z)
        width += 0.024 * np.exp(-((np.maximum(ring - 0.36, 0) / 0.085) ** 2))
    return width


def lower_body(p: np.ndarray) -> np.ndarray:
    """Signed value of the lower body at points (n,3)."""
    x, y, z = p[:, 0], np.abs(p[:, 1]), p[:, 2]
    side = y - flank_half_width(x, z)
    bonnet = 1 / (1 + np.exp(-(x - 0.8) / 0.12))
    # bonnet: crowned, with a gentle power bulge inside two raised lines
    crown = (0.05 + 0.06 * bonnet) * y**2 + bonnet * 0.016 * _ramp(y - 0.42, 0.05) / 0.3
    top = z - DECK(x) + crown
    q = y / 0.8
    nose = (x - NOSE(z) + 0.125 * q**2 + 0.10 * q**4) / 1.12
    tail = (TAIL(z) - x + 0.05 * q**2 + 0.075 * q**4) / 1.08
    floor = FLOOR(x) - z
    shoulder = _soft_max(0.020, side, top)
    ends = _soft_max(0.012, nose, tail)
    return _soft_max(0.022, shoulder, ends, floor)


def cabin(p: np.ndarray) -> np.ndarray:
    """Signed value of the cabin at points (n,3)."""
    x, y, z = p[:, 0], np.abs(p[:, 1]), p[:, 2]
    up = z - 0.95
    half = 0.790 - 0.33 * up - 0.32 * up * np.abs(up)
    half = half - 0.055 * _ramp(-0.6 - x, 0.25) ** 2 - 0.10 * _ramp(x - 0.1, 0.25) ** 2
    side = (y - half) / 1.1
    roof = z - ROOF(x) + 0.085 * y**2 + 0.10 * y**4
    screen = (x - SCREEN(z) + 0.22 * y**2 + 0.10 * y**4) / 1.95
    hatch = (HATCH(z) - x + 0.09 * y**2 + 0.14 * y**4) / 1.22
    floor = 0.6 - z
    return _soft_max(0.028, _soft_max(0.02, side, roof), screen, hatch, floor)


def skin(p: np.ndarray) -> np.ndarray:
    """Signed value of the whole skin at points (n,3): soft union of lower body and cabin."""
    return -_soft_max(0.006, -lower_body(p), -cabin(p))


def gradient(p: np.ndarray, h: float = 1e-4) -> np.ndarray:
    """Central-difference gradient of `skin`, (n,3)."""
    out = np.empty_like(p)
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = h
        out[:, axis] = (skin(p + step) - skin(p - step)) / (2 * h)
    return out


def normals(p: np.ndarray) -> np.ndarray:
    """Unit outward normals of the skin at points (n,3)."""
    g = gradient(p)
    return g / np.linalg.norm(g, axis=1, keepdims=True)


def project(p: np.ndarray, steps: int = 4) -> np.ndarray:
    """Move points (n,3) near the skin onto it, keeping those with y = 0 in that plane."""
    p = p.copy()
    for _ in range(steps):
        g = gradient(p)
        g[p[:, 1] == 0, 1] = 0
        p -= (skin(p) / (g * g).sum(axis=1))[:, None] * g
    return p


def cast(origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """First skin point along rays from inside the car; origin, direction (n,3) -> (n,3)."""
    low, high = np.zeros(len(origin)), np.full(len(origin), 2.5)
    for t in np.arange(0.1, 2.5, 0.02):  # coarse march, so the FIRST crossing is kept
        inside = skin(origin + t * direction) < 0
        low = np.where(inside & (high > t), t, low)
        high = np.where(~inside & (high > t), t, high)
    for _ in range(30):
        mid = 0.5 * (low + high)
        inside = skin(origin + mid[:, None] * direction) < 0
        low, high = np.where(inside, mid, low), np.where(inside, high, mid)
    return origin + 0.5 * (low + high)[:, None] * direction
