"""Slices through the loss: what is evaluated, in which order, and that it is the loss."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from poseviewer.errors import SettingsError
from poseviewer.fit.compared_pixels import ViewResidual
from poseviewer.fit.problem import FitProblem, pose_loss
from poseviewer.fit.slices import Slice, landscape
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.transform import RigidTransform
from poseviewer.losses.default_loss import DEFAULT
from poseviewer.render.attributes import Moments, PhotoAttributes, Renderer
from poseviewer.render.pool import RendererPool
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.settings import FitSettings
from tests.meshes import make_box, make_bumpy, merged

PLACE = RigidTransform(np.eye(3), np.array([0.0, 0.0, 5.0]))
MESH = make_box()
CHART = FreeBodyChart.near(MESH, Pose(Perspective(10.0, 10.0, 4.0, 3.0, 8, 6), PLACE))
LIGHT = DEFAULT.on("clip")


class CountingRenderer(Renderer):
    """Moments whose loss is a smooth function of the pose, least at the chart's start; with waves
    also one that a first grid is too coarse for.
    """

    def __init__(self, waves: float = 0.0) -> None:
        self.seen: list[bytes] = []
        self.waves = waves

    def clone(self):
        other = CountingRenderer(self.waves)
        other.seen = self.seen  # counted together; appending is one step
        return other

    def render(self, pose):
        raise NotImplementedError

    def render_mask(self, pose):
        raise NotImplementedError

    def moments(self, pose, photo) -> Moments:
        numbers = CHART.from_pose(pose).round(9) + 0.0
        self.seen.append(numbers.tobytes())
        covariance = np.eye(5)
        correlation = 1.0 / np.sqrt(1.0 + float(numbers @ numbers))
        correlation *= 1.0 - self.waves * np.sin(60.0 * CHART.from_pose(pose)[3])
        covariance[0, 1] = covariance[1, 0] = correlation
        return Moments(1000, 1000.0, np.zeros(5), covariance, photo.channels.shape[2])


def make_problem(*free: int) -> FitProblem:
    photo = PhotoAttributes(np.zeros((6, 8, 1), np.float32), np.ones((6, 8), np.float32))
    lock = tuple(name for number, name in enumerate(CHART.names) if number not in free)
    return FitProblem(
        MESH, (ViewResidual(photo, CHART, LIGHT),), np.zeros(6), FitSettings(lock=lock)
    )


def drawn(*free: int, renderer=None, centre=(), threads=1, **settings) -> list[Slice]:
    """All that a landscape yields."""
    at = np.array([*centre, *[0.0] * (6 - len(centre))])
    with RendererPool(renderer or CountingRenderer(), threads) as pool:
        return list(landscape(make_problem(*free), pool, at, **settings))


def finished(*free: int, **settings) -> dict[tuple[int, int], Slice]:
    return {(piece.first, piece.second): piece for piece in drawn(*free, **settings)}


@pytest.mark.parametrize("free", [(0, 1, 5), (1, 4)])
def test_every_two_free_numbers_have_the_direct_grid(free):
    centre = np.array([0.02, -0.05, 0, 0, 0, 0.1])
    slices = finished(*free, centre=centre, size=9, half_width=0.3)
    assert list(slices) == [*combinations(free, 2)]
    for (first, second), piece in slices.items():
        assert piece.first_values == pytest.approx(centre[first] + 0.3 * np.linspace(-1, 1, 9))
        for row, column in np.ndindex(9, 9):
            at = centre.copy()
            at[[first, second]] = piece.first_values[column], piece.second_values[row]
            assert piece.losses[row, column] == pose_loss(
                make_problem(*free), CountingRenderer(), at
            )


def test_no_point_is_evaluated_twice():
    renderer, size = CountingRenderer(), 21
    drawn(0, 1, 2, 3, renderer=renderer, size=size)
    # Six planes without the axes, four axes without the centre, the centre.
    assert len(renderer.seen) == 6 * (size - 1) ** 2 + 4 * (size - 1) + 1
    assert len(set(renderer.seen)) == len(renderer.seen)


def test_what_is_known_grows_coarsely_in_every_pair_before_any_is_seen_finely():
    pieces: dict[tuple[int, int], Slice] = {}
    for piece in drawn(0, 1, 2, 3, size=21):
        pair = piece.first, piece.second
        count = int(np.isfinite(piece.losses).sum())
        if pair in pieces:
            known = np.isfinite(pieces[pair].losses)
            assert np.array_equal(piece.losses[known], pieces[pair].losses[known])
            assert count > known.sum()
        assert not np.isnan(piece.fill_gaps()).any()
        pieces[pair] = piece
        if count > 36:
            assert len(pieces) == 6
            assert all(np.isfinite(one.losses).sum() >= 36 for one in pieces.values())


def test_minimum_is_found_in_the_numbers_of_the_chart():
    piece = finished(0, 1, centre=(0.1, -0.2), size=41)[0, 1]
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
        ((0,), 41, 0.2, "two free parameters"),
    ],
)
def test_impossible_grids_are_refused(free, size, half_width, said):
    with pytest.raises(SettingsError, match=said):
        drawn(*free, size=size, half_width=half_width)


def test_a_pool_gives_the_same_maps_in_the_same_order():
    made = [drawn(0, 1, 3, centre=(0.1, 0.0, -0.2), threads=t, size=9) for t in (1, 3)]
    for one, other in zip(*made, strict=True):
        assert (one.first, one.second) == (other.first, other.second)
        assert np.array_equal(one.losses, other.losses, equal_nan=True)


def test_a_stopped_map_stops_its_pool():
    renderer = CountingRenderer()
    with RendererPool(renderer, 2) as pool:
        next(landscape(make_problem(0, 1, 2, 3), pool, np.zeros(6), size=41))
    assert len(renderer.seen) < 100


def test_interpolation_does_nearly_as_well():
    centre, renderer = (0.03, -0.05, 0.02), CountingRenderer()
    exact = finished(0, 1, 2, centre=centre, size=41)
    fast = finished(0, 1, 2, centre=centre, size=41, smooth=True, renderer=renderer)
    assert len(set(renderer.seen)) == len(renderer.seen) < 0.5 * 3 * 41**2
    off = []
    for pair, piece in fast.items():
        known = exact[pair].losses
        assert exact[pair].error is None
        off.append(np.abs(piece.losses - known) / np.ptp(known))
        assert piece.losses[20, 20] == known[20, 20]
        assert piece.minimum == exact[pair].minimum
    error = next(iter(fast.values())).error or 0.0
    assert 0.0 < np.quantile(off, 0.95) < 3.0 * error < 0.02


def test_what_is_not_smooth_is_evaluated():
    settings = {"centre": (0.0, 0.0, 0.0, 0.03, -0.05), "size": 41}
    (exact,), (piece,) = (
        finished(3, 4, renderer=CountingRenderer(0.3), smooth=smooth, **settings).values()
        for smooth in (False, True)
    )
    off = np.abs(piece.losses - exact.losses) / np.ptp(exact.losses)
    assert np.quantile(off, 0.95) < 0.02


class WholeRenderer(SoftwareRenderer):
    """Draws all faces for all poses."""

    def cull_unseen(self, poses):  # noqa: ARG002
        return self


def test_faces_that_the_first_grid_does_not_show_hardly_count():
    mesh = make_bumpy(3)
    mesh = merged(mesh, replace(mesh, vertices=0.7 * mesh.vertices))
    pose = Pose(Perspective(80.0, 80.0, 32.0, 24.0, 64, 48), PLACE)
    renderer = SoftwareRenderer(mesh)
    photo = PhotoAttributes(renderer.render(pose).normals[..., :1], np.ones((48, 64), np.float32))
    chart = FreeBodyChart.near(mesh, pose)
    start, settings = chart.from_pose(pose), FitSettings(lock=chart.names[:4])
    problem = FitProblem(mesh, (ViewResidual(photo, chart, LIGHT),), start, settings)
    whole, culled = [], []
    for pieces, own in ((whole, WholeRenderer(mesh)), (culled, renderer)):
        with RendererPool(own, 2) as pool:
            pieces += landscape(problem, pool, start, size=41, smooth=True)
    off = np.abs(culled[-1].losses - whole[-1].losses) / np.ptp(whole[-1].losses)
    assert off.max() < 0.1
    assert np.quantile(off, 0.95) < 0.005
