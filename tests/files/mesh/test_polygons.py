"""Polygons, strips and the ways in which programs write OBJ, PLY and STL."""

import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.mesh.polygons import polygon_corners, strip_corners
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import face_normals_and_areas
from poseviewer.geometry.transform import RigidTransform

SHAPES = {
    "L": [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)],
    "U": [(0, 0), (5, 0), (5, 4), (4, 4), (4, 1), (1, 1), (1, 4), (0, 4)],
    "arrow": [(0, 0), (4, 0), (1, 1), (0, 4)],
    "star": [(np.cos(t) * r, np.sin(t) * r) for t, r in
             zip(np.linspace(0, 2 * np.pi, 40, endpoint=False), [3, 1] * 20, strict=True)],
    "a hole with a bridge": [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1),
                             (1, 1)],
    "corners on an edge": [(0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (2, 1), (2, 2), (0, 2)],
    "square": [(0, 0), (1, 0), (1, 1), (0, 1)],
}  # fmt: skip


def shoelace(points: np.ndarray) -> float:
    x, y = points.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("name", SHAPES)
def test_triangles_cover_a_polygon_once_and_face_its_way(name, turned):
    flat = np.array(SHAPES[name], float)
    place = RigidTransform.from_rotation_vector([0.7, -1.2, 0.4], [5.0, 6.0, 7.0])
    points = place.apply(np.column_stack([flat, np.zeros(len(flat))]))
    points = points[::-1] if turned else points
    normals, areas = face_normals_and_areas(points, polygon_corners(np.array([len(flat)]), points))
    assert areas.sum() == pytest.approx(shoelace(flat))
    wanted = place.rotation[:, 2] * (-1.0 if turned else 1.0)
    np.testing.assert_allclose(normals[areas > 1e-9] @ wanted, 1.0)


def test_polygons_keep_their_order_and_convex_ones_stay_fans():
    counts = np.array([3, 6, 4, 2, 4])
    square, line = SHAPES["square"], [(0, 0), (1, 1)]
    flat = np.array([*square[:3], *SHAPES["L"], *square, *line, *square], float)
    corners = polygon_corners(counts, np.column_stack([flat, np.zeros(len(flat))]))
    assert corners[0].tolist() == [0, 1, 2]
    assert set(corners[1:5].ravel()) == set(range(3, 9))
    assert corners[5:].tolist() == [[9, 10, 11], [9, 11, 12], [15, 16, 17], [15, 17, 18]]


def test_a_polygon_that_crosses_itself_is_no_endless_loop():
    points = np.column_stack([np.random.default_rng(0).normal(size=(50, 2)), np.zeros(50)])
    assert polygon_corners(np.array([50]), points).shape == (48, 3)


def test_strips_end_at_minus_one_and_turn_every_second_triangle():
    strips = [0, 1, 2, 3, -1, 4, 5, 6, -1, 7, 8, -1, -1, 2, 1, 0]
    assert strip_corners(np.array(strips)).tolist() == [[0, 1, 2], [2, 1, 3], [4, 5, 6], [2, 1, 0]]


@pytest.mark.parametrize("suffix", ["obj", "ply", "off"])
@pytest.mark.parametrize("name", SHAPES)
def test_readers_cut_polygons_into_triangles_of_their_area(tmp_path, name, suffix):
    flat, path = np.array(SHAPES[name], float), tmp_path / f"m.{suffix}"
    rows = "".join(f"{x} {y} 0\n" for x, y in flat)
    face = " ".join(map(str, range(len(flat))))
    head = f"ply\nformat ascii 1.0\nelement vertex {len(flat)}\n" + PLY_HEAD
    texts = {"off": f"OFF\n{len(flat)} 1 0\n{rows}", "ply": f"{head}end_header\n{rows}"}
    texts = {key: f"{text}{len(flat)} {face}\n" for key, text in texts.items()}
    texts["obj"] = "".join(f"v {row}\n" for row in rows.splitlines())
    texts["obj"] += "f " + " ".join(str(i + 1) for i in range(len(flat)))
    path.write_text(texts[suffix])
    mesh = load_mesh(path)
    areas = face_normals_and_areas(mesh.vertices, mesh.faces)[1]
    assert areas.sum() == pytest.approx(shoelace(flat), rel=1e-6)


PLY_HEAD = "property float x\nproperty float y\nproperty float z\nelement face 1\n"
PLY_HEAD += "property list uchar int vertex_indices\n"
STRIPS = {
    "one": [[0, 1, 2, 3, 4, 5]],
    "two": [[0, 1, 2, 3, -1, 2, 3, 4, 5]],
    "ends": [[-1, 0, 1, 2, 3, -1, -1, 2, 3, 4, 5, -1]],
    "two rows": [[0, 1, 2, 3], [2, 3, 4, 5]],
}


@pytest.mark.parametrize("order", ["ascii", "<", ">"])
@pytest.mark.parametrize("name", STRIPS)
def test_strips_of_ply_are_read(tmp_path, name, order):
    """A band of four triangles, three corners wide."""
    strips, points = STRIPS[name], [(x, y, 0) for x in (0, 1, 2) for y in (0, 1)]
    encoding = {"<": "binary_little_endian", ">": "binary_big_endian"}.get(order, order)
    head = PLY_HEAD.replace("face 1", f"tristrips {len(strips)}")
    data = f"ply\nformat {encoding} 1.0\nelement vertex 6\n{head}end_header\n".encode()
    for row in [*points, *((len(strip), *strip) for strip in strips)]:
        kind = "3f" if row in points else f"B{len(row) - 1}i"
        data += (" ".join(map(str, row)) + "\n").encode() if order == "ascii" else struct.pack(
            order + kind, *row)  # fmt: skip
    (tmp_path / "m.ply").write_bytes(data)
    mesh = load_mesh(tmp_path / "m.ply")
    assert (len(mesh.faces), mesh.notes) == (4, ())
    normals, areas = face_normals_and_areas(mesh.vertices, mesh.faces)
    assert areas.sum() == pytest.approx(2.0)
    assert np.all(normals == normals[0])


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3 4/4\n"


def load_obj(folder: Path, head: str, mtl: bytes | None = None, **more: bytes) -> Mesh:
    Image.new("RGB", (2, 2), (200, 10, 10)).save(folder / "t.png")
    (folder / "m.mtl").write_bytes(mtl or MTLS["plain"])
    for name, data in more.items():
        (folder / f"{name}.mtl").write_bytes(data)
    (folder / "m.obj").write_bytes(head.encode("utf-8", "surrogateescape"))
    return load_mesh(folder / "m.obj")


OBJS = {
    "plain": "mtllib m.mtl\n" + SQUARE + "usemtl m\n" + FACE,
    "no usemtl": "mtllib m.mtl\n" + SQUARE + FACE,
    "byte order mark": "\ufeffmtllib m.mtl\r\n" + SQUARE + "usemtl m\r\n" + FACE,
    "tabs": ("mtllib m.mtl\n" + SQUARE + "usemtl m\n" + FACE).replace(" ", "\t"),
    "two libraries": "mtllib a.mtl m.mtl\n" + SQUARE + "usemtl m\n" + FACE,
    "spaces behind": "mtllib m.mtl  \n" + SQUARE + "usemtl m \t\n" + FACE,
}
MTLS = {
    "plain": b"newmtl m\nmap_Kd t.png\n",
    "byte order mark": b"\xef\xbb\xbfnewmtl m\r\nmap_Kd t.png\r\n",
    "tabs": b"newmtl\tm\n\tmap_Kd\tt.png\n",
}


@pytest.mark.parametrize("mtl", MTLS)
@pytest.mark.parametrize("obj", OBJS)
def test_an_obj_has_its_texture(tmp_path, obj, mtl):
    mesh = load_obj(tmp_path, OBJS[obj], MTLS[mtl], a=b"newmtl a\nKd 1 0 0\n")
    assert (len(mesh.textures), mesh.notes) == (1, ())
    assert mesh.face_texture.tolist() == [0, 0]


@pytest.mark.parametrize(("name", "encoding"), [("Räder.png", "cp1252"), ("车漆.png", "gbk")])
def test_names_in_the_encodings_of_windows_are_found(tmp_path, name, encoding):
    Image.new("RGB", (2, 2)).save(tmp_path / name)
    mtl = b"newmtl m\nmap_Kd " + name.encode(encoding) + b"\n"
    assert len(load_obj(tmp_path, OBJS["plain"], mtl).textures) == 1


def test_a_texture_of_16_bit_grey_keeps_its_tones(tmp_path):
    load_obj(tmp_path, OBJS["plain"])
    Image.fromarray(np.full((2, 2), 40_000, np.uint16)).save(tmp_path / "t.png")
    assert np.all(load_mesh(tmp_path / "m.obj").textures[0] == 40_000 // 256)


@pytest.mark.parametrize("name", ["m.fbx", "m.usdz", "m.blend", "m.igs", "m.IGES"])
def test_models_of_other_programs_are_to_be_exported_as_glb(tmp_path, name):
    (tmp_path / name).write_bytes(b"Kaydara FBX Binary")
    with pytest.raises(MeshFileError, match=r"export it as (STEP or )?GLB"):
        load_mesh(tmp_path / name)
