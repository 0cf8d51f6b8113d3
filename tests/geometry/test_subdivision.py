"""Finer faces of a surface."""

import numpy as np
import pytest

from poseviewer.geometry.normals import face_normals_and_areas, find_adjacency, weld
from poseviewer.geometry.subdivision import halve_edges
from tests.meshes import make_box, make_bumpy, make_soup


@pytest.mark.parametrize("make", [make_box, make_bumpy, lambda: make_soup(1, triangles=40)])
@pytest.mark.parametrize("every", [1, 3])
def test_finer_faces_are_the_same_surface_without_gaps(make, every):
    mesh = make()

    def lengths(start, end, face):  # of some faces alone
        return np.linalg.norm(end - start, axis=1) / (0.11 * mesh.diameter) * (face % every == 0)

    fine, origin = halve_edges(mesh, lengths, 10**6)
    areas = face_normals_and_areas(mesh.vertices, mesh.faces)[1]
    own = face_normals_and_areas(fine.vertices, fine.faces)[1]
    np.testing.assert_allclose(np.bincount(origin, own, len(areas)), areas, rtol=1e-9)
    flat = face_normals_and_areas(mesh.vertices, mesh.faces)[0][origin]
    alike = np.einsum("fi,fi->f", flat, face_normals_and_areas(fine.vertices, fine.faces)[0])
    assert alike.min() > 1.0 - 1e-6
    np.testing.assert_allclose(np.linalg.norm(fine.normals, axis=1), 1.0)
    edges = fine.vertices[fine.faces] - fine.vertices[np.roll(fine.faces, -1, axis=1)]
    longest = np.linalg.norm(edges, axis=2).max(axis=1)[origin % every == 0]
    assert longest.max() <= 0.11 * mesh.diameter
    opened = find_adjacency(weld(mesh.vertices)[mesh.faces]).open_faces
    assert find_adjacency(weld(fine.vertices)[fine.faces]).open_faces.any() == opened.any()


def test_faces_are_not_divided_beyond_the_limit():
    mesh = make_bumpy(2)
    fine, _ = halve_edges(mesh, lambda start, *_: np.full(len(start), 9.0), 5 * len(mesh.faces))
    assert len(mesh.faces) < len(fine.faces) <= 5 * len(mesh.faces)
