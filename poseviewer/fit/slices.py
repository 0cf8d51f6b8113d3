"""The loss about a pose: a slice for every two parameters of the chart, coarse to fine."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import distance_transform_edt, maximum_filter

from poseviewer.errors import SettingsError
from poseviewer.fit.problem import FitProblem, pose_loss
from poseviewer.geometry.arrays import FloatArray, freeze_array
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.losses.loss import LossScale
from poseviewer.render.attributes import Renderer
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import Level, coarsest_level

MIN_GRID_STEPS = 4
"""Least steps along each side of a slice's first grid."""
MAX_INTERPOLATION_ERROR = 0.05
"""Error, as a fraction of a map's range, up to which the next finer grid is interpolated."""
WHOLE_GRIDS = 2
"""First grids that are not interpolated: their points must meet narrow valleys."""
SHOWN_POINTS = 100
"""Points of the first grid whose faces finer grids show: more hardly show others."""
CHECK_POINTS = 8
"""Points of each map at which its interpolation is checked."""

Pair = tuple[int, int]
"""Indices of two parameters."""


class SliceMinimum(NamedTuple):
    """The least known loss of a slice, and its place."""

    first_value: float
    second_value: float
    loss: float


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """The loss over a grid of two parameters, as far as it is known, the others at the centre."""

    first: int
    """Index of the parameter along the columns."""
    second: int
    """Index of the parameter along the rows."""
    first_values: FloatArray
    """(k,), ascending, the centre in the middle."""
    second_values: FloatArray
    """(k,), ascending, the centre in the middle."""
    losses: FloatArray
    """(k, k): row by ``second_values``, column by ``first_values``; nan where not yet known."""
    error: float | None = None
    """95 % quantile of errors by interpolation, as a fraction of the range; None: not known yet, or
    nothing is interpolated."""

    def __post_init__(self) -> None:
        size = len(self.first_values)
        for name, shape in {"first_values": 1, "second_values": 1, "losses": 2}.items():
            array = freeze_array(getattr(self, name), (size,) * shape)
            object.__setattr__(self, name, array)

    def as_shown(self, scale: LossScale) -> Slice:
        """Return the slice with its losses as people read them, by ``LossScale.as_shown``."""
        return replace(self, losses=scale.as_shown(self.losses))

    def fill_gaps(self) -> FloatArray:
        """(k, k): losses for pictures, unknown ones replaced by the nearest known."""
        unknown = np.isnan(self.losses)
        if unknown.all():
            return self.losses
        rows, columns = distance_transform_edt(unknown, return_distances=False, return_indices=True)  # pyright: ignore[reportGeneralTypeIssues] - scipy's stub sees no tuple here
        return self.losses[rows, columns]

    @property
    def minimum(self) -> SliceMinimum | None:
        """The least known loss, the first in reading order; None if no loss is known."""
        if np.isnan(self.losses).all():
            return None
        at = row, column = np.unravel_index(np.nanargmin(self.losses), self.losses.shape)
        least = self.first_values[column], self.second_values[row], self.losses[at]
        return SliceMinimum(*map(float, least))


def end_on_maps(slices: Sequence[Slice], path: FloatArray) -> FloatArray:
    """Return the end (t, d) of a path (n, d) from where it last came onto all slices; what lies
    before would run across them.
    """
    is_beside = np.zeros(len(path), bool)
    for piece in slices:
        for index, values in (
            (piece.first, piece.first_values),
            (piece.second, piece.second_values),
        ):
            is_beside |= (path[:, index] < values[0]) | (path[:, index] > values[-1])
    beside = np.flatnonzero(is_beside)
    return path[beside[-1] :] if len(beside) else path


def landscape(
    problem: FitProblem,
    pool: RendererPool,
    centre: FloatArray,
    *,
    half_width: float = 0.2,
    size: int = 41,
    smooth: bool = False,
) -> Iterator[Slice]:
    """Evaluate the slices through the loss about a centre, for every two free parameters.

    All slices are filled on a coarse grid, then on finer ones; no point is evaluated twice, also
    where slices cross. Yields a slice after each row of its grid; the last one of each pair is
    complete. Stop iterating to stop.

    Args:
        problem: problem whose loss is evaluated.
        pool: renderers of the problem's level, one for each thread.
        centre: (d,): parameters at the centre.
        half_width: distance from the centre to the border, in scales of the parameters; the default
            is the paper's.
        size: points along each side; odd, so that the centre is one of them.
        smooth: whether to interpolate finer grids where that did well one grid before, but not
            about each slice's minimum, and to draw them without faces that the first grid does not
            show. Random points give the ``error`` of each pair's last slice.

    Raises:
        SettingsError: ``size`` is even or less than 3, or ``half_width`` is not positive; or there
            are no two free parameters.
    """
    if size < 3 or size % 2 == 0 or not half_width > 0.0:
        raise SettingsError(
            f"a landscape of {size} points, +-{half_width} wide; wanted an odd number of points, "
            "3 or more (such as 41), and a width above 0 (such as 0.2)."
        )
    if len(problem.free_indices) < 2:
        raise SettingsError("a landscape needs two free parameters; lock fewer.")
    steps = half_width * np.linspace(-1.0, 1.0, size)
    steps[size // 2] = 0.0
    # Column i: the values of parameter i along its axis.
    values = np.array(centre, dtype=float) + steps[:, None] * problem.chart.scales(centre)
    losses, grids = _Losses(problem, pool, values), strides(size)
    is_smooth = smooth and len(grids) > WHOLE_GRIDS
    with ExitStack() as culled:
        for level, stride in enumerate(grids):
            if is_smooth and level == 1:
                losses.pool = culled.enter_context(pool.cull_unseen(losses.poses))
            if is_smooth and level >= WHOLE_GRIDS:
                losses.interpolate(stride)
            yield from losses.fill(stride)
    if is_smooth:
        losses.pool = pool
        yield from losses.check()


class _Losses:
    """The slices' losses, as far as they are known."""

    def __init__(self, problem: FitProblem, pool: RendererPool, values: FloatArray) -> None:
        self._problem = problem
        self.pool = pool
        self._values = values
        self._known: dict[tuple[float, ...], float] = {}
        pairs, size = combinations(problem.free_indices.tolist(), 2), len(values)
        self._grids = {pair: np.full((size, size), np.nan) for pair in pairs}

    @property
    def poses(self) -> list[list[Pose]]:
        """Poses in each view at some of the known points, those without a pose left out."""
        poses: list[tuple[Pose, ...]] = []
        for point in list(self._known)[:: -(-len(self._known) // SHOWN_POINTS)]:
            with suppress(OutsideChartError):
                poses.append(self._problem.poses(np.array(point)))
        return [list(of_view) for of_view in zip(*poses, strict=True)]

    def fill(self, stride: int) -> Iterator[Slice]:
        """Evaluate unknown points on a grid of this stride; yields the slice after each row."""
        rows = [
            (pair, row, (np.flatnonzero(np.isnan(losses[row, ::stride])) * stride).tolist())
            for pair, losses in self._grids.items()
            for row in range(0, len(losses), stride)
        ]
        points = [[self._point(pair, row, c) for c in columns] for pair, row, columns in rows]
        evaluations = self._evaluate([point for of_row in points for point in of_row])
        for (pair, row, columns), of_row in zip(rows, points, strict=True):
            if not of_row:
                continue
            for point in of_row:
                while point not in self._known:
                    next(evaluations)
            self._grids[pair][row, columns] = [self._known[point] for point in of_row]
            yield self._slice(pair)

    def interpolate(self, stride: int) -> None:
        """Interpolate grids from those of twice the stride, where that worked one grid before."""
        for losses in self._grids.values():
            coarse, part = losses[:: 2 * stride, :: 2 * stride], losses[::stride, ::stride]
            off = maximum_filter(np.abs(_interpolate(losses, 4 * stride, 2 * stride) - coarse), 3)
            near = off.repeat(2, axis=0).repeat(2, axis=1)[: len(part), : len(part)]
            limit = MAX_INTERPOLATION_ERROR * np.ptp(coarse)
            smooth = np.isnan(part) & (maximum_filter(near, 3) <= limit)
            part[smooth] = _interpolate(losses, 2 * stride, stride)[smooth]

    def check(self) -> Iterator[Slice]:
        """Evaluate the slices about their minima, and the error of their interpolated losses."""
        random = np.random.default_rng(0)
        errors: list[float] = []
        for pair, losses in self._grids.items():
            drawn = random.integers(len(losses), size=(CHECK_POINTS, 2))
            least = np.unravel_index(np.argmin(losses), losses.shape)
            about = np.indices((3, 3)).reshape(2, -1).T - 1 + np.array(least)
            about = about[np.all((about >= 0) & (about < len(losses)), axis=1)]
            at = np.vstack([drawn, about])
            points = [self._point(pair, row, column) for row, column in at.tolist()]
            deque(self._evaluate(points), maxlen=0)
            known = np.array([self._known[point] for point in points])
            off = np.abs(losses[tuple(at.T)] - known)[:CHECK_POINTS] / max(np.ptp(losses), 1e-12)
            errors.extend(off[off > 0.0])  # an evaluated point has no error
            losses[tuple(at.T)] = known
        error = float(np.quantile(errors, 0.95)) if errors else 0.0
        for pair in self._grids:
            yield replace(self._slice(pair), error=error)

    def _point(self, pair: Pair, row: int, column: int) -> tuple[float, ...]:
        point = self._values[len(self._values) // 2].tolist()
        point[pair[0]], point[pair[1]] = self._values[column, pair[0]], self._values[row, pair[1]]
        return tuple(point)

    def _evaluate(self, points: Sequence[tuple[float, ...]]) -> Iterator[None]:
        """Evaluate the unknown ``points``, one for each step of the iterator."""
        new = [point for point in dict.fromkeys(points) if point not in self._known]
        losses = self.pool.map(partial(pose_loss, self._problem), [np.array(p) for p in new])
        for point, loss in zip(new, losses, strict=True):
            self._known[point] = loss
            yield

    def _slice(self, pair: Pair) -> Slice:
        x, y = self._values[:, pair].T
        return Slice(*pair, x, y, self._grids[pair])


def _interpolate(losses: FloatArray, stride: int, finer: int) -> FloatArray:
    """(m, m): losses at every ``finer`` point, by a cubic spline of those at every ``stride``."""
    known, wanted = (np.arange(0, len(losses), step) for step in (stride, finer))
    order = min(3, len(known) - 1)
    curve = RectBivariateSpline(known, known, losses[::stride, ::stride], kx=order, ky=order, s=0)
    return np.asarray(curve(wanted, wanted))


def strides(size: int) -> list[int]:
    """Return the strides of the grids, coarse to fine: powers of 2 that reach the borders."""
    steps = [1]
    while (size - 1) % (2 * steps[0]) == 0 and (size - 1) // (2 * steps[0]) >= MIN_GRID_STEPS:
        steps.insert(0, 2 * steps[0])
    return steps


QUICK_SIZES = (3, 9)
"""Points along a side of the first maps, which follow the pose while it moves."""
QUICK_PIXELS = 1000
"""Pixels of the model on the level of the first maps, at least: they must come at once."""


def quick_level(problem: FitProblem, centre: Pose, renderer: Renderer) -> Level:
    """Return the level of the photo from which the first maps about ``centre`` are made."""
    return coarsest_level(problem.photo, renderer, centre, QUICK_PIXELS)
