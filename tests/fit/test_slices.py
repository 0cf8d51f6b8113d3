"""Slices through the loss: what is evaluated, in which order, and that it is the loss."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.errors import SettingsError
from poseviewer.fit.problem import ComparedView, FitProblem, pose_loss
from poseviewer.fit.slices import Slice, landscape, slice_minimum
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.pool import RendererPool
from poseviewer.render.types import Moments, PhotoAttributes, Renderer

WORST = 1.0


class ToyChart:
    """Any numbers, carried to the renderer by the translation and the principal point."""

    def __init__(self, count: int, limit: float = np.inf) -> None:
        self.count, self.limit = count, limit
        self.name, self.names = "toy", tuple(f"x{i}" for i in range(count))

    def scales(self, parameters):
        return np.arange(1.0, len(parameters) + 1.0)

    def to_pose(self, parameters):
        if np.any(np.abs(parameters) > self.limit):
            raise OutsideChartError("beyond the limit")
        rotation = 0.1 * np.resize(np.append(parameters[3:6], np.zeros(3)), 3)
        focal = 10.0 + (parameters[6] if self.count > 6 else 0.0)
        camera = Perspective(focal, 10.0, 4.0, 3.0, 8, 6)
        position = np.append(parameters[:3], np.zeros(3))[:3]
        return Pose(camera, RigidTransform.from_rotation_vector(rotation, position))

    def from_pose(self, pose):
        raise NotImplementedError


class CountingRenderer(Renderer):
    """Moments whose loss is a smooth function of the pose, least at the identity."""

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
        transform, focal = pose.camera_from_model, getattr(pose.camera, "fx")  # noqa: B009 - perspective
        vector = np.concatenate([transform.translation, transform.as_rotation_vector() * 10.0])
        self.seen.append(np.append(vector, focal).round(9).tobytes())
        distance = float(vector @ vector + (focal - 10.0) ** 2)
        covariance = np.eye(5)
        covariance[0, 1] = covariance[1, 0] = 1.0 / np.sqrt(1.0 + distance)
        return Moments(1000, 1000.0, np.zeros(5), covariance, photo.channels.shape[2])


def make_problem(count: int, limit: float = np.inf, free: tuple[bool, ...] = ()) -> FitProblem:
    photo = PhotoAttributes(np.zeros((6, 8, 1), np.float32), np.ones((6, 8), np.float32))
    return FitProblem((ComparedView(photo, ToyChart(count, limit)),), np.zeros(count), free)


def finished(problem, centre, renderer=None, **settings) -> dict[tuple[int, int], Slice]:
    pieces = landscape(problem, renderer or CountingRenderer(), centre, **settings)
    return {(piece.first, piece.second): piece for piece in pieces}


@pytest.mark.parametrize(("count", "pairs"), [(6, 15), (7, 21), (2, 1)])
def test_every_two_numbers_have_a_slice(count, pairs):
    slices = finished(make_problem(count), np.zeros(count), size=5)
    assert len(slices) == pairs
    assert all(first < second and piece.complete for (first, second), piece in slices.items())


def test_ends_equal_to_the_direct_grid():
    problem, centre = make_problem(3), np.array([0.02, -0.05, 0.1])
    for (first, second), piece in finished(problem, centre, size=9, half_width=0.3).items():
        assert piece.first_values == pytest.approx(
            centre[first] + 0.3 * (first + 1) * np.linspace(-1, 1, 9)
        )
        for row, column in np.ndindex(9, 9):
            parameters = centre.copy()
            parameters[first], parameters[second] = (
                piece.first_values[column],
                piece.second_values[row],
            )
            assert piece.losses[row, column] == pose_loss(problem, CountingRenderer(), parameters)


@pytest.mark.parametrize("size", [3, 5, 9, 21])
def test_no_point_is_evaluated_twice(size):
    renderer = CountingRenderer()
    finished(make_problem(4), np.zeros(4), renderer, size=size)
    # Six planes without the axes, four axes without the centre, the centre.
    assert len(renderer.seen) == 6 * (size - 1) ** 2 + 4 * (size - 1) + 1
    assert len(set(renderer.seen)) == len(renderer.seen)


def test_every_pair_is_seen_coarsely_before_any_is_seen_finely():
    known: dict[tuple[int, int], int] = {}
    for piece in landscape(make_problem(4), CountingRenderer(), np.zeros(4), size=41):
        known[piece.first, piece.second] = int(np.isfinite(piece.losses).sum())
        if max(known.values()) > 36:
            break
    assert len(known) == 6
    assert sorted(known.values())[:5] == [36] * 5


def test_what_is_known_stays_and_grows():
    before: dict[tuple[int, int], Slice] = {}
    for piece in landscape(make_problem(3), CountingRenderer(), np.zeros(3), size=9):
        old = before.get((piece.first, piece.second))
        if old is not None:
            known = np.isfinite(old.losses)
            assert np.array_equal(piece.losses[known], old.losses[known])
            assert np.isfinite(piece.losses).sum() > known.sum()
        assert not np.isnan(piece.filled()).any()
        before[piece.first, piece.second] = piece


def test_numbers_without_a_pose_cost_the_most():
    slices = finished(make_problem(2, limit=0.15), np.zeros(2), size=5)
    assert slices[0, 1].losses[0, 0] == WORST
    assert slices[0, 1].losses[2, 2] < WORST


def test_locked_numbers_have_no_slices():
    problem = make_problem(4, free=(True, False, True, True))
    assert set(finished(problem, np.zeros(4), size=3)) == {(0, 2), (0, 3), (2, 3)}


def test_minimum_is_found_in_the_numbers_of_the_chart():
    centre = np.array([0.1, -0.2])
    least = slice_minimum(finished(make_problem(2), centre, size=41)[0, 1])
    assert least is not None
    assert [least.first_value, least.second_value] == pytest.approx([0.0, 0.0], abs=0.011)
    assert least.loss == pytest.approx(0.0, abs=1e-3)


def test_minimum_of_nothing_is_none():
    values = np.linspace(-1, 1, 3)
    assert slice_minimum(Slice(0, 1, values, values, np.full((3, 3), np.nan))) is None


@pytest.mark.parametrize(("size", "half_width"), [(40, 0.2), (1, 0.2), (41, 0.0), (41, -1.0)])
def test_impossible_grids_are_refused(size, half_width):
    with pytest.raises(SettingsError, match="wanted an odd number"):
        next(
            landscape(
                make_problem(2), CountingRenderer(), np.zeros(2), size=size, half_width=half_width
            )
        )


def test_one_free_number_gives_no_landscape():
    problem = make_problem(3, free=(True, False, False))
    with pytest.raises(SettingsError, match="two free numbers"):
        next(landscape(problem, CountingRenderer(), np.zeros(3)))


@pytest.mark.parametrize("threads", [1, 3])
def test_a_pool_gives_the_same_maps_in_the_same_order(threads):
    problem, centre = make_problem(4), np.array([0.1, 0.0, -0.2, 0.05])
    alone = list(landscape(problem, CountingRenderer(), centre, size=9))
    with RendererPool(CountingRenderer(), threads) as pool:
        together = list(landscape(problem, pool, centre, size=9))
    assert len(alone) == len(together)
    for one, other in zip(alone, together, strict=True):
        assert (one.first, one.second) == (other.first, other.second)
        assert np.array_equal(one.losses, other.losses, equal_nan=True)


def test_a_stopped_map_stops_its_pool():
    renderer = CountingRenderer()
    with RendererPool(renderer, 2) as pool:
        next(landscape(make_problem(6), pool, np.zeros(6), size=41))
    assert len(renderer.seen) < 100


def test_interpolation_does_nearly_as_well():
    problem, centre = make_problem(3), np.array([0.03, -0.05, 0.02])
    exact = finished(problem, centre, size=41)
    renderer = CountingRenderer()
    fast = finished(problem, centre, renderer, size=41, smooth=True)
    assert len(renderer.seen) < 0.5 * 3 * 41**2
    assert len(set(renderer.seen)) == len(renderer.seen)
    off = []
    for pair, piece in fast.items():
        known = exact[pair].losses
        assert piece.complete
        assert piece.error is not None
        assert exact[pair].error is None
        off.append(np.abs(piece.losses - known) / np.ptp(known))
        assert piece.losses[20, 20] == known[20, 20]
        assert slice_minimum(piece) == slice_minimum(exact[pair])
    error = next(iter(fast.values())).error or 0.0
    assert 0.0 < np.quantile(off, 0.95) < 3.0 * error < 0.02


class WavyRenderer(CountingRenderer):
    """More loss and less, by waves that the first grid is too coarse for."""

    def moments(self, pose, photo) -> Moments:
        found = super().moments(pose, photo)
        covariance = found.covariance.copy()
        covariance[0, 1] *= 1.0 - 0.3 * np.sin(60.0 * pose.camera_from_model.translation[0])
        covariance[1, 0] = covariance[0, 1]
        return replace(found, covariance=covariance)


def test_what_is_not_smooth_is_evaluated():
    problem, centre = make_problem(2), np.array([0.03, -0.05])
    (exact,) = finished(problem, centre, WavyRenderer(), size=41).values()
    (piece,) = finished(problem, centre, WavyRenderer(), size=41, smooth=True).values()
    off = np.abs(piece.losses - exact.losses) / np.ptp(exact.losses)
    assert np.quantile(off, 0.95) < 0.02


def test_few_points_are_all_evaluated():
    problem = make_problem(2)
    (piece,) = finished(problem, np.zeros(2), size=9, smooth=True).values()
    (exact,) = finished(problem, np.zeros(2), size=9).values()
    assert np.array_equal(piece.losses, exact.losses)
    assert piece.error is None
