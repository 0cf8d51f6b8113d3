"""Poses that stand right but are turned about an axis: told from right ones, and mended."""

from contextlib import closing
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh

from poseviewer.api import load
from poseviewer.confidence.verdict import Features, judge
from poseviewer.evaluation.synthetic import photograph, random_lighting
from poseviewer.files.demo import demo_case
from poseviewer.fit.judge import gather_features, judge_end
from poseviewer.fit.probing import Probe
from poseviewer.fit.problem import FitProblem, make_problem
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.search import Search
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.symmetry_group import NO_SYMMETRY, Symmetry, SymmetryAxis
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene
from tests.meshes import make_mesh
from tests.opened import locked, scene_of
from tests.renderers import require_opengl

ACROSS, _, AXIS = np.eye(3)


def make_can() -> Mesh:
    """A cylinder along z, with a print of coloured spots."""
    can = trimesh.creation.cylinder(radius=0.5, height=1.4, sections=90)
    vertices, faces, *_ = trimesh.remesh.subdivide_to_size(can.vertices, can.faces, 0.08)
    spots = np.random.default_rng(5).uniform(-0.7, 0.7, (60, 3))
    spots[:, :2] *= 0.5 / np.linalg.norm(spots[:, :2], axis=1, keepdims=True)
    nearest = np.argmin(np.linalg.norm(vertices[:, None] - spots, axis=2), axis=1)
    colours = np.random.default_rng(6).uniform(0.1, 0.9, (len(spots), 3))[nearest]
    return make_mesh(vertices, faces, colours=colours)


CAN = make_can()
TRUTH = Pose(
    Perspective(400.0, 400.0, 160.0, 120.0, 320, 240),
    RigidTransform.from_rotation_vector([1.25, 0.5, -0.4], [0.05, 0.02, 4.0]),
)
ROUND = Symmetry.from_axes(CAN.centre, [SymmetryAxis(AXIS, 0), SymmetryAxis(ACROSS, 2)])


def turned(pose: Pose, degrees: float) -> Pose:
    """The can turned about its own axis."""
    turn = RigidTransform.from_rotation_vector(np.radians(degrees) * AXIS, [0.0, 0.0, 0.0])
    return replace(pose, camera_from_model=pose.camera_from_model @ turn)


@cache
def photo_of(mesh: Mesh) -> Photo:
    """Drawn by OpenGL."""
    require_opengl()
    lighting, ground = random_lighting(np.random.default_rng(3)), (0.45, 0.5, 0.4)
    pixels = photograph(mesh, TRUTH, lighting, ground, blur_px=0.7, noise=2.0, seed=3)
    return Photo(pixels, "can.png", "0" * 64)


def scene_from(start: Pose, mesh: Mesh = CAN) -> Scene:
    """A photo of the can and a start beside its pose."""
    return scene_of(photo_of(mesh), mesh, start, FitSettings(chart="free-body"))


def fitted_from(start: Pose, mesh: Mesh = CAN) -> FitProblem:
    return make_problem(scene_from(start, mesh))[0]


def probing(problem: FitProblem, pose: Pose = TRUTH) -> closing[Probe]:
    return closing(Probe(problem, make_renderer(problem.mesh), pose))


def symmetric(problem: FitProblem, symmetry: Symmetry) -> FitProblem:
    return replace(problem, symmetry=symmetry)


def features_of(problem: FitProblem, pose: Pose = TRUTH) -> Features | None:
    with probing(problem, pose) as probe:
        return gather_features(probe)[0]


def rival_of(problem: FitProblem, pose: Pose) -> FloatArray | None:
    """Parameters of the better pose that the verdict on a pose comes upon."""
    at = replace(FitProgress.at_start(problem), pose=pose, status=Status.CONVERGED)
    return judge_end(at, make_renderer(problem.mesh), 2).rival_parameters


@pytest.mark.parametrize("lock", [(), ("mu_x",), ("width_per_focal",)])
def test_motions_are_those_that_the_search_was_free_in(lock):
    files = demo_case()
    case = load(files.photo, files.model, files.start, free_focal=True, lock=lock)
    problem = case.problem
    with probing(problem, case.pose) as probe:
        assert len(probe.motions) == len(problem.free_indices) == 7 - len(lock)
        assert probe.motions.shape[1] == 7 - ("width_per_focal" in lock)
        held = [index for index in range(7) if index not in problem.free_indices]
        for step in 1e-4 * np.eye(len(probe.motions)):
            moved = problem.chart.from_pose(probe.pose(step)) - problem.start
            np.testing.assert_allclose(moved[held], 0.0, atol=1e-6)


@pytest.mark.slow
@pytest.mark.long
def test_what_a_search_may_not_turn_is_not_turned():
    problem = locked(fitted_from(TRUTH), "rotation_x", "rotation_y", "rotation_z")
    with probing(problem) as probe:
        assert probe.turns(30.0).shape == (0, 3)
    assert rival_of(problem, turned(TRUTH, 25.0)) is None


@pytest.mark.slow
@pytest.mark.long
def test_the_right_turn_is_found_and_what_is_held_stays_to_the_last_digit():
    start = turned(TRUTH, -38.0)
    problem = fitted_from(start)
    parameters = rival_of(problem, start)
    assert parameters is not None
    assert pose_error(CAN, problem.chart.to_pose(parameters), TRUTH).rotation_deg < 4.0
    assert rival_of(problem, TRUTH) is None
    start = turned(TRUTH, 25.0)
    problem = locked(fitted_from(start), "rotation_x")
    off = problem.start + np.array([0.0, 0.03, -0.03, 0.02, 0.01, 0.02])
    parameters = rival_of(problem, problem.chart.to_pose(off))
    assert parameters is not None
    assert parameters[0] == problem.start[0]


@pytest.mark.slow
@pytest.mark.long
def test_a_fit_that_would_end_turned_ends_right():
    start = turned(TRUTH, -35.0)  # without the turns: 31.6 degrees off, and `lost`
    *_, now = Search(scene_from(start), {0: make_renderer(CAN)}, threads=2).run()
    end = now.progress
    assert end.verdict is not None
    assert end.verdict.label == "found"
    assert pose_error(CAN, end.pose, TRUTH).rotation_deg < 1.0


@pytest.mark.slow
@pytest.mark.long
def test_the_verdict_tells_a_turned_can_from_a_right_one():
    problem = fitted_from(TRUTH)
    right, wrong = (judge(features_of(problem, p)) for p in (TRUTH, turned(TRUTH, 30.0)))
    assert right.features["rival_margin"] > 1.0 > wrong.features["rival_margin"]
    assert right.label == "found"
    assert wrong.label != "found"
    assert any("may be turned" in reason for reason in wrong.reasons)
    assert not any("turned" in reason for reason in right.reasons)


def test_turns_to_equal_poses_are_no_motions():
    problem = symmetric(fitted_from(TRUTH), ROUND)
    with probing(problem) as probe:
        assert probe.motions.shape == (5, 6)
        np.testing.assert_allclose(probe.motions @ probe.motions.T, np.eye(5), atol=1e-9)
        about = TRUTH.camera_from_model.rotation @ AXIS
        np.testing.assert_allclose(probe.motions[:, :3] @ about, 0.0, atol=1e-6)
        for step in probe.turns(30.0, 180.0):  # across the axis alone
            turn = probe.pose(step).camera_from_model.rotation @ AXIS
            assert turn @ about < 1.0 - 1e-6


def test_an_equal_pose_is_not_away():
    symmetry = Symmetry.from_axes(CAN.centre, [SymmetryAxis(ACROSS, 2)])
    problem = symmetric(fitted_from(TRUTH), symmetry)
    with probing(problem) as probe:
        _, over = symmetry.transforms()
        equal = replace(TRUTH, camera_from_model=TRUTH.camera_from_model @ over)
        step, nothing = probe.chart.from_pose(equal), np.zeros(6)
        assert np.linalg.norm(step[:3]) == pytest.approx(np.pi)
        assert probe.distance(nothing, step) < 1e-9
        aside = np.array([0.0, 0.0, 0.0, 0.2, 0.0, 0.0])
        away = probe.distance(nothing, step + aside)
        assert away == pytest.approx(probe.distance(nothing, aside), rel=0.05)


@pytest.mark.slow
@pytest.mark.long
def test_equal_poses_do_not_count_as_turned():
    plain = make_mesh(CAN.vertices, CAN.faces)  # by its loss alone it may be turned as one likes
    problem = fitted_from(TRUTH, plain)
    said = NO_SYMMETRY, ROUND
    as_any, as_round = (features_of(symmetric(problem, one)) for one in said)
    assert as_any is not None
    assert as_round is not None
    assert as_any.rival_margin < 0.1 < 1.0 < as_round.rival_margin
    assert judge(as_round).label == "found"
