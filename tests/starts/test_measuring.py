"""Points, distances and relative poses are those of known boxes, and deviate as drawn poses do."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.errors import SettingsError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform, Similarity
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.types import Scene, SceneObject, SearchResult, View
from poseviewer.starts.measuring import (
    MeasuredPoint,
    measure_distance,
    measure_point,
    measure_relative,
)
from tests.app.state.documents import make_photo
from tests.meshes import make_box

CAMERA = Perspective(300.0, 290.0, 83.0, 58.0, 160, 120)
SIZE = np.array([2.0, 1.0, 0.5])
SCALES = (1.0, 0.5)
"""World units in one of each model's."""
PLACES = (
    RigidTransform.from_rotation_vector([0.4, -0.3, 0.2], [-1.0, 0.1, 8.0]),
    RigidTransform.from_rotation_vector([-0.5, 0.4, 0.3], [1.1, 0.2, 7.0]),
)
"""Poses in the world."""
DRAWS = 4000


def make_scene(camera: Perspective | Parallel = CAMERA, spread: float = 0.0) -> Scene:
    """Two boxes of one model, seen by a camera that is not the world's frame."""
    motion = RigidTransform.from_rotation_vector([0.1, -0.05, 0.2], [0.1, 0.2, 0.3])
    view = View(PhotoFile.of(make_photo()), camera, motion)
    model = ModelFile.of(make_box(SIZE), None, "0" * 64, name="box.ply")
    scene = Scene(
        views=(view,),
        objects=tuple(
            SceneObject(id=str(i), model=model, world_from_model=Similarity(place, scale))
            for i, (place, scale) in enumerate(zip(PLACES, SCALES, strict=True))
        ),
    )
    for index in range(2 * (spread > 0.0)):
        factor = spread * np.random.default_rng(index).normal(size=(6, 6))
        sure = PoseCovariance(scene.pose(index), np.zeros(3), factor @ factor.T)
        scene = scene.with_object(index, result=SearchResult(covariance=sure))
    return scene


def seen_at(scene: Scene, index: int, point: FloatArray) -> MeasuredPoint:
    """Measure where a point of an object's surface is seen."""
    measured = measure_point(scene, scene.pose(index).project(point))
    assert measured is not None
    assert measured.object_index == index
    return measured


def front(scene: Scene, index: int, *shares: float) -> FloatArray:
    """A point of the face across z that is in sight, at shares of half its sides."""
    towards = scene.pose(index).camera_from_model.inverse().translation[2]
    return 0.5 * SIZE * np.array([*shares, np.sign(towards)])


def drawn(scene: Scene, index: int, function: Callable[[Pose], FloatArray]) -> FloatArray:
    """Values (draws, n) of a function of an object's pose, by its covariance."""
    sure = scene.covariance(index)
    assert sure is not None
    steps = np.random.default_rng(7 + index).multivariate_normal(np.zeros(6), sure.matrix, DRAWS)
    return np.array([function(sure.pose_at(step)) for step in steps])


@pytest.mark.parametrize("camera", [CAMERA, Parallel(25.0, 83.0, 58.0, 160, 120)])
def test_a_distance_on_a_box_is_exact(camera) -> None:
    scene = make_scene(camera)
    points = [front(scene, 1, -0.9, 0.8), front(scene, 1, 0.9, 0.8)]
    first, second = (seen_at(scene, 1, point) for point in points)
    np.testing.assert_allclose(first.coordinates[:3], points[0], atol=1e-9)
    in_camera = scene.pose(1).camera_from_model.apply(points[0])
    np.testing.assert_allclose(
        first.coordinates[3 : 5 if camera is not CAMERA else 6],
        in_camera[: 2 if camera is not CAMERA else 3],
        atol=1e-9,
    )
    assert measure_distance(scene, first, second) == (pytest.approx(1.8), None)
    assert measure_point(scene, [1.0, 1.0]) is None


def test_a_distance_between_two_objects_is_in_the_worlds_unit() -> None:
    scene = make_scene()
    points = [front(scene, 0, 0.3, 0.2), front(scene, 1, -0.4, 0.5)]
    ends = [scene.objects[i].world_from_model.apply(points[i]) for i in (0, 1)]
    measured = [seen_at(scene, i, points[i]) for i in (0, 1)]
    value = measure_distance(scene, measured[0], measured[1])[0]
    assert value == pytest.approx(np.linalg.norm(ends[0] - ends[1]))
    hidden = scene.with_object(0, hidden=True)
    assert measure_point(hidden, scene.pose(0).project(points[0])) is None


def test_deviations_are_those_of_poses_drawn_by_the_covariance() -> None:
    scene = make_scene(spread=2e-3)
    one, two = (seen_at(scene, 0, front(scene, 0, x, 0.3)) for x in (-0.5, 0.7))
    other = seen_at(scene, 1, front(scene, 1, 0.1, -0.2))
    ends, others = (
        drawn(scene, 0, lambda p: np.array([one.at(p), two.at(p)])),
        drawn(scene, 1, other.at),
    )
    assert one.deviations is not None
    np.testing.assert_allclose(one.deviations, ends[:, 0].std(axis=0), rtol=0.06)
    lengths = np.linalg.norm(ends[:, 0, :3] - ends[:, 1, :3], axis=1)
    assert measure_distance(scene, one, two)[1] == pytest.approx(lengths.std(), rel=0.06)
    between = np.linalg.norm(ends[:, 0, 3:] - 0.5 * others[:, 3:], axis=1)
    assert measure_distance(scene, one, other)[1] == pytest.approx(between.std(), rel=0.06)
    half = replace(scene, objects=(make_scene().objects[0], scene.objects[1]))
    assert measure_distance(half, one, other)[1] is None


def test_relative_poses_compose() -> None:
    scene = make_scene()
    to_other, back = scene.relative_pose(0, 1), scene.relative_pose(1, 0)
    np.testing.assert_allclose(to_other.as_matrix() @ back.as_matrix(), np.eye(4), atol=1e-12)
    world = [item.world_from_model.as_matrix() for item in scene.objects]
    np.testing.assert_allclose(world[1] @ to_other.as_matrix(), world[0], atol=1e-12)
    numbers = measure_relative(scene, 0, 1)
    assert numbers["distance"] == pytest.approx(np.linalg.norm(to_other.rigid.translation))
    assert numbers["degrees"] == pytest.approx(
        np.degrees(np.linalg.norm(to_other.rigid.as_rotation_vector()))
    )
    assert "distance_std" not in numbers


def test_relative_poses_deviate_as_both_poses_drawn_by_their_covariances() -> None:
    scene = make_scene(spread=2e-3)
    own, frame = (drawn(scene, i, lambda p: p.camera_from_model.as_matrix()) for i in (0, 1))
    own[:, :3, 3] *= SCALES[0] / SCALES[1]
    relative = np.linalg.inv(frame) @ own
    turns = [RigidTransform.from_matrix(matrix).as_rotation_vector() for matrix in relative]
    numbers = measure_relative(scene, 0, 1)
    distances = np.linalg.norm(relative[:, :3, 3], axis=1)
    assert numbers["distance_std"] == pytest.approx(distances.std(), rel=0.06)
    degrees = np.degrees(np.linalg.norm(turns, axis=1))
    assert numbers["degrees_std"] == pytest.approx(degrees.std(), rel=0.06)


def test_parallel_projection_tells_no_depth_between_objects() -> None:
    scene = make_scene(Parallel(25.0, 83.0, 58.0, 160, 120))
    points = [seen_at(scene, i, front(scene, i, 0.0, 0.0)) for i in (0, 1)]
    with pytest.raises(SettingsError, match="parallel"):
        measure_distance(scene, points[0], points[1])
    with pytest.raises(SettingsError, match="parallel"):
        measure_relative(scene, 0, 1)
