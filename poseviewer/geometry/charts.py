"""Charts: pose parameterisations, vectors of comparable parameters; and the parameters' labels."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose


class OutsideChartError(ValueError):
    """Parameters that stand for no pose; a search gives them the worst loss there is."""


class Chart:
    """A pose parameterisation. It fixes what it does not vary (picture size, and so on)."""

    __slots__ = ()
    name: ClassVar[str]
    """The chart's name in pose files."""

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each parameter."""
        raise NotImplementedError

    def scales(self, parameters: FloatArray) -> FloatArray:
        """Return (d,): the change of each parameter, near ``parameters``, that counts as 100 %."""
        return np.ones(len(parameters))

    def to_pose(self, parameters: FloatArray) -> Pose:
        """Return the pose of parameters (d,).

        Raises:
            OutsideChartError: they stand for no pose.
        """
        raise NotImplementedError

    def from_pose(self, pose: Pose) -> FloatArray:
        """Return the parameters (d,) of a pose.

        Raises:
            SingularChartError: they are not well-defined there.
        """
        raise NotImplementedError


LOG_FOCAL: Literal["log_focal"] = "log_focal"
"""Name of the logarithm of a free focal length."""
FOCAL_PREFIXES = (LOG_FOCAL, "width_per_focal")
"""Beginnings of the names of parameters that are a free focal length."""
PRINCIPAL_POINT = ("principal_x", "principal_y")
"""Names of the offsets of a free principal point, of the photo's width and height."""


def has_focal(chart: Chart, indices: Iterable[int] | None = None) -> bool:
    """Tell whether a parameter is the focal length, and is among the ``indices`` if given."""
    return _has_parameter(chart, indices, FOCAL_PREFIXES)


def has_principal_point(chart: Chart, indices: Iterable[int] | None = None) -> bool:
    """Tell whether parameters are the principal point, and one is among the ``indices``."""
    return _has_parameter(chart, indices, PRINCIPAL_POINT)


def _has_parameter(chart: Chart, indices: Iterable[int] | None, prefixes: tuple[str, ...]) -> bool:
    names = chart.names if indices is None else [chart.names[index] for index in indices]
    return any(name.startswith(prefixes) for name in names)


LABELS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "mu_x": ("rear wheel x", "μx, of the photo's width"),
        "mu_y": ("rear wheel y", "μy, of the photo's height"),
        "delta_x": ("front wheel x", "δx, from the rear wheel, of the photo's width"),
        "delta_y": ("front wheel y", "δy, from the rear wheel, of the photo's height"),
        "psi_x": ("axle x", "ψx, of the unit vector along the axle"),
        "psi_y": ("axle y", "ψy, of the unit vector along the axle"),
        "width_per_focal": ("width/focal", "the photo's width over the focal length"),
        "rotation_x": ("tilt", "rad, about the camera's x axis"),
        "rotation_y": ("turn", "rad, about the camera's y axis"),
        "rotation_z": ("roll", "rad, about the camera's z axis"),
        "shift_x": ("shift x", "model radii in the photo"),
        "shift_y": ("shift y", "model radii in the photo"),
        "log_depth": ("log depth", "natural logarithm of the depth, 0 at the start"),
        "log_scale": ("log scale", "natural logarithm of the scale, 0 at the start"),
        "log_focal": ("log focal", "logarithm of the focal length, 0 at the start"),
        "principal_x": ("principal x", "of the photo's width, 0 at the start's principal point"),
        "principal_y": ("principal y", "of the photo's height, 0 at the start's principal point"),
        "log_size": ("log size", "natural logarithm of the model's size, 0 at the start"),
    }
)
"""Label of each parameter, and its tooltip: symbol, unit and reference."""


def short_name(name: str) -> str:
    """Return the label of a parameter."""
    return LABELS[name][0] if name in LABELS else name.replace("_", " ")


def tooltip(name: str) -> str:
    """Return symbol, unit and reference of a parameter; "" for an unknown one."""
    return LABELS[name][1] if name in LABELS else ""
