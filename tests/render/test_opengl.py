"""OpenGL pictures against geometry worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.opengl import OpenGLRenderer
from tests.meshes import make_mesh, make_sphere
from tests.opengl import require_opengl

PERSPECTIVE = Perspective(410.0, 395.0, 97.3, 148.6, 251, 203)
PARALLEL = Parallel(55.0, 171.4, 61.9, 251, 203)
CAMERAS = pytest.mark.parametrize(
    "camera", [PERSPECTIVE, PARALLEL], ids=["perspective", "parallel"]
)


@pytest.fixture(autouse=True, scope="module")
def _opengl():
    require_opengl()


def lift(camera: Camera, pixels, depths):
    """Points in the camera frame that ``camera`` sees at ``pixels`` (..., 2)."""
    pixels, depths = np.asarray(pixels, float), np.asarray(depths, float)
    if isinstance(camera, Perspective):
        return camera.rays(pixels) * depths[..., None]
    flat = (pixels - [camera.cx, camera.cy]) / camera.scale
    return np.concatenate([flat, np.broadcast_to(depths[..., None], (*flat.shape[:-1], 1))], -1)


def make_pose(camera: Camera) -> Pose:
    """A turned and far-off model frame, so that the transform counts."""
    return Pose(camera, RigidTransform.from_rotation_vector([0.4, -0.8, 0.3], [3.0, -2.0, 9.0]))


def make_mesh_at(pose: Pose, points, faces, **more):
    """A mesh whose vertices are where ``points`` (V, 3) are in the camera frame."""
    return make_mesh(pose.camera_from_model.inverse().apply(points), faces, **more)


@CAMERAS
def test_tiny_triangles_light_the_pixel_whose_centre_they_hold(camera):
    random = np.random.default_rng(0)
    pose = make_pose(camera)
    chosen = random.permutation(camera.width * camera.height)[:4000]
    rows, columns = np.divmod(chosen, camera.width)
    held = random.random(4000) < 0.5
    angle = random.uniform(0, 2 * np.pi, 4000)
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    # Triangles with a circumradius of 0.2 and an inradius of 0.1 px, 0.05 or 0.25 px off.
    middle = np.stack([columns, rows], -1) + 0.5 + direction * np.where(held, 0.05, 0.25)[:, None]
    corner = random.uniform(0, 2 * np.pi, (4000, 1)) + np.radians([0, 120, 240])
    pixels = middle[:, None] + 0.2 * np.stack([np.cos(corner), np.sin(corner)], axis=-1)
    points = lift(camera, pixels, np.repeat(random.uniform(3, 5, (4000, 1)), 3, axis=1))
    faces = np.arange(12000).reshape(-1, 3)
    image = OpenGLRenderer(make_mesh_at(pose, points.reshape(-1, 3), faces)).render(pose)
    expected = np.full((camera.height, camera.width), -1)
    expected[rows[held], columns[held]] = np.flatnonzero(held)
    assert (image.face_ids == expected).all()


@CAMERAS
def test_face_numbers_are_exact_beyond_two_bytes(camera):
    random = np.random.default_rng(1)
    pose = make_pose(camera)
    count, step = 300, 0.9
    rows, columns = np.divmod(np.arange(count * count), count)
    square = np.array([[0, 0], [1, 0], [0, 1], [1, 0], [1, 1], [0, 1]])
    pixels = (np.stack([columns, rows], -1)[:, None] + square) * step
    points = lift(camera, pixels, np.full(pixels.shape[:-1], 4.0)).reshape(-1, 3)
    order = random.permutation(2 * count * count)
    faces = np.arange(len(points)).reshape(-1, 3)[order]
    normals = np.tile([0.0, 0.0, -1.0], (len(points), 1))
    image = OpenGLRenderer(make_mesh_at(pose, points, faces, normals=normals)).render(pose)
    v, u = np.mgrid[: camera.height, : camera.width] + 0.5
    (row, down), (column, right) = np.divmod(v / step, 1), np.divmod(u / step, 1)
    triangle = 2 * (row * count + column) + (right + down > 1)
    clear = np.min([right, 1 - right, down, 1 - down, abs(right + down - 1)], axis=0) > 0.02
    expected = np.argsort(order)[triangle.astype(int)]
    assert expected.max() > 1 << 16
    assert (image.face_ids[clear] == expected[clear]).all()
    assert image.mask.all()


@CAMERAS
def test_sphere_has_analytic_normals(camera):
    pose = Pose(camera, RigidTransform.from_rotation_vector([0.3, 0.2, 0.1], [0.1, 0.1, 4.0]))
    image = OpenGLRenderer(make_sphere(subdivisions=5)).render(pose)
    rows, columns = np.nonzero(image.mask)
    pixels = np.stack([columns, rows], -1) + 0.5
    if isinstance(camera, Perspective):
        start, along = np.zeros(3), camera.rays(pixels)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
    else:
        start, along = lift(camera, pixels, np.zeros(len(pixels))), np.array([0.0, 0.0, 1.0])
    offset = start - pose.camera_from_model.translation
    half = np.sum(offset * along, axis=-1)
    inside = half**2 - np.sum(offset**2, axis=-1) + 1.0
    normals = offset + (-half - np.sqrt(np.maximum(inside, 0.0)))[:, None] * along
    clear = -np.sum(normals * along, axis=-1) > 0.3  # at the rim a facet is not the sphere
    found = image.normals[rows, columns].astype(float)
    angle = np.linalg.norm(np.cross(found, normals), axis=1)[clear]
    assert clear.sum() > 5000
    assert np.degrees(angle.max()) < 0.1


@CAMERAS
def test_faces_seen_from_behind_are_turned_round_or_left_out(camera):
    pose = make_pose(camera)
    points = lift(camera, [[20.0, 20.0], [20.0, 150.0], [200.0, 90.0]], np.array([4.0, 5.0, 6.0]))
    front = make_mesh_at(pose, points, [[0, 1, 2]])
    back = make_mesh_at(pose, points, [[0, 2, 1]])
    seen, turned = OpenGLRenderer(front).render(pose), OpenGLRenderer(back).render(pose)
    assert (OpenGLRenderer(front, two_sided=False).render(pose).face_ids == seen.face_ids).all()
    assert (turned.face_ids == seen.face_ids).all()
    assert turned.normals == pytest.approx(seen.normals, abs=1e-6)
    v, u = np.mgrid[: camera.height, : camera.width] + 0.5
    view = [0.0, 0.0, 1.0] if isinstance(camera, Parallel) else camera.rays(np.stack([u, v], -1))
    assert ((seen.normals * view).sum(axis=-1)[seen.mask] < 0).all()
    assert not OpenGLRenderer(back, two_sided=False).render(pose).mask.any()


def test_colours_are_interpolated_in_perspective():
    pose = make_pose(PERSPECTIVE)
    points = lift(PERSPECTIVE, [[-50, -50], [-50, 400], [400, 100]], np.array([2.0, 9.0, 4.0]))
    colours = np.array([[0.9, 0.1, 0.3], [0.2, 0.8, 0.3], [0.1, 0.5, 0.9]])
    mesh = make_mesh_at(pose, points, [[0, 1, 2]], colours=colours)
    image = OpenGLRenderer(mesh).render(pose)
    v, u = np.nonzero(image.mask)
    rays = PERSPECTIVE.rays(np.stack([u, v], -1) + 0.5)
    shares = rays @ np.linalg.inv(points)
    shares /= shares.sum(axis=1, keepdims=True)
    assert image.reflectance[v, u] == pytest.approx(shares @ colours, abs=1e-6)


def test_texture_lies_upright_and_multiplies_the_colour():
    texture = np.random.default_rng(2).integers(0, 256, (5, 8, 3), dtype=np.uint8)
    camera = Parallel(10.0, 0.0, 0.0, 80, 50)
    mesh = make_mesh(
        [[0, 0, 0], [8, 0, 0], [8, 5, 0], [0, 5, 0]],
        [[0, 2, 1], [0, 3, 2]],
        normals=np.tile([0.0, 0.0, -1.0], (4, 1)),
        colours=np.tile([0.5, 1.0, 0.25], (4, 1)),
        uvs=[[0, 1], [1, 1], [1, 0], [0, 0]],
        face_texture=[0, 0],
        textures=(texture,),
    )
    image = OpenGLRenderer(mesh).render(Pose(camera, RigidTransform.identity()))
    centres = 0.25 * (
        image.reflectance[4::10, 4::10]
        + image.reflectance[5::10, 4::10]
        + image.reflectance[4::10, 5::10]
        + image.reflectance[5::10, 5::10]
    )
    expected = texture / 255 * [0.5, 1.0, 0.25]
    assert image.mask.all()
    assert np.abs(centres - expected).max() < 0.1
    assert np.corrcoef(centres.ravel(), expected.ravel())[0, 1] > 0.99


def test_floor_that_reaches_behind_the_camera_is_cut_at_the_near_plane():
    corners = [[-50, 1, -50], [50, 1, -50], [50, 1, 50], [-50, 1, 50]]
    mesh = make_mesh(corners, [[0, 1, 2], [0, 2, 3]])
    camera = Perspective(100.0, 100.0, 50.0, 40.0, 100, 80)
    image = OpenGLRenderer(mesh).render(Pose(camera, RigidTransform.identity()))
    # The horizon is at v = 40; the floor ends at z = 50, v = 42.
    assert not image.mask[:42].any()
    assert image.mask[42:].all()
    assert image.normals[image.mask] == pytest.approx(np.tile([0, -1, 0], (3800, 1)), abs=1e-6)


def test_behind_the_camera_there_is_nothing():
    pose = Pose(PERSPECTIVE, RigidTransform(np.eye(3), np.array([0.0, 0.0, -5.0])))
    assert not OpenGLRenderer(make_sphere(2)).render(pose).mask.any()


def test_several_renderers_sizes_and_closing_do_not_disturb_one_another():
    first, second = OpenGLRenderer(make_sphere(2)), OpenGLRenderer(make_sphere(3))
    pose = Pose(PERSPECTIVE, RigidTransform(np.eye(3), np.array([0.1, 0.0, 5.0])))
    before = first.render(pose)
    assert second.render(pose.scaled(0.5)).mask.shape == (102, 126)
    assert first.render(pose.scaled(1.7)).mask.sum() == pytest.approx(
        1.7**2 * before.mask.sum(), rel=0.02
    )
    first.close()
    assert second.render(pose).mask.any()
    assert (first.render(pose).face_ids == before.face_ids).all()
    first.close()
    second.close()
