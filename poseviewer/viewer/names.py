"""What the page calls the charts' numbers."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

LABELS: Mapping[str, str] = MappingProxyType(
    {
        "mu_x": "μx  rear wheel",
        "mu_y": "μy  rear wheel",
        "delta_x": "δx  to front wheel",
        "delta_y": "δy  to front wheel",
        "psi_x": "ψx  axle",
        "psi_y": "ψy  axle",
        "width_per_focal": "width / focal",
        "rotation_x": "tilt  (rad)",
        "rotation_y": "turn  (rad)",
        "rotation_z": "roll  (rad)",
        "shift_x": "shift x  (radii)",
        "shift_y": "shift y  (radii)",
        "log_depth": "log depth",
        "log_scale": "log scale",
        "log_focal": "log focal",
    }
)


def label(name: str) -> str:
    """A number's name for people."""
    return LABELS.get(name, name)
