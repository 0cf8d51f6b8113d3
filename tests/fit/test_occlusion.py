"""Things in front of the model are seen without being told; nothing else is taken for one."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh

from poseviewer.api import load, make_registration
from poseviewer.files.demo import demo_case
from poseviewer.files.photo import save_image
from poseviewer.files.pose import load_pose
from poseviewer.fit.compared_pixels import enlarge_mask
from poseviewer.fit.occlusion import find_occluded
from poseviewer.fit.problem import pose_loss
from poseviewer.fit.visibility import make_occlusion
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import PlacedModel, View, scene_at
from tests.meshes import make_box, make_bumpy, make_mesh
from tests.several import LIGHT, coloured, lit_models

SLAB = (350, 520)
"""Columns of the demo's photo."""


@pytest.fixture(scope="module")
def demo():
    """The demo's case, and the true pose."""
    files = demo_case()
    case = load(files.photo, files.model, files.start)
    return case, load_pose(files.truth, case.photo.width, case.photo.height).pose


@pytest.fixture(scope="module")
def behind_slab(demo):
    """The demo's case with a post in front of the car."""
    case, _ = demo
    pixels = case.photo.pixels.copy()
    left, right = SLAB
    noise = np.random.default_rng(0).normal(0.0, 6.0, (*pixels[:, left:right].shape[:2], 3))
    pixels[:, left:right] = np.clip(np.array([70, 110, 60]) + noise, 0, 255)
    view = replace(case.views[0], file=PhotoFile.of(replace(case.photo, pixels=pixels)))
    return make_registration(replace(case.scene, views=(view,)), case.renderer)


def test_nothing_is_in_front_of_a_car_that_is_seen_whole(demo):
    case, truth = demo
    assert find_occluded(case.problem.photo, case.renderer, truth) is None


def test_a_post_is_told_from_the_car_behind_it(demo, behind_slab):
    case, truth = demo
    hidden = find_occluded(behind_slab.problem.photo, case.renderer, truth)
    assert hidden is not None
    photo = case.photo
    full = enlarge_mask(hidden, case.problem.photo.factor, photo.width, photo.height)
    covered = case.renderer.render_mask(truth)
    post = np.zeros_like(covered)
    post[:, slice(*SLAB)] = True
    assert np.mean(full[covered & post]) > 10 * np.mean(full[covered & ~post])


def test_a_patterned_post_is_told_where_the_pose_is_known(demo):
    """Its own edges cross the car's outline, as those of things beside a wrong pose do."""
    case, truth = demo
    pixels = case.photo.pixels.copy()
    left, right = SLAB
    random = np.random.default_rng(3)
    tiles = random.integers(30, 220, (pixels.shape[0] // 24 + 1, (right - left) // 24 + 1, 3))
    pattern = np.kron(tiles, np.ones((24, 24, 1)))[: pixels.shape[0], : right - left]
    pixels[:, left:right] = pattern
    view = replace(case.views[0], file=PhotoFile.of(replace(case.photo, pixels=pixels)))
    photo = make_registration(replace(case.scene, views=(view,)), case.renderer).problem.photo
    assert find_occluded(photo, case.renderer, truth) is None
    hidden = find_occluded(photo, case.renderer, truth, is_known=True)
    assert hidden is not None
    size = photo.weights.shape[::-1]
    post = np.zeros(case.photo.pixels.shape[:2], np.uint8)
    post[:, left:right] = 1
    post = np.asarray(cv2.resize(post, size, interpolation=cv2.INTER_NEAREST), bool)
    covered = case.renderer.render(truth).mask
    covered = np.asarray(cv2.resize(covered.astype(np.uint8), size, interpolation=0), bool)
    assert np.mean(hidden[covered & post]) > 0.5
    assert np.mean(hidden[covered & ~post]) < 0.1


def test_what_is_hidden_does_not_count_on_any_level(demo, behind_slab):
    _, truth = demo
    problem = behind_slab.problem
    hidden = find_occluded(problem.photo, behind_slab.renderer, truth)
    assert hidden is not None
    rest = problem.views[0].without(hidden)
    assert not np.any(rest.photo.weights[hidden])
    assert np.array_equal(rest.photo.weights[~hidden], problem.photo.weights[~hidden])
    fine = rest.fine_photo
    assert fine is not None
    height, width = fine.weights.shape
    larger = enlarge_mask(hidden, problem.photo.factor / fine.factor, width, height)
    assert larger.any()
    assert not np.any(fine.weights[larger])


@pytest.mark.slow
@pytest.mark.long
def test_a_fit_leaves_out_what_it_sees_in_front(demo, behind_slab, tmp_path):
    _, truth = demo
    found = behind_slab.fit()
    assert pose_error(behind_slab.mesh, found.pose, truth).percent < 0.3
    assert found.hidden is not None
    assert 0.6 < found.seen < 0.8
    assert found.scene.mask(0) is None
    found.save(tmp_path / "car.pose.json")
    photo = found.photo
    record = load_pose(tmp_path / "car.pose.json", photo.width, photo.height)
    assert record.seen == found.seen
    assert (record.mask, record.occluders) == (None, "car.occluders.png")
    again = load(demo_case().photo, demo_case().model, tmp_path / "car.pose.json").scene
    (occluders,) = again.earlier_occluders(0)
    assert np.array_equal(occluders.weights == 0.0, found.hidden)


def make_can(random: np.random.Generator | None = None) -> Mesh:
    """A printed can; ``random``: with a panel that the model lacks."""
    shape = trimesh.creation.cylinder(0.7, 2.0, sections=48).subdivide().subdivide()
    angle, z = np.arctan2(shape.vertices[:, 1], shape.vertices[:, 0]), shape.vertices[:, 2]
    shade = (
        0.5 + 0.25 * np.sin(3 * angle + 1) * np.cos(2.5 * z) + 0.2 * np.sign(np.sin(angle + 2 * z))
    )
    colours = np.clip(shade[:, None] * [1.0, 0.75, 0.6], 0.05, 0.95)
    if random is not None:
        middle, width, low, grey = random.uniform((-np.pi, 0.5, -0.8, 0.1), (np.pi, 0.9, 0.1, 0.9))
        panel = (np.cos(angle - middle) > np.cos(width)) & (z > low)
        colours[panel] = grey * random.uniform(0.4, 1.0, 3)
    return make_mesh(shape.vertices, shape.faces, colours=colours)


@pytest.fixture(scope="module")
def painted_over():
    """A can with another label than the model's, whose occluder is painted over exactly, 8 degrees
    off; and the true pose.
    """
    random, camera = np.random.default_rng(11), Perspective(520.0, 520.0, 160.5, 120.5, 320, 240)

    def at(turn, *shift: float) -> Pose:
        return Pose(camera, RigidTransform.from_rotation_vector(turn, shift))

    turn = np.array([1.4, 0.2, -0.2]) + random.normal(0.0, 0.3, 3)
    x, y = random.uniform((-0.3, -0.2), (0.3, 0.2))
    truth, tint = at(turn, x, y, 7.0), random.uniform(0.3, 1.0, 3)
    side = random.choice([-1, 1])
    front = coloured(make_box((1.0, 2.6, 0.3)), tint)
    occluder = PlacedModel(front, at([0.05, 0.1, 0.3 * side], 0.6 * x + 0.55 * side, 0.1, 5.0))
    bumpy = coloured(make_bumpy(3), random.uniform(0.3, 1.0, 3))
    behind = PlacedModel(bumpy, at([0.4, -0.3, 0.2], -1.3 * side, -0.2, 9.0))
    ground = random.uniform(0.05, 0.5, (8, 10, 3)).astype(np.float32)
    ground = cv2.resize(ground, (960, 720), interpolation=cv2.INTER_CUBIC).clip(0.02, 0.9)
    shown = PlacedModel(make_can(random), truth), occluder, behind
    photo = Photo(lit_models(shown, LIGHT, random, ground), "can.png", "0" * 64)
    model, away = make_can(), random.normal(size=(2, 3))
    away *= np.array([[np.radians(8.0)], [0.06]]) / np.linalg.norm(away, axis=1, keepdims=True)
    start = FreeBodyChart.near(model, truth).to_pose(away.ravel())
    mask = Mask.of(~make_occlusion(PlacedModel(model, truth), (occluder,)).occluded)
    view = View(PhotoFile.of(photo), camera, mask=mask)
    return scene_at(view, ModelFile.of(model, None, "0" * 64, name="can.ply"), start), truth


@pytest.mark.slow
def test_what_is_in_front_does_not_eat_an_object_whose_occluder_is_painted_over(painted_over):
    scene, truth = painted_over
    case = make_registration(scene, SoftwareRenderer(scene.objects[0].mesh))
    end = case.fit(evaluations=400)
    shown = case.renderer.render_mask(truth)
    assert end.hidden is None or np.mean(end.hidden[shown]) < 0.5  # the label, if anything
    progress = end.progress
    assert progress is not None
    of_start = pose_loss(progress.problem, case.renderer, progress.problem.start)
    assert progress.start_loss == of_start > progress.loss  # on the same pixels


def test_what_is_painted_hides_unless_the_user_says_that_nothing_does(painted_over):
    scene, _ = painted_over
    masked = {}
    for name in ("find", "painted", "nothing"):
        now = scene.with_object(0, settings=FitSettings(in_front=name))
        photo = make_registration(now, SoftwareRenderer(scene.objects[0].mesh)).problem.photo
        masked[name] = np.count_nonzero(photo.weights == 0.0)
    assert masked["find"] == masked["painted"] > masked["nothing"]


@pytest.mark.slow
@pytest.mark.long
def test_a_black_photo_is_searched_without_a_warning(scene, tmp_path):
    save_image(tmp_path / "black.png", np.zeros((120, 160, 3), np.uint8))
    end = load(tmp_path / "black.png", scene.model, scene.start).fit()
    assert end.verdict is None or end.verdict.label != "found"
