"""Symmetries are groups; of the equal poses, the nearest and the canonical one."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.symmetry_group import NO_SYMMETRY, Symmetry, SymmetryAxis
from poseviewer.geometry.transform import RigidTransform, rotation_angle

X, Y, Z = np.eye(3)
CENTRE = np.array([1.0, -2.0, 0.5])
CAMERA = Perspective(600.0, 600.0, 320.0, 240.0, 640, 480)
TURNS = {
    "none": (),
    "half": (SymmetryAxis(Z, 2),),
    "prism": (SymmetryAxis(Z, 5), SymmetryAxis(X, 2)),
    "cube": (SymmetryAxis(Z, 4), SymmetryAxis(X, 4)),
    "bottle": (SymmetryAxis(Y, 0),),
    "can": (SymmetryAxis(Z, 0), SymmetryAxis(X, 2)),
    "ball": (SymmetryAxis(Z, 0), SymmetryAxis(X, 0)),
}
COUNTS = {"none": 1, "half": 2, "prism": 10, "cube": 24}
SYMMETRIES = {name: Symmetry.from_axes(CENTRE, turns) for name, turns in TURNS.items()}
EVERY = pytest.mark.parametrize("symmetry", SYMMETRIES.values(), ids=SYMMETRIES)
numbers = st.floats(-3.0, 3.0, allow_subnormal=False)
vectors = st.tuples(numbers, numbers, numbers)


def place(turn, shift) -> RigidTransform:
    return RigidTransform.from_rotation_vector(turn, np.add(shift, [0.0, 0.0, 20.0]))


@cache
def equals(symmetry: Symmetry) -> tuple[RigidTransform, ...]:
    """A few of many."""
    found = symmetry.transforms()
    return found[:: max(len(found) // 12, 1)]


def apart(one: RigidTransform, other: RigidTransform) -> float:
    turned = rotation_angle(one.rotation, other.rotation)
    return turned + float(np.abs(one.apply(CENTRE) - other.apply(CENTRE)).max())


@pytest.mark.parametrize("name", COUNTS)
def test_products_and_inverses_are_symmetries(name):
    motions = SYMMETRIES[name].transforms()
    assert len(motions) == COUNTS[name]
    for one in motions[:: len(motions) // 6 or 1]:
        for found in (one.inverse(), *(one @ other for other in motions)):
            assert min(apart(found, known) for known in motions) < 1e-6


@pytest.mark.parametrize("name", ["bottle", "can"])
def test_neighbours_move_no_point_by_more_than_a_hundredth_of_the_diameter(name):
    motions = SYMMETRIES[name].transforms()[:: 1 if name == "bottle" else 2]
    rim = CENTRE + 0.5 * (X if name == "can" else Z)
    moved = np.array([motion.apply(rim) for motion in motions])
    assert np.linalg.norm(np.diff(moved, axis=0, append=moved[:1]), axis=1).max() < 0.0101


@EVERY
@settings(max_examples=25, deadline=None)
@given(turn=vectors, shift=vectors, wanted=vectors)
def test_nearest_is_nearer_than_every_other(symmetry, turn, shift, wanted):
    here, there = place(turn, shift), place(wanted, shift)
    found = symmetry.nearest(here, there)
    angle = rotation_angle(found.rotation, there.rotation)
    for motion in equals(symmetry):
        assert angle <= rotation_angle((here @ motion).rotation, there.rotation) + 1e-6
    np.testing.assert_allclose(found.apply(CENTRE), here.apply(CENTRE), atol=1e-9)


@EVERY
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_all_equals_have_one_canonical_pose(symmetry, seed):
    random = np.random.default_rng(seed)
    pose = Pose(CAMERA, place(random.normal(size=3), random.normal(size=3)))
    found = symmetry.canonical(pose).camera_from_model
    assert apart(symmetry.nearest(pose.camera_from_model, found), found) < 1e-6
    for motion in equals(symmetry):
        equal = Pose(CAMERA, pose.camera_from_model @ motion)
        assert apart(symmetry.canonical(equal).camera_from_model, found) < 1e-6


def test_motions_and_axes_give_the_same_as_turns():
    motions = SYMMETRIES["prism"].transforms()[1:]
    again = Symmetry.from_transforms(motions, [], 3.0)
    assert len(again.transforms()) == 10
    np.testing.assert_allclose(again.centre, CENTRE)
    can = Symmetry.from_transforms(SYMMETRIES["half"].transforms()[1:], [(X, CENTRE - 7 * X)], 3.0)
    assert can.words == "every turn about (1, 0, 0), half a turn about (0, 0, 1)"


@pytest.mark.parametrize("name", [name for name in TURNS if name != "ball"])
def test_turns_give_the_symmetry_that_they_are_of(name):
    symmetry = SYMMETRIES[name]
    again = Symmetry.from_axes(symmetry.centre, symmetry.symmetry_axes)
    assert again.words == symmetry.words
    assert len(again.transforms()) == len(symmetry.transforms())


def test_what_never_closes_is_refused():
    slanted = np.array([0.6, 0.0, 0.8])
    with pytest.raises(ValueError, match="more than"):
        Symmetry.from_axes(CENTRE, [SymmetryAxis(Z, 7), SymmetryAxis(slanted, 2)])
    aside = RigidTransform(SYMMETRIES["half"].rotations[1], np.array([5.0, 0.0, 0.0]))
    with pytest.raises(ValueError, match="no common point"):
        Symmetry.from_transforms([*SYMMETRIES["half"].transforms(), aside], [], 3.0)
    assert NO_SYMMETRY.is_none
