"""Rectangles of a picture, and non-maximum suppression."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, TypeVar

if TYPE_CHECKING:  # help texts of the command line need no NumPy
    import numpy as np
    from numpy.typing import NDArray

T = TypeVar("T")
"""Any kind of candidates."""
Corner: TypeAlias = "Sequence[float] | NDArray[np.float64]"


class Rectangle(NamedTuple):
    """A rectangle of a picture in px, pixel centres at i + 0.5, as users write it."""

    left: float
    top: float
    width: float
    height: float

    @classmethod
    def from_corners(cls, low: Corner, high: Corner) -> Rectangle:
        """Make the rectangle between its upper left and its lower right corner (u, v), px."""
        return cls(low[0], low[1], high[0] - low[0], high[1] - low[1])

    @property
    def right(self) -> float:
        """Right side, px."""
        return self.left + self.width

    @property
    def bottom(self) -> float:
        """Lower side, px."""
        return self.top + self.height

    @property
    def centre(self) -> tuple[float, float]:
        """Middle (u, v), px."""
        return self.left + self.width / 2.0, self.top + self.height / 2.0

    @property
    def area(self) -> float:
        """Area in square px; 0 for one turned inside out, as an empty intersection is."""
        return max(self.width, 0.0) * max(self.height, 0.0)

    def expand(self, share: float) -> Rectangle:
        """Return the rectangle about the same middle, with sides longer by ``share``."""
        width, height = self.width * (1.0 + share), self.height * (1.0 + share)
        u, v = self.centre
        return Rectangle(u - width / 2.0, v - height / 2.0, width, height)

    def intersection(self, other: Rectangle) -> Rectangle:
        """Return the part that both have in common; its ``area`` is 0 where there is none."""
        low = max(self.left, other.left), max(self.top, other.top)
        high = min(self.right, other.right), min(self.bottom, other.bottom)
        return Rectangle.from_corners(low, high)

    def union(self, other: Rectangle) -> Rectangle:
        """Return the smallest rectangle about both."""
        low = min(self.left, other.left), min(self.top, other.top)
        high = max(self.right, other.right), max(self.bottom, other.bottom)
        return Rectangle.from_corners(low, high)

    def overlap(self, other: Rectangle) -> float:
        """Return the intersection over union with another rectangle, in [0, 1]."""
        shared = self.intersection(other).area
        return shared / max(self.area + other.area - shared, 1e-12)

    def mask(self, height: int, width: int) -> NDArray[np.float32]:
        """Return (height, width): 1 inside, right and lower ends excluded, 0 beside it."""
        import numpy as np

        mask = np.zeros((height, width), np.float32)
        rows = slice(int(max(self.top, 0)), int(max(self.bottom, 0)))
        mask[rows, int(max(self.left, 0)) : int(max(self.right, 0))] = 1.0
        return mask


def non_maximum_suppression(
    candidates: Iterable[T], is_same: Callable[[T, T], bool], max_count: int | None = None
) -> list[T]:
    """Keep candidates, given best first, that are not the same as better ones."""
    kept: list[T] = []
    for candidate in candidates:
        if len(kept) == max_count:
            break
        if not any(is_same(candidate, other) for other in kept):
            kept.append(candidate)
    return kept
