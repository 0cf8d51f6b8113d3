"""The surface laid out for the rasteriser: faces that are near one another lie together.

Faces stand in clusters of ``CLUSTER_FACES``, each with its own copy of its vertices: a cluster
that is hidden or outside the picture is left without looking at what is in it, and what is seen
lies close together in memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.software.kernel_blocks import GRADED, MAPPED
from poseviewer.render.software.kernel_visibility import CLUSTER_BITS

CLUSTER_FACES = 1 << CLUSTER_BITS
BOX_MARGIN = 1e-6  # vertices are projected in float32


@dataclass(frozen=True, slots=True, eq=False)
class ClusteredSurface:
    """A mesh's triangles in another order: face f here is face ``order[f]`` of the mesh.

    Cluster c has the faces from ``c * CLUSTER_FACES`` on; the last one may have fewer.
    """

    order: NDArray[np.int32]
    """(F,): the mesh's index of each face."""
    centre: FloatArray
    """(3,): the middle of the model, in its own frame."""
    vertices: NDArray[np.float32]
    """(3, V) about ``centre``; those shared by clusters stand once in each."""
    faces: NDArray[np.int32]
    """(F, 3) indices into ``vertices``."""
    cluster_start: NDArray[np.int32]
    """(C + 1,): where the vertices of each cluster begin."""
    cluster_box: FloatArray
    """(C, 6): middle and half extent of each cluster's bounding box."""
    vertex_data: NDArray[np.float32]
    """(V, 8): normal, RGB, UV."""
    face_texture: NDArray[np.int32]
    """(F,): index of the texture, -1 for none."""
    corners: NDArray[np.float32]
    """(F + 1, 9): the normals at the three corners of each face; a row of zeros at the end."""
    colours: NDArray[np.float32]
    """(F + 1, 3): RGB at the first corner, the colour of the whole face where it does not vary."""
    kinds: NDArray[np.uint8]
    """(F,): what a face's reflectance is told by, see ``kernel_blocks``."""
    paint: NDArray[np.float32]
    """(F + 1, 12): of GRADED faces R, G, B, 1 at the three corners, of MAPPED ones u, v, 0, 1; of
    others zeros. (1, 12) where there are none."""


def make_clusters(mesh: Mesh, seen: NDArray[np.bool_]) -> ClusteredSurface:
    """Cluster the mesh; the faces ``seen`` (F,) come first and do not mix with the others."""
    place = _along_curve(mesh.vertices[mesh.faces].mean(axis=1))
    order = np.lexsort((place, _direction(mesh), ~seen)).astype(np.int32)
    faces = mesh.faces[order]
    cluster = np.repeat(np.arange(len(faces)) >> CLUSTER_BITS, 3)
    key = cluster * len(mesh.vertices) + faces.reshape(-1)
    unique, local = np.unique(key, return_inverse=True)
    source = unique % max(len(mesh.vertices), 1)
    count = -(-len(faces) // CLUSTER_FACES)
    start = np.searchsorted(unique, np.arange(count + 1) * len(mesh.vertices))
    centre = mesh.centre
    vertices = (mesh.vertices[source] - centre).astype(np.float32)
    low = np.minimum.reduceat(vertices, start[:-1]) if count else np.zeros((0, 3))
    high = np.maximum.reduceat(vertices, start[:-1]) if count else np.zeros((0, 3))
    half = 0.5 * (high - low) + BOX_MARGIN * mesh.diameter
    data: Any = np.concatenate([mesh.normals, mesh.colours, mesh.uvs], axis=1)
    colours = mesh.colours[faces]
    kinds = _kinds(colours, mesh.face_texture[order])
    return ClusteredSurface(
        order,
        centre,
        np.ascontiguousarray(vertices.T),
        local.reshape(-1, 3).astype(np.int32),
        start.astype(np.int32),
        np.concatenate([0.5 * (low + high), half], axis=1).astype(float),
        data[source].astype(np.float32),
        np.ascontiguousarray(mesh.face_texture[order]),
        np.concatenate([mesh.normals[faces].reshape(-1, 9), np.zeros((1, 9))]).astype(np.float32),
        np.concatenate([colours[:, 0], np.zeros((1, 3), np.float32)]),
        kinds,
        _paint(kinds, colours, mesh.uvs[faces]),
    )


def _kinds(colours: NDArray[np.float32], textures: NDArray[np.int32]) -> NDArray[np.uint8]:
    """(F,) of the colours (F, 3, 3) at faces' corners and their textures (F,)."""
    graded, mapped = np.any(colours != colours[:, :1], axis=(1, 2)), textures >= 0
    return (GRADED * graded + MAPPED * mapped).astype(np.uint8)


def _paint(
    kinds: NDArray[np.uint8], colours: NDArray[np.float32], uvs: NDArray[np.float32]
) -> NDArray[np.float32]:
    if not kinds.any():
        return np.zeros((1, 12), np.float32)
    paint = np.zeros((len(kinds) + 1, 3, 4), np.float32)
    graded, mapped = np.flatnonzero(kinds == GRADED), np.flatnonzero(kinds == MAPPED)
    paint[graded, :, :3], paint[mapped, :, :2] = colours[graded], uvs[mapped]
    paint[graded, :, 3] = paint[mapped, :, 3] = 1.0
    return paint.reshape(-1, 12)


def _direction(mesh: Mesh) -> NDArray[np.int64]:
    """(F,): the axis, 0 to 5 for x, y, z, -x, -y, -z, that each face looks along most nearly."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    axis = np.argmax(np.abs(normal), axis=1)
    return axis + 3 * (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] < 0.0)


def _along_curve(points: FloatArray) -> NDArray[np.int64]:
    """(N,): places of points (N, 3) along Morton's curve (10 bits an axis), which keeps what is
    near together (G. M. Morton, 1966).
    """
    if len(points) == 0:
        return np.zeros(0, np.int64)
    low, extent = points.min(axis=0), np.ptp(points, axis=0).max()
    cells = ((points - low) * (1023.0 / extent if extent > 0.0 else 0.0)).astype(np.int64)
    place = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            place |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return place
