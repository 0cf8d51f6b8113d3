"""Finer faces of a triangle surface, without gaps: long edges are halved in all faces that meet."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import weld

Lengths = Callable[[FloatArray, FloatArray, NDArray[np.int64]], FloatArray]
"""Function of the ends (n, 3) of n edges and of the given face (n,) that each belongs to; returns
their lengths (n,), by which the longest are halved until none is above 1."""


def halve_edges(mesh: Mesh, lengths: Lengths, max_faces: int) -> tuple[Mesh, NDArray[np.int64]]:
    """Halve edges until none is longer than 1, or a further round would leave too many faces.

    Args:
        mesh: the surface.
        lengths: measures edges.
        max_faces: number of faces from which on none is divided.

    Returns:
        The finer mesh, and the given face (F,) that each of its faces is a part of.
    """
    origin = np.arange(len(mesh.faces))
    while len(mesh.faces) < max_faces:
        start, end = mesh.faces, np.roll(mesh.faces, -1, axis=1)
        ends = (mesh.vertices[corners.ravel()] for corners in (start, end))
        is_long = lengths(*ends, np.repeat(origin, 3)) > 1.0
        # An edge has the same ends in all faces that meet in it, whatever their order.
        points = weld(mesh.vertices)
        is_long = _anywhere(points[start].ravel(), points[end].ravel(), is_long).reshape(-1, 3)
        if not is_long.any():
            break
        if len(mesh.faces) + np.count_nonzero(is_long) > max_faces:
            break
        mesh, parent = _halve(mesh, is_long)
        origin = origin[parent]
    return mesh, origin


def _anywhere(
    one: NDArray[np.int64], other: NDArray[np.int64], flags: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """(n,): whether any of the edges between the same two points has the flag."""
    key = np.minimum(one, other) * (int(max(one.max(), other.max())) + 1) + np.maximum(one, other)
    return np.isin(key, key[flags])


def _halve(mesh: Mesh, is_long: NDArray[np.bool_]) -> tuple[Mesh, NDArray[np.int64]]:
    """Halve the edges ``is_long`` (F, 3), corner i to i + 1, of faces."""
    start, end = mesh.faces, np.roll(mesh.faces, -1, axis=1)
    low, high = np.minimum(start, end)[is_long], np.maximum(start, end)[is_long]
    pairs, index = np.unique(low.astype(np.int64) * len(mesh.vertices) + high, return_inverse=True)
    ends = np.divmod(pairs, len(mesh.vertices))
    middle = np.full(is_long.shape, -1, np.int64)
    middle[is_long] = len(mesh.vertices) + index
    count, faces, parents = is_long.sum(axis=1), [], []
    for halved, begin, pieces in PIECES:
        for turn in range(3 if halved in (1, 2) else 1):
            chosen = np.flatnonzero((count == halved) & (is_long[:, turn] == begin))
            if halved == 2:
                chosen = np.flatnonzero((count == 2) & ~is_long[:, (turn + 2) % 3])
            corners = np.hstack(
                [
                    np.roll(mesh.faces[chosen], -turn, axis=1),
                    np.roll(middle[chosen], -turn, axis=1),
                ]
            )
            faces += [corners[:, piece] for piece in pieces]
            parents += [chosen] * len(pieces)
    values = {}
    for name in ("vertices", "normals", "colours", "uvs"):
        own = getattr(mesh, name)
        values[name] = np.concatenate([own, 0.5 * (own[ends[0]] + own[ends[1]])])
    normals = values["normals"]
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    values["normals"] = normals / np.where(length > 0.0, length, 1.0)
    parent = np.concatenate(parents)
    of_faces = {name: getattr(mesh, name)[parent] for name in ("face_texture", "face_part")}
    return replace(mesh, faces=np.concatenate(faces), **values, **of_faces), parent


PIECES = (
    (0, False, ((0, 1, 2),)),
    (1, True, ((0, 3, 2), (3, 1, 2))),
    (2, True, ((3, 1, 4), (0, 3, 4), (0, 4, 2))),
    (3, True, ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))),
)
"""Pieces of a face by how many of its edges are halved: of corners 0 to 2, and 3 to 5, the middles
after each. The first edges are the halved ones."""
