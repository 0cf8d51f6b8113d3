"""One pose in several views."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.confidence.pose_covariance import region_reach
from poseviewer.errors import SettingsError
from poseviewer.fit.judge import judge_end
from poseviewer.fit.problem import FitProblem, make_problem, pose_loss
from poseviewer.fit.search import Search
from poseviewer.fit.slices import landscape
from poseviewer.geometry.transform import RigidTransform
from poseviewer.opening.photo_sets import SetChoice
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from poseviewer.render.pool import RendererPool
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import InView, Scene
from tests.opened import locked
from tests.view_sets import CAMERA, DISTANCE, MESH, START, TRUTH, focal_length, make_views

MODEL = ModelFile.of(MESH, None, "0" * 64, name="m.ply")
AT = np.array([0.02, 0.01, -0.03, 0.02, 0.0, 0.01])


def make_scene(unit: float = 1.0, scale: float | None = 1.0) -> Scene:
    views, choice = make_views(unit, scale), SetChoice(view="a.png")
    return open_scene(Sources(views=views, model=MODEL, start=START, choice=choice))


@pytest.fixture(scope="module")
def problem() -> FitProblem:
    return make_problem(make_scene())[0]


@pytest.fixture(scope="module")
def renderer() -> SoftwareRenderer:
    return SoftwareRenderer(MESH)


def test_the_loss_is_the_mean_over_the_views(problem, renderer):
    losses = [pose_loss(alone, renderer, AT) for alone in problem.by_view]
    assert len(set(losses)) == 3
    assert pose_loss(problem, renderer, AT) == pytest.approx(np.mean(losses), rel=1e-12)


def test_a_view_alone_is_compared_as_without_the_others(problem, renderer):
    scene = make_scene()
    views = tuple(InView(is_compared=number == 0) for number in range(3))
    settings = FitSettings(chart="free-body")
    alone, notes = make_problem(scene.with_object(0, in_views=views, settings=settings))
    assert not notes
    expected = pose_loss(alone, renderer, AT)
    assert pose_loss(problem.by_view[0], renderer, AT) == pytest.approx(expected, rel=1e-9)
    # Small as they are: the search of several is refined.
    assert alone.views[0].fine_photo is None
    assert all(view.fine_photo is not None for view in problem.views)


@pytest.mark.slow
@pytest.mark.long
def test_views_of_several_sides_tell_the_depth(renderer):
    search = Search(make_scene(), {0: renderer})
    *_, end = search.run()
    at, true = (p.camera_from_model.apply(MESH.centre) for p in (end.progress.pose, TRUTH[0]))
    assert np.abs(at - true).max() < 0.002 * DISTANCE
    for number, truth in enumerate(TRUTH):
        moved, true = (p.project(MESH.vertices) for p in (search.scene.pose(0, number), truth))
        assert np.abs(moved - true).max() < 1.0
    verdict = end.progress.verdict
    assert verdict is not None
    assert verdict.label == "found"
    assert [one.label for one in verdict.views].count("found") >= 2  # one alone may be turned
    joint = end.progress.covariance
    alone = replace(end.progress, problem=end.problem.by_view[0])
    single = judge_end(alone, renderer).covariance
    assert joint is not None
    assert single is not None
    assert joint.deviations["depth"] < 0.3 * single.deviations["depth"]


@pytest.mark.slow
@pytest.mark.long
def test_photos_of_one_camera_tell_its_focal_length(renderer):
    scene = make_scene()
    focals = [focal_length(view.camera) for view in scene.views]
    wrong = [0.85, 0.85, 1.1]  # the third is of another camera
    views = tuple(
        replace(view, camera=replace(CAMERA, fx=share * focal, fy=share * focal))
        for view, focal, share in zip(scene.views, focals, wrong, strict=True)
    )
    scene = replace(scene, views=views)
    search = Search(scene.with_object(0, settings=FitSettings(free_focal=True)), {0: renderer})
    *_, end = search.run()
    assert end.problem.chart.names[6:] == ("log_focal", "log_focal_2")
    found = [view.camera for view in search.scene.views]
    assert found[0] == found[1] != found[2]
    assert [focal_length(camera) for camera in found] == pytest.approx(focals, rel=0.01)
    at, true = (p.camera_from_model.apply(MESH.centre) for p in (end.progress.pose, TRUTH[0]))
    assert np.abs(at - true).max() < 0.003 * DISTANCE
    sure = end.progress.covariance
    assert sure is not None
    assert sure.deviations["focal_px"] < 0.02 * focals[0]


@pytest.mark.slow
@pytest.mark.long
def test_an_unknown_scale_is_found_with_the_pose(renderer):
    scene = make_scene(2.5, None)
    assert scene.free_scale
    search = Search(scene, {0: renderer})
    *_, now = search.run()
    end, problem = now.progress, now.problem
    at, true = (p.camera_from_model.apply(MESH.centre) for p in (end.pose, TRUTH[0]))
    assert np.abs(at - true).max() < 0.003 * DISTANCE
    scale = 1.0 / search.scene.objects[0].world_from_model.scale
    assert scale == pytest.approx(2.5, rel=0.003)
    # The size is as sure as the distance, which is that of what the views look at.
    joint = end.covariance
    assert joint is not None
    depth, size = joint.deviations["depth"], joint.deviations["size_percent"]
    assert size == pytest.approx(100.0 * depth / DISTANCE, rel=0.3)
    assert np.isfinite(joint.in_chart(problem.chart)).all()
    # As each view has it, pose and size are one distribution: that of what is seen there.
    first = search.scene.views[0].camera_from_world.inverse()
    for number, pose in enumerate(TRUTH):
        turn = search.scene.views[number].camera_from_world @ first
        turn = RigidTransform(turn.rotation, scale * turn.translation)
        also = joint.in_view_of(turn, search.scene.pose(0, number), MESH)
        assert also.deviations["size_percent"] == pytest.approx(size)
        off = also.deviation(pose) / also.scales
        off[6] = scale / 2.5 - 1.0
        units = np.outer(also.scales, also.scales)
        assert off @ np.linalg.solve(also.matrix / units, off) < region_reach(7) ** 2


def test_a_grey_photo_makes_all_of_them_grey():
    scene = make_scene()
    first, second, third = scene.views
    pixels = second.photo.pixels.mean(-1, keepdims=True).astype("u1")
    grey = replace(second, file=PhotoFile.of(replace(second.photo, pixels=pixels)))
    mixed, _ = make_problem(replace(scene, views=(first, grey, third)))
    assert [view.photo.channels.shape[2] for view in mixed.views] == [1, 1, 1]


@pytest.mark.parametrize("is_mixed", [False, True])
def test_a_landscape_is_of_all_views_of_any_sizes(renderer, is_mixed):
    scene = make_scene()
    if is_mixed:
        first, second, third = scene.views
        pixels = second.photo.pixels.repeat(2, axis=0).repeat(2, axis=1)
        camera, photo = second.camera.rescale(2.0), replace(second.photo, pixels=pixels)
        scene = replace(
            scene, views=(first, replace(second, file=PhotoFile.of(photo), camera=camera), third)
        )
    problem = make_problem(scene)[0]
    problem = locked(problem, *problem.chart.names[1:5])
    assert is_mixed == (problem.views[1].photo.factor > problem.views[0].photo.factor)
    pool = RendererPool(renderer, 1)
    *_, last = landscape(problem, pool, np.zeros(6), half_width=0.1, size=3)
    assert last.losses[2, 1] == pose_loss(problem, renderer, 0.1 * np.eye(6)[5])


@pytest.mark.parametrize(
    ("changes", "said"),
    [({"chart": "vehicle"}, 'chart="vehicle"'), ({"pixels": "clip"}, 'pixels="clip"')],
)
def test_what_does_not_go_with_several_views_is_said(changes, said):
    scene = make_scene().with_object(0, settings=FitSettings(**changes))
    with pytest.raises(SettingsError, match=said):
        make_problem(scene)


def test_a_view_that_does_not_see_the_object_is_left_out_and_said():
    scene = make_scene()
    away = scene.views[1].camera_from_world
    away = replace(away, translation=away.translation + np.array([90.0, 0.0, 0.0]))
    views = (scene.views[0], replace(scene.views[1], camera_from_world=away), scene.views[2])
    problem, notes = make_problem(replace(scene, views=views))
    assert [view.view_index for view in problem.views] == [0, 2]
    assert notes == ("b.png does not see the model where it starts, and is left out.",)
