"""Slices through the loss: what is evaluated, in which order, and that it is the loss."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from poseviewer.errors import SettingsError
from poseviewer.fit.problem import ComparedView, FitProblem, pose_loss
from poseviewer.fit.slices import Slice, landscape
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.pool import RendererPool
from poseviewer.render.types import Moments, PhotoAttributes, Renderer
from tests.meshes import make_box

PLACE = RigidTransform(np.eye(3), np.array([0.0, 0.0, 5.0]))
CHART = FreeBodyChart.near(make_box(), Pose(Perspective(10.0, 10.0, 4.0, 3.0, 8, 6), PLACE))


class CountingRenderer(Renderer):
    """Moments whose loss is a smooth function of the pose, least at the chart's start."""

    def __init__(self) -> None:
        self.seen: list[bytes] = []

    def clone(self):
        other = CountingRenderer()
        other.seen = self.seen  # counted together; appending is one step
        return other

    def render(self, pose):
        raise NotImplementedError

    def covers(self, pose):
        raise NotImplementedError

    def moments(self, pose, photo) -> Moments:
        numbers = CHART.from_pose(pose).round(9) + 0.0
        self.seen.append(numbers.tobytes())
        covariance = np.eye(5)
        covariance[0, 1] = covariance[1, 0] = 1.0 / np.sqrt(1.0 + float(numbers @ numbers))
        return Moments(1000, 1000.0, np.zeros(5), covariance, photo.channels.shape[2])


def make_problem(*free: int) -> FitProblem:
    """A problem with some free numbers, by default the first four."""
    free = free or (0, 1, 2, 3)
    photo = PhotoAttributes(np.zeros((6, 8, 1), np.float32), np.ones((6, 8), np.float32))
    freed = tuple(number in free for number in range(6))
    return FitProblem((ComparedView(photo, CHART),), np.zeros(6), freed)


def drawn(problem, centre, renderer=None, **settings) -> Iterator[Slice]:
    pool = RendererPool(renderer or CountingRenderer(), 1)
    return landscape(problem, pool, centre, **settings)


def finished(problem, centre, renderer=None, **settings) -> dict[tuple[int, int], Slice]:
    pieces = drawn(problem, centre, renderer, **settings)
    return {(piece.first, piece.second): piece for piece in pieces}


@pytest.mark.parametrize("free", [(0, 1, 2, 3, 4, 5), (0, 2, 3), (1, 4)])
def test_every_two_free_numbers_have_a_slice(free):
    slices = finished(make_problem(*free), np.zeros(6), size=5)
    assert list(slices) == [(one, other) for one in free for other in free if one < other]
    assert all(np.isfinite(piece.losses).all() for piece in slices.values())


def test_ends_equal_to_the_direct_grid():
    problem, centre = make_problem(0, 1, 5), np.array([0.02, -0.05, 0, 0, 0, 0.1])
    for (first, second), piece in finished(problem, centre, size=9, half_width=0.3).items():
        assert piece.first_values == pytest.approx(centre[first] + 0.3 * np.linspace(-1, 1, 9))
        for row, column in np.ndindex(9, 9):
            parameters = centre.copy()
            parameters[first], parameters[second] = (
                piece.first_values[column],
                piece.second_values[row],
            )
            assert piece.losses[row, column] == pose_loss(problem, CountingRenderer(), parameters)


@pytest.mark.parametrize("size", [3, 21])
def test_no_point_is_evaluated_twice(size):
    renderer = CountingRenderer()
    finished(make_problem(), np.zeros(6), renderer, size=size)
    # Six planes without the axes, four axes without the centre, the centre.
    assert len(renderer.seen) == 6 * (size - 1) ** 2 + 4 * (size - 1) + 1
    assert len(set(renderer.seen)) == len(renderer.seen)


def test_every_pair_is_seen_coarsely_before_any_is_seen_finely():
    known: dict[tuple[int, int], int] = {}
    for piece in landscape(
        make_problem(), RendererPool(CountingRenderer(), 1), np.zeros(6), size=41
    ):
        known[piece.first, piece.second] = int(np.isfinite(piece.losses).sum())
        if max(known.values()) > 36:
            break
    assert len(known) == 6
    assert sorted(known.values())[:5] == [36] * 5


def test_what_is_known_stays_and_grows():
    before: dict[tuple[int, int], Slice] = {}
    for piece in landscape(
        make_problem(0, 1, 2), RendererPool(CountingRenderer(), 1), np.zeros(6), size=9
    ):
        old = before.get((piece.first, piece.second))
        if old is not None:
            known = np.isfinite(old.losses)
            assert np.array_equal(piece.losses[known], old.losses[known])
            assert np.isfinite(piece.losses).sum() > known.sum()
        assert not np.isnan(piece.filled()).any()
        before[piece.first, piece.second] = piece


def test_numbers_without_a_pose_cost_the_most():
    slices = finished(make_problem(4, 5), np.zeros(6), size=5, half_width=40.0)
    losses = slices[4, 5].losses
    assert np.all(losses[[0, -1]] == 1.0)  # a depth out of all proportion
    assert losses[2, 2] < 1.0


def test_minimum_is_found_in_the_numbers_of_the_chart():
    centre = np.array([0.1, -0.2, 0.0, 0.0, 0.0, 0.0])
    piece = finished(make_problem(0, 1), centre, size=41)[0, 1]
    least = piece.minimum
    assert least is not None
    assert [least.first_value, least.second_value] == pytest.approx([0.0, 0.0], abs=0.011)
    assert least.loss == pytest.approx(0.0, abs=1e-3)
    assert replace(piece, losses=np.full((41, 41), np.nan)).minimum is None


@pytest.mark.parametrize(
    ("free", "size", "half_width", "said"),
    [
        ((0, 1), 40, 0.2, "wanted an odd number"),
        ((0, 1), 1, 0.2, "wanted an odd number"),
        ((0, 1), 41, 0.0, "wanted an odd number"),
        ((0,), 41, 0.2, "two free numbers"),
    ],
)
def test_impossible_grids_are_refused(free, size, half_width, said):
    with pytest.raises(SettingsError, match=said):
        finished(make_problem(*free), np.zeros(6), size=size, half_width=half_width)


def test_a_pool_gives_the_same_maps_in_the_same_order():
    problem, centre = make_problem(), np.array([0.1, 0.0, -0.2, 0.05, 0.0, 0.0])
    made = []
    for threads in (1, 3):
        with RendererPool(CountingRenderer(), threads) as pool:
            made.append(list(landscape(problem, pool, centre, size=9)))
    for one, other in zip(*made, strict=True):
        assert (one.first, one.second) == (other.first, other.second)
        assert np.array_equal(one.losses, other.losses, equal_nan=True)


def test_a_stopped_map_stops_its_pool():
    renderer = CountingRenderer()
    with RendererPool(renderer, 2) as pool:
        next(landscape(make_problem(), pool, np.zeros(6), size=41))
    assert len(renderer.seen) < 100


def test_interpolation_does_nearly_as_well():
    problem, centre = make_problem(0, 1, 2), np.array([0.03, -0.05, 0.02, 0.0, 0.0, 0.0])
    exact = finished(problem, centre, size=41)
    renderer = CountingRenderer()
    fast = finished(problem, centre, renderer, size=41, smooth=True)
    assert len(renderer.seen) < 0.5 * 3 * 41**2
    assert len(set(renderer.seen)) == len(renderer.seen)
    off = []
    for pair, piece in fast.items():
        known = exact[pair].losses
        assert np.isfinite(piece.losses).all()
        assert piece.error is not None
        assert exact[pair].error is None
        off.append(np.abs(piece.losses - known) / np.ptp(known))
        assert piece.losses[20, 20] == known[20, 20]
        assert piece.minimum == exact[pair].minimum
    error = next(iter(fast.values())).error or 0.0
    assert 0.0 < np.quantile(off, 0.95) < 3.0 * error < 0.02


class WavyRenderer(CountingRenderer):
    """More loss and less, by waves that the first grid is too coarse for."""

    def moments(self, pose, photo) -> Moments:
        moments = super().moments(pose, photo)
        covariance = moments.covariance.copy()
        covariance[0, 1] *= 1.0 - 0.3 * np.sin(60.0 * CHART.from_pose(pose)[3])
        covariance[1, 0] = covariance[0, 1]
        return replace(moments, covariance=covariance)


def test_what_is_not_smooth_is_evaluated():
    problem, centre = make_problem(3, 4), np.array([0.0, 0.0, 0.0, 0.03, -0.05, 0.0])
    (exact,) = finished(problem, centre, WavyRenderer(), size=41).values()
    (piece,) = finished(problem, centre, WavyRenderer(), size=41, smooth=True).values()
    off = np.abs(piece.losses - exact.losses) / np.ptp(exact.losses)
    assert np.quantile(off, 0.95) < 0.02
