"""Colours and textures of model files come in as they would be shown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from poseviewer.files.mesh.load import load_mesh, srgb_from_linear
from poseviewer.geometry.mesh import Mesh

TEXTURE = np.arange(4 * 4 * 3, dtype=np.uint8).reshape(4, 4, 3) * 5
CORNERS = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0]] * 2, np.uint8)
QUAD = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def sampled(mesh: Mesh, face: int, weights: np.ndarray) -> np.ndarray:
    """Colour (3,) of the nearest texel at a place of a face, as a renderer looks it up."""
    texture = mesh.textures[mesh.face_texture[face]]
    u, v = weights @ mesh.uvs[mesh.faces[face]]
    height, width = texture.shape[:2]
    return texture[int((1.0 - v) * height) % height, int(u * width) % width]


def assert_is_textured_quad(mesh: Mesh) -> None:
    assert mesh.faces.shape == (2, 3)
    assert mesh.has_reflectance
    np.testing.assert_array_equal(mesh.textures[0], TEXTURE)
    np.testing.assert_array_equal(mesh.colours, 1.0)
    for face in range(2):
        place = mesh.vertices[mesh.faces[face]].mean(axis=0)
        row, column = int((1.0 - place[1]) * 4), int(place[0] * 4)
        np.testing.assert_array_equal(sampled(mesh, face, np.full(3, 1 / 3)), TEXTURE[row, column])


def write_texture(path: Path) -> Image.Image:
    image = Image.fromarray(TEXTURE)
    image.save(path)
    return image


QUAD_OBJ = (
    "mtllib quad.mtl\nusemtl paint\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"
)


@pytest.mark.parametrize(
    "named", ["a picture.png", "-s 1 1 1 -clamp on a picture.png", "C:\\old place\\a picture.png"]
)
def test_texture_of_an_obj(tmp_path: Path, named: str) -> None:
    write_texture(tmp_path / "a picture.png")
    (tmp_path / "quad.obj").write_text(QUAD_OBJ)
    (tmp_path / "quad.mtl").write_text(f"newmtl paint\nKd 0 0 0\nmap_Kd {named}\n")
    assert_is_textured_quad(load_mesh(tmp_path / "quad.obj"))


def test_a_missing_texture_is_noted_and_the_material_colour_used(tmp_path: Path) -> None:
    (tmp_path / "quad.obj").write_text(QUAD_OBJ)
    (tmp_path / "quad.mtl").write_text("newmtl paint\nKd 0.5 0.25 0\nmap_Kd gone.png\n")
    mesh = load_mesh(tmp_path / "quad.obj")
    assert mesh.textures == ()
    assert np.all(mesh.face_texture == -1)
    np.testing.assert_allclose(mesh.colours, np.tile([0.5, 0.25, 0.0], (4, 1)))
    assert mesh.notes == ("Texture left out: gone.png is not there.",)


@pytest.mark.parametrize("content", [b"", b"Dear all,\n", b"\x89PNG\r\n\x1a\n"])
def test_a_damaged_texture_is_noted(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "quad.obj").write_text(QUAD_OBJ)
    (tmp_path / "quad.mtl").write_text("newmtl paint\nmap_Kd bad.png\n")
    (tmp_path / "bad.png").write_bytes(content)
    mesh = load_mesh(tmp_path / "quad.obj")
    assert not mesh.has_reflectance
    assert mesh.notes[0].startswith("Texture left out: ")


def test_missing_materials_are_noted(tmp_path: Path) -> None:
    (tmp_path / "quad.obj").write_text(QUAD_OBJ)
    assert load_mesh(tmp_path / "quad.obj").notes == (
        "Material file left out: quad.mtl is not there.",
    )
    (tmp_path / "quad.mtl").write_text("newmtl other\nKd 1 0 0\n")
    assert load_mesh(tmp_path / "quad.obj").notes == ("Materials not in the MTL file: paint.",)


QUAD_PLY = (
    "ply\nformat ascii 1.0\ncomment TextureFile a picture.png\nelement vertex 4\n"
    "property float x\nproperty float y\nproperty float z\n{vertex}element face 1\n"
    "property list uchar int vertex_indices\n{face}end_header\n"
)


@pytest.mark.parametrize("names", [("s", "t"), ("u", "v"), ("texture_u", "texture_v")])
def test_texture_of_a_ply_by_vertex(tmp_path: Path, names: tuple[str, str]) -> None:
    write_texture(tmp_path / "a picture.png")
    columns = "".join(f"property float {name}\n" for name in names)
    rows = "".join(f"{x} {y} {z} {x} {y}\n" for x, y, z in QUAD)
    text = QUAD_PLY.format(vertex=columns, face="") + rows + "4 0 1 2 3\n"
    (tmp_path / "quad.ply").write_text(text)
    assert_is_textured_quad(load_mesh(tmp_path / "quad.ply"))


def test_texture_of_a_ply_by_face(tmp_path: Path) -> None:
    write_texture(tmp_path / "a picture.png")
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in QUAD)
    text = QUAD_PLY.format(vertex="", face="property list uchar float texcoord\n")
    (tmp_path / "quad.ply").write_text(text + rows + "4 0 1 2 3 8 0 0 1 0 1 1 0 1\n")
    assert_is_textured_quad(load_mesh(tmp_path / "quad.ply"))
    (tmp_path / "a picture.png").unlink()
    assert load_mesh(tmp_path / "quad.ply").notes == (
        "Texture left out: a picture.png is not there.",
    )


def test_texture_of_a_glb(tmp_path: Path) -> None:
    image = write_texture(tmp_path / "unused.png")
    material = PBRMaterial(baseColorTexture=image)
    visual = TextureVisuals(uv=QUAD[:, :2], material=material)
    faces = [[0, 1, 2], [0, 2, 3]]
    trimesh.Trimesh(QUAD, faces, visual=visual, process=False).export(tmp_path / "quad.glb")
    mesh = load_mesh(tmp_path / "quad.glb")
    assert_is_textured_quad(mesh)
    assert mesh.unit == "m"


def test_colours_of_faces_and_mixed_polygons_of_a_ply(tmp_path: Path) -> None:
    colours = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    text = QUAD_PLY.format(vertex="", face=colours).replace("face 1", "face 2")
    text += "".join(f"{x} {y} {z}\n" for x, y, z in QUAD).replace("0.0 1.0 0.0", "0 1 5")
    (tmp_path / "mixed.ply").write_text(text + "4 0 1 2 3 255 0 0\n3 0 2 1 0 0 255\n")
    mesh = load_mesh(tmp_path / "mixed.ply")
    assert {tuple(c) for c in mesh.colours.tolist()} <= {(1.0, 0.0, 0.0), (0.0, 0.0, 1.0)}
    assert len(mesh.faces) == 2  # the triangle doubles half of the quad


def test_gltf_is_linear_but_what_trimesh_writes_is_not(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    trimesh.Trimesh(box.vertices, box.faces, vertex_colors=CORNERS).export(tmp_path / "cube.glb")
    data = (tmp_path / "cube.glb").read_bytes()
    assert b"mikedh/trimesh" in data
    (tmp_path / "other.glb").write_bytes(data.replace(b"mikedh/trimesh", b"somebody/else_"))
    theirs = load_mesh(tmp_path / "other.glb")
    ours = load_mesh(tmp_path / "cube.glb")
    np.testing.assert_allclose(theirs.colours, srgb_from_linear(ours.colours), atol=1e-6)
    assert srgb_from_linear(np.array([0.0, 0.2140, 1.0])) == pytest.approx(
        [0.0, 0.5, 1.0], abs=1e-3
    )


def test_a_textured_face_has_one_colour_that_of_its_corners_on_average(tmp_path: Path) -> None:
    write_texture(tmp_path / "a picture.png")
    names = ("s", "t", "red", "green", "blue")
    columns = "".join(
        f"property {'float' if k < 2 else 'uchar'} {n}\n" for k, n in enumerate(names)
    )
    rows = "".join(f"{x} {y} {z} {x} {y} {round(90 * y)} 0 255\n" for x, y, z in QUAD)
    text = QUAD_PLY.format(vertex=columns, face="") + rows + "4 0 1 2 3\n"
    (tmp_path / "quad.ply").write_text(text)
    mesh = load_mesh(tmp_path / "quad.ply")
    for face, red in zip(mesh.faces, (30, 60), strict=True):
        np.testing.assert_allclose(255.0 * mesh.colours[face], [[red, 0, 255]] * 3, rtol=1e-5)
        np.testing.assert_array_equal(mesh.uvs[face], mesh.vertices[face, :2])
    assert "shown in the mean of these: 2." in mesh.notes[0]
