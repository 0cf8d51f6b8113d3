"""Evidence on a pose of the small scene: its features, its covariance, and the border of charts."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from poseviewer.api import load
from poseviewer.confidence.verdict import judge
from poseviewer.fit.covariance import FOCAL_MODELS, MODELS, find_covariance, inverse_curvature
from poseviewer.fit.judge import gather_features, judge_end
from poseviewer.fit.probing import Probe, free_motions
from poseviewer.fit.problem import FitProblem, make_problem
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.stages import fit_pose
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.symmetry_group import Symmetry, SymmetryAxis
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.starts.start import Start
from poseviewer.vehicle.chart import MIN_AXLE_COMPONENT, VehicleChart
from tests.geometry.test_charts import make_keypoints
from tests.opened import by, locked


@pytest.fixture(scope="module")
def opened(scene):
    return open_scene(Sources(scene.photo, model=scene.model, start=scene.truth))


@pytest.fixture(scope="module")
def case(opened) -> Any:
    mesh = opened.objects[0].mesh
    return make_problem(by(opened, chart="free-body"))[0], SoftwareRenderer(mesh)


@pytest.fixture(scope="module")
def truth(opened) -> Pose:
    return opened.pose(0)


def probing(problem: FitProblem, pose: Pose, case: Any, **more: Any) -> closing[Probe]:
    return closing(Probe(problem, case[1], pose, **more))


def sure_of(problem: FitProblem, pose: Pose, case: Any, seen: float = 1.0, threads: int = 1) -> Any:
    with probing(problem, pose, case, threads=threads, is_fine=True) as probe:
        return find_covariance(probe, seen)


def test_the_features_speak_for_the_true_pose(case, truth):
    off = case[0].chart.to_pose(np.array([0.7, -0.5, 0.3, 0.3, 0.2, 0.1]))
    with probing(case[0], truth, case) as here, probing(case[0], off, case) as there:
        (right, _), (wrong, _) = gather_features(here), gather_features(there)
    assert right is not None
    assert wrong is not None
    assert right.rival_margin > wrong.rival_margin
    assert right.spread_percent < wrong.spread_percent
    assert judge(wrong).label == "lost"
    assert judge(right).probability > 0.5 > judge(wrong).probability


def test_a_pose_at_the_border_of_its_chart_has_motions(case):
    """The axle lies as flat as the vehicle's numbers allow: one more step leads to no pose."""
    problem, mesh = case[0], case[0].mesh
    camera = Parallel(60.0, 100.0, 80.0, 200, 160)
    chart = VehicleChart(make_keypoints(np.random.default_rng(3)).left, camera)
    flattest = np.sqrt(1.0 - MIN_AXLE_COMPONENT**2) - 1e-9
    parameters = np.array([0.3, 0.6, 0.3, 0.01, 0.0, flattest])
    with pytest.raises(OutsideChartError):
        chart.to_pose(parameters + 1e-4 * np.eye(6)[5])
    views = (replace(problem.views[0], chart=chart),)
    here = locked(replace(problem, views=views, start=parameters), "psi_x")
    motions = free_motions(here, parameters, FreeBodyChart.near(mesh, chart.to_pose(parameters)))
    np.testing.assert_allclose(motions @ motions.T, np.eye(5), atol=1e-9)


@pytest.mark.parametrize(
    ("curvatures", "options"),
    [
        ([300, 1000, 3000, 5000, 10000, 20000], MODELS),
        ([5, 300, 1000, 3000, 5000, 10000, 20000], FOCAL_MODELS),
    ],
    ids=["all are steep", "one is flat far beyond the first samples"],
)
def test_the_curvature_of_a_known_quadratic_is_found_under_jumps(curvatures, options):
    random, size = np.random.default_rng(0), len(curvatures)
    axes, _ = np.linalg.qr(random.normal(size=(size, size)))
    hessian = (axes * curvatures) @ axes.T
    centre = 0.003 * random.normal(size=size)

    def losses(points: Sequence[np.ndarray]) -> np.ndarray:
        away = np.array(points) - centre
        smooth = 40.0 + 0.5 * np.einsum("ni,ij,nj->n", away, hessian, away)
        return smooth + 0.003 * random.normal(size=len(away))

    least, inverse, _ = inverse_curvature(losses, size, options)
    assert least == pytest.approx(40.0, abs=0.02)
    ratios = np.linalg.eigvals(inverse @ hessian).real
    assert 0.8 < ratios.min() <= ratios.max() < 1.25


def test_the_end_of_a_fit_is_sure_and_the_same_on_any_threads(case):
    problem, renderer = case
    *_, end = fit_pose(problem, renderer)
    judged = judge_end(end, renderer)
    verdict, sure = judged.verdict, judged.covariance
    assert verdict is not None
    assert verdict.label == "found"
    assert sure is not None
    assert np.linalg.eigvalsh(sure.matrix)[0] > 0.0
    assert 0.0 < sure.deviations["sideways"] < sure.deviations["depth"] < problem.mesh.diameter
    assert 0.0 < sure.px < 5.0
    again = sure_of(problem, end.pose, case, verdict.features["seen"], 3)
    np.testing.assert_array_equal(again.matrix, sure.matrix)
    far = problem.chart.to_pose(np.array([0.0, 0.0, 0.0, 30.0, 30.0, 0.0]))
    unseen = judge_end(replace(end, pose=far), renderer)
    assert unseen.verdict is not None
    assert (unseen.verdict.label, unseen.verdict.probability) == ("lost", 0.0)
    assert unseen.covariance is None


def test_a_pose_that_may_be_anywhere_in_the_photo_is_not_found(case, truth):
    problem, renderer = case
    at = replace(problem, start=problem.chart.from_pose(truth))
    end = replace(FitProgress.at_start(at), status=Status.CONVERGED)
    known = judge_end(end, renderer).covariance
    assert known is not None
    for wider, word, count in ((1.0, "found", 0), (3000.0, "doubtful", 1)):
        unsure = known.with_matrix(wider * known.matrix, problem.mesh)
        verdict = judge_end(end, renderer, covariance=unsure).verdict
        assert verdict is not None
        assert verdict.label == word
        assert sum("is known to ±" in reason for reason in verdict.reasons) == count


def test_a_symmetric_model_says_which_turns_no_photo_tells(case, truth):
    problem, renderer = case
    half = Symmetry.from_axes(problem.mesh.centre, [SymmetryAxis(np.array([0.0, 0.0, 1.0]), 2)])
    turned = replace(problem, symmetry=half)
    for here, count in ((problem, 0), (turned, 1)):
        at = replace(here, start=here.chart.from_pose(truth))
        end = judge_end(replace(FitProgress.at_start(at), status=Status.CONVERGED), renderer)
        assert end.verdict is not None
        said = " ".join(end.verdict.reasons)
        assert said.count("the same after half a turn about (0, 0, 1)") == count


@pytest.mark.slow
@pytest.mark.long
def test_a_pose_from_a_doubtful_start_is_not_found(scene, truth):
    """Those of all instances know of their own start, until somebody puts the model elsewhere."""
    doubt = "Of such starts most are wrong."
    for doubts in ((doubt, ""), ("", doubt)):
        start = Start(truth, (), (Start(truth, (), doubt=doubts[1]),), doubts[0])
        both = load(scene.photo, scene.model, lambda _, start=start: start)
        for own, said in zip((both["1"], both["2"]), doubts, strict=True):
            for placed, reason in ((own, said), (own.at(truth), "")):
                alone = replace(placed.scene, objects=(placed.object,))
                at = FitProgress.at_start(make_problem(alone)[0])
                verdict = judge_end(replace(at, status=Status.CONVERGED), own.renderer).verdict
                assert verdict is not None
                assert verdict.label == ("doubtful" if reason else "found")
                assert (verdict.reasons[-1] == doubt) is bool(reason)


def test_the_less_is_seen_the_less_sure_it_is_and_what_is_held_is_sure(case, truth):
    problem = case[0]
    whole, half = (sure_of(problem, truth, case, seen) for seen in (1.0, 0.5))
    held = locked(problem, problem.chart.names[5])
    sure = sure_of(held, truth, case)
    assert half.px > whole.px
    assert np.linalg.matrix_rank(sure.matrix / np.outer(sure.scales, sure.scales)) == 5
    assert sure.matrix[5, 5] == pytest.approx(0.0, abs=1e-12)


def test_a_free_focal_length_has_a_deviation_of_its_own(opened, case, truth):
    free, _ = make_problem(by(opened, chart="free-body", free_focal=True))
    sure, known = (sure_of(problem, truth, case) for problem in (free, case[0]))
    assert sure.matrix.shape == (7, 7)
    assert sure.deviations["focal_px"] > 0.0
    assert sure.deviations["depth"] > known.deviations["depth"]


@pytest.mark.slow
@pytest.mark.long
def test_a_plain_box_far_from_its_pose_is_not_found_there(shared_cases):
    """It was, at 99 %: its outline lies beside other edges, and what was left out agreed."""
    folder = shared_cases / "false_found"
    photo, model = folder / "box.jpg", folder / "box.ply"
    right = load(photo, model, folder / "right.pose.json")
    end = load(photo, model, folder / "wrong.pose.json").fit(threads=2)
    assert end.verdict is not None
    away = pose_error(end.mesh, end.pose, right.pose, right.scene.objects[0].symmetry).percent
    assert away < 3.0 or end.verdict.label != "found"
    problem = right.problem
    at = load(photo, model, folder / "wrong.pose.json")
    wrong = replace(FitProgress.at_start(at.problem), pose=at.pose, status=Status.CONVERGED)
    judged = judge_end(wrong, at.renderer, 2)
    assert judged.verdict is not None
    assert judged.verdict.label != "found"
    assert judged.rival is not None
    there = replace(FitProgress.at_start(problem), pose=right.pose, status=Status.CONVERGED)
    verdict = judge_end(there, right.renderer, 2).verdict
    assert verdict is not None
    assert verdict.label == "found"
