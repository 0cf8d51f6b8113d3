"""The same surface in more triangles: for measuring what triangles cost."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import find_adjacency, weld

Halves = tuple[NDArray[np.int64], NDArray[np.int64]]


def subdivide(mesh: Mesh, faces: int) -> Mesh:
    """The mesh in ``faces`` triangles, or one or two more, by cutting the longest edges in half.

    The surface, its reflectance and its normals stay what they are. Only edges that are the
    longest of all faces they belong to are cut, with all of these faces: no vertex comes to lie on
    another face's edge, and triangles keep their shape (Rivara, 1984). A mesh that has as many
    faces or more is returned as it is.
    """
    while len(mesh.faces) < faces:
        mesh = _cut(mesh, _edges_to_cut(mesh, faces - len(mesh.faces)))
    return mesh


@dataclass(frozen=True, slots=True)
class _Edges:
    """Half-edges to be cut; each face has one at most. ``3 f + i`` runs from corner i of face f."""

    first: NDArray[np.int64]
    """(N,): of each edge."""
    second: NDArray[np.int64]
    """(N,): the same edge in the other face, -1 where there is none."""


def _edges_to_cut(mesh: Mesh, wanted: int) -> _Edges:
    """The longest of those edges that no longer one shares a face with, to add ``wanted`` faces."""
    rank, other = _half_edges(mesh)
    longest = 3 * np.arange(len(mesh.faces)) + np.argmax(rank.reshape(-1, 3), axis=1)
    is_longest = np.zeros(len(rank), bool)
    is_longest[longest] = True
    partner = other[longest]
    # Each edge once: by the lower of its two half-edges.
    kept = (partner < 0) | (is_longest[partner] & (longest < partner))
    first, second = longest[kept], partner[kept]
    order = np.argsort(-rank[first])
    adds = np.cumsum(1 + (second[order] >= 0))
    count = min(int(np.searchsorted(adds, wanted)) + 1, len(order))
    return _Edges(first[order[:count]], second[order[:count]])


def _half_edges(mesh: Mesh) -> Halves:
    """(3 F,): rank by length, the same for both halves of an edge, and the other half, or -1."""
    places = weld(mesh.vertices)
    faces = places[mesh.faces]
    points = np.empty((int(places.max()) + 1, 3))
    points[places] = mesh.vertices
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    lengths = np.sum((points[high] - points[low]) ** 2, axis=1)
    # Equal lengths must have an order too, the same in all faces, or no edge might be the longest.
    rank = np.empty(len(lengths), np.int64)
    order = np.lexsort((high, low, lengths))
    changes = np.any(np.diff(np.stack([low, high])[:, order], axis=1) != 0, axis=0)
    rank[order] = np.concatenate([[0], np.cumsum(changes)])
    other = np.full(len(lengths), -1)
    adjacency = find_adjacency(faces)
    other[adjacency.first], other[adjacency.second] = adjacency.second, adjacency.first
    return rank, other


def _cut(mesh: Mesh, edges: _Edges) -> Mesh:
    """Every face of the edges in two; where normals differ beside an edge, both sides get a vertex
    of their own.
    """
    half = np.concatenate([edges.first, edges.second[edges.second >= 0]])
    face, at = half // 3, half % 3
    a, b, c = (mesh.faces[face, (at + i) % 3] for i in range(3))
    ends, middle = np.unique(np.sort(np.stack([a, b], axis=1)), axis=0, return_inverse=True)
    middle = len(mesh.vertices) + middle.ravel()
    kept = np.array(mesh.faces)
    kept[face] = np.stack([a, middle, c], axis=1)
    return replace(
        mesh,
        vertices=_with_means(mesh.vertices, ends),
        faces=np.concatenate([kept, np.stack([middle, b, c], axis=1)]),
        normals=_unit(_with_means(mesh.normals, ends), mesh.normals[ends[:, 0]]),
        colours=_with_means(mesh.colours, ends),
        uvs=_with_means(mesh.uvs, ends),
        face_texture=np.concatenate([mesh.face_texture, mesh.face_texture[face]]),
        face_part=np.concatenate([mesh.face_part, mesh.face_part[face]]),
    )


def _with_means(values: NDArray, ends: NDArray) -> NDArray:
    """(V + N, k): ``values`` (V, k), and their means over the pairs ``ends`` (N, 2)."""
    return np.concatenate([values, 0.5 * (values[ends[:, 0]] + values[ends[:, 1]])])


def _unit(normals: FloatArray, fallback: FloatArray) -> FloatArray:
    """(V + N, 3): the last N made of unit length; where they cancel out, the ``fallback``."""
    made = normals[-len(fallback) :]
    length = np.linalg.norm(made, axis=1, keepdims=True)
    made[:] = np.where(length > 1e-9, made / np.maximum(length, 1e-9), fallback)
    return normals
