"""What a user has marked on the photo for a quick start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from poseviewer.geometry.arrays import FloatArray, frozen_array
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.vehicle.ellipses import FEWEST_RIM_POINTS, Ellipse, ellipse_through

WHEELS = 2


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """A point of the model, and where the photo shows it."""

    point: FloatArray
    """(3,), in the model's frame."""
    pixel: FloatArray | None = None
    """(2,), px; None: still to be clicked."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", frozen_array(self.point, (3,)))
        if self.pixel is not None:
            object.__setattr__(self, "pixel", frozen_array(self.pixel, (2,)))


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """All marks; only the last pair may be half done."""

    pairs: tuple[Pair, ...] = ()
    box: Rectangle | None = None
    """Rectangle (left, top, width, height) about the object, px."""
    rims: tuple[FloatArray, ...] = ()
    """Points (2,), px, on wheels' rims: five on the rear one, then five on the front one."""
    note: str = ""
    """Why no pose follows from them, as far as it was asked; a sentence."""

    @property
    def waits_for_pixel(self) -> bool:
        """Whether a model point was picked whose place in the photo comes next."""
        return bool(self.pairs) and self.pairs[-1].pixel is None

    @property
    def points(self) -> FloatArray:
        """(n, 3): the model points of the pairs that are done."""
        return np.array([p.point for p in self.pairs if p.pixel is not None]).reshape(-1, 3)

    @property
    def pixels(self) -> FloatArray:
        """(n, 2): their places in the photo."""
        return np.array([p.pixel for p in self.pairs if p.pixel is not None]).reshape(-1, 2)

    @property
    def ellipses(self) -> tuple[Ellipse, ...]:
        """Of the rear wheel, and of the front wheel, as far as they have their points.

        Raises:
            QuickStartError: the points of a wheel lie on no ellipse.
        """
        count = len(self.rims) // FEWEST_RIM_POINTS
        pieces = [self.rims[i * FEWEST_RIM_POINTS :][:FEWEST_RIM_POINTS] for i in range(count)]
        return tuple(ellipse_through(piece) for piece in pieces)
