"""Normals of a triangle surface: winding made consistent, smooth flanks, sharp edges.

All is computed on *welded* corners (vertices at the same point count as one), so that a seam of
the texture or of two parts does not show in the shading.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from poseviewer.geometry.arrays import FloatArray

CREASE_ANGLE_RAD = math.radians(40.0)
"""Edges bent by more than this stay sharp: boxes keep theirs, the flanks of a car are smooth."""


@dataclass(frozen=True, slots=True, eq=False)
class Adjacency:
    """Pairs of half-edges ``3 f + i``, corner ``i`` to ``(i + 1) % 3``, of edges with two faces."""

    first: NDArray[np.int64]
    """(P,) a half-edge."""
    second: NDArray[np.int64]
    """(P,) the half-edge of the other face."""
    same_direction: NDArray[np.bool_]
    """(P,) whether both run the same way: then the two faces are wound differently."""
    open_faces: NDArray[np.bool_]
    """(F,) whether an edge of the face has one face only, or more than two."""


def weld(vertices: FloatArray) -> NDArray[np.int64]:
    """Return (V,): an index of the point at which each vertex (V, 3) lies."""
    order = np.lexsort(vertices.T)
    ordered = vertices.T[:, order]
    is_new = np.any(ordered[:, 1:] != ordered[:, :-1], axis=0)
    welded = np.empty(len(vertices), dtype=np.int64)
    welded[order] = np.concatenate([[0], np.cumsum(is_new)])
    return welded


def face_normals_and_areas(vertices: FloatArray, faces: NDArray) -> tuple[FloatArray, FloatArray]:
    """Return unit normals (F, 3), on the counter-clockwise side, and areas (F,); 0 without area."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    double_area = np.linalg.norm(cross, axis=1)
    normals = cross / np.where(double_area > 0.0, double_area, 1.0)[:, None]
    return normals, 0.5 * double_area


def find_adjacency(faces: NDArray) -> Adjacency:
    """Find the half-edges of faces (F, 3) of welded corners that meet."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    key = low.astype(np.int64) * (int(high.max(initial=0)) + 1) + high
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    bounds = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1], [True]]))
    pairs = bounds[:-1][np.diff(bounds) == 2]
    first, second = order[pairs], order[pairs + 1]
    is_open = np.ones(len(key), dtype=bool)
    is_open[first] = is_open[second] = False
    open_faces = np.any(is_open.reshape(-1, 3), axis=1)
    return Adjacency(first, second, start[first] == start[second], open_faces)


def faces_to_flip(vertices: FloatArray, faces: NDArray) -> NDArray[np.bool_]:
    """Return (F,): the faces to flip so that closed pieces are wound outwards, open ones alike."""
    if not len(faces):
        return np.zeros(0, dtype=bool)
    adjacency = find_adjacency(weld(vertices)[faces])
    a, b = adjacency.first // 3, adjacency.second // 3
    pieces, piece = connected_components(_links(a, b, len(faces)), directed=False)
    flip = _parity_from_root(a, b, adjacency.same_direction, piece)
    closed = np.ones(pieces, dtype=bool)
    closed[piece[adjacency.open_faces]] = False
    # Whole pieces, too: closed ones that are inside out, and open ones where that flips less area.
    sign = np.where(flip, -1.0, 1.0)
    a, b, c = (vertices[faces[:, i]] - vertices.mean(axis=0) for i in range(3))
    volume = np.bincount(piece, sign * np.einsum("ij,ij->i", a, np.cross(b, c)), pieces)
    area = np.bincount(piece, sign * face_normals_and_areas(vertices, faces)[1], pieces)
    return flip ^ (np.where(closed, volume, area) < 0.0)[piece]


def _links(a: NDArray, b: NDArray, count: int) -> coo_array:
    """Return the graph (count, count) whose edges join ``a`` and ``b``."""
    return coo_array((np.ones(len(a), np.int8), (a, b)), shape=(count, count))


def _parity_from_root(a: NDArray, b: NDArray, differs: NDArray, piece: NDArray) -> NDArray:
    """Return (F,): whether a face differs from its piece's first, by pointer doubling on a tree."""
    count, first = len(piece), np.unique(piece, return_index=True)[1]
    to_root = np.concatenate([a, first]), np.concatenate([b, np.full(len(first), count)])
    tree = _links(*to_root, count + 1).tocsr()
    ancestor = breadth_first_order(tree, count, directed=False)[1]
    ancestor[count] = count
    parity = np.zeros(count + 1, dtype=bool)
    parity[a[ancestor[a] == b]] = differs[ancestor[a] == b]
    parity[b[ancestor[b] == a]] = differs[ancestor[b] == a]
    while np.any(ancestor != count):
        parity ^= parity[ancestor]
        ancestor = ancestor[ancestor]
    return parity[:count]


def crease_normals(
    vertices: FloatArray, faces: NDArray
) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Average face normals by the corners' angles, sharp at creases (Thuermer, Wuethrich 1998).

    Returns:
        The given vertex of each new one (N,), faces (F, 3), unit normals (N, 3).
    """
    face_normals, _ = face_normals_and_areas(vertices, faces)
    fan = _smooth_fans(find_adjacency(weld(vertices)[faces]), face_normals)
    fans = int(fan.max(initial=-1)) + 1
    weighted = corner_angles(vertices, faces)[:, :, None] * face_normals[:, None, :]
    weighted = weighted.reshape(-1, 3)
    sums = np.stack([np.bincount(fan, weighted[:, i], fans) for i in range(3)], axis=1)
    key = faces.ravel().astype(np.int64) * fans + fan
    _, corner, new_faces = np.unique(key, return_index=True, return_inverse=True)
    normals = sums[fan[corner]]
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    # A fan that cancels out (a fold) keeps the normal of one of its faces.
    normals = np.where(length > 1e-9, normals / np.maximum(length, 1e-9), face_normals[corner // 3])
    return faces.ravel()[corner].astype(np.int64), new_faces.reshape(-1, 3), normals


def corner_angles(vertices: FloatArray, faces: NDArray) -> FloatArray:
    """Return the angles (F, 3) of the triangles, radians."""
    corners = vertices[faces]
    ahead = np.roll(corners, -1, axis=1) - corners
    length = np.linalg.norm(ahead, axis=2, keepdims=True)
    ahead = ahead / np.where(length > 0.0, length, 1.0)
    cosine = -np.einsum("fij,fij->fi", ahead, np.roll(ahead, 1, axis=1))
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def _smooth_fans(adjacency: Adjacency, face_normals: FloatArray) -> NDArray:
    """Return (3 F,): the index of each corner's fan, corners that smooth edges join."""
    a, b = adjacency.first, adjacency.second
    bend = np.einsum("ij,ij->i", face_normals[a // 3], face_normals[b // 3])
    smooth = (bend >= math.cos(CREASE_ANGLE_RAD)) & ~adjacency.same_direction
    a, b = a[smooth], b[smooth]
    next_a, next_b = (corner - corner % 3 + (corner + 1) % 3 for corner in (a, b))
    ends = np.concatenate([a, next_a]), np.concatenate([next_b, b])
    return connected_components(_links(*ends, 3 * len(face_normals)), directed=False)[1]
