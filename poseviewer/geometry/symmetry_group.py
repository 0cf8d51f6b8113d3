"""The turns of a model that leave it as it is, and which of the equal poses is meant.

All are rotations about one point. A continuous symmetry is every turn about an axis through it;
where there are two such axes, every rotation.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from poseviewer.errors import list_names
from poseviewer.geometry.arrays import FloatArray, freeze_array
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.transform import RigidTransform

STEP = 0.01
"""Share of the diameter between turns of a continuous symmetry, BOP's ``max_sym_disc_step``."""
SAME_COSINE = math.cos(math.radians(2.0))
"""Rotations and axes nearer than that are one: files round."""
ROUNDING = 1e-12
"""Radians: a pose so near to the wanted one is the one, to the last digit."""
MAX_FOLD = 60
"""Steps of a full turn, six degrees each: finer ones are a continuous symmetry to the eye."""
MAX_ROTATIONS, MAX_NAMED_AXES = 2 * MAX_FOLD, 3
"""Rotations of a prism with ``MAX_FOLD`` sides (an icosahedron has 60); turns a message names."""
APART = 0.01
"""Share of the model's diameter by which motions may differ on the point that they leave."""
REFERENCE = Rotation.from_rotvec([0.3, 0.5, 0.7]).as_matrix()
"""Rotation from which the canonical one of equal poses is turned least. No pose that people give
exactly lies half way from it to an equal one, as those along the axes do from the identity."""


class SymmetryAxis(NamedTuple):
    """The turns about an axis."""

    axis: FloatArray
    """(3,): unit direction in the model's frame."""
    fold: int
    """Number of equal steps in a full turn; 0: every turn."""

    @property
    def words(self) -> str:
        """Such as ``half a turn about (0, 0, 1)``."""
        steps = {0: "every turn", 2: "half a turn"}.get(self.fold, f"1/{self.fold} of a turn")
        direction = ", ".join(f"{value + 0.0:.3g}" for value in np.round(self.axis, 3))
        return f"{steps} about ({direction})"


@dataclass(frozen=True, slots=True, eq=False)
class Symmetry:
    """The rigid motions, model from model, that map a model onto itself, in shape and colours."""

    centre: FloatArray
    """(3,): the point that they all leave where it is, in the model's frame and unit."""
    rotations: FloatArray
    """(n, 3, 3): about it, the identity first; the symmetries are these, after every turn about
    one of the axes."""
    axes: FloatArray
    """(k, 3): unit directions of continuous symmetries; two or more: every rotation is one."""

    def __post_init__(self) -> None:
        for name, shape in (("centre", (3,)), ("rotations", (-1, 3, 3)), ("axes", (-1, 3))):
            object.__setattr__(self, name, freeze_array(getattr(self, name), shape))

    @classmethod
    def from_axes(cls, centre: ArrayLike, turns: Iterable[SymmetryAxis]) -> Symmetry:
        """Close these turns about axes through a point; raises ``ValueError`` if too many."""
        turns = tuple(turns)
        steps = (2.0 * math.pi / fold * axis for axis, fold in turns if fold)
        rotations = [Rotation.from_rotvec(step).as_matrix() for step in steps]
        axes = [axis for axis, fold in turns if not fold]
        return cls(np.array(centre, float), *_closed(rotations, axes))

    @classmethod
    def from_transforms(
        cls,
        discrete: Sequence[RigidTransform],
        axes: ArrayLike,
        offsets: ArrayLike,
        diameter: float,
    ) -> Symmetry:
        """Close motions, and axes (k, 3) through ``offsets`` (k, 3); raises ``ValueError``: they
        are too many, or leave no common point where it is.
        """
        axes, offsets = np.reshape(axes, (-1, 3)), np.reshape(offsets, (-1, 3))
        across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
        sides = [np.zeros((3, 3)), *(np.eye(3) - motion.rotation for motion in discrete), *across]
        shifts = [np.zeros(3), *(motion.translation for motion in discrete)]
        shifts += [side @ offset for side, offset in zip(across, offsets, strict=True)]
        left, right = np.concatenate(sides), np.concatenate(shifts)
        # Of an axis's points the one nearest to the origin.
        centre = np.linalg.lstsq(left, right, rcond=1e-6)[0]
        apart = np.abs(left @ centre - right).max()
        if apart > APART * diameter:
            raise ValueError("leave no common point where it is, so that no model has them all")
        return cls(centre, *_closed([motion.rotation for motion in discrete], list(axes)))

    @property
    def is_none(self) -> bool:
        """Whether nothing but the identity is in it."""
        return len(self.rotations) == 1 and not len(self.axes)

    @property
    def is_any_rotation(self) -> bool:
        """Whether it is that of a ball."""
        return len(self.axes) > 1

    @property
    def free_axes(self) -> FloatArray:
        """(k, 3): orthogonal ones of every continuous symmetry."""
        return np.eye(3) if self.is_any_rotation else self.axes

    @property
    def symmetry_axes(self) -> tuple[SymmetryAxis, ...]:
        """The turns that it is made of, those about one axis together, the finest first."""
        turns: list[SymmetryAxis] = []
        for rotation in self.rotations[1:]:
            vector = Rotation.from_matrix(rotation).as_rotvec()
            upwards = vector[np.argmax(np.abs(vector))] > 0.0  # along the greatest coordinate
            axis = (vector if upwards else -vector) / np.linalg.norm(vector)
            for index, known in enumerate(turns):
                if abs(axis @ known.axis) > SAME_COSINE:
                    turns[index] = SymmetryAxis(known.axis, known.fold + 1)
                    break
            else:
                turns.append(SymmetryAxis(axis, 2))
        turns.sort(key=lambda turn: -turn.fold)
        return (*(SymmetryAxis(axis, 0) for axis in self.axes), *turns)

    @property
    def words(self) -> str:
        """Such as ``every turn about (0, 0, 1), half a turn about (1, 0, 0)``; empty for none."""
        if self.is_any_rotation:
            return "every rotation"
        return list_names([turn.words for turn in self.symmetry_axes], MAX_NAMED_AXES)

    def transforms(self) -> tuple[RigidTransform, ...]:
        """All symmetries, the identity first, continuous ones in steps of at most ``STEP``."""
        count = math.ceil(math.pi / STEP)
        angles = 2.0 * math.pi / count * np.arange(1, count)
        ways = (Rotation.from_rotvec(angles[:, None] * axis).as_matrix() for axis in self.axes)
        turns = np.concatenate([np.eye(3)[None], *ways])
        return tuple(self.as_transform(own @ turn) for turn in turns for own in self.rotations)

    def nearest(self, place: RigidTransform, wanted: RigidTransform) -> RigidTransform:
        """The transform equal to ``place`` whose rotation is nearest to ``wanted``; exact."""
        if self.is_none:
            return place
        # The nearest makes trace(wanted^T place S) greatest; S is a rotation, then a turn t about
        # the axis a: trace(M turn(t)) = a.Ma + (trace M - a.Ma) cos t + trace(M [a]x) sin t.
        off = wanted.rotation.T @ place.rotation
        if self.is_any_rotation:
            is_there = np.abs(off - np.eye(3)).max() < ROUNDING
            return place if is_there else place @ self.as_transform(off.T)
        products = off @ self.rotations
        traces = np.trace(products, axis1=1, axis2=2)
        if not len(self.axes):
            index = int(np.argmax(traces))
            return place @ self.as_transform(self.rotations[index]) if index else place
        (axis,) = self.axes
        along = np.einsum("i,nij,j->n", axis, products, axis)
        cosines = traces - along
        sines = np.einsum("nij,ji->n", products, np.cross(np.eye(3), axis))
        best = np.argmax(along + np.hypot(cosines, sines))
        angle = math.atan2(sines[best], cosines[best])
        if best == 0 and abs(angle) < ROUNDING:
            return place
        turn = Rotation.from_rotvec(angle * axis).as_matrix()
        return place @ self.as_transform(self.rotations[best] @ turn)

    def nearest_pose(self, pose: Pose, wanted: Pose) -> Pose:
        """Pose equal to ``pose``, with its camera, whose rotation is nearest to ``wanted``."""
        given = pose.camera_from_model
        place = self.nearest(given, wanted.camera_from_model)
        return pose if place is given else replace(pose, camera_from_model=place)

    def canonical(self, pose: Pose) -> Pose:
        """The one of the equal poses that stands for all of them."""
        return self.nearest_pose(pose, Pose(pose.camera, RigidTransform(REFERENCE, np.zeros(3))))

    def as_transform(self, rotation: FloatArray) -> RigidTransform:
        """The rotation (3, 3) about the centre."""
        return RigidTransform(rotation, self.centre - rotation @ self.centre)


NO_SYMMETRY = Symmetry(np.zeros(3), np.eye(3)[None], np.zeros((0, 3)))
"""That of most models."""


def _closed(
    rotations: Sequence[FloatArray], axes: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """(n, 3, 3), (k, 3): all products of rotations, and axes; ValueError where there is no end."""
    group = _products(rotations)
    turned: list[FloatArray] = []
    for axis in (rotation @ axis for axis in axes for rotation in group):
        if all(abs(axis @ known) < SAME_COSINE for known in turned):
            turned.append(axis)
    if len(turned) > 1:
        return np.eye(3)[None], np.array(turned)
    if turned:  # what is no turn about the axis turns it over, in as many ways as there are turns
        flips = [rotation for rotation in group if turned[0] @ rotation @ turned[0] < 0.0]
        group = np.array([np.eye(3), *flips[:1]])
    return group, np.reshape(turned, (-1, 3))


def _products(rotations: Sequence[FloatArray]) -> FloatArray:
    """(n, 3, 3): what products of these come to, the identity first."""
    products = [np.eye(3)]
    least = 1.0 + 2.0 * SAME_COSINE  # trace of a rotation by that angle
    for product in products:  # grows meanwhile
        for new in (product @ rotation for rotation in rotations):
            if np.max(np.einsum("nij,ij->n", np.array(products), new)) < least:
                products.append(new)
        if len(products) > MAX_ROTATIONS:
            raise ValueError(
                f"lead to more than {MAX_ROTATIONS} equal poses, so that no turn of them closes"
            )
    return np.array(products)
