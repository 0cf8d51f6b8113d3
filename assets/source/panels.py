"""Where the skin is cut: windows, lamps, grilles, seams, arches. Metres, car frame.

Every region is a field on the left half of the skin, negative inside. Outlines are drawn in
the view in which a designer would draw them (side, front, top, or slantwise at a corner).
"""

from __future__ import annotations

from dataclasses import dataclass

import body_surface as body
import numpy as np
import outlines
from curves import (
    Points,
    polygon_distance,
    polyline_distance,
    polyline_side,
    smooth_line,
)
from shell import Field

SEAM = 0.0028  # half width of a gap between panels


@dataclass(frozen=True)
class Region:
    """A named piece of skin; `central` ones join over the middle line, others come in pairs."""

    name: str
    field: Field
    material: str
    central: bool = False
    inset: float = 0.0
    spine: Field | None = None  # middle line of a region thinner than the triangles


def _guard(field: Field, allowed: Field) -> Field:
    """The field where `allowed` is positive, far outside elsewhere."""
    return lambda p: np.where(allowed(p) > 0, field(p), 1.0)


def side_shape(outline: np.ndarray) -> Field:
    """Region drawn in the side view (x, z)."""
    return _guard(lambda p: polygon_distance(p[:, [0, 2]], outline), lambda p: p[:, 1] - 0.42)


def end_shape(outline: np.ndarray, front: bool) -> Field:
    """Region drawn in the front or rear view (y, z)."""
    sign = 1 if front else -1
    return _guard(lambda p: polygon_distance(p[:, 1:], outline), lambda p: sign * p[:, 0] - 0.1)


def corner_shape(outline: np.ndarray, front: bool, degrees: float = 40.0) -> Field:
    """Region drawn in a view slantwise on a corner: (across, z), across = y cos - |x| sin."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    sign = 1 if front else -1

    def field(p: np.ndarray) -> np.ndarray:
        across = p[:, 1] * c - sign * p[:, 0] * s
        return polygon_distance(np.stack([across, p[:, 2]], 1), outline)

    return _guard(field, lambda p: np.minimum(sign * p[:, 0] - 1.0, p[:, 1] - 0.2))


def grown(field: Field, by: float) -> Field:
    """The region made wider (or with a negative number narrower)."""
    return lambda p: field(p) - by


def both(*fields: Field) -> Field:
    """Where all of the fields are negative."""
    return lambda p: np.max([f(p) for f in fields], axis=0)


def half_plane(x: float, z: float, lean: float, sign: int) -> Field:
    """Side-view half plane: behind (sign 1) or ahead (sign -1) of a leaning line."""
    return lambda p: sign * (p[:, 0] - x - lean * (p[:, 2] - z))


def seam(points: Points, axes: tuple[int, int], allowed: Field) -> Region:
    """A thin gap along a smooth curve drawn in the view of two axes."""
    line = smooth_line(points)
    return Region(
        "panel gaps",
        _guard(lambda p: polyline_distance(p[:, list(axes)], line) - SEAM, allowed),
        "trim",
        spine=_guard(lambda p: polyline_side(p[:, list(axes)], line), allowed),
    )


def arch(p: np.ndarray) -> np.ndarray:
    """The two wheel arches, seen from the side."""
    rings = [
        np.hypot(p[:, 0] - x, p[:, 2] - body.WHEEL_Z) - body.ARCH_RADIUS
        for x in (body.FRONT_AXLE_X, body.REAR_AXLE_X)
    ]
    return np.where(p[:, 1] > 0.6, np.minimum(*rings), 1.0)


def _underside(p: np.ndarray) -> np.ndarray:
    return p[:, 2] - body.FLOOR(p[:, 0]) - 0.040


def _cowl(p: np.ndarray) -> np.ndarray:
    off = np.abs(p[:, 0] - 1.02 + 0.22 * p[:, 1] ** 2) - 0.035
    return np.where(p[:, 2] > 0.8, np.maximum(off, p[:, 1] - 0.735), 1.0)


def _bars(name: str, inside: Field, z: float, half: float, material: str) -> Region:
    """A thin level bar across a grille."""
    return Region(
        name,
        both(inside, lambda p: np.abs(p[:, 2] - z) - half),
        material,
        central=True,
        spine=_guard(lambda p: p[:, 2] - z, lambda p: 0.004 - inside(p)),
    )


def regions() -> list[Region]:
    """All regions; a face belongs to the first one that holds it, else it is painted body."""
    day, screen = side_shape(outlines.DAYLIGHT), end_shape(outlines.SCREEN, True)
    rear, head = end_shape(outlines.REAR_GLASS, False), corner_shape(outlines.HEADLAMP, True)
    tail, upper = corner_shape(outlines.TAILLAMP, False), end_shape(outlines.UPPER_GRILLE, True)
    intake, fog = end_shape(outlines.INTAKE, True), corner_shape(outlines.FOG_POCKET, True)
    glass = grown(day, -0.014)
    flank: Field = lambda p: p[:, 1] - 0.5  # noqa: E731
    above: Field = lambda p: p[:, 2] - 0.55  # noqa: E731
    behind: Field = lambda p: -1.35 - p[:, 0]  # noqa: E731
    side, top, end = (0, 2), (0, 1), (1, 2)
    fixed = [
        Region("arch", arch, "none"),
        Region("underbody", _underside, "plastic", central=True),
        Region(
            "window front", both(glass, half_plane(-0.275, 1.0, -0.05, -1)), "glass", inset=0.004
        ),
        Region(
            "window rear",
            both(glass, half_plane(-0.365, 1.0, -0.05, 1), half_plane(-1.085, 1.0, -0.10, -1)),
            "glass",
            inset=0.004,
        ),
        Region(
            "window quarter", both(glass, half_plane(-1.115, 1.0, -0.10, 1)), "glass", inset=0.004
        ),
        Region("window trim", day, "trim"),
        Region("window windscreen", grown(screen, -0.022), "glass", central=True),
        Region("windscreen trim", screen, "trim", central=True),
        Region("window hatch", grown(rear, -0.022), "glass", central=True),
        Region("hatch glass trim", rear, "trim", central=True),
        Region("cowl", _cowl, "plastic", central=True),
        Region(
            "headlamp projector outer",
            corner_shape(outlines.disc(np.array([-0.545, 0.668, 0.033])), True),
            "lamp bright",
            inset=0.006,
        ),
        Region(
            "headlamp projector inner",
            corner_shape(outlines.disc(np.array([-0.685, 0.656, 0.028])), True),
            "lamp bright",
            inset=0.006,
        ),
        Region("headlamp", grown(head, -0.007), "lamp clear"),
        Region("headlamp bezel", head, "trim"),
        Region("tail lamp light", grown(tail, -0.030), "lamp red bright"),
        Region("tail lamp", grown(tail, -0.004), "lamp red"),
        Region("tail lamp bezel", tail, "trim"),
        _bars("grille strip", upper, 0.632, 0.0045, "chrome"),
        Region("grille upper", upper, "grille", central=True, inset=0.012),
        *(_bars("intake bars", intake, z, 0.004, "plastic") for z in (0.325, 0.365)),
        Region("intake", intake, "grille", central=True, inset=0.02),
        Region(
            "fog lamp",
            corner_shape(outlines.disc(np.array([-0.675, 0.372, 0.03])), True),
            "lamp clear",
        ),
        Region("fog lamp pocket", fog, "plastic", inset=0.012),
        Region("rear reflector", corner_shape(outlines.REFLECTOR, False), "lamp red"),
        Region("bumper rear valance", end_shape(outlines.VALANCE, False), "plastic", central=True),
    ]
    seams = [
        seam([(0.70, 0.255), (0.70, 0.5), (0.705, 0.8), (0.74, 0.955)], side, flank),
        seam([(-0.30, 0.255), (-0.305, 0.5), (-0.315, 0.8), (-0.32, 0.98)], side, flank),
        seam(
            [
                (-1.105, 0.99),
                (-1.10, 0.82),
                (-1.05, 0.66),
                (-0.955, 0.53),
                (-0.905, 0.40),
                (-0.895, 0.255),
            ],
            side,
            flank,
        ),
        seam([(0.70, 0.255), (-0.1, 0.252), (-0.895, 0.255)], side, flank),
        seam([(1.50, 0.46), (1.56, 0.55), (1.585, 0.655)], side, flank),
        seam([(-1.66, 0.47), (-1.72, 0.56), (-1.735, 0.66), (-1.735, 0.80)], side, flank),
        seam(
            [
                (0.80, 0.742),
                (1.15, 0.733),
                (1.40, 0.715),
                (1.60, 0.68),
                (1.725, 0.61),
                (1.80, 0.50),
                (1.85, 0.30),
                (1.872, 0.1),
                (1.875, 0.0),
                (1.872, -0.1),
            ],
            top,
            above,
        ),
        seam(
            [
                (-0.02, 1.385),
                (0.3, 1.378),
                (0.53, 1.345),
                (0.567, 1.28),
                (0.602, 1.18),
                (0.652, 1.055),
                (0.655, 0.95),
                (0.64, 0.85),
                (0.63, 0.70),
                (0.60, 0.60),
                (0.52, 0.565),
                (0.3, 0.56),
                (-0.02, 0.56),
            ],
            end,
            behind,
        ),
    ]
    flap = outlines.disc(np.array([-1.46, 0.79, 0.075]))
    ring = _guard(lambda p: polygon_distance(p[:, [0, 2]], flap), flank)
    seams.append(Region("panel gaps", lambda p: np.abs(ring(p)) - 0.002, "trim", spine=ring))
    return fixed + seams
