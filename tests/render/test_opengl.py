"""What is OpenGL's own; all else is compared in ``test_software_matches_opengl``."""

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
