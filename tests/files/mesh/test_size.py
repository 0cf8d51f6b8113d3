from dataclasses import replace

import numpy as np
import pytest

from poseviewer.files.mesh.size import distance_notes, size_words
from poseviewer.files.pose import load_pose, save_pose
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from tests.meshes import make_bumpy

BALL = make_bumpy(2)


@pytest.mark.parametrize(("size", "unit", "shift", "words"), [
    (0.1, None, 0.0, ("likely m)", "in its middle", "camera, in m")),
    (150.0, None, 0.0, ("likely mm)", "camera, in mm")),
    (150.0, "cm", 0.0, ("in cm;", "camera, in cm")),
    (1.0, "m", 3.0, ("in m;", "of its size from its middle")),
])  # fmt: skip
def test_a_models_size_and_origin_are_said(size, unit, shift, words):
    moved = np.array([shift, 0.0, 0.0])
    vertices = moved + (BALL.vertices - BALL.centre) * size / np.ptp(BALL.vertices, axis=0).max()
    said = size_words(replace(BALL, vertices=vertices, unit=unit))
    for word in words:
        assert word in said


def test_a_pose_in_another_unit_is_noted():
    """A model of 150 that is said to be 0.3 away, or 900 m."""
    camera = Perspective(500.0, 500.0, 320.0, 240.0, 640, 480)
    mesh = replace(BALL, vertices=BALL.vertices * 150.0)
    for distance, noted in ((0.3, True), (-1.0, True), (900.0, False), (9e5, True)):
        place = RigidTransform(np.eye(3), np.array([0.0, 0.0, distance]))
        assert bool(distance_notes(mesh, Pose(camera, place))) == noted
        assert not distance_notes(mesh, Pose(Parallel(2.0, 320.0, 240.0, 640, 480), place))


def test_the_note_comes_with_a_start_in_metres_for_a_model_in_millimetres(scene, tmp_path):
    record = load_pose(scene.start)
    place = record.pose.camera_from_model
    place = RigidTransform(place.rotation, 0.001 * place.translation)
    path = tmp_path / "start.json"
    save_pose(path, record.with_pose(replace(record.pose, camera_from_model=place)))
    for start, is_noted in ((path, True), (scene.start, False)):
        notes = open_scene(Sources(scene.photo, model=scene.model, start=start)).notes
        assert any("in one unit" in note for note in notes) == is_noted
