"""Symmetries that a surface has, and those that its colours break."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from poseviewer.geometry.surface_symmetry import find_symmetry, worst_turn
from poseviewer.geometry.symmetry import Symmetry, Turn
from tests.meshes import make_box, make_mesh, make_waves

_, _, Z = np.eye(3)
AWAY = np.array([3.0, -1.0, 2.0])
TILT = trimesh.transformations.rotation_matrix(0.7, [1.0, 2.0, 0.5])[:3, :3]


def placed(shape: trimesh.Trimesh):
    """Off the origin and slanted, as models are."""
    return make_mesh(shape.vertices @ TILT.T + AWAY, shape.faces)


def cylinder(sections: int):
    return placed(trimesh.creation.cylinder(1.0, 3.0, sections=sections))


def test_a_can_has_every_turn_and_can_be_turned_over():
    found = find_symmetry(cylinder(64)).symmetry
    assert [turn.fold for turn in found.turns] == [0, 2]
    np.testing.assert_allclose(np.abs(found.axes[0] @ TILT[:, 2]), 1.0, atol=1e-9)
    np.testing.assert_allclose(np.cross(found.centre - AWAY, TILT[:, 2]), 0.0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "count"),
    [
        (trimesh.creation.box(extents=(2.0, 1.0, 0.5)), 4),
        (trimesh.creation.box(extents=(1.0, 1.0, 3.0)), 8),
        (trimesh.creation.box(extents=(1.0, 1.0, 1.0)), 24),
        (trimesh.creation.cylinder(1.0, 3.0, sections=6), 12),
        (trimesh.creation.cylinder(1.0, 3.0, sections=5), 10),
    ],
)
def test_a_box_and_a_prism_have_all_their_turns(shape, count):
    found = find_symmetry(placed(shape)).symmetry
    assert len(found.transforms()) == count
    corners = placed(shape).vertices
    for motion in found.transforms():
        moved = motion.apply(corners)
        away = np.linalg.norm(moved[:, None] - corners, axis=2).min(axis=1)
        assert away.max() < 1e-6


def test_a_ball_has_every_rotation():
    assert find_symmetry(placed(trimesh.creation.icosphere(4))).symmetry.is_any_rotation


def test_a_cone_is_not_turned_over():
    found = find_symmetry(placed(trimesh.creation.cone(1.0, 2.0))).symmetry
    assert [turn.fold for turn in found.turns] == [0]


def test_colours_break_a_symmetry_and_are_named():
    found = find_symmetry(make_box())
    assert found.symmetry.is_none
    assert len(found.of_shape.transforms()) == 4
    assert "its colours break half a turn about" in found.text


@pytest.mark.parametrize(("is_printed", "count"), [(True, 1), (False, 4)])
def test_a_texture_breaks_a_symmetry(is_printed, count):
    box = trimesh.creation.box(extents=(2.0, 1.0, 0.5))
    waves = make_waves(8, 64) if is_printed else np.full((8, 64, 3), 90, np.uint8)
    mesh = make_mesh(
        box.vertices,
        box.faces,
        uvs=box.vertices[:, :2] * 0.4 + 0.5,
        face_texture=np.zeros(len(box.faces)),
        textures=(waves,),
    )
    found = find_symmetry(mesh)
    assert len(found.of_shape.transforms()) == 4
    assert len(found.symmetry.transforms()) == count


@pytest.mark.slow
def test_a_spout_breaks_a_symmetry():
    pot = trimesh.creation.cylinder(1.0, 2.0, sections=64)
    spout = trimesh.creation.box(extents=(0.8, 0.3, 0.3)).apply_translation([1.3, 0.0, 0.4])
    both = trimesh.util.concatenate([pot, spout])
    assert isinstance(both, trimesh.Trimesh)
    mesh = placed(both)
    assert find_symmetry(mesh).of_shape.is_none


def test_the_worst_turn_is_named():
    box, centre = make_box(), [0.0, 0.0, 0.0]
    words, off = worst_turn(box, Symmetry.from_turns(centre, [Turn(Z, 4)]))
    assert words == "1/4 of a turn about (0, 0, 1)"
    assert off > 0.1
    assert worst_turn(box, Symmetry.from_turns(centre, [Turn(Z, 2)]))[1] < 0.01
    assert worst_turn(box, Symmetry.from_turns([0.4, 0.0, 0.0], [Turn(Z, 2)]))[1] > 0.1
