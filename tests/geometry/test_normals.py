import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from poseviewer.geometry.normals import crease_normals, face_normals_and_areas, faces_to_flip


def turned(faces: np.ndarray, which: np.ndarray) -> np.ndarray:
    faces = np.array(faces)
    faces[which] = faces[which][:, ::-1]
    return faces


def wavy_sheet(n: int) -> tuple[np.ndarray, np.ndarray]:
    side = np.linspace(0.0, 1.0, n)
    x, y = np.meshgrid(side, side)
    vertices = np.stack([x.ravel(), y.ravel(), 0.2 * np.sin(6.0 * x.ravel())], axis=1)
    corner = np.arange(n * n).reshape(n, n)[:-1, :-1].ravel()
    halves = [(corner, corner + 1, corner + n), (corner + 1, corner + n + 1, corner + n)]
    return vertices, np.concatenate([np.stack(half, axis=1) for half in halves])


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 1.0))
def test_any_turned_faces_of_a_closed_surface_are_turned_back_outwards(
    seed: int, share: float
) -> None:
    rng = np.random.default_rng(seed)
    shape = trimesh.creation.torus(1.0, 0.3, major_sections=12, minor_sections=8)
    faces = shape.faces[rng.permutation(len(shape.faces))]
    which = rng.random(len(faces)) < share
    assert np.array_equal(faces_to_flip(shape.vertices, turned(faces, which)), which)


def test_of_an_open_surface_the_smaller_area_is_turned() -> None:
    vertices, faces = wavy_sheet(12)
    which = np.random.default_rng(0).random(len(faces)) < 0.3
    assert np.array_equal(faces_to_flip(vertices, turned(faces, which)), which)


def test_surfaces_that_are_no_manifolds_come_to_an_end() -> None:
    rng = np.random.default_rng(1)
    vertices = rng.normal(size=(30, 3))
    faces = rng.integers(0, 30, (2000, 3))
    assert faces_to_flip(vertices, faces).shape == (2000,)
    source, new_faces, normals = crease_normals(vertices, faces)
    assert new_faces.max() < len(source) == len(normals)
    assert np.isfinite(normals).all()


def test_a_cube_keeps_sharp_edges() -> None:
    cube = trimesh.creation.box()
    source, faces, normals = crease_normals(cube.vertices, cube.faces)
    assert len(source) == 24
    expected = face_normals_and_areas(cube.vertices, cube.faces)[0]
    np.testing.assert_allclose(normals[faces], np.repeat(expected[:, None], 3, axis=1), atol=1e-12)
    np.testing.assert_array_equal(source[faces], cube.faces)


def test_a_sphere_is_smooth_also_over_seams() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=3)
    soup = sphere.vertices[sphere.faces].reshape(-1, 3)
    _, faces, normals = crease_normals(soup, np.arange(len(soup)).reshape(-1, 3))
    np.testing.assert_allclose(normals[faces].reshape(-1, 3), soup, atol=0.01)


@pytest.mark.parametrize("function", [faces_to_flip, crease_normals])
def test_no_faces_are_no_trouble(function: object) -> None:
    assert callable(function)
    function(np.zeros((3, 3)), np.zeros((0, 3), dtype=np.int64))
