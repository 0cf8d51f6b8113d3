"""Rectangles of a picture, and the choice of those that differ among many candidates."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, NamedTuple, TypeVar

if TYPE_CHECKING:  # help texts of the command line need no NumPy
    import numpy as np
    from numpy.typing import NDArray

T = TypeVar("T")


class Rectangle(NamedTuple):
    """A rectangle of a picture in px, pixel centres at i + 0.5, as users write it."""

    left: float
    top: float
    width: float
    height: float

    @classmethod
    def from_corners(cls, left: float, top: float, right: float, bottom: float) -> Rectangle:
        """From its left upper and right lower corners."""
        return cls(left, top, right - left, bottom - top)

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
        """Its middle (u, v), px."""
        return self.left + self.width / 2.0, self.top + self.height / 2.0

    @property
    def area(self) -> float:
        """Area in px; 0 for a rectangle that is turned inside out, as an empty intersection is."""
        return max(self.width, 0.0) * max(self.height, 0.0)

    def expand(self, share: float) -> Rectangle:
        """The rectangle about the same middle, longer by ``share`` along each side."""
        width, height = self.width * (1.0 + share), self.height * (1.0 + share)
        u, v = self.centre
        return Rectangle(u - width / 2.0, v - height / 2.0, width, height)

    def intersection(self, other: Rectangle) -> Rectangle:
        """Part that both have in common; its ``area`` is 0 where there is none."""
        left, top = max(self.left, other.left), max(self.top, other.top)
        right, bottom = min(self.right, other.right), min(self.bottom, other.bottom)
        return Rectangle.from_corners(left, top, right, bottom)

    def union(self, other: Rectangle) -> Rectangle:
        """Make the smallest rectangle about both."""
        left, top = min(self.left, other.left), min(self.top, other.top)
        right, bottom = max(self.right, other.right), max(self.bottom, other.bottom)
        return Rectangle.from_corners(left, top, right, bottom)

    def mask(self, height: int, width: int) -> NDArray[np.float32]:
        """(height, width): 1 inside, its right and lower ends excluded, 0 beside it."""
        import numpy as np

        mask = np.zeros((height, width), np.float32)
        rows = slice(int(max(self.top, 0)), int(max(self.bottom, 0)))
        mask[rows, int(max(self.left, 0)) : int(max(self.right, 0))] = 1.0
        return mask


def non_maximum_suppression(
    candidates: Iterable[T], is_same: Callable[[T, T], bool], most: int | None = None
) -> list[T]:
    """Keep at most ``most`` of ``candidates``, the best first, that differ from better ones."""
    kept: list[T] = []
    for candidate in candidates:
        if len(kept) == most:
            break
        if not any(is_same(candidate, other) for other in kept):
            kept.append(candidate)
    return kept
