"""Pose charts: a vector of comparable numbers for a pose, and back."""

from __future__ import annotations

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
        """(d,): the change of each number, near ``numbers``, that counts as 100 %."""
        ...

    def to_pose(self, parameters: FloatArray) -> Pose:
        """The pose that the numbers (d,) stand for.

        Raises:
            OutsideChartError: they stand for none.
        """
        ...

    def from_pose(self, pose: Pose) -> FloatArray:
        """The numbers (d,) of a pose.

        Raises:
            SingularChartError: the pose has no well-defined numbers in this chart.
        """
        ...
