"""Simplified models look like the original from all around, and lie on it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poseviewer.files.demo import demo_case
from poseviewer.files.mesh.load import load_mesh
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.attributes import AttributeImage
from poseviewer.render.pyramid.simplified import simplify
from poseviewer.render.software.software_renderer import SoftwareRenderer
from tests.meshes import make_box, make_bumpy, make_mesh, make_soup, make_sphere

VIEWS = Rotation.random(5, rng=np.random.default_rng(7)).as_matrix()


def textured_sphere() -> Mesh:
    """A white ball whose texture is the red of its height and the green of its longitude."""
    ball = make_sphere(5)
    u = 0.25 + 0.2 * ball.vertices[:, 0]
    v = 0.5 + 0.4 * ball.vertices[:, 2]
    rows, columns = np.mgrid[0:256, 0:256]
    texture = np.stack([255 - rows, columns, 0 * rows], axis=-1).astype(np.uint8)
    return make_mesh(
        ball.vertices,
        ball.faces,
        ball.normals,
        np.ones((len(ball.vertices), 3)),
        uvs=np.stack([u, v], axis=-1),
        face_texture=np.zeros(len(ball.faces)),
        textures=(texture,),
    )


def demo_car() -> Mesh:
    return load_mesh(demo_case().model)


def seen(mesh: Mesh, original: Mesh, size: int) -> list[AttributeImage]:
    """Pictures of a mesh, ``size`` px, at the views of the original."""
    camera = Parallel(size / original.diameter, size / 2 + 0.3, size / 2 - 0.2, size, size)
    renderer = SoftwareRenderer(mesh)
    return [
        renderer.render(Pose(camera, RigidTransform(turn, -turn @ original.centre)))
        for turn in VIEWS
    ]


CASES = {
    # Mesh, faces, px; silhouettes in common, degrees between normals, reflectance (median, mean).
    "bumpy": (lambda: make_bumpy(5), 2000, 90, 0.99, 3.0, 5.0, 0.02, 0.03),
    "texture": (textured_sphere, 2000, 90, 0.99, 2.0, 3.0, 0.02, 0.03),
    "car": (demo_car, 16384, 250, 0.99, 2.0, 5.0, 0.005, 0.02),
}


@pytest.mark.parametrize("case", CASES)
def test_a_simplified_model_looks_the_same(case):
    make, faces, size, common, median_deg, mean_deg, median, mean = CASES[case]
    original = make()
    small = simplify(original, faces)
    assert len(small.faces) <= faces
    assert small.textures == ()
    assert np.all(small.face_texture == -1)
    assert np.linalg.norm(small.normals, axis=1) == pytest.approx(1.0, abs=1e-9)
    angles, apart = [], []
    for before, after in zip(
        seen(original, original, size), seen(small, original, size), strict=True
    ):
        both = before.mask & after.mask
        assert both.sum() > common * (before.mask | after.mask).sum()
        cosine = np.sum(before.normals[both] * after.normals[both], axis=-1)
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
        apart.append(np.abs(before.reflectance - after.reflectance)[both].max(axis=-1))
    assert np.median(np.concatenate(angles)) < median_deg
    assert np.mean(np.concatenate(angles)) < mean_deg
    assert np.median(np.concatenate(apart)) < median
    assert np.mean(np.concatenate(apart)) < mean


def test_sharp_edges_stay_sharp_and_parts_keep_their_colour():
    """A finely cut box of six parts, each of a colour of its own."""
    box = make_box((2.0, 1.2, 0.8))
    sides = [tuple(normal) for normal in np.unique(box.normals.round(6), axis=0)]
    vertices, faces = box.vertices, box.faces
    parts = np.array([sides.index(tuple(box.normals[face[0]].round(6))) for face in faces])
    for _ in range(4):
        vertices, faces, parts = divided(vertices, faces, parts)
    grey = np.linspace(0.1, 0.9, 6)
    fine = make_mesh(vertices, faces, face_part=parts, part_names=tuple("abcdef"))
    colours = np.repeat(grey[parts], 3)[:, None] * np.ones(3, np.float32)
    fine = replace(fine, colours=colours.astype(np.float32))
    small = simplify(fine, 300)
    assert len(small.faces) <= 300
    assert set(small.face_part) == set(range(6))
    for part in range(6):
        own = small.faces[small.face_part == part].ravel()
        wanted = fine.normals[fine.faces[parts == part].ravel()[0]]
        assert small.colours[own] == pytest.approx(grey[part], abs=1e-6)
        assert small.normals[own] @ wanted == pytest.approx(1.0, abs=1e-6)


def divided(vertices, faces, parts):
    """Every triangle cut into four."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    ab = (a + b) / 2
    bc = (b + c) / 2
    ca = (c + a) / 2
    pieces = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    corners = np.concatenate([np.stack(piece, axis=1) for piece in pieces])
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), np.tile(parts, 4)


@pytest.mark.parametrize("mesh", [make_box(), make_bumpy(2), make_soup(1, triangles=900)])
def test_small_and_broken_meshes_stay_usable(mesh):
    small = simplify(mesh, 300)
    if len(mesh.faces) <= 300:
        assert small is mesh
    assert 0 < len(small.faces) <= len(mesh.faces)
    assert np.isfinite(small.vertices).all()
    assert np.isfinite(small.normals).all()
    assert small.colours.min() >= 0.0


def test_a_large_model_is_decimated_beside_the_interpreter(monkeypatch: pytest.MonkeyPatch):
    mesh = make_bumpy(4)
    here = simplify(mesh, 500)
    monkeypatch.setattr("poseviewer.render.pyramid.simplified.MAX_TRIANGLES_IN_PROCESS", 0)
    monkeypatch.delattr("fast_simplification.simplify")  # it would keep the lock
    beside = simplify(mesh, 500)
    assert len(here.faces) < len(mesh.faces)
    for name in ("vertices", "faces", "colours"):
        np.testing.assert_array_equal(getattr(here, name), getattr(beside, name))
