"""The loss about a pose: a slice through it for every two numbers of the chart, coarse to fine."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import distance_transform_edt, maximum_filter

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
SMOOTH = 0.05
"""Share of a map's range by which interpolation may be off to be used on the next finer grid."""
WHOLE_GRIDS = 2
"""Number of the first grids that are not interpolated: their points must meet narrow valleys."""
CHECKED = 8
"""Points of each map that tell how good its interpolation is."""

Pair = tuple[int, int]
Place = frozenset[tuple[int, int]]
"""A point of the grid: (number, step) of those numbers that are not at the centre."""


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """The loss over a grid of two numbers, as far as it is known, the others at the centre."""

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
    error: float | None = None
    """95 % quantile of the interpolated losses' errors, as a share of the range; None: none is
    interpolated, or it is not known yet."""

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
        """The slice with its losses as shown to a person."""
        return replace(self, losses=scale.shown(self.losses))

    def filled(self) -> FloatArray:
        """(k, k): losses for pictures, the nearest known one where none is known."""
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
    """The minimum, the first in reading order; None if no loss is known."""
    if np.isnan(piece.losses).all():
        return None
    row, column = np.unravel_index(np.nanargmin(piece.losses), piece.losses.shape)
    return SliceMinimum(
        float(piece.first_values[column]),
        float(piece.second_values[row]),
        float(piece.losses[row, column]),
    )


def landscape(
    problem: FitProblem,
    pool: RendererPool,
    centre: FloatArray,
    *,
    half_width: float = 0.2,
    size: int = 41,
    smooth: bool = False,
) -> Iterator[Slice]:
    """The slices through the loss about ``centre`` (d,), within +- ``half_width`` scales of it.

    All pairs of free numbers are filled on a coarse grid, then on finer ones down to ``size`` x
    ``size`` points; no point is evaluated twice, also where slices cross. Yields a pair's slice
    after each row of its grid; the last one of each pair is complete. To stop, stop asking. The
    default width is the paper's.

    ``smooth``: finer grids are interpolated where that did well one grid before, but about each
    slice's minimum; points drawn at random give the ``error`` of each pair's last slice.

    Raises:
        SettingsError: ``size`` is even (the centre would not be on the grid) or less than 3, or
            ``half_width`` is not positive; or there are no two free numbers.
    """
    if size < 3 or size % 2 == 0 or not half_width > 0.0:
        raise SettingsError(
            f"a landscape of {size} points, +-{half_width} wide; wanted an odd number of points, "
            "3 or more (such as 41), and a width above 0 (such as 0.2)."
        )
    if len(problem.free_indices) < 2:
        raise SettingsError("a landscape needs two free numbers; lock fewer.")
    centre = np.array(centre, dtype=float)
    steps = half_width * np.linspace(-1.0, 1.0, size)
    steps[size // 2] = 0.0
    # Column i: the values that number i takes along its axis.
    values = centre + steps[:, None] * problem.chart.scales(centre)
    losses = _Losses(problem, pool, values)
    first, *finer = strides(size)
    yield from losses.fill(first)
    if smooth and len(finer) >= WHOLE_GRIDS:
        yield from losses.fill_smooth(finer)
        yield from losses.checked()
        return
    for stride in finer:
        yield from losses.fill(stride)


class _Losses:
    """The slices' losses, as far as they are known."""

    def __init__(self, problem: FitProblem, pool: RendererPool, values: FloatArray) -> None:
        self._loss, self._pool = partial(pose_loss, problem), pool
        self._values, self._size = values, len(values)
        self._known: dict[Place, float] = {}
        shape, pairs = (self._size, self._size), [*combinations(problem.free_indices.tolist(), 2)]
        self._grids = {pair: np.full(shape, np.nan) for pair in pairs}
        self._guessed = {pair: np.full(shape, False) for pair in pairs}

    def fill(self, stride: int) -> Iterator[Slice]:
        """Evaluate what is not known on a grid of this stride; yields the slice after each row."""
        rows: list[tuple[Pair, int, list[int], list[Place]]] = []
        for pair, losses in self._grids.items():
            for row in range(0, self._size, stride):
                columns = [c for c in range(0, self._size, stride) if np.isnan(losses[row, c])]
                if columns:
                    rows.append((pair, row, columns, [self._place(pair, row, c) for c in columns]))
        coming = self._find([place for *_, places in rows for place in places])
        for pair, row, columns, places in rows:
            for place in places:
                while place not in self._known:
                    next(coming)
            self._grids[pair][row, columns] = [self._known[place] for place in places]
            yield self._slice(pair, self._grids[pair].copy())

    def fill_smooth(self, finer: Sequence[int]) -> Iterator[Slice]:
        """Fill the grids of the strides after the first one, interpolated where that did well one
        grid before.
        """
        guesses: dict[Pair, FloatArray] = {}
        for level, stride in enumerate(finer, 1):
            for pair, losses in self._grids.items():
                if level >= WHOLE_GRIDS:
                    self._grids[pair] = _with_smooth(losses, guesses[pair], 2 * stride)
                    self._guessed[pair] |= np.isnan(losses) & ~np.isnan(self._grids[pair])
                guesses[pair] = _between(self._grids[pair], 2 * stride, stride)
            yield from self.fill(stride)

    def checked(self) -> Iterator[Slice]:
        """The slices, evaluated about their minima, and how good the other losses are."""
        random = np.random.default_rng(0)
        off: list[float] = []
        for pair, losses in self._grids.items():
            points = np.vstack([random.integers(self._size, size=(CHECKED, 2)), _about(losses)])
            places = [self._place(pair, row, column) for row, column in points.tolist()]
            deque(self._find(places), maxlen=0)
            at = tuple(points.T)
            known = np.array([self._known[place] for place in places])
            away = np.abs(losses[at] - known) / max(np.ptp(losses), 1e-12)
            off.extend(away[:CHECKED][self._guessed[pair][at][:CHECKED]])
            losses[at] = known
        error = float(np.quantile(off, 0.95)) if off else 0.0
        for pair, losses in self._grids.items():
            yield replace(self._slice(pair, losses), error=error)

    def _place(self, pair: Pair, row: int, column: int) -> Place:
        steps = (pair[0], column), (pair[1], row)
        return frozenset((i, step) for i, step in steps if step != self._size // 2)

    def _find(self, places: Sequence[Place]) -> Iterator[None]:
        """Evaluate those that are not known, one a step."""
        new = [place for place in dict.fromkeys(places) if place not in self._known]
        points = []
        for place in new:
            points.append(self._values[self._size // 2].copy())
            for i, step in place:
                points[-1][i] = self._values[step, i]
        for place, loss in zip(new, self._pool.map(self._loss, points), strict=True):
            self._known[place] = loss
            yield

    def _slice(self, pair: Pair, losses: FloatArray) -> Slice:
        first, second = pair
        return Slice(first, second, self._values[:, first], self._values[:, second], losses)


def _about(losses: FloatArray) -> NDArray[np.intp]:
    """(n, 2): rows and columns of the least loss and of its neighbours."""
    row, column = np.unravel_index(np.argmin(losses), losses.shape)
    near = np.indices((3, 3)).reshape(2, -1).T + np.array([row - 1, column - 1])
    return near[np.all((near >= 0) & (near < len(losses)), axis=1)]


def _between(losses: FloatArray, stride: int, finer: int) -> FloatArray:
    """(k, k): ``losses`` known at every ``stride``, cubic between them, at every ``finer``."""
    known, wanted = (np.arange(0, len(losses), step) for step in (stride, finer))
    order = min(3, len(known) - 1)
    curve = RectBivariateSpline(known, known, losses[::stride, ::stride], kx=order, ky=order, s=0)
    between = np.full_like(losses, np.nan)
    between[::finer, ::finer] = curve(wanted, wanted)
    return between


def _with_smooth(losses: FloatArray, guess: FloatArray, stride: int) -> FloatArray:
    """(k, k): ``losses`` known at every ``stride``, and at half of it where a ``guess`` of those
    from the grid before was right near by.
    """
    coarse, half = losses[::stride, ::stride], stride // 2
    near = maximum_filter(np.abs(guess[::stride, ::stride] - coarse), 3)
    filled, between = losses.copy(), _between(losses, stride, half)[::half, ::half]
    part = filled[::half, ::half]
    near = near.repeat(2, axis=0).repeat(2, axis=1)[: len(part), : len(part)]
    smooth = np.isnan(part) & (maximum_filter(near, 3) <= SMOOTH * np.ptp(coarse))
    part[smooth] = between[smooth]
    return filled


def strides(size: int) -> list[int]:
    """Steps from one grid point to the next, coarse to fine: powers of 2 that reach the borders."""
    steps = [1]
    while (size - 1) % (2 * steps[0]) == 0 and (size - 1) // (2 * steps[0]) >= COARSEST:
        steps.insert(0, 2 * steps[0])
    return steps


QUICK_SIZES = (3, 9)
"""Points along a side of the first maps, the only ones while the pose moves."""
QUICK_PIXELS = 1000
"""Least pixels of the model on the level of the first maps: they are to be there at once."""


def quick_level(problem: FitProblem, centre: Pose, renderer: Renderer) -> Level:
    """The level of the photo that the first maps about ``centre`` are made from."""
    return coarsest_level(problem.photo, renderer, centre, QUICK_PIXELS)
