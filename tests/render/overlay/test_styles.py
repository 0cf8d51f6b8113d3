"""Looks against circles, cubes and residuals that are known exactly."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.image import GREY_WEIGHTS
from poseviewer.geometry.normals import crease_normals
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.attributes import AttributeImage
from poseviewer.render.overlay import LOOKS
from poseviewer.render.overlay.edges import find_lines
from poseviewer.render.overlay.residual import diverging_colours, paint_residual
from poseviewer.render.overlay.styles import LINE_COLOUR, ModelInPhoto, draw_style
from poseviewer.render.software.software_renderer import SoftwareRenderer
from tests.meshes import make_box, make_mesh, make_sphere, merged

SIZE = 240
CUBE = make_box((2.0, 2.0, 2.0))
CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def make_view(mesh, pose, relight=None, level=90) -> ModelInPhoto:
    photo = np.full((pose.camera.height, pose.camera.width, 3), level, np.uint8)
    return ModelInPhoto(photo, mesh, SoftwareRenderer(mesh), pose, relight)


def cube_pose(size: int = SIZE) -> Pose:
    camera = Perspective(1.2 * size, 1.2 * size, size / 2, size / 2, size, size)
    return Pose(camera, RigidTransform.from_rotation_vector([0.55, 0.65, 0.1], [0.0, 0.0, 5.5]))


def cyan(picture) -> np.ndarray:
    """(H, W) in [0, 1]: how much of the line's colour is there, from blue over red."""
    contrast = picture[..., 2].astype(float) - picture[..., 0]
    return np.clip(contrast / (LINE_COLOUR[2] - LINE_COLOUR[0]), 0.0, 1.0)


def test_of_a_cube_nine_edges_are_drawn_and_three_are_hidden():
    pose = cube_pose()
    drawn = cyan(draw_style("edges", make_view(CUBE, pose)))
    edges = [(a, b) for a, b in itertools.combinations(CORNERS, 2) if np.abs(a - b).sum() == 2]
    strengths = []
    for a, b in edges:
        # Away from the ends, where other edges begin; the widest of the neighbours catches
        # lines that are half a pixel off.
        points = a + np.linspace(0.12, 0.88, 60)[:, None] * (b - a)
        u, v = np.floor(pose.project(points)).astype(int).T
        near = [drawn[v + i, u + j] for i in (-1, 0, 1) for j in (-1, 0, 1)]
        strengths.append(np.median(np.max(near, axis=0)))
    strengths = np.sort(strengths)
    assert len(strengths) == 12
    assert strengths[:3].max() < 0.05
    assert strengths[3:].min() > 0.5


def test_segments_of_a_cubes_edges_run_along_them_and_back():
    pose = cube_pose()
    lines = find_lines(CUBE, SoftwareRenderer(CUBE), pose, 1.0)
    assert lines is not None
    segments = lines.edge_segments()
    near = CORNERS[np.argmin(pose.camera_from_model.apply(CORNERS)[:, 2])]
    ends = pose.project(near - 2.0 * np.diag(near))  # of the three edges that meet there
    begin = pose.project(near)
    along = (ends - begin) / np.linalg.norm(ends - begin, axis=1, keepdims=True)
    points = segments.reshape(-1, 2) - begin
    off = np.abs(along[:, :1] * points[:, 1] - along[:, 1:] * points[:, 0]).min(axis=0)
    assert off.max() < 0.6
    length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum()
    wanted = 2.0 * np.linalg.norm(ends - begin, axis=1).sum()
    assert length == pytest.approx(wanted, rel=0.05)


def test_smooth_surfaces_have_no_feature_edges():
    pose = Pose(Parallel(80, 120, 120, SIZE, SIZE), cube_pose().camera_from_model)
    mesh = make_sphere(5)
    lines = find_lines(mesh, SoftwareRenderer(mesh), pose, 1.0)
    assert lines is not None
    assert lines.edges(1.0).max() == 0.0
    assert lines.outline(1.0).max() == 1.0


def test_the_noise_of_a_scan_makes_no_lines_inside_the_outline():
    pose = Pose(Parallel(80, 120, 120, SIZE, SIZE), cube_pose().camera_from_model)
    smooth = make_sphere(6)
    noise = 0.004 * np.random.default_rng(0).normal(size=(len(smooth.vertices), 1))
    rough = smooth.vertices * (1.0 + noise)
    given, faces, normals = crease_normals(rough, smooth.faces)
    mesh = make_mesh(rough[given], faces, normals)
    lines = find_lines(mesh, SoftwareRenderer(mesh), pose, 1.0)
    assert lines is not None
    assert lines.edges(1.0).max() == 0.0
    assert lines.outline(1.0).max() == 1.0


def test_a_solid_model_hides_the_photo():
    shown = [draw_style("solid", make_view(CUBE, cube_pose(), level=level)) for level in (0, 255)]
    mask = SoftwareRenderer(CUBE).render(cube_pose()).mask
    assert np.array_equal(shown[0][mask], shown[1][mask])


@pytest.mark.slow
def test_parts_and_materials_have_borders():
    mesh = make_sphere(5)
    half = (mesh.vertices[mesh.faces].mean(axis=1)[:, 1] > 0).astype(np.int32)
    pose = Pose(Parallel(80, 120, 120, SIZE, SIZE), cube_pose().camera_from_model)
    parted = replace(mesh, face_part=half, part_names=("", "upper"))
    lines = find_lines(parted, SoftwareRenderer(parted), pose, 1.0)
    assert lines is not None
    assert lines.edges(1.0).max() > 0.9
    corners = mesh.faces.ravel()
    colours = np.repeat(0.3 + 0.5 * half, 9).reshape(-1, 3)
    faces = np.arange(len(corners)).reshape(-1, 3)
    painted = make_mesh(mesh.vertices[corners], faces, mesh.normals[corners], colours)
    again = find_lines(painted, SoftwareRenderer(painted), pose, 1.0)
    assert again is not None
    assert np.array_equal(again.features, lines.features)


def test_a_ball_before_a_ball_has_an_outline_of_its_own():
    ball = make_sphere(4)
    mesh = merged(ball, replace(ball, vertices=ball.vertices * 0.4 - [0.0, 0.0, 2.0]))
    camera = Parallel(80, 120, 120, SIZE, SIZE)
    pose = Pose(camera, RigidTransform.from_rotation_vector([0, 0, 0], [0, 0, 5]))
    drawn = cyan(draw_style("edges", make_view(mesh, pose)))
    for angle in np.linspace(0, 2 * np.pi, 17):
        u, v = (120 + 32 * np.array([np.cos(angle), np.sin(angle)])).astype(int)
        assert drawn[v - 1 : v + 2, u - 1 : u + 2].max() > 0.5


def test_colour_bar_avoids_the_model():
    photo, mask = np.full((300, 500, 3), 128, np.uint8), np.ones((300, 500), bool)
    mask[:150, 250:] = False
    whole = (slice(0, 300), slice(0, 500))
    picture = paint_residual(photo, whole, np.zeros(mask.shape), mask)
    white = np.rint(diverging_colours(np.zeros(1)))[0]
    assert np.all(picture[mask] == white)
    assert picture[:150, 250:].std() > 0.0


def test_relit_shows_the_relit_model_and_the_photo_beside_it():
    def relight(image: AttributeImage):
        return image.reflectance @ GREY_WEIGHTS[:, None] * 5.0

    view = make_view(CUBE, cube_pose(), relight)
    mask = view.renderer.render(view.pose).mask
    picture = draw_style("relit", view)
    assert np.all(picture[mask] == 255)
    assert np.array_equal(picture[~mask], view.photo[~mask])


@pytest.mark.parametrize("look", LOOKS)
def test_photo_is_untouched_away_from_the_model(look):
    view = make_view(CUBE, cube_pose(), lambda image: np.zeros((*image.mask.shape, 3)))
    before = view.photo.copy()
    picture = draw_style(look, view)
    assert picture.shape == view.photo.shape
    assert picture.dtype == np.uint8
    assert np.array_equal(view.photo, before)
    if look != "residual":
        assert np.array_equal(picture[:20], before[:20])


def test_the_photo_s_border_is_not_an_outline():
    camera = Perspective(300, 300, 0, SIZE / 2, SIZE, SIZE)
    pose = Pose(camera, RigidTransform.from_rotation_vector([0, 0, 0], [0, 0, 5]))
    drawn = cyan(draw_style("outline", make_view(CUBE, pose)))
    top, bottom = pose.project([[0.0, -1.0, -1.0], [0.0, 1.0, -1.0]])[:, 1].round().astype(int)
    assert drawn[top + 5 : bottom - 5, :4].max() == 0.0
    assert drawn[top - 2 : top + 2, 0].max() > 0.5


@pytest.mark.parametrize(
    "position",
    [(40, 0, 5), (0, -40, 5), (0, 0, -5), (0, 0, 0.2), (2.0, 1.5, 5), (0, 0, 4000), (0, 0, 1e9)],
    ids=["beside", "above", "behind", "inside", "cut", "far", "a-point"],
)
@pytest.mark.parametrize("size", [(1, 1), (3, 100)], ids=str)
def test_any_pose_and_any_small_photo_can_be_drawn(position, size):
    camera = Perspective.from_field_of_view(50.0, size[0], size[1])
    pose = Pose(camera, RigidTransform.from_rotation_vector([0.3, 0.4, 0.0], position))
    view = make_view(CUBE, pose, lambda image: np.zeros((*image.mask.shape, 1)))
    for look in LOOKS:
        assert draw_style(look, view).shape == (size[1], size[0], 3)
