"""The corners of a model's convex hull: all that its box in a photo depends on; its axes."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from poseviewer.geometry.arrays import FloatArray, frozen_array
from poseviewer.geometry.mesh import Mesh

FEWEST = 100
"""Models of fewer vertices are taken as they are."""


@lru_cache(maxsize=4)
def hull_points(mesh: Mesh) -> FloatArray:
    """(k, 3): those vertices whose convex hull holds all others; found once for each model.

    They are all in front of a camera exactly if the model is, and their box in a photo is then
    the model's. A flat model's are all its vertices.
    """
    if len(mesh.vertices) < FEWEST:
        return mesh.vertices
    try:
        corners = ConvexHull(mesh.vertices).vertices
    except QhullError:
        return mesh.vertices
    return frozen_array(mesh.vertices[corners], (-1, 3))


def principal_axes(mesh: Mesh) -> FloatArray:
    """(3, 3): unit axes in the model's frame, a row each, the shortest way through it first: those
    of the scatter of its hull's corners. Where it is as long one way as another, any of these.
    """
    points = hull_points(mesh)
    return np.linalg.eigh(np.cov(points.T))[1].T
