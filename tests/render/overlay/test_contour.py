"""Silhouettes as line segments, against circles whose outline is known."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.overlay.contour import (
    MIN_HOLE_PX,
    Sketch,
    is_within_outline,
    quick_silhouette,
    silhouette,
)
from poseviewer.render.overlay.window import Window
from poseviewer.render.software.software_renderer import SoftwareRenderer
from tests.meshes import make_box, make_sphere

SEEDS = st.integers(0, 2**32 - 1)
BALL = make_sphere(5)
RENDERER = SoftwareRenderer(BALL)


def ball_in_photo(x=0.0, y=0.0, radius_px=80.0, width=640, height=480) -> Pose:
    """A unit sphere under parallel projection: a circle of ``radius_px`` about (330 + x, 230 + y),
    in a photo of 640 by 480 px."""
    camera = Parallel(radius_px, 300.0, 250.0, width, height)
    place = np.array([(30.0 + x) / radius_px, (y - 20.0) / radius_px, 4.0])
    return Pose(camera, RigidTransform(np.eye(3), place))


def assert_closed(segments):
    """Every point that one segment leaves, another one comes to."""
    leaves, comes = (np.array(sorted(map(tuple, segments[:, end]))) for end in (0, 1))
    assert np.array_equal(leaves, comes)


@pytest.mark.parametrize("radius", [20.0, 80.0, 150.0])
@given(seed=SEEDS)
@settings(deadline=None, max_examples=10)
def test_a_balls_outline_is_a_circle(radius, seed):
    x, y = np.random.default_rng(seed).uniform(-60.0, 60.0, 2)
    segments = quick_silhouette(BALL, RENDERER, ball_in_photo(x, y, radius))
    away = np.linalg.norm(segments - [330.0 + x, 230.0 + y], axis=2)
    assert np.abs(away - radius).max() < 0.6
    assert np.abs(away - radius).mean() < 0.3
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    middle = np.average(segments.mean(axis=1), axis=0, weights=lengths)
    assert middle == pytest.approx([330.0 + x, 230.0 + y], abs=0.2)
    assert_closed(segments)


def test_a_balls_outline_under_perspective_is_its_cone_of_sight():
    camera = Perspective(500.0, 500.0, 290.0, 260.0, 640, 480)
    pose = Pose(camera, RigidTransform(np.eye(3), np.array([0.4, -0.3, 4.0])))
    segments = quick_silhouette(BALL, RENDERER, pose)
    # Lines of sight that graze a unit ball: at the angle arcsin(1 / distance) to its centre.
    centre = pose.camera_from_model.translation
    rays = camera.rays(segments.reshape(-1, 2))
    cosines = rays @ centre / np.linalg.norm(rays, axis=1) / np.linalg.norm(centre)
    away = np.arccos(cosines) - math.asin(1.0 / float(np.linalg.norm(centre)))
    assert np.abs(away).max() * camera.fx < 0.5
    assert_closed(segments)


@pytest.mark.parametrize("samples", [0.5, 1.0, 2.0, 3.0])
def test_segments_are_px_of_the_photo_wherever_the_window_lies(samples):
    window = Window(-7, 31, 120, 90, samples)
    rows, columns = np.indices((round(90 * samples), round(120 * samples)))
    x, y = (columns + 0.5) / samples - 7.0, (rows + 0.5) / samples + 31.0
    covered = np.hypot(x - 50.3, y - 74.6) < 30.0
    segments = silhouette(covered, window)
    away = np.linalg.norm(segments - [50.3, 74.6], axis=2)
    assert np.abs(away - 30.0).max() < 0.6 / min(samples, 1.0)
    assert_closed(segments)


def test_a_model_partly_outside_is_outlined_where_it_is_seen():
    pose = ball_in_photo(-330.0, 0.0)  # its centre on the left edge
    segments = quick_silhouette(BALL, RENDERER, pose)
    assert_closed(segments)
    seen = segments[(segments[..., 0] > 0.5).all(axis=1)]
    away = np.linalg.norm(seen - [0.0, 230.0], axis=2)
    assert np.abs(away - 80.0).max() < 0.5
    # The edge of the photo is no edge of the model.
    assert not np.any((np.abs(segments[..., 0]) < 2.0) & (np.abs(segments[..., 1] - 230.0) < 70.0))


def test_nothing_in_sight_has_no_outline():
    assert quick_silhouette(BALL, RENDERER, ball_in_photo(-500.0)).shape == (0, 2, 2)
    assert silhouette(np.zeros((20, 30), bool), Window(0, 0, 30, 20)).shape == (0, 2, 2)


def test_holes_are_drawn_unless_they_are_small():
    covered = np.ones((100, 100), bool)
    covered[30:60, 30:60] = False
    small = int(MIN_HOLE_PX) // 4
    covered[80 : 80 + small, 80 : 80 + small] = False
    segments = silhouette(covered, Window(0, 0, 100, 100))
    assert_closed(segments)
    at = segments.reshape(-1, 2)
    inside = at[np.all((at > 5.0) & (at < 95.0), axis=1)]
    assert inside.min() == pytest.approx(30.0, abs=0.6)
    assert inside.max() == pytest.approx(60.0, abs=0.6)


@pytest.mark.parametrize("reach", [0.0, 5.0])
def test_within_is_the_hull_and_a_margin(reach):
    pose = ball_in_photo()
    for angle in np.linspace(0.0, 6.0, 13):
        way = np.array([math.cos(angle), math.sin(angle)])
        centre = np.array([330.0, 230.0])
        assert is_within_outline(centre + way * (80.0 + reach - 1.0), pose, BALL, reach)
        assert not is_within_outline(centre + way * (80.0 + reach + 1.0), pose, BALL, reach)
    assert not is_within_outline(np.array([np.nan, 230.0]), pose, BALL, reach)


def test_nothing_is_within_a_model_behind_the_camera():
    behind = Pose(
        Perspective(100.0, 100.0, 50.0, 50.0, 100, 100),
        RigidTransform(np.eye(3), np.array([0.0, 0.0, -5.0])),
    )
    assert not is_within_outline(np.array([50.0, 50.0]), behind, make_box(), 10.0)
    assert not Sketch(make_box()).render_mask(behind).any()


@pytest.mark.parametrize("mesh", [make_box(), BALL])
@pytest.mark.parametrize("depth", [6.0, 0.1])
def test_a_sketch_covers_what_the_rasteriser_covers(mesh, depth):
    turn, place = [0.4, -0.7, 0.2], [0.05 * depth, -0.02 * depth, depth]
    camera = Perspective(500.0, 500.0, 310.0, 250.0, 640, 480)
    pose = Pose(camera, RigidTransform.from_rotation_vector(turn, place))
    sketched, drawn = (make(mesh).render_mask(pose) for make in (Sketch, SoftwareRenderer))
    assert sketched.any()
    if depth > 1.0:  # else the camera is in the model
        assert np.sum(sketched & drawn) > 0.97 * np.sum(sketched | drawn) > 1000
