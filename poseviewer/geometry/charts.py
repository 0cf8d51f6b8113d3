"""Pose charts: a vector of comparable numbers for a pose, and back; and their names."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose


class OutsideChartError(ValueError):
    """Numbers that stand for no pose; a search takes them as the worst there is."""


class Chart(Protocol):
    """Numbers for poses. Every chart fixes what it does not vary (picture size, and so on)."""

    @property
    def name(self) -> str:
        """``vehicle`` or ``free-body``."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """What each number is called."""
        ...

    def scales(self, parameters: FloatArray) -> FloatArray:
        """(d,): the change of each number, near ``parameters``, that counts as 100 %."""
        ...

    def to_pose(self, parameters: FloatArray) -> Pose:
        """The pose that the numbers (d,) stand for.

        Raises ``OutsideChartError``: they stand for none.
        """
        ...

    def from_pose(self, pose: Pose) -> FloatArray:
        """The numbers (d,) of a pose.

        Raises ``SingularChartError``: the pose has no well-defined numbers in this chart.
        """
        ...


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
        "log_size": ("log size", "(of the model)"),
    }
)
"""By the chart's own name: a short name, as on the maps, and what is said beside it in fields."""


def short_name(name: str) -> str:
    """A number's name where there is little room."""
    return NAMES[name][0] if name in NAMES else name.replace("_", " ")


def label(name: str) -> str:
    """A number's name beside its field."""
    return "  ".join(NAMES[name]).rstrip() if name in NAMES else short_name(name)
