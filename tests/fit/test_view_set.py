"""One pose on several photos."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.confidence.model import judge_end
from poseviewer.confidence.uncertainty import joint_covariance
from poseviewer.errors import SettingsError
from poseviewer.fit.landscape import landscape
from poseviewer.fit.problem import FitProblem, make_problem, pose_loss
from poseviewer.fit.registration import LoadedModel, Registration
from poseviewer.fit.search import search
from poseviewer.fit.settings import FitSettings
from poseviewer.fit.stages import fit_pose
from poseviewer.fit.view_set import make_set_problem
from poseviewer.geometry.pose_covariance import region_reach
from poseviewer.geometry.view_chart import ViewChart
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.starts.view_set import place_in_views
from tests.view_sets import DISTANCE, MESH, START, TRUTH, make_views

MODEL = LoadedModel(MESH, "m.ply", "0" * 64, None)
SETTINGS = FitSettings()


def registrations(scale: float | None = 1.0, unit: float = 1.0) -> tuple[Registration, ...]:
    return place_in_views(make_views(unit, scale), MODEL, START, "a.png").registrations


@pytest.fixture(scope="module")
def problem() -> FitProblem:
    return make_set_problem(registrations(), SETTINGS, False)


@pytest.fixture(scope="module")
def renderer() -> SoftwareRenderer:
    return SoftwareRenderer(MESH)


def test_the_loss_is_the_mean_over_the_photos(problem, renderer):
    at = np.array([0.02, 0.01, -0.03, 0.02, 0.0, 0.01])
    losses = [pose_loss(view, renderer, at) for view in problem.views]
    assert len(set(losses)) == 3
    assert pose_loss(problem, renderer, at) == pytest.approx(np.mean(losses), rel=1e-12)


def test_the_first_photo_alone_is_compared_as_without_the_others(problem, renderer):
    alone, _ = make_problem(registrations()[0], replace(SETTINGS, chart="free-body"))
    at = np.array([0.02, 0.01, -0.03, 0.02, 0.0, 0.01])
    expected = pose_loss(alone, renderer, at)
    assert pose_loss(problem.views[0], renderer, at) == pytest.approx(expected, rel=1e-9)
    # Small as they are: the search of several is refined.
    assert alone.fine_photo is None
    assert all(view.fine_photo is not None for view in problem.views)


@pytest.mark.slow
def test_photos_of_several_sides_tell_the_depth(problem, renderer):
    *_, end = search(problem, MESH, renderer, judge_end)
    at, true = (p.camera_from_model.apply(MESH.centre) for p in (end.pose, TRUTH[0]))
    assert np.abs(at - true).max() < 0.002 * DISTANCE
    assert end.verdict is not None
    assert end.verdict.word == "found"
    assert [one.word for one in end.verdict.views] == ["found"] * 3
    joint, single = end.verdict.covariance, end.verdict.views[0].covariance
    assert joint is not None
    assert single is not None
    assert joint.depth < 0.3 * single.depth  # type: ignore[operator]


@pytest.mark.slow
def test_an_unknown_scale_is_found_with_the_pose(renderer):
    placed = place_in_views(make_views(2.5, None), MODEL, START, "a.png")
    assert placed.free_size
    problem = make_set_problem(placed.registrations, SETTINGS, True)
    *_, end = search(problem, MESH, renderer, judge_end)
    at, true = (p.camera_from_model.apply(MESH.centre) for p in (end.pose, TRUTH[0]))
    assert np.abs(at - true).max() < 0.003 * DISTANCE
    assert isinstance(problem.chart, ViewChart)
    assert placed.scale * problem.chart.nearness(end.parameters) == pytest.approx(2.5, rel=0.003)
    # The size is as sure as the distance, which is that of what the set looks at.
    assert end.verdict is not None
    joint = end.verdict.covariance
    assert joint is not None
    assert joint.depth is not None
    assert joint.size_percent == pytest.approx(100.0 * joint.depth / DISTANCE, rel=0.3)
    assert np.isfinite(joint.in_chart(problem.chart)).all()
    # As each photo has it, pose and size are one distribution: that of what is seen there.
    for view, pose in zip(problem.views, TRUTH, strict=True):
        assert isinstance(view.chart, ViewChart)
        seen = view.chart.to_pose(end.parameters)
        also = joint_covariance(problem, MESH, end.parameters, end.verdict.views, seen, view.chart)
        assert also is not None
        assert also.size_percent == pytest.approx(joint.size_percent)
        off = also.deviation(pose) / also.scales
        off[6] = placed.scale * problem.chart.nearness(end.parameters) / 2.5 - 1.0
        units = np.outer(also.scales, also.scales)
        assert off @ np.linalg.solve(also.matrix / units, off) < region_reach(7) ** 2


def test_threads_change_nothing(problem, renderer):
    few = replace(problem, limits=replace(problem.limits, evaluations=120))
    ends = [[*fit_pose(few, renderer, threads)][-1] for threads in (1, 3)]
    assert ends[0].loss == ends[1].loss
    np.testing.assert_array_equal(ends[0].parameters, ends[1].parameters)


def test_a_grey_photo_makes_all_of_them_grey():
    first, second, third = registrations()
    grey = replace(second.photo, pixels=second.photo.pixels.mean(-1, keepdims=True).astype("u1"))
    mixed = make_set_problem((first, replace(second, photo=grey), third), SETTINGS, False)
    assert [view.photo.channels.shape[2] for view in mixed.views] == [1, 1, 1]


def test_a_landscape_is_of_all_photos(problem, renderer):
    *_, last = landscape(problem, renderer, np.zeros(6), half_width=0.1, size=3, pairs=[(0, 5)])
    at = np.zeros(6)
    at[5] = 0.1
    assert last.losses[2, 1] == pose_loss(problem, renderer, at)


@pytest.mark.parametrize(
    ("changes", "said"),
    [({"free_focal": True}, "--free-focal"), ({"pixels": "clip"}, "--pixels clip")],
)
def test_what_does_not_go_with_several_photos_is_said(changes, said):
    with pytest.raises(SettingsError, match=said):
        make_set_problem(registrations(), replace(SETTINGS, **changes), False)
