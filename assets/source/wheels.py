"""One wheel: tyre, ten-spoke rim, brake disc. Local frame: y outward, axle on the y axis.

y = 0 is the outer face plane of the rim. Metres.
"""

from __future__ import annotations

import numpy as np
from body_surface import WHEEL_Z
from shell import Field, Shell, grid_faces, join, rim_wall, split
from solids import turned

RIM_RADIUS = 0.208
SPOKES = 5


def tyre() -> Shell:
    """Rubber ring with bulged side walls and four grooves in the tread."""
    side = [
        (0.203, -0.012),
        (0.2035, -0.004),
        (0.209, 0.001),
        (0.222, 0.004),
        (0.240, 0.0075),
        (0.258, 0.0085),
        (0.274, 0.006),
        (0.287, 0.000),
        (0.297, -0.008),
        (0.304, -0.018),
        (0.3085, -0.030),
    ]
    tread: list[tuple[float, float]] = []
    for groove in (-0.052, -0.082, -0.112, -0.142):
        tread += [
            (0.312, groove + 0.005),
            (0.305, groove + 0.004),
            (0.305, groove - 0.004),
            (0.312, groove - 0.005),
        ]
    back = [(r, -0.194 - y) for r, y in reversed(side)][::2]
    profile = np.array(side + tread + back)
    profile[:, 0] *= WHEEL_Z / 0.312
    return turned(profile, 60)


def _face_height(r: np.ndarray) -> np.ndarray:
    """Y of the rim's front over the radius: lip, step, spokes dished towards a raised hub."""
    lip = -0.010 / (1 + np.exp((r - 0.193) / 0.0015))
    dish = -0.018 * np.clip((0.185 - r) / 0.14, 0, 1) ** 1.3
    return lip + dish + 0.010 / (1 + np.exp((r - 0.037) / 0.002))


def _openings() -> Field:
    """Field of the holes between the spokes (negative inside a hole)."""

    def field(p: np.ndarray) -> np.ndarray:
        r, t = np.hypot(p[:, 0], p[:, 2]), np.arctan2(p[:, 2], p[:, 0])
        best = np.full(len(p), 1.0)
        for wide, r0, half0, half1 in ((True, 0.072, 0.008, 0.072), (False, 0.085, 0.0045, 0.016)):
            step = 2 * np.pi / SPOKES
            local = (t - (0 if wide else step / 2) + step / 2) % step - step / 2
            along, across = r * np.cos(local), np.abs(r * np.sin(local))
            half = half0 + (half1 - half0) * (along - r0) / (0.183 - r0)
            walls = np.stack([r0 - along, r - 0.183, (across - half) / 1.1])
            k = 0.005 if wide else 0.003
            top = walls.max(0)
            best = np.minimum(best, top + k * np.log(np.exp((walls - top) / k).sum(0)))
        return best

    return field


def rim() -> Shell:
    """Alloy rim: dished face with holes, walls behind its edges, barrel."""
    radii = np.concatenate(
        [
            [0.001],
            [0.020, 0.032, 0.036, 0.039, 0.045],
            np.linspace(0.058, 0.184, 9),
            np.linspace(0.190, 0.197, 4),
            [RIM_RADIUS],
        ]
    )
    t = np.linspace(0, 2 * np.pi, 71)
    r, tt = np.meshgrid(radii, t, indexing="ij")
    y = _face_height(r)
    slope = (_face_height(r + 1e-4) - _face_height(r - 1e-4)) / 2e-4
    normal = np.stack([-slope * np.cos(tt), np.ones_like(r), -slope * np.sin(tt)], 2).reshape(-1, 3)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    points = np.stack([r * np.cos(tt), y, r * np.sin(tt)], 2)
    points[:, -1] = points[:, 0]  # close the seam exactly
    face = Shell(points.reshape(-1, 3), normal, grid_faces(len(radii), len(t))[:, ::-1])
    vertices, first, again = np.unique(
        np.round(face.vertices, 7), axis=0, return_index=True, return_inverse=True
    )
    face = Shell(vertices, face.normals[first], again.reshape(-1)[face.faces])
    holes = _openings()
    cut = split(face, holes, on_skin=False)
    cut = cut.pick(holes(cut.vertices[cut.faces].mean(1)) > 0)
    back = Shell(cut.vertices - np.array([0, 0.028, 0]), cut.normals, cut.faces)
    barrel = turned(np.array([(RIM_RADIUS, 0.0), (RIM_RADIUS, -0.006), (0.204, -0.012)]), 70)
    return join([cut, rim_wall(cut, back), barrel])


def inner() -> Shell:
    """What one sees between the spokes: the dark barrel and its end."""
    return turned(np.array([(0.186, -0.030), (0.186, -0.15), (0.001, -0.15)])[::-1], 40)


def brake() -> Shell:
    """Brake disc behind the spokes."""
    return turned(
        np.array(
            [(0.132, -0.085), (0.132, -0.075), (0.075, -0.075), (0.07, -0.06), (0.001, -0.06)]
        )[::-1],
        40,
    )
