"""The stage shows what the pose shows; parts are what their names and colours say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.evaluation.cycles.stage import (
    DIAMETER,
    FINISHES,
    around_photo,
    around_plain,
    corner_colours,
    find_finishes,
    make_stage,
    scaled_to,
)
from poseviewer.evaluation.photos import random_view
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.mesh.load import linear_from_srgb, load_mesh
from tests.meshes import make_bumpy
from tests.vehicles import save_vehicle


@pytest.mark.parametrize("parallel", [True, False])
def test_the_stage_is_upright_and_looks_the_same(tmp_path, parallel):
    path = save_vehicle(tmp_path)
    mesh = load_mesh(path)
    keypoints = load_keypoints(path, mesh)
    assert keypoints is not None
    # Neither upright in its file, nor of a car's size.
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    turned = replace(mesh, vertices=300.0 * mesh.vertices @ turn.T, normals=mesh.normals @ turn.T)
    sides = [
        replace(side, rear_wheel=300.0 * turn @ side.rear_wheel,
                front_wheel=300.0 * turn @ side.front_wheel, axle=turn @ side.axle)
        for side in (keypoints.left, keypoints.right)
    ]  # fmt: skip
    there = replace(keypoints, left=sides[0], right=sides[1])
    pose = random_view(turned, there, (320, 200), parallel, np.random.default_rng(2))
    stage = make_stage(turned, there, pose)
    seen = stage.pose.project(stage.mesh.vertices)
    np.testing.assert_allclose(seen, pose.project(turned.vertices), atol=1e-9)
    assert stage.mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-12)
    assert stage.mesh.diameter == pytest.approx(DIAMETER)
    # As in the file, whose z is up and x ahead, but for size and place.
    size = stage.mesh.diameter / mesh.diameter
    np.testing.assert_allclose(np.ptp(stage.mesh.vertices, 0), size * np.ptp(mesh.vertices, 0))
    np.testing.assert_allclose(stage.mesh.normals, mesh.normals, atol=1e-12)


def test_finishes_go_by_names_and_then_by_the_commonest_colour():
    mesh = make_bumpy(2)
    half = np.arange(len(mesh.faces)) % 4
    colours = np.full_like(mesh.colours, 0.2)
    colours[mesh.faces[half == 3].ravel()] = 0.9
    names = ("wheel FL tyre", "window left", "mirror glass", "door")
    mesh = replace(mesh, colours=colours, face_part=half.astype(np.int32), part_names=names)
    found = find_finishes(mesh)
    for part, finish in enumerate(("rubber", "glass", "metal")):
        assert {FINISHES[i] for i in found[half == part]} == {finish}
    assert {FINISHES[i] for i in found[half == 3]} == {"paint"}
    new = corner_colours(mesh, found, (0.5, 0.1, 0.0))
    own = corner_colours(mesh, found, None)
    np.testing.assert_allclose(new[half == 3], np.broadcast_to(
        linear_from_srgb(np.array([0.5, 0.1, 0.0])), new[half == 3].shape), rtol=1e-6)  # fmt: skip
    np.testing.assert_array_equal(new[half < 3], own[half < 3])


def test_surroundings_light_a_white_ground_as_is_said():
    random = np.random.default_rng(0)
    photo = random.integers(0, 256, (60, 90, 3)).astype(np.uint8)
    plain = around_plain(np.full(3, 0.2), random)
    for light in (around_photo(photo), plain):
        assert light.shape == (512, 1024, 3)
        np.testing.assert_allclose(light[:, 0], light[:, -1], atol=0.2)  # the circle is closed
        scaled = scaled_to(light, 0.4)
        rise = np.pi * (0.5 - (np.arange(512) + 0.5) / 512)
        # Irradiance over pi: the mean over the upper half sphere of light times cosine.
        solid = np.cos(rise) * np.clip(np.sin(rise), 0.0, None) * (np.pi / 512) * (2 * np.pi / 1024)
        lit = (scaled.mean(axis=2).astype(float) * solid[:, None]).sum() / np.pi
        assert lit == pytest.approx(0.4, rel=0.01)
