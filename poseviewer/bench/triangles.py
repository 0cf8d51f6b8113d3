"""The bundled car in any number of triangles, to measure what triangles cost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, KDTree

from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import crease_normals, find_adjacency, weld, winding_to_flip
from poseviewer.render.pyramid.simplified import simplify

MOST_TOO_MANY = 1.1
"""A simplified model with more than this many times the triangles wanted is not taken."""


def in_triangles(mesh: Mesh, triangles: int) -> Mesh:
    """The mesh in about ``triangles`` triangles: simplified, or subdivided on the same surface.

    A model of a hundred parts cannot be simplified to a thousand triangles; its hull then stands
    for it.
    """
    if len(mesh.faces) <= triangles:
        return subdivide(mesh, triangles)
    smaller = simplify(mesh, triangles)
    if len(smaller.faces) <= MOST_TOO_MANY * triangles:
        return smaller
    return subdivide(simplify(_convex_hull(mesh), triangles), triangles)


def _convex_hull(mesh: Mesh) -> Mesh:
    """In the colours of the mesh's nearest vertices."""
    hull = ConvexHull(mesh.vertices)
    places = np.full(len(mesh.vertices), -1)
    places[hull.vertices] = np.arange(len(hull.vertices))
    points, faces = mesh.vertices[hull.vertices], places[hull.simplices]
    flip = winding_to_flip(points, faces)
    faces[flip] = faces[flip][:, ::-1]
    source, faces, normals = crease_normals(points, faces)
    nearest = KDTree(mesh.vertices).query(points[source])[1]
    return replace(
        mesh,
        vertices=points[source],
        faces=faces,
        normals=normals,
        colours=mesh.colours[nearest],
        uvs=mesh.uvs[nearest],
        face_texture=np.full(len(faces), -1),
        face_part=np.zeros(len(faces), np.int32),
    )


def subdivide(mesh: Mesh, faces: int) -> Mesh:
    """The mesh in ``faces`` triangles, or one or two more, by cutting the longest edges in half.

    Surface, reflectance and normals stay what they are. An edge is cut only where it is the longest
    of all its faces, together with all of them: no vertex comes to lie on another face's edge, and
    triangles keep their shape (Rivara, 1984). A mesh that has as many faces is returned as it is.
    """
    while len(mesh.faces) < faces:
        mesh = _cut(mesh, *_edges_to_cut(mesh, faces - len(mesh.faces)))
    return mesh


def _edges_to_cut(mesh: Mesh, wanted: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The longest of the edges that are the longest of their faces, to add ``wanted`` faces.

    Each as its two half-edges (N,), the second -1 where there is none; ``3 f + i`` runs from corner
    i of face f.
    """
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
    return first[order[:count]], second[order[:count]]


def _half_edges(mesh: Mesh) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
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


def _cut(mesh: Mesh, first: NDArray[np.int64], second: NDArray[np.int64]) -> Mesh:
    """Both faces of each edge in two; where normals differ across an edge, each side gets a vertex
    of its own.
    """
    half = np.concatenate([first, second[second >= 0]])
    face, at = half // 3, half % 3
    a, b, c = (mesh.faces[face, (at + i) % 3] for i in range(3))
    ends, middle = np.unique(np.sort(np.stack([a, b], axis=1)), axis=0, return_inverse=True)
    middle = len(mesh.vertices) + middle.ravel()
    kept = np.array(mesh.faces)
    kept[face] = np.stack([a, middle, c], axis=1)

    def with_means(values: NDArray) -> NDArray:
        return np.concatenate([values, 0.5 * (values[ends[:, 0]] + values[ends[:, 1]])])

    normals = with_means(mesh.normals)
    made = normals[len(mesh.normals) :]
    length = np.linalg.norm(made, axis=1, keepdims=True)
    # Opposite normals have no mean: the first is taken.
    made[:] = np.where(length > 1e-9, made / np.maximum(length, 1e-9), mesh.normals[ends[:, 0]])
    return replace(
        mesh,
        vertices=with_means(mesh.vertices),
        faces=np.concatenate([kept, np.stack([middle, b, c], axis=1)]),
        normals=normals,
        colours=with_means(mesh.colours),
        uvs=with_means(mesh.uvs),
        face_texture=np.concatenate([mesh.face_texture, mesh.face_texture[face]]),
        face_part=np.concatenate([mesh.face_part, mesh.face_part[face]]),
    )
