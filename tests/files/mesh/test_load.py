import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from poseviewer.files.mesh.load import load_mesh
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import face_normals_and_areas
from tests.writing import write

COLOURS = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0]] * 2, np.uint8)


def cube() -> trimesh.Trimesh:
    box = trimesh.creation.box(extents=[1.0, 2.0, 3.0])
    return trimesh.Trimesh(box.vertices, box.faces, vertex_colors=COLOURS, process=False)


def as_big_endian(data: bytes) -> bytes:
    """The PLY of ``cube()`` as trimesh writes it, with its numbers the other way round."""
    head, _, body = data.partition(b"end_header\n")
    vertex, face = [("xyz", "<f4", 3), ("rgba", "u1", 4)], [("count", "u1"), ("indices", "<i4", 3)]
    tables = np.frombuffer(body, vertex, 8), np.frombuffer(body, face, 12, 8 * 16)
    swapped = b"".join(table.astype(table.dtype.newbyteorder(">")).tobytes() for table in tables)
    return head.replace(b"little", b"big") + b"end_header\n" + swapped


def chunk_3ds(kind: int, data: bytes) -> bytes:
    return struct.pack("<HI", kind, 6 + len(data)) + data


def write_3ds(
    path: Path, colour: tuple[int, int, int], objects: dict[str, trimesh.Trimesh], nodes: str = ""
) -> None:
    """Write objects by their names, and keyframes' nodes of some of them, a letter each."""
    chunk, shapes = chunk_3ds, b""
    for name, mesh in objects.items():
        count = len(mesh.faces)
        corners = chunk(0x4110, struct.pack("<H", 8) + mesh.vertices.astype("<f4").tobytes())
        indices = np.pad(mesh.faces, ((0, 0), (0, 1))).astype("<u2").tobytes()
        of_material = b"m\0" + struct.pack("<H", count) + np.arange(count, dtype="<u2").tobytes()
        faces = chunk(0x4120, struct.pack("<H", count) + indices + chunk(0x4130, of_material))
        shapes += chunk(0x4000, name.encode() + b"\0" + chunk(0x4100, corners + faces))
    material = chunk(0xAFFF, chunk(0xA000, b"m\0") + chunk(0xA020, chunk(0x0011, bytes(colour))))
    version, places = chunk(0x0002, struct.pack("<I", 3)), b""
    for number, name in enumerate(nodes):
        head = name.encode() + b"\0" + struct.pack("<HHH", 0, 0, 0xFFFF)
        places += chunk(0xB002, chunk(0xB030, struct.pack("<H", number)) + chunk(0xB010, head))
    keys = chunk(0xB000, places) if nodes else b""
    path.write_bytes(chunk(0x4D4D, version + chunk(0x3D3D, material + shapes) + keys))


def assert_is_cube(mesh: Mesh) -> None:
    """The box of ``cube()``, sharp and wound outwards."""
    assert mesh.vertices.shape == (24, 3)
    assert mesh.faces.shape == (12, 3)
    expected = {tuple(v) for v in cube().vertices.tolist()}
    assert {tuple(v) for v in mesh.vertices.tolist()} == expected
    normals, areas = face_normals_and_areas(mesh.vertices, mesh.faces)
    np.testing.assert_allclose(mesh.normals[mesh.faces][:, 0], normals, atol=1e-6)
    np.testing.assert_allclose(mesh.normals[mesh.faces][:, 2], normals, atol=1e-6)
    assert np.all(np.sum(normals * mesh.vertices[mesh.faces].mean(axis=1), axis=1) > 0.0)
    assert areas.sum() == pytest.approx(22.0)


@pytest.mark.parametrize("kind", ["ply", "ply text", "ply big-endian", "obj", "glb", "gltf",
                                  "stl", "stl text", "off"])  # fmt: skip
def test_a_cube_comes_back_with_its_colours_if_the_file_has_them(tmp_path: Path, kind: str) -> None:
    ending = kind.split()[0]
    options = {"encoding": "ascii"} if kind == "ply text" else {}
    data: Any = cube().export(file_type="stl_ascii" if kind == "stl text" else ending, **options)
    data = as_big_endian(data) if kind == "ply big-endian" else data
    for name, content in (data if ending == "gltf" else {f"model.{ending}": data}).items():
        write(tmp_path / name, content)
    mesh = load_mesh(tmp_path / f"model.{ending}")
    assert_is_cube(mesh)
    assert mesh.notes == ()
    assert mesh.has_reflectance is (ending not in ("stl", "off"))
    wanted = {tuple(v): c for v, c in zip(cube().vertices.tolist(), COLOURS / 255.0, strict=True)}
    for place, colour in zip(mesh.vertices.tolist(), mesh.colours, strict=True):
        own = wanted[tuple(place)] if mesh.has_reflectance else mesh.colours[0, 0]
        np.testing.assert_allclose(colour, own, atol=1e-6)


def test_a_cube_comes_back_from_3ds(tmp_path: Path) -> None:
    pytest.importorskip("assimp_py")
    write_3ds(tmp_path / "cube.3ds", (200, 30, 40), {"box": cube()})
    mesh = load_mesh(tmp_path / "cube.3ds")
    assert_is_cube(mesh)
    np.testing.assert_allclose(mesh.colours, np.full((24, 3), [200, 30, 40]) / 255.0, atol=1e-6)


@pytest.mark.parametrize(("nodes", "others"), [("", 0), ("ab", 0), ("a", 1), ("b", 1)])
def test_every_object_of_a_3ds_is_there_whatever_its_nodes(tmp_path: Path, nodes, others) -> None:
    pytest.importorskip("assimp_py")
    far = cube()
    far.apply_translation([5.0, 0.0, 0.0])
    write_3ds(tmp_path / "two.3ds", (200, 30, 40), {"a": cube(), "b": far}, nodes)
    mesh = load_mesh(tmp_path / "two.3ds")
    assert len(mesh.faces) == 24
    np.testing.assert_allclose(mesh.bounds, [[-0.5, -1.0, -1.5], [5.5, 1.0, 1.5]], atol=1e-6)
    note = "Objects that no node places, shown where they are drawn: 1."
    assert mesh.notes == (note,) * others


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".obj"])
def test_normals_of_the_file_are_kept(tmp_path: Path, suffix: str) -> None:
    box = trimesh.creation.box()
    rounded = box.vertices / np.linalg.norm(box.vertices, axis=1)[:, None]
    shape = trimesh.Trimesh(box.vertices, box.faces, vertex_normals=rounded, process=False)
    path = tmp_path / f"soft{suffix}"
    options: dict[str, Any] = {} if suffix == ".ply" else {"include_normals": True}
    shape.export(path, **options)
    mesh = load_mesh(path)
    assert mesh.vertices.shape == (8, 3)
    np.testing.assert_allclose(mesh.normals, mesh.vertices * 2 / np.sqrt(3), atol=1e-6)


def test_normals_that_contradict_the_faces_are_computed_anew(tmp_path: Path) -> None:
    sphere = trimesh.creation.icosphere(subdivisions=2)
    sphere.vertex_normals = np.tile([0.0, 0.0, 1.0], (len(sphere.vertices), 1))
    sphere.export(tmp_path / "sphere.ply")
    mesh = load_mesh(tmp_path / "sphere.ply")
    np.testing.assert_allclose(mesh.normals, mesh.vertices, atol=0.03)
    assert "contradict" in mesh.notes[0]


def test_faces_are_turned_to_the_side_of_the_files_normals(tmp_path: Path) -> None:
    sphere = trimesh.creation.icosphere(subdivisions=2)
    faces, normals = np.array(sphere.faces), sphere.vertices.copy()
    faces[::3] = faces[::3, ::-1]
    shape = trimesh.Trimesh(sphere.vertices, faces, vertex_normals=normals, process=False)
    shape.export(tmp_path / "sphere.ply")
    mesh = load_mesh(tmp_path / "sphere.ply")
    normals, _ = face_normals_and_areas(mesh.vertices, mesh.faces)
    assert np.all(np.sum(normals * mesh.normals[mesh.faces[:, 0]], axis=1) > 0.9)
    assert mesh.notes == ("Triangles turned to the side of their normals: 107.",)


def test_what_is_useless_is_left_out_and_noted(tmp_path: Path) -> None:
    faces = cube().faces.tolist()
    extra = [faces[0], faces[1][::-1], [0, 0, 1], [2, 2, 2]]
    faces[5] = faces[5][::-1]
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in [*cube().vertices.tolist(), [9.0, 9.0, 9.0]])
    text += "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces + extra)
    (tmp_path / "cube.obj").write_text(text)
    mesh = load_mesh(tmp_path / "cube.obj")
    assert_is_cube(mesh)
    assert mesh.notes == (
        "Triangles without area, left out: 2.",
        "Doubled triangles, left out: 2.",
        "Triangles turned to face the way of their neighbours: 1.",
    )


def test_parts_of_a_scene_are_named_and_in_their_places(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirror[:3, 3] = [10.0, 0.0, 0.0]
    sphere = trimesh.creation.icosphere(subdivisions=2)
    sphere.vertex_normals = sphere.vertices.copy()
    scene.add_geometry(sphere, node_name="left ball", geom_name="ball")
    scene.add_geometry(sphere, node_name="right ball", geom_name="ball", transform=mirror)
    scene.export(tmp_path / "balls.glb", include_normals=True)
    mesh = load_mesh(tmp_path / "balls.glb")
    assert set(mesh.part_names) == {"left ball", "right ball"}
    np.testing.assert_allclose(mesh.part_vertices("right ball").mean(axis=0), [10, 0, 0], atol=1e-6)
    centres = np.where(mesh.vertices[:, :1] > 5.0, [[10.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]])
    np.testing.assert_allclose(mesh.normals, mesh.vertices - centres, atol=1e-5)
    assert mesh.notes == ()


def test_groups_of_an_obj_are_parts_and_indices_may_be_relative(tmp_path: Path) -> None:
    (tmp_path / "two.obj").write_text(
        "o car\ng wheel a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n"
        "usemtl x\ng door\nv 5 0 0\nv 6 0 0\nv 5 \\\n1 0\nf -3//  -2 -1\n".replace("//  ", " ")
    )
    mesh = load_mesh(tmp_path / "two.obj")
    assert mesh.part_names == ("car wheel a", "car door")
    assert mesh.part_vertices("car door")[:, 0].min() == 5.0


@pytest.mark.parametrize("face", ["f 1/1/1 2/2/1 3/3/1", "f 1//1 2//1 3//1", "f 1/1 2/2 3",
                                  "f 1 2/2 3/3/1 4//1"])  # fmt: skip
def test_all_ways_of_writing_an_obj_face(tmp_path: Path, face: str) -> None:
    (tmp_path / "face.obj").write_text(
        "v 0 0 0\r\nv 1 0 0\r\nv 1e0 1E+0 0\r\nv 0 1 0 1.0\r\n"
        "vt 0 0\r\nvt 1 0 0\r\nvt 1 1\r\nvn 0 0 2\r\n" + face + "\r\n"
    )
    mesh = load_mesh(tmp_path / "face.obj")
    assert len(mesh.faces) == len(face.split()) - 3
    np.testing.assert_allclose(mesh.normals, np.tile([0, 0, 1], (len(mesh.vertices), 1)))


def test_libraries_do_not_talk_to_the_user(tmp_path: Path, caplog, capfd) -> None:
    text: Any = cube().export(file_type="stl_ascii")
    (tmp_path / "cube.stl").write_text(text.replace("normal", "normal oops", 1))
    assert_is_cube(load_mesh(tmp_path / "cube.stl"))
    assert not caplog.records
    assert capfd.readouterr() == ("", "")
