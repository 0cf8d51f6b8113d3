"""The order in which faces are drawn changes no picture."""

from __future__ import annotations

import numpy as np
import pytest

from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.render.types import PhotoAttributes
from tests.meshes import make_bumpy, make_mesh, make_soup
from tests.render.software.test_software_renderer import random_pose


def make_filled() -> Mesh:
    """A closed shape, with holes here and there, full of triangles that it mostly hides."""
    shell, filling = make_bumpy(4), make_soup(1, triangles=3000, spread=0.35, size=0.1)
    keep = np.arange(len(shell.faces)) % 97 != 0
    return make_mesh(
        np.concatenate([shell.vertices, filling.vertices]),
        np.concatenate([shell.faces[keep], filling.faces + len(shell.vertices)]),
        np.concatenate([shell.normals, filling.normals]),
        np.concatenate([shell.colours, filling.colours]),
    )


@pytest.mark.parametrize("parallel", [False, True])
def test_pictures_do_not_depend_on_what_was_drawn_before(parallel):
    """Buffers are emptied where something was drawn alone."""
    renderer, random = SoftwareRenderer(make_filled()), np.random.default_rng(0)
    photo = PhotoAttributes(
        random.uniform(size=(72, 96, 3)).astype(np.float32), np.ones((72, 96), np.float32)
    )
    for _ in range(12):
        pose = random_pose(random, parallel)
        for _ in range(4):  # on the spot, as a search does, before it jumps
            turn = RigidTransform.from_rotation_vector(random.normal(size=3) * 0.02, [0, 0, 0])
            pose = Pose(
                pose.camera,
                RigidTransform(
                    turn.rotation @ pose.camera_from_model.rotation,
                    pose.camera_from_model.translation,
                ),
            )
            fresh = renderer.clone()
            moments, expected = renderer.moments(pose, photo), fresh.moments(pose, photo)
            assert np.array_equal(moments.covariance, expected.covariance)
            assert moments.pixels == expected.pixels
            assert np.array_equal(renderer.render(pose).face_ids, fresh.render(pose).face_ids)


def test_of_two_faces_at_the_same_depth_the_same_one_is_always_seen():
    mesh = make_bumpy(3)
    twice = make_mesh(
        mesh.vertices, np.concatenate([mesh.faces, mesh.faces]), mesh.normals, mesh.colours
    )
    renderer, random = SoftwareRenderer(twice), np.random.default_rng(1)
    for _ in range(10):
        assert renderer.render(random_pose(random, False)).face_ids.max() < len(mesh.faces)
