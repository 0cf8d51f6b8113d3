"""Small files that promise huge models, and huge files, take little memory."""

from __future__ import annotations

import base64
import json
import struct
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.load import LARGEST_FILE, load_mesh
from poseviewer.geometry.mesh import Mesh
from tests.files.broken_inputs import PLY_HEAD, png_header

LARGEST_PEAK = 100_000_000
"""Bytes: the models refused here would take gigabytes."""


def refusal(path: Path) -> str:
    """Why a model is refused, having taken little memory."""
    tracemalloc.start()
    try:
        with pytest.raises(MeshFileError) as caught:
            load_mesh(path)
        assert tracemalloc.get_traced_memory()[1] < LARGEST_PEAK
    finally:
        tracemalloc.stop()
    text = str(caught.value)
    assert text.startswith(f"{path.name}: ")
    assert "\n" not in text
    return text


def sparse_file(path: Path, head: bytes, size: int) -> Path:
    """A file that seems to have ``size`` bytes, nearly all of them a hole."""
    with path.open("wb") as file:
        file.write(head)
        file.truncate(size)
    return path


@pytest.mark.parametrize("ending", [".obj", ".ply", ".stl", ".off", ".glb", ".gltf", ".3ds"])
def test_files_too_large_for_any_model(tmp_path: Path, ending: str) -> None:
    path = sparse_file(tmp_path / f"model{ending}", b"", LARGEST_FILE + 1)
    assert f"{LARGEST_FILE + 1:,} bytes; poseviewer takes a" in refusal(path)


def gltf(shown: int, triangles: int = 1000, **changes: object) -> str:
    """A glTF file whose one mesh of ``triangles`` is shown by ``shown`` nodes."""
    points = np.random.default_rng(0).random((triangles * 3, 3), np.float32).tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(points).decode()
    accessor = {"bufferView": 0, "componentType": 5126, "count": triangles * 3, "type": "VEC3"}
    header = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": uri, "byteLength": len(points)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(points)}],
        "accessors": [accessor],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0, "translation": [i, 0, 0]} for i in range(shown)],
        "scenes": [{"nodes": list(range(shown))}],
    }
    return json.dumps(header | changes)


@pytest.mark.parametrize("count", [-5, "many", 1e300, None, 2.5])
def test_gltf_counts_that_make_no_sense(tmp_path: Path, count: object) -> None:
    path = tmp_path / "model.gltf"
    path.write_text(gltf(1, accessors=[json.loads(gltf(1))["accessors"][0] | {"count": count}]))
    refusal(path)


def test_a_texture_that_unpacks_to_gigabytes_is_left_out(tmp_path: Path) -> None:
    (tmp_path / "bomb.png").write_bytes(png_header(60_000, 60_000))
    (tmp_path / "model.mtl").write_text("newmtl m\nmap_Kd bomb.png\n")
    path = tmp_path / "model.obj"
    path.write_text(
        "mtllib model.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n"
    )
    mesh = load_mesh(path)
    assert len(mesh.textures) == 0
    assert "bomb.png has too many pixels" in " ".join(mesh.notes)


def test_a_gltf_texture_that_unpacks_to_gigabytes(tmp_path: Path) -> None:
    uri = "data:image/png;base64," + base64.b64encode(png_header(60_000, 60_000)).decode()
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 0}, "material": 0}
    path = tmp_path / "model.gltf"
    path.write_text(
        gltf(
            1,
            images=[{"uri": uri}],
            textures=[{"source": 0}],
            materials=[material],
            meshes=[{"primitives": [primitive]}],
        )
    )
    mesh, peak = peak_of(path)
    assert len(mesh.textures) == 0
    assert peak < LARGEST_PEAK


def peak_of(path: Path) -> tuple[Mesh, int]:
    """The model, and the most memory that reading it took, in bytes."""
    tracemalloc.start()
    try:
        mesh = load_mesh(path)
        return mesh, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def write_pictures(folder: Path, count: int, side: int) -> list[str]:
    picture = np.zeros((side, side, 3), np.uint8)
    names = [f"t{number}.png" for number in range(count)]
    for number, name in enumerate(names):
        picture[0, 0] = number
        Image.fromarray(picture).save(folder / name)
    return names


def texels(mesh: Mesh) -> int:
    return sum(texture.shape[0] * texture.shape[1] for texture in mesh.textures)


def textured_obj(folder: Path, names: list[str]) -> Path:
    mtl = "".join(f"newmtl {name}\nmap_Kd {name}\n" for name in names)
    (folder / "model.mtl").write_text(mtl)
    lines = ["mtllib model.mtl", "vt 0 0", "vt 1 0", "vt 0 1"]
    for i, name in enumerate(names):
        lines += [f"v {i} 0 0", f"v {i + 1} 0 0", f"v {i} 1 0", f"usemtl {name}"]
        lines += [f"f {3 * i + 1}/1 {3 * i + 2}/2 {3 * i + 3}/3"]
    path = folder / "model.obj"
    path.write_text("\n".join(lines))
    return path


def textured_ply(folder: Path, names: list[str]) -> Path:
    count, path = len(names), folder / "model.ply"
    files = "".join(f"comment TextureFile {name}\n" for name in names)
    head = PLY_HEAD.format(format="ascii", vertices=3 * count, faces=count)
    head = head.replace("ply\n", f"ply\n{files}", 1)
    head = head.replace("float z\n", "float z\nproperty float u\nproperty float v\n")
    head = head.replace("end_header", "property int texnumber\nend_header")
    rows = [f"{i} 0 0 0 0\n{i + 1} 0 0 1 0\n{i} 1 0 0 1" for i in range(count)]
    rows += [f"3 {3 * i} {3 * i + 1} {3 * i + 2} {i}" for i in range(count)]
    path.write_text(head + "\n".join(rows) + "\n")
    return path


def textured_glb(folder: Path, names: list[str]) -> Path:
    scene = trimesh.Scene()
    for number, name in enumerate(names):
        box = trimesh.creation.box()
        box.apply_translation([2.0 * number, 0, 0])
        uv = np.random.default_rng(number).random((len(box.vertices), 2))
        with Image.open(folder / name) as image:
            box.visual = TextureVisuals(uv, image=image.copy())
        scene.add_geometry(box)
    path = folder / "model.glb"
    data: Any = scene.export(file_type="glb")
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("write", [textured_obj, textured_ply, textured_glb])
def test_large_textures_are_shrunk_until_they_fit_together(
    tmp_path: Path, write: Callable[[Path, list[str]], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path, write_pictures(tmp_path, 5, 40))
    whole = load_mesh(path)
    assert texels(whole) == 5 * 40 * 40
    monkeypatch.setattr("poseviewer.files.mesh.parts.MOST_TEXELS", 3000)
    shrunk = load_mesh(path)
    assert len(shrunk.textures) == 5
    assert 1000 < texels(shrunk) <= 3000
    assert "Textures shrunk to" in " ".join(shrunk.notes)
    np.testing.assert_array_equal(shrunk.faces, whole.faces)


def test_small_textures_keep_their_size_beside_a_large_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = [*write_pictures(tmp_path, 3, 10), "large.png", "huge.png"]
    Image.new("RGB", (60, 60)).save(tmp_path / "large.png")
    Image.new("RGB", (61, 60)).save(tmp_path / "huge.png")
    monkeypatch.setattr("poseviewer.files.mesh.parts.MOST_TEXELS", 3600)
    mesh = load_mesh(textured_obj(tmp_path, names))
    sides = sorted(texture.shape[0] for texture in mesh.textures)
    assert sides[:3] == [10, 10, 10]
    assert 30 < sides[3] < 60
    assert "huge.png has too many pixels" in " ".join(mesh.notes)


@pytest.mark.slow
def test_very_many_textures_take_no_square_of_memory(tmp_path: Path) -> None:
    mesh, peak = peak_of(textured_ply(tmp_path, [f"{i}.png" for i in range(3000)]))
    assert len(mesh.faces) == 3000
    assert peak < LARGEST_PEAK  # the vertices alone, once for each texture, have 650 MB
    assert "all but 2,000 of 3,000" in " ".join(mesh.notes)


@pytest.mark.slow
def test_very_many_groups_take_no_square_of_time(tmp_path: Path) -> None:
    count, path = 20_000, tmp_path / "model.obj"
    vertices = "".join(f"v {i} 0 0\nv {i} 1 0\n" for i in range(count + 1))
    groups = "".join(f"g {i}\nf {2 * i + 1} {2 * i + 2} {2 * i + 3}\n" for i in range(count))
    path.write_text(vertices + groups)
    start = time.process_time()
    mesh = load_mesh(path)
    assert time.process_time() - start < 15.0
    assert len(mesh.part_names) == count


def test_gltf_nodes_above_themselves(tmp_path: Path) -> None:
    path = tmp_path / "model.gltf"
    nodes = [{"mesh": 0, "children": [1]}, {"mesh": 0, "children": [0]}]
    path.write_text(gltf(1, 1, nodes=nodes, scenes=[{"nodes": [0]}]))
    refusal(path)


@pytest.mark.parametrize("most", ["MOST_FACES", "MOST_PARTS"])
def test_models_of_too_many_faces_or_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: str
) -> None:
    path = tmp_path / "model.gltf"
    path.write_text(gltf(3))
    assert len(load_mesh(path).faces) == 3000
    monkeypatch.setattr(f"poseviewer.files.mesh.surface.{most}", 2)
    assert "poseviewer takes up to 2, simplify" in refusal(path)


def test_glb_chunks_beyond_the_file(tmp_path: Path) -> None:
    path = textured_glb(tmp_path, write_pictures(tmp_path, 1, 4))
    data = bytearray(path.read_bytes())
    at = 20 + struct.unpack("<I", data[12:16])[0]
    data[at : at + 4] = struct.pack("<I", 0xFFFFFFF0)
    path.write_bytes(data)
    assert "is cut short" in refusal(path)
