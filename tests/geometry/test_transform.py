"""Transforms are a group, and their matrices and quaternions stand for them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poseviewer.geometry.transform import RigidTransform, Similarity, rotation_about


@pytest.fixture(params=range(5))
def pair(request) -> tuple[RigidTransform, RigidTransform]:
    vectors = np.random.default_rng(request.param).normal(size=(2, 2, 3))
    first, second = (RigidTransform.from_rotation_vector(3.0 * turn, t) for turn, t in vectors)
    return first, second


def test_products_and_inverses_are_those_of_the_matrices(pair):
    first, second = pair
    product = first.as_matrix() @ second.as_matrix()
    np.testing.assert_allclose((first @ second).as_matrix(), product, atol=1e-14)
    np.testing.assert_allclose((first @ first.inverse()).as_matrix(), np.eye(4), atol=1e-14)


def test_a_matrix_moves_homogeneous_points_as_its_transform_does(pair):
    points = np.random.default_rng(9).normal(size=(7, 3))
    homogeneous = np.column_stack([points, np.ones(7)])
    for transform in (pair[0], Similarity(pair[0], 2.5)):
        moved = homogeneous @ transform.as_matrix().T
        np.testing.assert_allclose(moved[:, :3], transform.apply(points), atol=1e-14)


def test_a_transform_comes_back_from_its_matrix_and_its_rotation_from_its_quaternion(pair):
    transform, _ = pair
    for rows in (3, 4):
        again = RigidTransform.from_matrix(transform.as_matrix()[:rows])
        np.testing.assert_allclose(again.as_matrix(), transform.as_matrix(), atol=1e-14)
    quaternion = transform.as_quaternion()
    assert quaternion[0] >= 0.0
    rotation = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(rotation, transform.rotation, atol=1e-14)


def test_a_matrix_with_a_scale_gives_the_nearest_rotation(pair):
    again = RigidTransform.from_matrix(Similarity(pair[0], 1.001).as_matrix())
    np.testing.assert_allclose(again.rotation, pair[0].rotation, atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-9, 9e-5, 1.1e-4, 0.1, 3.1, np.pi, 50.0])
def test_rotations_about_axes_match_scipy(angle):
    for axis in np.random.default_rng(0).normal(size=(20, 3)):
        vector = axis / np.linalg.norm(axis) * angle
        found = rotation_about(*vector.tolist())
        np.testing.assert_allclose(found, Rotation.from_rotvec(vector).as_matrix(), atol=1e-14)
        np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-14)
