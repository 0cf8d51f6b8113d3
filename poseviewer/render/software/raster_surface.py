"""Surfaces laid out for the rasteriser: near faces lie together in memory.

What one face reads of vertices and picture is then in the cache for the next.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.software.rasterise import GRADED, MAPPED


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A mesh's triangles in another order: face f here is face ``order[f]`` of the mesh."""

    order: NDArray[np.int32]
    """(F,): the mesh's index of each face."""
    centre: FloatArray
    """(3,): the middle of the model, in its own frame."""
    vertices: NDArray[np.float32]
    """(3, V) about ``centre``."""
    faces: NDArray[np.int32]
    """(F, 3) indices into ``vertices``."""
    face_texture: NDArray[np.int32]
    """(F,): index of the texture, -1 for none."""
    normals: NDArray[np.float32]
    """(F + 1, 9): at the three corners of each face; a row of zeros at the end."""
    colours: NDArray[np.float32]
    """(F + 1, 3): RGB at the first corner, the colour of the whole face where it does not vary."""
    kinds: NDArray[np.uint8]
    """(F,): PLAIN, GRADED or MAPPED, see ``rasterise``."""
    attributes: NDArray[np.float32]
    """(F + 1, 12): R, G, B, 1 at the three corners of GRADED faces, u, v, 0, 1 of MAPPED ones,
    zeros of others. (1, 12) where all are PLAIN."""


def face_order(mesh: Mesh, seen: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Order faces: ``seen`` (F,) from outside first, which win at the same depth.

    Then they go by the axis that faces look along, then along Morton's curve (1966).
    """
    code = _morton_codes(mesh.vertices[mesh.faces].mean(axis=1))
    return np.lexsort((code, _facing_axes(mesh), ~seen)).astype(np.int32)


def make_surface(mesh: Mesh, order: NDArray[np.int32]) -> Surface:
    """Lay out the faces of a mesh that are in ``order``."""
    corners, texture = mesh.faces[order], np.ascontiguousarray(mesh.face_texture[order])
    used, faces = _number_by_use(corners, len(mesh.vertices))
    colours, uvs = mesh.colours[corners], mesh.uvs[corners]
    graded = np.any(colours != colours[:, :1], axis=(1, 2))
    kinds = np.where(texture >= 0, MAPPED, GRADED * graded).astype(np.uint8)
    attributes = np.zeros((len(kinds) + 1 if kinds.any() else 1, 3, 4), np.float32)
    graded, mapped = np.flatnonzero(kinds == GRADED), np.flatnonzero(kinds == MAPPED)
    attributes[graded, :, :3], attributes[mapped, :, :2] = colours[graded], uvs[mapped]
    attributes[graded, :, 3] = attributes[mapped, :, 3] = 1.0
    normals = np.zeros((len(kinds) + 1, 9), np.float32)
    normals[:-1] = mesh.normals[corners].reshape(-1, 9)
    return Surface(
        order,
        mesh.centre,
        np.ascontiguousarray((mesh.vertices[used] - mesh.centre).astype(np.float32).T),
        faces,
        texture,
        normals,
        np.concatenate([colours[:, 0], np.zeros((1, 3), np.float32)]),
        kinds,
        attributes.reshape(-1, 12),
    )


def _number_by_use(
    faces: NDArray[np.int32], count: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the vertices that faces (F, 3) use, as they come, and the faces in these."""
    _, first = np.unique(faces, return_index=True)
    used = faces.reshape(-1)[np.sort(first)]
    index = np.zeros(count, np.int32)
    index[used] = np.arange(len(used))
    return used, index[faces]


def _facing_axes(mesh: Mesh) -> NDArray[np.int64]:
    """Return (F,): the axis, 0 to 5 for x, y, z, -x, -y, -z, that each face looks along."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    axis = np.argmax(np.abs(normal), axis=1)
    return axis + 3 * (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] < 0.0)


def _morton_codes(points: FloatArray) -> NDArray[np.int64]:
    """Return (N,): places along Morton's curve (10 bits an axis), which keeps near points near."""
    if len(points) == 0:
        return np.zeros(0, np.int64)
    low, extent = points.min(axis=0), np.ptp(points, axis=0).max()
    cells = ((points - low) * (1023.0 / extent if extent > 0.0 else 0.0)).astype(np.int64)
    codes = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            codes |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return codes
