"""Symmetry of a mesh, found by turning its surface about axes and comparing it with itself."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import Mesh, hull_points
from poseviewer.geometry.symmetry_group import NO_SYMMETRY, Symmetry, SymmetryAxis

SURFACE_POINTS = 8_000
"""Points of the surface that turned ones are compared with."""
TURNED_POINTS = 1500
"""Points that are turned: a hundredth of the surface has fifteen."""
FIRST_POINTS = 150
"""Points that are turned to tell what is worth a comparison."""
TOLERANCE = 0.01
"""Distance from the surface, in diameters, up to which a turned point lies on it."""
FIRST_TOLERANCE = 0.03
"""``TOLERANCE`` before the axis is refined."""
COLOUR_TOLERANCE = 0.08
"""Difference of reflectance, in [0, 1], up to which colours are the same: scans are noisy."""
MAX_OUTSIDE = 0.01
"""Fraction of the points that may lie off the surface, or have another colour."""
NORMAL_LENGTH = 0.03
"""Length of normals, in diameters, by which the sides of a sheet are told apart."""
COLOUR_NEIGHBOURS = 4
"""Points whose reflectance is averaged, since a texture is finer than ``TOLERANCE``."""
EQUAL_MOMENTS = 0.03
"""Relative difference up to which two second moments are the same."""
FOLDS = (12, 10, 9, 8, 7, 6, 5, 4, 3, 2)
"""Equal steps of a full turn that are looked for; more are a continuous symmetry to the eye."""
ANY_TURN_DEG = (7.0, 17.0, 38.0, 67.0, 103.0)
"""Turns (degrees) that only a continuous symmetry has."""
PLANE_STEP_DEG = 3.0
"""Step (degrees) between axes in a plane."""
SAME_DIRECTION = math.cos(math.radians(5.0))
"""Cosine from which directions lead to the same axis: the axes of no symmetry are as near."""
SNAPPED = math.cos(math.radians(0.5))
"""Cosine of the angle to an axis of the model's frame up to which it is meant."""
MAX_DIRECTIONS = 150
"""Directions of corners and faces that may be axes of a model without a longest side."""
REFINEMENTS = 6
"""Alignments of the turned surface with itself."""
MAX_REFINED = 30
"""Turns that are refined in vain: about any axis a rough ball nearly lies on itself."""


@lru_cache(maxsize=64)
def find_symmetry(mesh: Mesh) -> Symmetry:
    """Find the rotations that map a mesh onto itself, in shape and reflectance, within 1 % of its
    diameter; cached.

    An axis of symmetry is a principal axis of the surface's second moments. Where two moments are
    equal the axis may be any in a plane, where three are, any that leads to a corner or a face.
    """
    surface = _sample(mesh)
    if surface is None:
        return NO_SYMMETRY
    moments, axes = np.linalg.eigh(surface.second_moments)
    low, high = moments[1] - moments[0], moments[2] - moments[1]
    least = EQUAL_MOMENTS * moments[2]
    found: list[SymmetryAxis] = []
    if low > least and high > least:
        found = _axes_among(surface, axes.T, (2,))
    elif low > least or high > least:
        main = axes[:, 2 if high > least else 0]
        found = _axes_among(surface, [main], (0, *FOLDS))
        fold = found[0].fold if found else 1
        found += _axes_among(surface, list(_in_plane(main, fold)), (2,), limit=1)
    elif surface.is_same(Rotation.from_rotvec([1.0, 0.4, -0.7])) and surface.is_same(
        Rotation.from_rotvec([-0.5, 1.1, 0.6])
    ):
        found = [SymmetryAxis(axis, 0) for axis in np.eye(3)[:2]]
    else:
        found = _axes_among(surface, list(_directions(mesh, surface.centre)), (0, 5, 4, 3, 2))
    try:
        symmetry = Symmetry.from_axes(surface.centre, found)
    except ValueError:  # axes that hardly differ from those of a symmetry
        return NO_SYMMETRY
    rotations = Rotation.from_matrix(symmetry.rotations)
    return symmetry if all(map(surface.is_same, rotations)) else NO_SYMMETRY


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """Points of a surface, about its centre and by its diameter."""

    centre: FloatArray
    """(3,): centre of the surface's mass, in the model's frame."""
    second_moments: FloatArray
    """(3, 3)."""
    points: FloatArray
    """(n, 3)."""
    normals: FloatArray
    """(n, 3)."""
    colours: FloatArray
    """(n, 3): averaged over neighbours."""
    tree: KDTree
    """Tree of points and normals."""
    spacing: float

    def is_same(self, turn: Rotation) -> bool:
        """Whether a turned surface lies on itself, with the same colours."""
        if self._apart(turn, FIRST_POINTS)[0] > FIRST_TOLERANCE:
            return False
        distance, colour = self._apart(turn, TURNED_POINTS)
        return distance <= TOLERANCE and colour <= COLOUR_TOLERANCE

    def refine(self, turn: Rotation) -> Rotation | None:
        """Align the turned surface with itself; None: it is another."""
        if self._apart(turn, FIRST_POINTS)[0] > FIRST_TOLERANCE:
            return None
        some = self.points[:TURNED_POINTS]
        for _ in range(REFINEMENTS):
            nearest = self.points[self._nearest(turn, TURNED_POINTS)[1]]
            turn = Rotation.align_vectors(nearest, some)[0]
        return turn

    def _nearest(self, turn: Rotation, count: int) -> tuple[FloatArray, NDArray[np.intp]]:
        points, normals = turn.apply(self.points[:count]), turn.apply(self.normals[:count])
        _, index = self.tree.query(np.hstack([points, NORMAL_LENGTH * normals]))
        return points, np.asarray(index)

    def _apart(self, turn: Rotation, count: int) -> tuple[float, float]:
        """Distance and difference of colour that ``MAX_OUTSIDE`` of the points exceed."""
        points, index = self._nearest(turn, count)
        off = points - self.points[index]
        across = np.abs(np.einsum("ni,ni->n", off, self.normals[index]))
        beside = np.linalg.norm(off, axis=1) - 3.0 * self.spacing
        colour = np.abs(self.colours[:count] - self.colours[index]).max(axis=1)
        distance = np.maximum(across, beside)
        most = 1.0 - MAX_OUTSIDE
        return float(np.quantile(distance, most)), float(np.quantile(colour, most))


def _sample(mesh: Mesh) -> _Surface | None:
    """Sample a surface evenly, the same each time; None: it has no area."""
    corners = mesh.vertices[mesh.faces]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    total, size = float(areas.sum()), mesh.diameter
    if not (total > 0.0 and size > 0.0 and math.isfinite(total)):
        return None
    centre = areas @ corners.mean(axis=1) / total
    corners = (corners - centre) / size
    sums = corners.sum(axis=1)
    outer = np.einsum("fki,fkj->fij", corners, corners) + np.einsum("fi,fj->fij", sums, sums)
    random = np.random.default_rng(0)
    # Evenly in area, in a random order, since the first points stand for all.
    at = (np.arange(SURFACE_POINTS) + random.random(SURFACE_POINTS)) / SURFACE_POINTS
    chosen = np.searchsorted(np.cumsum(areas) / total, at).clip(0, len(areas) - 1)
    chosen = random.permutation(chosen)
    u, v = random.random((2, SURFACE_POINTS))
    root = np.sqrt(u)
    shares = np.stack([1.0 - root, root * (1.0 - v), root * v], axis=1)
    points = np.einsum("nk,nki->ni", shares, corners[chosen])
    across = np.cross(
        corners[chosen, 1] - corners[chosen, 0], corners[chosen, 2] - corners[chosen, 0]
    )
    normals = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    tree = KDTree(np.hstack([points, NORMAL_LENGTH * normals]))
    colours = _colours(mesh, chosen, shares)
    if np.ptp(colours, axis=0).max() > 0.0:
        colours = colours[tree.query(tree.data, COLOUR_NEIGHBOURS)[1]].mean(axis=1)
    spacing = math.sqrt(total / size**2 / SURFACE_POINTS)
    moments = np.einsum("f,fij->ij", areas, outer) / (12.0 * total)
    return _Surface(centre, moments, points, normals, colours, tree, spacing)


def _colours(mesh: Mesh, faces: NDArray[np.intp], shares: FloatArray) -> FloatArray:
    """Reflectance (n, 3) of points of faces, given by their shares (n, 3) of the corners."""
    corners = mesh.faces[faces]
    colours = np.einsum("nk,nki->ni", shares, mesh.colours[corners].astype(float))
    uvs = np.einsum("nk,nki->ni", shares, mesh.uvs[corners].astype(float)) % 1.0
    for index, texture in enumerate(mesh.textures):
        own = mesh.face_texture[faces] == index
        height, width = texture.shape[:2]
        column = np.minimum((uvs[own, 0] * width).astype(int), width - 1)
        row = np.minimum(((1.0 - uvs[own, 1]) * height).astype(int), height - 1)
        colours[own] *= texture[row, column] / 255.0
    return colours


def _axes_among(
    surface: _Surface, directions: list[FloatArray] | FloatArray, folds: tuple[int, ...],
    limit: int | None = None,
) -> list[SymmetryAxis]:  # fmt: skip
    """Find which directions are axes, each with its finest fold; 0: of every turn."""
    found: list[SymmetryAxis] = []
    left = MAX_REFINED
    for direction in directions:
        for fold in folds:
            if any(abs(direction @ known.axis) > SAME_DIRECTION for known in found):
                break
            if fold == 0:
                axis = _snap(direction)
                turns = [Rotation.from_rotvec(np.radians(t) * axis) for t in ANY_TURN_DEG]
                if all(map(surface.is_same, turns)):
                    found.append(SymmetryAxis(axis, 0))
                continue
            turn = surface.refine(Rotation.from_rotvec(2.0 * math.pi / fold * direction))
            vector = np.zeros(3) if turn is None else turn.as_rotvec()
            if vector.any():
                axis = vector / np.linalg.norm(vector)
                axis = _snap(axis if axis @ direction > 0.0 else -axis)
                if surface.is_same(Rotation.from_rotvec(2.0 * math.pi / fold * axis)):
                    found.append(SymmetryAxis(axis, fold))
                else:
                    left -= 1
        if left <= 0 or (limit is not None and len(found) >= limit):
            break
    return found


def _snap(axis: FloatArray) -> FloatArray:
    """Return the frame's own axis that is next to an axis, where it is very near."""
    index = np.argmax(np.abs(axis))
    own = np.sign(axis[index]) * np.eye(3)[index]
    return own if axis @ own > SNAPPED else axis


def _in_plane(normal: FloatArray, fold: int) -> Iterator[FloatArray]:
    """Directions in the plane across an axis, of which its fold makes all others."""
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    end = 180.0 / fold if fold else PLANE_STEP_DEG
    for degrees in np.arange(0.0, end, PLANE_STEP_DEG):
        yield Rotation.from_rotvec(degrees * normal, degrees=True).apply(first)


def _directions(mesh: Mesh, centre: FloatArray) -> Iterator[FloatArray]:
    """Directions of faces' normals, of the hull's corners and of its edges' middles."""
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = normals[np.argsort(-np.linalg.norm(normals, axis=1))][: 4 * MAX_DIRECTIONS]
    hull = hull_points(mesh) - centre
    known: list[FloatArray] = []
    for vector in chain(normals, hull):
        length = np.linalg.norm(vector)
        direction = vector / max(length, 1e-30)
        if length > 0.0 and all(abs(direction @ other) < SAME_DIRECTION for other in known):
            known.append(direction)
            yield direction
        if len(known) >= MAX_DIRECTIONS:
            return
