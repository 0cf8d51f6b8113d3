"""Covariance of a pose in its tangent space."""

import math

import numpy as np
import pytest

from poseviewer.confidence.pose_covariance import PoseCovariance, ellipse, region_reach, short
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_chart import ViewChart
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.vehicle_keypoints import SideKeypoints, VehicleKeypoints
from tests.meshes import make_box

MESH = make_box((3.0, 1.0, 1.5))
PERSPECTIVE = Perspective(800.0, 810.0, 320.0, 240.0, 640, 480)
PARALLEL = Parallel(60.0, 320.0, 240.0, 640, 480)

ALONG, ACROSS = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
WHEELS = VehicleKeypoints(
    *(SideKeypoints(z * ACROSS - ALONG, z * ACROSS + ALONG, z * ACROSS) for z in (0.7, -0.7))
)


def pose_by(camera: Perspective | Parallel) -> Pose:
    return Pose(camera, RigidTransform.from_rotation_vector([0.4, 0.9, -0.2], [0.7, 0.3, 9.0]))


def distribution(pose: Pose, covariance: np.ndarray) -> PoseCovariance:
    return PoseCovariance.from_chart(MESH, pose, FreeBodyChart.near(MESH, pose), covariance)


def random_covariance(size: int, spread: float = 1e-3) -> np.ndarray:
    factor = spread * np.random.default_rng(3).normal(size=(size, size))
    return factor @ factor.T


@pytest.mark.parametrize(
    ("camera", "size"), [*((PERSPECTIVE, n) for n in (6, 7, 8, 9)), (PARALLEL, 6)]
)
def test_deviation_undoes_moved(camera: Perspective | Parallel, size: int) -> None:
    sure = PoseCovariance(pose_by(camera), np.array([0.5, 0.2, 0.1]), np.eye(size))
    off = np.array([0.3, -0.2, 0.5, 0.4, -0.1, 0.2, 0.05, 0.1, -0.2])[:size]
    np.testing.assert_allclose(sure.deviation(sure.pose_at(off)), off, atol=1e-12)


@pytest.mark.parametrize("free_principal", [False, True])
@pytest.mark.parametrize("free_focal", [False, True])
def test_the_covariance_is_the_same_by_any_chart(free_focal: bool, free_principal: bool) -> None:
    pose = pose_by(PERSPECTIVE)
    free = free_focal, free_principal
    chart = FreeBodyChart.near(MESH, pose, *free)
    other_start = Pose(
        PERSPECTIVE, RigidTransform.from_rotation_vector([0.5, 0.8, -0.1], [0.5, 0.2, 8.0])
    )
    other = FreeBodyChart.near(MESH, other_start, *free)
    vehicle = VehicleChart.near(WHEELS, pose, *free)
    sure = PoseCovariance.from_chart(MESH, pose, chart, random_covariance(len(chart.names)))
    for also in (other, vehicle):
        again = PoseCovariance.from_chart(MESH, pose, also, sure.in_chart(also))
        np.testing.assert_allclose(again.matrix, sure.matrix, rtol=1e-5, atol=1e-12)
        assert again.px == pytest.approx(sure.px, rel=1e-5)
    assert ("principal_px" in sure.deviations) == free_principal


def test_the_size_of_a_model_in_its_set_goes_with_its_pose() -> None:
    pose = pose_by(PERSPECTIVE)
    reference = FreeBodyChart.near(MESH, pose)
    chart = ViewChart(reference, PERSPECTIVE, RigidTransform.identity(), True, 2.0)
    off = np.random.default_rng(1).normal(size=(400, 7)) @ np.linalg.cholesky(random_covariance(7))
    sure = PoseCovariance(pose, MESH.centre, np.cov(off.T), seventh="log_size")
    numbers = np.array([chart.parameters_at(sure.pose_at(d), 2.0 * math.exp(-d[6])) for d in off])
    told = sure.in_chart(chart)
    scales = np.sqrt(np.outer(np.diag(told), np.diag(told)))
    np.testing.assert_allclose(np.cov(numbers.T) / scales, told / scales, atol=0.01)
    plain = PoseCovariance(pose, MESH.centre, sure.matrix[:6, :6])
    np.testing.assert_allclose(sure.in_chart(reference), plain.in_chart(reference))
    assert np.isnan(plain.in_chart(chart)[-1]).all()
    assert sure.deviations["size_percent"] == pytest.approx(100.0 * math.sqrt(sure.matrix[6, 6]))
    assert "its size ±" in sure.words()
    assert "focal_px" not in sure.deviations
    assert "size_percent" not in plain.deviations


def test_it_is_what_a_sample_of_poses_spreads_by() -> None:
    pose = pose_by(PERSPECTIVE)
    sure = distribution(pose, random_covariance(6))
    draws = np.random.default_rng(0).multivariate_normal(np.zeros(6), sure.matrix, 4000)
    poses = [sure.pose_at(draw) for draw in draws]
    centres = np.array([one.camera_from_model.apply(MESH.centre) for one in poses])
    sight = pose.camera_from_model.apply(MESH.centre)
    along = centres @ (sight / np.linalg.norm(sight))
    assert sure.deviations["depth"] == pytest.approx(along.std(), rel=0.05)
    points = MESH.vertices
    away = np.array([one.project(points) - pose.project(points) for one in poses])
    assert sure.px == pytest.approx(math.sqrt((away**2).sum(axis=-1).mean()), rel=0.05)
    assert sure.deviations["sideways"] > 0.0


def test_the_ellipse_of_two_numbers_holds_nine_tenths_of_the_poses() -> None:
    pose = pose_by(PERSPECTIVE)
    sure = distribution(pose, random_covariance(6))
    chart = VehicleChart.near(WHEELS, pose)
    draws = np.random.default_rng(1).multivariate_normal(np.zeros(6), sure.matrix, 3000)
    at = chart.from_pose(pose)
    away = np.array([chart.from_pose(sure.pose_at(draw)) - at for draw in draws])
    covariance = sure.in_chart(chart)
    for pair in ([0, 1], [1, 4], [3, 5]):
        block = covariance[np.ix_(pair, pair)]
        border = ellipse(block)
        reached = np.einsum("ni,ij,nj->n", border, np.linalg.inv(block), border)
        np.testing.assert_allclose(reached, region_reach(2) ** 2)
        inside = np.einsum("ni,ij,nj->n", away[:, pair], np.linalg.inv(block), away[:, pair])
        assert np.mean(inside <= region_reach(2) ** 2) == pytest.approx(0.9, abs=0.02)


def test_a_parallel_projection_tells_its_scale() -> None:
    pose = pose_by(PARALLEL)
    sure = distribution(pose, np.diag([0, 0, 0, 0, 0, 4e-4]))
    assert "depth" not in sure.deviations
    assert sure.deviations["scale_percent"] == pytest.approx(2.0)
    assert sure.words("m").startswith("scale ±2.0 %, across the line of sight ±0.015 m, rotation")


@pytest.mark.parametrize(
    ("value", "text"),
    [(12.34, "12"), (0.0123, "0.012"), (0.4, "0.40"), (123.0, "120"), (0.0, "0"), (9.99, "10")],
)
def test_two_digits_count(value: float, text: str) -> None:
    assert short(value) == text
