"""The same surface in fewer triangles."""

from __future__ import annotations

from dataclasses import replace

import fast_simplification
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import crease_normals, weld


def simplify(mesh: Mesh, faces: int) -> Mesh:
    """The mesh in about so many ``faces``, by collapsing edges where the shape changes least.

    Reflectance is that of the nearest vertex, parts those of the nearest face; normals are made
    anew. A mesh that has no more faces than wanted is returned as it is. Quadric error metrics
    (Garland and Heckbert, 1997).

    Raises:
        ValueError: fewer than one face is wanted.
    """
    if faces < 1:
        raise ValueError(f"a mesh of {faces} faces; wanted 1 or more")
    if len(mesh.faces) <= faces:
        return mesh
    places = weld(mesh.vertices)
    _, first = np.unique(places, return_index=True)
    points, triangles = fast_simplification.simplify(
        mesh.vertices[first], places[mesh.faces].astype(np.int32), target_count=faces
    )[:2]
    source, corners, normals = crease_normals(points, triangles)
    vertices = points[source]
    nearest = KDTree(mesh.vertices).query(vertices)[1]
    part = KDTree(_centres(mesh.vertices, mesh.faces)).query(_centres(points, triangles))[1]
    return replace(
        mesh,
        vertices=vertices,
        faces=corners,
        normals=normals,
        colours=mesh.colours[nearest],
        uvs=mesh.uvs[nearest],
        face_texture=mesh.face_texture[part],
        face_part=mesh.face_part[part],
    )


def _centres(vertices: NDArray, faces: NDArray) -> NDArray:
    return vertices[faces].mean(axis=1)
