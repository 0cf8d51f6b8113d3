"""Which motions map a mesh onto itself: looked at, and found, by points on its surface.

A motion is a symmetry where nearly all points that it moves come to lie on the surface again, and
on the same colours. Colours are means over a neighbourhood: what is printed tells, noise does not.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import Mesh, kept_lately
from poseviewer.geometry.symmetry import SAME_COSINE, Symmetry, Turn
from poseviewer.geometry.transform import RigidTransform

SAMPLES, ASKED, FIRST_ASKED = 40_000, 2_000, 100
"""Points on the surface, those of them that are moved, and those that are moved first: most motions
are far from a symmetry."""
COLOUR_NEIGHBOURS = 12
"""Points whose mean is the colour of a place: some 2 % of the model's size across."""
NEARLY_ALL = 0.98
"""Share of the points that a symmetry must move well: a spout or a button is more than the rest."""
ASIDE = 0.02
"""Share of the diameter by which a point may lie beside the sample that it is on a level with, as
these are apart themselves: farther off, the surface has ended."""
FOUND_SHAPE, GIVEN_SHAPE = 0.025, 0.06
"""How far from the surface these may come to lie, as shares of the diameter, for a symmetry that is
found, and for one that a file gives: scans of symmetric things come to 0.036, others from 0.066."""
WORSE_SHAPE = (0.005, 0.01)
"""By how much more than the best ones about its axis turns in equal steps, and all turns, may bring
the surface off: a hexagon is nearly round, and turns by sixths all the better."""
SEEN_COLOUR = 0.02
"""Mean difference of colours, of 1, that a photo shows."""
FOUND_COLOUR = 0.5
"""The same as a share of what unrelated points of the surface differ by, where that is more: scans
of symmetric things come to 0.4, things with print on both sides to 0.7 and more."""
MOST_FOLD = 12
"""That is looked for: polygons of more sides are nearly round."""
MOST_FACES, FACE_SHARE = 6, 0.04
"""Directions about which turns are looked for, as so much of the surface or more faces them."""
ROUND_ANGLES = 2.399963 * np.arange(1, 7)
"""The golden angle's multiples, which share no step: what these turns leave as it is, all do."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfacePoints:
    """Points on a mesh, spread evenly."""

    points: FloatArray
    """(n, 3)."""
    normals: FloatArray
    """(n, 3)."""
    colours: FloatArray
    """(n, 3), of their neighbourhoods."""
    tree: KDTree
    diameter: float

    def shape_off(self, motion: RigidTransform) -> float:
        """How far from the surface a motion brings it, but for the worst points: a share of the
        diameter.
        """
        first = self._off(motion, FIRST_ASKED)
        return first if first > 2.0 * GIVEN_SHAPE else self._off(motion, ASKED)

    def has_colours_of(self, motion: RigidTransform) -> bool:
        """Whether the colours go where the motion brings the surface."""
        _, at = self._moved(motion, ASKED)
        own, unrelated = self.colours[:ASKED], self.colours[ASKED : 2 * ASKED]
        seen = max(SEEN_COLOUR, FOUND_COLOUR * float(np.abs(own - unrelated).mean()))
        return float(np.abs(own - self.colours[at]).mean()) <= seen

    def _off(self, motion: RigidTransform, count: int) -> float:
        moved, at = self._moved(motion, count)
        away = moved - self.points[at]
        level = np.abs(np.einsum("nk,nk->n", away, self.normals[at]))
        off = np.maximum(level, np.linalg.norm(away, axis=1) - ASIDE * self.diameter)
        return float(np.quantile(off, NEARLY_ALL)) / self.diameter

    def _moved(self, motion: RigidTransform, count: int) -> tuple[FloatArray, NDArray[np.intp]]:
        """(count, 3): where points come to lie, and the nearest ones there."""
        moved = motion.apply(self.points[:count])
        return moved, self.tree.query(moved)[1]


@kept_lately(4)
def surface_of(mesh: Mesh) -> SurfacePoints:
    """The same points each time."""
    random = np.random.default_rng(0)
    corners, crossed, areas = _triangles(mesh)
    faces = random.choice(len(areas), SAMPLES, p=areas / areas.sum())
    shares = random.dirichlet((1.0, 1.0, 1.0), SAMPLES)
    points = np.einsum("nc,nck->nk", shares, corners[faces])
    tree = KDTree(points)
    near = tree.query(points, COLOUR_NEIGHBOURS)[1]
    colours = _colours(mesh, faces, shares)[near].mean(axis=1)
    return SurfacePoints(points, crossed[faces] / areas[faces, None], colours, tree, mesh.diameter)


def worst_turn(mesh: Mesh, symmetry: Symmetry) -> tuple[str, float]:
    """Of the turns that a symmetry is made of, the one that brings the surface farthest from
    itself: in words, and how far, as a share of the diameter.
    """
    surface = surface_of(mesh)
    found = [
        (max(surface.shape_off(motion) for motion in _motions(symmetry.centre, turn)), turn)
        for turn in symmetry.turns
    ]
    off, turn = max(found, key=lambda one: one[0])
    return turn.words, off


@dataclass(frozen=True, slots=True, eq=False)
class FoundSymmetry:
    """What maps a mesh onto itself."""

    symmetry: Symmetry
    """In shape and colours."""
    of_shape: Symmetry
    """In shape alone."""

    @property
    def text(self) -> str:
        """Half a sentence, without a full stop."""
        both, shape = self.symmetry.words, self.of_shape.words
        if both == shape:
            return f"symmetric by {both}" if both else "no symmetry found"
        return f"{f'symmetric by {both}; ' if both else ''}its colours break {shape} of its shape"


def find_symmetry(mesh: Mesh) -> FoundSymmetry:
    """What maps a mesh onto itself, on the whole surface, within ``FOUND_SHAPE`` and
    ``FOUND_COLOUR``.

    Looked at are turns about the principal axes and those normal to the largest faces, through the
    centroid of the surface: every turn, or one in up to twelve equal steps.
    """
    surface = surface_of(mesh)
    centre, axes = _centroid_and_axes(mesh)
    both: list[Turn] = []
    shape: list[Turn] = []
    for axis in axes:
        turns = [Turn(axis, fold) for fold in (0, *range(MOST_FOLD, 1, -1))]
        off = [max(map(surface.shape_off, _motions(centre, turn))) for turn in turns]
        fitting = [
            turn
            for turn, of_turn in zip(turns, off, strict=True)
            if of_turn <= min(FOUND_SHAPE, min(off) + WORSE_SHAPE[turn.fold == 0])
        ]
        of_both = [
            turn for turn in fitting if all(map(surface.has_colours_of, _motions(centre, turn)))
        ]
        shape = _with_turn(centre, shape, fitting[:1])
        both = _with_turn(centre, both, of_both[:1])
    return FoundSymmetry(Symmetry.from_turns(centre, both), Symmetry.from_turns(centre, shape))


def _with_turn(centre: FloatArray, turns: list[Turn], new: list[Turn]) -> list[Turn]:
    """With what is new, unless all together never close, or in finer steps than are looked for: its
    axis is then nearly another's.
    """
    with suppress(ValueError):
        closed = Symmetry.from_turns(centre, [*turns, *new])
        if all(turn.fold <= MOST_FOLD for turn in closed.turns):
            return [*turns, *new]
    return turns


def _motions(centre: FloatArray, turn: Turn) -> list[RigidTransform]:
    angles = ROUND_ANGLES if turn.fold == 0 else _steps(turn.fold)
    rotations = Rotation.from_rotvec(np.outer(angles, turn.axis)).as_matrix()
    return [RigidTransform(rotation, centre - rotation @ centre) for rotation in rotations]


def _steps(fold: int) -> FloatArray:
    """Angles up to half a turn: farther ones are these, backwards."""
    return np.linspace(0.0, 2.0 * math.pi, fold, endpoint=False)[1 : fold // 2 + 1]


def _centroid_and_axes(mesh: Mesh) -> tuple[FloatArray, list[FloatArray]]:
    """(3,), (3,) each: of the surface, exactly; what its largest faces are normal to, and the
    principal axes.
    """
    corners, crossed, areas = _triangles(mesh)
    sums, weights = corners.sum(axis=1), areas / areas.sum()
    centre = weights @ sums / 3.0
    corners, sums = corners - centre, sums - 3.0 * centre
    # Of a triangle, the integral of x x^T is its area / 12 (sum of c c^T, and s s^T of the sum).
    second = np.einsum("n,nci,ncj->ij", weights, corners, corners)
    second += np.einsum("n,ni,nj->ij", weights, sums, sums)
    normals = np.divide(
        crossed, areas[:, None], out=np.zeros_like(crossed), where=areas[:, None] > 0
    )
    axes, left = [], weights.copy()
    for _ in range(MOST_FACES):
        along = normals @ normals[np.argmax(left)]
        face = (np.abs(along) > SAME_COSINE) & (left > 0.0)
        if left[face].sum() < FACE_SHARE:
            break
        mean = (left[face] * np.sign(along[face])) @ normals[face]
        axes.append(mean / np.linalg.norm(mean))
        left[face] = 0.0
    # Exact ones first: a square prism's principal axes may lie anywhere across its own.
    for axis in np.linalg.eigh(second)[1].T:
        if all(abs(axis @ known) < SAME_COSINE for known in axes):
            axes.append(axis)
    return centre, axes


def _triangles(mesh: Mesh) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(n, 3, 3), (n, 3), (n,): corners, their cross products, and twice the areas."""
    corners = mesh.vertices[mesh.faces]
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return corners, crossed, np.linalg.norm(crossed, axis=1)


def _colours(mesh: Mesh, faces: NDArray[np.intp], shares: FloatArray) -> FloatArray:
    """(n, 3): reflectance at points of faces (n,), by their shares (n, 3) of the corners."""
    corners = mesh.faces[faces]
    colours = np.einsum("nc,nck->nk", shares, mesh.colours[corners].astype(float))
    uvs = np.einsum("nc,nck->nk", shares, mesh.uvs[corners].astype(float))
    for index, texture in enumerate(mesh.textures):
        own = mesh.face_texture[faces] == index
        height, width = texture.shape[:2]
        columns = (uvs[own, 0] % 1.0 * width).astype(int) % width
        rows = ((1.0 - uvs[own, 1]) % 1.0 * height).astype(int) % height
        colours[own] *= texture[rows, columns] / 255.0
    return colours
