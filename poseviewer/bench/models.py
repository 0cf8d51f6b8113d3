"""The bundled car in as many triangles as are wanted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import ConvexHull, KDTree

from poseviewer.bench.subdivided import subdivide
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import crease_normals, winding_to_flip
from poseviewer.render.pyramid.simplified import simplify

MOST_TOO_MANY = 1.1
"""A simplified model with more than this many times the triangles wanted is not taken."""


def in_triangles(mesh: Mesh, triangles: int) -> Mesh:
    """The mesh in about so many triangles: simplified, or cut up with the same surface.

    A model of a hundred parts cannot be had in a thousand triangles; its hull then stands for it.
    """
    if len(mesh.faces) <= triangles:
        return subdivide(mesh, triangles)
    smaller = simplify(mesh, triangles)
    if len(smaller.faces) <= MOST_TOO_MANY * triangles:
        return smaller
    return _hull_in(mesh, triangles)


def _hull_in(mesh: Mesh, triangles: int) -> Mesh:
    """The convex hull, in the colours of the mesh's nearest vertices."""
    hull = ConvexHull(mesh.vertices)
    places = np.full(len(mesh.vertices), -1)
    places[hull.vertices] = np.arange(len(hull.vertices))
    points, faces = mesh.vertices[hull.vertices], places[hull.simplices]
    flip = winding_to_flip(points, faces)
    faces[flip] = faces[flip][:, ::-1]
    source, faces, normals = crease_normals(points, faces)
    nearest = KDTree(mesh.vertices).query(points[source])[1]
    surface = replace(
        mesh,
        vertices=points[source],
        faces=faces,
        normals=normals,
        colours=mesh.colours[nearest],
        uvs=mesh.uvs[nearest],
        face_texture=np.full(len(faces), -1),
        face_part=np.zeros(len(faces), np.int32),
    )
    smaller = simplify(surface, triangles)
    return subdivide(smaller, triangles)
