"""The loss about a pose: a slice through it for every two numbers of the chart, coarse to fine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.ndimage import distance_transform_edt

from poseviewer.errors import SettingsError
from poseviewer.fit.problem import FitProblem, pose_loss
from poseviewer.fit.unexplained import LossScale
from poseviewer.geometry.arrays import FloatArray, frozen_array
from poseviewer.geometry.camera import Pose
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import Level, coarsest_level
from poseviewer.render.types import Renderer

COARSEST = 4
"""Steps along each side of a slice's first grid, at least."""

Pair = tuple[int, int]
Place = frozenset[tuple[int, int]]
"""A point of the grid: (number, step) of those numbers that are not at the centre."""


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """The loss over a grid of two numbers, as far as it is known; the others are at the centre."""

    first: int
    """Index of the number along the columns."""
    second: int
    """Index of the number along the rows."""
    first_values: FloatArray
    """(k,), ascending, the centre in the middle."""
    second_values: FloatArray
    """(k,), ascending, the centre in the middle."""
    losses: FloatArray
    """(k, k): row by ``second_values``, column by ``first_values``; nan where not yet known."""

    def __post_init__(self) -> None:
        size = len(self.first_values)
        object.__setattr__(self, "first_values", frozen_array(self.first_values, (size,)))
        object.__setattr__(self, "second_values", frozen_array(self.second_values, (size,)))
        object.__setattr__(self, "losses", frozen_array(self.losses, (size, size)))

    @property
    def complete(self) -> bool:
        """Whether every loss is known."""
        return not bool(np.isnan(self.losses).any())

    def shown(self, scale: LossScale) -> Slice:
        """The same with the losses as a person is shown them."""
        return replace(self, losses=scale.shown(self.losses))

    def filled(self) -> FloatArray:
        """(k, k): the losses, with the nearest known one where none is known; for pictures."""
        unknown = np.isnan(self.losses)
        if unknown.all():
            return self.losses
        rows, columns = distance_transform_edt(unknown, return_distances=False, return_indices=True)  # pyright: ignore[reportGeneralTypeIssues] - scipy's stub sees no tuple here
        return self.losses[rows, columns]


@dataclass(frozen=True, slots=True)
class SliceMinimum:
    """The least known loss of a slice, and where it is."""

    first_value: float
    second_value: float
    loss: float


def slice_minimum(piece: Slice) -> SliceMinimum | None:
    """Where the slice is least, the first such place in reading order; None if nothing is known."""
    if np.isnan(piece.losses).all():
        return None
    row, column = np.unravel_index(np.nanargmin(piece.losses), piece.losses.shape)
    return SliceMinimum(
        float(piece.first_values[column]),
        float(piece.second_values[row]),
        float(piece.losses[row, column]),
    )


def free_pairs(problem: FitProblem) -> tuple[Pair, ...]:
    """Every two free numbers, ``first < second``: 15 pairs for six numbers, 21 for seven."""
    return tuple(combinations([int(i) for i in problem.free_indices], 2))


def landscape(
    problem: FitProblem,
    renderer: Renderer | RendererPool,
    centre: FloatArray,
    *,
    half_width: float = 0.2,
    size: int = 41,
    pairs: Sequence[Pair] | None = None,
) -> Iterator[Slice]:
    """The slices through the loss about ``centre`` (d,), within +- ``half_width`` spans of it.

    All pairs (default: of all free numbers) are first seen on a coarse grid, then on finer ones
    down to ``size`` x ``size`` points; no point is evaluated twice, also where slices cross.
    Yields a pair's slice whenever one more row of its grid is known: the last one of each pair is
    complete. To stop, stop asking. A pool spreads the poses over its threads, and gives the same
    values in the same order. The default is the paper's +-20 % about the true pose.

    Raises:
        SettingsError: ``size`` is even (the centre would not be on the grid) or less than 3, or
            ``half_width`` is not positive; or there are no two free numbers.
    """
    if size < 3 or size % 2 == 0 or not half_width > 0.0:
        raise SettingsError(
            f"a landscape of {size} points, +-{half_width} wide; wanted an odd number of points, "
            "3 or more (such as 41), and a width above 0 (such as 0.2)."
        )
    pairs = free_pairs(problem) if pairs is None else tuple(pairs)
    if not pairs:
        raise SettingsError("a landscape needs two free numbers; lock fewer.")
    centre = np.array(centre, dtype=float)
    steps = half_width * np.linspace(-1.0, 1.0, size)
    steps[size // 2] = 0.0
    # Column i: the values that number i takes along its axis.
    values = centre + steps[:, None] * problem.chart.scales(centre)
    known: dict[Place, float] = {}
    grids = {pair: np.full((size, size), np.nan) for pair in pairs}
    for stride in strides(size):
        rows = _rows_to_fill(grids, stride)
        new = dict.fromkeys(p for row in rows for p in row.places if p not in known)
        losses = _losses(problem, renderer, [_numbers_at(p, centre, values) for p in new])
        coming = zip(new, losses, strict=True)
        for row in rows:
            while any(place not in known for place in row.places):
                place, loss = next(coming)
                known[place] = loss
            first, second = row.pair
            grids[row.pair][row.row, row.columns] = [known[place] for place in row.places]
            slice_losses = grids[row.pair].copy()
            yield Slice(first, second, values[:, first], values[:, second], slice_losses)


@dataclass(frozen=True, slots=True)
class _Row:
    """The points of a row of a pair's grid that are to be found on one of its strides."""

    pair: Pair
    row: int
    columns: list[int]
    places: list[Place]


def _rows_to_fill(grids: Mapping[Pair, FloatArray], stride: int) -> list[_Row]:
    rows = []
    for (first, second), losses in grids.items():
        size = len(losses)
        for row in range(0, size, stride):
            columns = [c for c in range(0, size, stride) if np.isnan(losses[row, c])]
            if columns:
                places = [_place(size // 2, {first: c, second: row}) for c in columns]
                rows.append(_Row((first, second), row, columns, places))
    return rows


def _place(middle: int, steps: dict[int, int]) -> Place:
    """What slices that cross agree on: only the numbers that are off the centre count."""
    return frozenset((i, step) for i, step in steps.items() if step != middle)


def _numbers_at(place: Place, centre: FloatArray, values: FloatArray) -> FloatArray:
    parameters = centre.copy()
    for i, step in place:
        parameters[i] = values[step, i]
    return parameters


def _losses(
    problem: FitProblem, renderer: Renderer | RendererPool, points: Sequence[FloatArray]
) -> Iterator[float]:
    """The losses of all points, in order, each worked out when it is asked for or before."""
    if isinstance(renderer, RendererPool):
        return renderer.map(lambda one, parameters: pose_loss(problem, one, parameters), points)
    return (pose_loss(problem, renderer, parameters) for parameters in points)


def strides(size: int) -> list[int]:
    """Steps from one grid point to the next, coarse to fine: powers of 2 that reach the borders."""
    found = [1]
    while (size - 1) % (2 * found[0]) == 0 and (size - 1) // (2 * found[0]) >= COARSEST:
        found.insert(0, 2 * found[0])
    return found


QUICK_SIZES = (3, 9)
"""Points along a side of the first maps, which are all there are while the pose moves."""

QUICK_PIXELS = 1000
"""For the first maps the photo is brought down until the model covers fewer than four times so
many pixels: they are to be there at once."""


def quick_level(problem: FitProblem, centre: Pose, renderer: Renderer) -> Level:
    """The level of the photo that the first maps about ``centre`` are made from."""
    return coarsest_level(problem.photo, renderer, centre, QUICK_PIXELS)
