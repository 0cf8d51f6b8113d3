"""Symmetries of a model: rotations that leave it as it is, and which of the equal poses is meant.

All are rotations about one point. A continuous symmetry is every rotation about an axis through
it; two such axes stand for every rotation.
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
"""Share of the diameter between steps of a continuous symmetry, BOP's ``max_sym_disc_step``."""
SAME_COSINE = math.cos(math.radians(2.0))
"""Cosine from which rotations and axes are the same: files round."""
ROUNDING = 1e-12
"""Radians below which a pose is the wanted one to the last digit."""
MAX_FOLD = 60
"""Steps of a full turn, six degrees each: finer ones are a continuous symmetry to the eye."""
MAX_ROTATIONS = 2 * MAX_FOLD
"""Rotations of a prism with ``MAX_FOLD`` sides; an icosahedron has 60."""
MAX_NAMED_AXES = 3
"""Symmetry axes that a message names."""
MAX_CENTRE_ERROR = 0.01
"""Share of the model's diameter by which motions may differ on the point that they leave."""
REFERENCE = Rotation.from_rotvec([0.3, 0.5, 0.7]).as_matrix()
"""Rotation next to the canonical one of equal poses. No pose that people give exactly lies half way
from it to an equal one, as those along the axes do from the identity."""


class SymmetryAxis(NamedTuple):
    """An axis of rotational symmetry."""

    axis: FloatArray
    """(3,): unit direction in the model's frame."""
    fold: int
    """Number of equal steps in a full turn; 0: every rotation."""

    @property
    def words(self) -> str:
        """Text such as ``half a turn about (0, 0, 1)``."""
        steps = {0: "every turn", 2: "half a turn"}.get(self.fold, f"1/{self.fold} of a turn")
        direction = ", ".join(f"{value + 0.0:.3g}" for value in np.round(self.axis, 3))
        return f"{steps} about ({direction})"


@dataclass(frozen=True, slots=True, eq=False)
class Symmetry:
    """The rigid motions, model from model, that map a model onto itself, in shape and colours."""

    centre: FloatArray
    """(3,): the point that all motions leave where it is, in the model's frame and unit."""
    rotations: FloatArray
    """(n, 3, 3): about the centre, the identity first. The symmetries are these, each after every
    rotation about one of the axes."""
    axes: FloatArray
    """(k, 3): unit directions of continuous symmetries; two or more: every rotation is one."""

    def __post_init__(self) -> None:
        for name, shape in (("centre", (3,)), ("rotations", (-1, 3, 3)), ("axes", (-1, 3))):
            object.__setattr__(self, name, freeze_array(getattr(self, name), shape))

    @classmethod
    def from_axes(cls, centre: ArrayLike, axes: Iterable[SymmetryAxis]) -> Symmetry:
        """Close the rotations about axes through a point.

        Raises:
            ValueError: there are too many.
        """
        axes = tuple(axes)
        steps = (2.0 * math.pi / fold * axis for axis, fold in axes if fold)
        rotations = [Rotation.from_rotvec(step).as_matrix() for step in steps]
        continuous = [axis for axis, fold in axes if not fold]
        return cls(np.array(centre, float), *_close(rotations, continuous))

    @classmethod
    def from_transforms(
        cls,
        discrete: Sequence[RigidTransform],
        continuous: Sequence[tuple[FloatArray, FloatArray]],
        diameter: float,
    ) -> Symmetry:
        """Close motions, and rotations about axes: a unit direction (3,) and a point (3,) each.

        Raises:
            ValueError: they are too many, or leave no common point of a model of this diameter.
        """
        axes, offsets = np.moveaxis(np.reshape(continuous, (-1, 2, 3)), 1, 0)
        across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
        sides = [np.zeros((3, 3)), *(np.eye(3) - motion.rotation for motion in discrete), *across]
        shifts = [np.zeros(3), *(motion.translation for motion in discrete)]
        shifts += [side @ offset for side, offset in zip(across, offsets, strict=True)]
        left, right = np.concatenate(sides), np.concatenate(shifts)
        # Least squares take the point of an axis nearest to the origin.
        centre = np.linalg.lstsq(left, right, rcond=1e-6)[0]
        if np.abs(left @ centre - right).max() > MAX_CENTRE_ERROR * diameter:
            raise ValueError("leave no common point where it is, so that no model has them all")
        return cls(centre, *_close([motion.rotation for motion in discrete], list(axes)))

    @property
    def is_none(self) -> bool:
        """Whether the identity is the only symmetry."""
        return len(self.rotations) == 1 and not len(self.axes)

    @property
    def is_any_rotation(self) -> bool:
        """Whether every rotation is a symmetry, as of a ball."""
        return len(self.axes) > 1

    @property
    def free_axes(self) -> FloatArray:
        """(k, 3): orthogonal axes of every continuous symmetry."""
        return np.eye(3) if self.is_any_rotation else self.axes

    @property
    def symmetry_axes(self) -> tuple[SymmetryAxis, ...]:
        """Axes with their folds, the finest first."""
        known: list[SymmetryAxis] = []
        for rotation in self.rotations[1:]:
            vector = Rotation.from_matrix(rotation).as_rotvec()
            is_upwards = vector[np.argmax(np.abs(vector))] > 0.0  # along the largest coordinate
            axis = (vector if is_upwards else -vector) / np.linalg.norm(vector)
            for index, other in enumerate(known):
                if abs(axis @ other.axis) > SAME_COSINE:
                    known[index] = SymmetryAxis(other.axis, other.fold + 1)
                    break
            else:
                known.append(SymmetryAxis(axis, 2))
        known.sort(key=lambda other: -other.fold)
        return (*(SymmetryAxis(axis, 0) for axis in self.axes), *known)

    @property
    def words(self) -> str:
        """Text such as ``every turn about (0, 0, 1), half a turn about (1, 0, 0)``, or ""."""
        if self.is_any_rotation:
            return "every rotation"
        return list_names([axis.words for axis in self.symmetry_axes], MAX_NAMED_AXES)

    def transforms(self) -> tuple[RigidTransform, ...]:
        """Return all symmetries, the identity first, continuous ones in steps of ``STEP``."""
        count = math.ceil(math.pi / STEP)
        angles = 2.0 * math.pi / count * np.arange(1, count)
        ways = (Rotation.from_rotvec(angles[:, None] * axis).as_matrix() for axis in self.axes)
        about_axes = np.concatenate([np.eye(3)[None], *ways])
        return tuple(self.as_transform(own @ turn) for turn in about_axes for own in self.rotations)

    def nearest(self, transform: RigidTransform, target: RigidTransform) -> RigidTransform:
        """Return the transform equal to one whose rotation is nearest to the ``target``'s; exact.

        It makes trace(target^T transform S) greatest, where S is a rotation of the symmetry, then
        one by t about the axis a: trace(M R(t)) = a.Ma + (trace M - a.Ma) cos t + trace(M [a]x)
        sin t.
        """
        if self.is_none:
            return transform
        off = target.rotation.T @ transform.rotation
        if self.is_any_rotation:
            is_there = np.abs(off - np.eye(3)).max() < ROUNDING
            return transform if is_there else transform @ self.as_transform(off.T)
        products = off @ self.rotations
        traces = np.trace(products, axis1=1, axis2=2)
        if not len(self.axes):
            index = int(np.argmax(traces))
            return transform @ self.as_transform(self.rotations[index]) if index else transform
        (axis,) = self.axes
        along = np.einsum("i,nij,j->n", axis, products, axis)
        cosines = traces - along
        sines = np.einsum("nij,ji->n", products, np.cross(np.eye(3), axis))
        best = np.argmax(along + np.hypot(cosines, sines))
        angle = math.atan2(sines[best], cosines[best])
        if best == 0 and abs(angle) < ROUNDING:
            return transform
        about_axis = Rotation.from_rotvec(angle * axis).as_matrix()
        return transform @ self.as_transform(self.rotations[best] @ about_axis)

    def nearest_pose(self, pose: Pose, target: Pose) -> Pose:
        """Return the pose equal to one, with its camera, whose rotation is nearest to a target."""
        given = pose.camera_from_model
        nearest = self.nearest(given, target.camera_from_model)
        return pose if nearest is given else replace(pose, camera_from_model=nearest)

    def canonical(self, pose: Pose) -> Pose:
        """Return the one of the equal poses that stands for all of them."""
        return self.nearest_pose(pose, Pose(pose.camera, RigidTransform(REFERENCE, np.zeros(3))))

    def as_transform(self, rotation: FloatArray) -> RigidTransform:
        """Return the motion that is a rotation (3, 3) about the centre."""
        return RigidTransform(rotation, self.centre - rotation @ self.centre)


NO_SYMMETRY = Symmetry(np.zeros(3), np.eye(3)[None], np.zeros((0, 3)))
"""Symmetry of most models: the identity alone."""


def _close(
    rotations: Sequence[FloatArray], axes: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return all products (n, 3, 3) of rotations, and axes (k, 3).

    Raises:
        ValueError: there are too many products.
    """
    group = _products(rotations)
    images: list[FloatArray] = []
    for axis in (rotation @ axis for axis in axes for rotation in group):
        if all(abs(axis @ known) < SAME_COSINE for known in images):
            images.append(axis)
    if len(images) > 1:
        return np.eye(3)[None], np.array(images)
    if images:  # other rotations than about the axis turn it over: with these one will do
        flips = [rotation for rotation in group if images[0] @ rotation @ images[0] < 0.0]
        group = np.array([np.eye(3), *flips[:1]])
    return group, np.reshape(images, (-1, 3))


def _products(rotations: Sequence[FloatArray]) -> FloatArray:
    """Return all products (n, 3, 3), the identity first.

    Raises:
        ValueError: there are too many products.
    """
    products = [np.eye(3)]
    same_trace = 1.0 + 2.0 * SAME_COSINE  # of a rotation by that angle
    for product in products:  # grows meanwhile
        for new in (product @ rotation for rotation in rotations):
            if np.max(np.einsum("nij,ij->n", np.array(products), new)) < same_trace:
                products.append(new)
        if len(products) > MAX_ROTATIONS:
            raise ValueError(
                f"lead to more than {MAX_ROTATIONS} equal poses, so that no turn of them closes"
            )
    return np.array(products)
