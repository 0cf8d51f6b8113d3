"""Symmetries that are found from the mesh itself."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.mesh_symmetry import find_symmetry
from poseviewer.scene.assets import ModelFile
from tests.meshes import make_box as make_coloured
from tests.meshes import make_bumpy, make_mesh

TURN = Rotation.from_rotvec([0.7, -0.4, 1.1])
SHIFT = np.array([3.0, -2.0, 7.0])


def make_box(size: tuple[float, float, float]) -> Mesh:
    """A box of one colour."""
    box = make_coloured(size)
    return replace(box, colours=np.full_like(box.colours, 0.7))


def make_can() -> Mesh:
    """A cylinder of 64 sides."""
    can = trimesh.creation.cylinder(0.5, 2.0, sections=64)
    return make_mesh(can.vertices, can.faces)


def make_ball() -> Mesh:
    """A ball of one colour."""
    ball = trimesh.creation.icosphere(3)
    return make_mesh(ball.vertices, ball.faces)


def turned(mesh: Mesh) -> Mesh:
    """The mesh elsewhere, along no axis of its frame."""
    vertices = TURN.apply(mesh.vertices.copy()) + SHIFT
    return replace(mesh, vertices=vertices, normals=TURN.apply(mesh.normals.copy()))


def folds_of(mesh: Mesh) -> list[int]:
    """Folds of the axes, sorted; 0: every turn."""
    symmetry = find_symmetry(mesh)
    return sorted(axis.fold for axis in symmetry.symmetry_axes)


@pytest.mark.parametrize(
    ("mesh", "folds"),
    [
        (make_box((1.0, 2.0, 3.0)), [2, 2, 2]),
        (make_box((1.0, 1.0, 3.0)), [2, 2, 2, 2, 4]),
        (make_box((1.0, 1.0, 1.0)), [2] * 6 + [3] * 4 + [4] * 3),
        (make_can(), [0, 2]),
        (make_bumpy(2), []),
    ],
    ids=["box", "square box", "cube", "can", "bumpy"],
)
def test_rotations_of_a_surface_onto_itself_are_found_anywhere(mesh, folds):
    assert folds_of(turned(mesh)) == folds
    centre = find_symmetry(turned(mesh)).centre
    if folds:
        assert centre == pytest.approx(
            TURN.apply(mesh.centre.copy()) + SHIFT, abs=0.01 * mesh.diameter
        )


def test_every_rotation_of_a_ball_is_one():
    assert find_symmetry(turned(make_ball())).is_any_rotation


def test_every_symmetry_lays_the_surface_on_itself():
    mesh = turned(make_box((1.0, 1.0, 3.0)))
    for motion in find_symmetry(mesh).transforms():
        moved = motion.apply(mesh.vertices)
        apart = np.linalg.norm(moved[:, None] - mesh.vertices, axis=2).min(axis=1)
        assert apart.max() < 0.01 * mesh.diameter


def test_colours_are_taken_into_account():
    box = make_box((1.0, 2.0, 3.0))
    colours = np.full_like(box.colours, 0.6)
    colours[box.vertices[:, 2] > 0.0] = 0.2  # the top half is dark: only turns about z are left
    assert folds_of(replace(box, colours=colours)) == [2]
    axis = find_symmetry(replace(box, colours=colours)).symmetry_axes[0].axis
    assert np.abs(axis) == pytest.approx([0.0, 0.0, 1.0])


def test_a_bump_of_two_per_cent_is_seen():
    box = make_box((1.0, 2.0, 3.0))
    longer = np.where(box.vertices[:, 2:] > 0.0, [[1.2, 1.0, 1.0]], 1.0)
    assert folds_of(replace(box, vertices=box.vertices * longer)) == [2]


def test_what_a_file_says_comes_first_and_parts_left_out_change_it():
    box = make_box((1.0, 2.0, 3.0))
    assert len(ModelFile.of(box).symmetry.rotations) == 4
    said = find_symmetry(make_bumpy(2))
    assert ModelFile.of(box, symmetry=said).symmetry.is_none
