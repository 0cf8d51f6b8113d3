"""An unknown focal length: freed, it comes nearer to the true one, and the pose with it.

How near depends on how much of its perspective the model shows; this ball shows little.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from poseviewer.api import load
from poseviewer.app.state.cameras import with_camera
from poseviewer.files.demo import demo_case
from poseviewer.files.pose import load_pose
from poseviewer.fit.problem import make_problem
from poseviewer.fit.progress import Status
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.fit.stages import fit_pose
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.photo import Photo
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.starts.registration import load_model
from tests.measure.free_focal import run_trials
from tests.meshes import make_bumpy
from tests.scene import LIGHT

CAMERA = Perspective(140.0, 140.0, 80.0, 60.0, 160, 120)
TRUTH = Pose(
    CAMERA,
    RigidTransform.from_rotation_vector([0.4, -0.3, 0.2], [0.1, 0.05, 3.2]),
)
"""As near as three times the model's radius."""


def photo_of(mesh: Mesh) -> Photo:
    image = SoftwareRenderer(mesh).render(TRUTH.scaled(4.0))
    lit = image.reflectance * (0.5 + 0.45 * image.normals @ LIGHT)[..., None]
    lit = np.where(image.mask[..., None], lit, 0.0)
    small = cv2.resize(lit, (160, 120), interpolation=cv2.INTER_AREA)
    small = small + np.random.default_rng(0).normal(0.0, 0.01, small.shape)
    return Photo(np.rint(np.clip(small, 0.0, 1.0) * 255.0).astype(np.uint8), "p.png", "0" * 64)


@pytest.mark.slow
def test_an_unknown_focal_length_comes_nearer_to_the_truth():
    ball = make_bumpy(3)
    mesh = replace(ball, colours=ball.colours[:, :1] * np.array([1.0, 0.8, 0.6], np.float32))
    focal = 0.75 * CAMERA.fx
    guess = replace(CAMERA, fx=focal, fy=focal)
    start = with_camera(TRUTH, guess, mesh.centre)
    photo, record = photo_of(mesh), start
    registration = Registration(photo, mesh, "m.ply", "0" * 64, None, record, ())
    ends = {}
    for free in (True, False):
        problem, _ = make_problem(registration, FitSettings(free_focal=free))
        *_, ends[free] = fit_pose(problem, SoftwareRenderer(mesh))
    found = ends[True].pose
    assert isinstance(found.camera, Perspective)
    focals = np.array([found.camera.fx, focal]) / CAMERA.fx
    assert abs(np.log(focals[0])) < 0.7 * abs(np.log(focals[1]))
    assert ends[True].loss < ends[False].loss - 0.5
    errors = {free: pose_error(mesh, end.pose, TRUTH).reprojection_px for free, end in ends.items()}
    assert errors[True] < 0.7 * errors[False]


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.75, 4.0 / 3.0])
def test_on_the_demo_it_is_found_from_a_quarter_or_a_third_off(factor: float):
    free, held = run_trials([factor])
    assert free.free
    assert not held.free
    assert held.end == pytest.approx(factor)
    assert abs(free.end - 1.0) < 0.06
    assert free.error_px < 2.0
    assert held.error_px > 4.0


@pytest.mark.slow
def test_where_the_focal_length_stays_one_search_is_enough():
    (free, held) = run_trials([0.98])  # near the least loss, which lies beside the true length
    assert free.evaluations < 1.5 * held.evaluations


@pytest.mark.slow
def test_all_searches_together_keep_to_the_limit():
    case = demo_case()
    truth = load_pose(case.truth, 960, 720).pose
    assert isinstance(truth.camera, Perspective)
    longer = replace(truth.camera, fx=2.0 * truth.camera.fx, fy=2.0 * truth.camera.fy)
    model = load_model(case.model)
    begin = with_camera(truth, longer, model.mesh.centre)
    found = load(case.photo, model, begin, free_focal=True).fit(evaluations=1700, threads=2)
    assert found.progress is not None
    assert found.progress.status is Status.EVALUATIONS_SPENT
    assert 1700 <= found.progress.evaluations < 1760
    assert found.progress.restart > 3
    assert found.progress.start_loss > found.loss
