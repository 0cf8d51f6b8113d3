"""Points, distances and relative poses are those of known boxes, and deviate as drawn poses do."""

import numpy as np
import pytest

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.errors import SettingsError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Perspective
from poseviewer.geometry.transform import RigidTransform, Similarity
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.measuring import (
    MeasuredPoint,
    measure_distance,
    measure_point,
    measure_relative,
)
from poseviewer.scene.types import Scene, SceneObject, SearchResult, View
from tests.app.state.documents import PARALLEL, PERSPECTIVE, make_photo
from tests.meshes import make_box

HALF = np.array([1.0, 0.5, 0.25])
"""Half the sides of both boxes."""
SCALES = (1.0, 0.5)
"""World units in one of each model's."""
PLACES = ([0.4, -0.3, 0.2], [-1.0, 0.1, 8.0]), ([-0.5, 0.4, 0.3], [1.1, 0.2, 7.0])
MOTION = RigidTransform.from_rotation_vector([0.1, -0.05, 0.2], [0.1, 0.2, 0.3])
"""Camera from world."""


def make_scene(camera: Perspective | Parallel = PERSPECTIVE) -> Scene:
    """Two boxes of one model, whose poses are known as searches know them."""
    model = ModelFile.of(make_box(2.0 * HALF), None, "0" * 64, name="box.ply")
    objects = []
    for number, (place, scale) in enumerate(zip(PLACES, SCALES, strict=True)):
        world_from_model = Similarity(RigidTransform.from_rotation_vector(*place), scale)
        item = SceneObject(id=str(number), model=model, world_from_model=world_from_model)
        objects.append(item)
    view = View(PhotoFile.of(make_photo()), camera, MOTION)
    scene = Scene(views=(view,), objects=tuple(objects))
    for index in (0, 1):
        factor = 2e-3 * np.random.default_rng(index).normal(size=(6, 6))
        sure = PoseCovariance(scene.pose(index), np.zeros(3), factor @ factor.T)
        scene = scene.with_object(index, result=SearchResult(covariance=sure))
    return scene


def seen_at(scene: Scene, index: int, x: float, y: float) -> tuple[FloatArray, MeasuredPoint]:
    """A point of a box's front face, at shares of half its sides, and what is measured there."""
    pose = scene.pose(index)
    towards = -pose.camera_from_model.rotation[2, 2]
    point = HALF * [x, y, np.sign(towards)]
    measured = measure_point(scene, pose.project(point))
    assert measured is not None
    assert measured.object_index == index
    return point, measured


def drawn_poses(scene: Scene, index: int) -> list:
    """Poses of an object by its covariance."""
    sure = scene.covariance(index)
    assert sure is not None
    draws = np.random.default_rng(7 + index).multivariate_normal(np.zeros(6), sure.matrix, 4000)
    return [sure.pose_at(draw) for draw in draws]


@pytest.mark.parametrize(("camera", "count"), [(PERSPECTIVE, 6), (PARALLEL, 5)])
def test_points_of_a_box_and_their_distance_are_exact(camera, count: int) -> None:
    scene = make_scene(camera)
    (point, first), (_, second) = seen_at(scene, 1, -0.9, 0.8), seen_at(scene, 1, 0.9, 0.8)
    wanted = [*point, *scene.pose(1).camera_from_model.apply(point)]
    np.testing.assert_allclose(first.coordinates[:count], wanted[:count], atol=1e-9)
    assert measure_distance(scene, first, second)[0] == pytest.approx(1.8)
    assert measure_point(scene, [1.0, 1.0]) is None


def test_a_distance_between_two_objects_is_in_the_worlds_unit() -> None:
    scene = make_scene()
    (point, first), (other, second) = seen_at(scene, 0, 0.3, 0.2), seen_at(scene, 1, -0.4, 0.5)
    ends = [scene.objects[i].world_from_model.apply(p) for i, p in enumerate((point, other))]
    distance = measure_distance(scene, first, second)[0]
    assert distance == pytest.approx(np.linalg.norm(ends[0] - ends[1]))
    unsearched = scene.with_object(1, result=None)
    assert measure_distance(unsearched, first, second) == (distance, None)
    hidden = scene.with_object(0, hidden=True)
    assert measure_point(hidden, scene.pose(0).project(point)) is None


def test_deviations_are_those_of_poses_drawn_by_the_covariances() -> None:
    scene = make_scene()
    one, two = (seen_at(scene, 0, x, 0.3)[1] for x in (-0.5, 0.7))
    other = seen_at(scene, 1, 0.1, -0.2)[1]
    poses = [drawn_poses(scene, index) for index in (0, 1)]
    ends = np.array([[one.at(pose), two.at(pose)] for pose in poses[0]])
    assert one.deviations is not None
    np.testing.assert_allclose(one.deviations, ends[:, 0].std(axis=0), rtol=0.06)
    lengths = np.linalg.norm(ends[:, 0, :3] - ends[:, 1, :3], axis=1)
    assert measure_distance(scene, one, two)[1] == pytest.approx(lengths.std(), rel=0.06)
    others = np.array([other.at(pose) for pose in poses[1]])
    lengths = np.linalg.norm(ends[:, 0, 3:] - SCALES[1] * others[:, 3:], axis=1)
    assert measure_distance(scene, one, other)[1] == pytest.approx(lengths.std(), rel=0.06)
    own, frame = (np.array([p.camera_from_model.as_matrix() for p in drawn]) for drawn in poses)
    own[:, :3, 3] *= SCALES[0] / SCALES[1]
    relative, numbers = np.linalg.inv(frame) @ own, measure_relative(scene, 0, 1)
    distances = np.linalg.norm(relative[:, :3, 3], axis=1)
    assert numbers["distance_std"] == pytest.approx(distances.std(), rel=0.06)
    cosines = (np.trace(relative[:, :3, :3], axis1=1, axis2=2) - 1.0) / 2.0
    assert numbers["degrees_std"] == pytest.approx(np.degrees(np.arccos(cosines)).std(), rel=0.06)


def test_relative_poses_compose() -> None:
    scene = make_scene()
    relative, back = scene.relative_pose(0, 1), scene.relative_pose(1, 0)
    np.testing.assert_allclose(relative.as_matrix() @ back.as_matrix(), np.eye(4), atol=1e-12)
    world = [item.world_from_model.as_matrix() for item in scene.objects]
    np.testing.assert_allclose(world[1] @ relative.as_matrix(), world[0], atol=1e-12)
    numbers = measure_relative(scene, 0, 1)
    assert numbers["distance"] == pytest.approx(np.linalg.norm(numbers["translation"]))
    half = 2.0 * np.degrees(np.arccos(numbers["quaternion_wxyz"][0]))
    assert numbers["degrees"] == pytest.approx(half)


def test_parallel_projection_tells_no_depth_between_objects() -> None:
    scene = make_scene(PARALLEL)
    points = [seen_at(scene, index, 0.0, 0.0)[1] for index in (0, 1)]
    with pytest.raises(SettingsError, match="parallel"):
        measure_distance(scene, *points)
    with pytest.raises(SettingsError, match="parallel"):
        measure_relative(scene, 0, 1)
