"""More triangles, the same surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.bench.workload import subdivide
from poseviewer.geometry.normals import face_normals_and_areas, find_adjacency, weld
from tests.meshes import make_box, make_bumpy, make_mesh


@pytest.mark.parametrize("mesh", [make_bumpy(2), make_box()], ids=["smooth", "creased"])
@pytest.mark.parametrize("faces", [400, 1001, 5000])
def test_the_surface_stays_and_has_no_gaps(mesh, faces):
    fine = subdivide(mesh, faces)
    assert faces <= len(fine.faces) <= faces + 2
    normals, areas = face_normals_and_areas(fine.vertices, fine.faces)
    assert areas.sum() == pytest.approx(face_normals_and_areas(mesh.vertices, mesh.faces)[1].sum())
    assert areas.min() > 0.0
    # Closed before and closed after: every edge has two faces, so no vertex lies on another's edge.
    adjacency = find_adjacency(weld(fine.vertices)[fine.faces])
    assert not adjacency.open_faces.any()
    assert not adjacency.same_direction.any()
    assert np.linalg.norm(fine.normals, axis=1) == pytest.approx(1.0)
    corner_normals = fine.normals[fine.faces].sum(axis=1)
    assert (np.sum(corner_normals * normals, axis=1) > 0.0).all()


def test_triangles_become_even():
    """Cutting the longest edges makes them alike: none stays much longer than others."""
    fine = subdivide(make_box((8.0, 1.0, 0.2)), 4000)
    corners = fine.vertices[fine.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    assert longest.max() < 4.0 * np.median(longest)


def test_attributes_lie_between_those_of_the_ends():
    """On a flat triangle colours and UVs are linear in the place; parts and textures stay."""
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    mesh = make_mesh(
        vertices,
        [[0, 1, 2], [1, 3, 2]],
        np.tile([0.0, 0.0, 1.0], (4, 1)),
        vertices * 0.5 + 0.25,
        uvs=vertices[:, :2] * 3.0,
        face_texture=np.array([0, -1]),
        textures=(np.zeros((2, 2, 3), np.uint8),),
    )
    fine = subdivide(replace(mesh, face_part=np.array([0, 1])), 500)
    assert fine.colours == pytest.approx(fine.vertices * 0.5 + 0.25, abs=1e-6)
    assert fine.uvs == pytest.approx(fine.vertices[:, :2] * 3.0, abs=1e-6)
    middle = fine.vertices[fine.faces].mean(axis=1)
    upper = middle[:, 0] + middle[:, 1] > 1.0
    assert (fine.face_part == upper).all()
    assert (fine.face_texture == np.where(upper, -1, 0)).all()


def test_a_mesh_with_enough_faces_is_left_alone():
    mesh = make_bumpy(2)
    assert subdivide(mesh, len(mesh.faces)) is mesh
