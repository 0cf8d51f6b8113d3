"""What people read for the charts' numbers, on the page and in figures."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

NAMES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "mu_x": ("μx", "rear wheel"),
        "mu_y": ("μy", "rear wheel"),
        "delta_x": ("δx", "to front wheel"),
        "delta_y": ("δy", "to front wheel"),
        "psi_x": ("ψx", "axle"),
        "psi_y": ("ψy", "axle"),
        "width_per_focal": ("width/focal", ""),
        "rotation_x": ("tilt", "(rad)"),
        "rotation_y": ("turn", "(rad)"),
        "rotation_z": ("roll", "(rad)"),
        "shift_x": ("shift x", "(radii)"),
        "shift_y": ("shift y", "(radii)"),
        "log_depth": ("log depth", ""),
        "log_scale": ("log scale", ""),
        "log_focal": ("log focal", ""),
    }
)
"""By the chart's own name: a short name, as on the maps, and what is said beside it in fields."""


def short_name(name: str) -> str:
    """A number's name where there is little room."""
    return NAMES[name][0] if name in NAMES else name.replace("_", " ")


def label(name: str) -> str:
    """A number's name beside its field."""
    return "  ".join(NAMES[name]).rstrip() if name in NAMES else short_name(name)
