"""Names in model files, and the files that they mean."""

import json
import struct
import unicodedata
from pathlib import Path

import pytest

from poseviewer.files.mesh.named import find_named
from poseviewer.files.mesh.references import names_in
from tests.textured import write_ply
from tests.writing import write


def test_an_obj_names_its_mtl_and_that_its_pictures(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(
        "\ufeffmtllib a.mtl b.mtl\no x\nmtllib\tmy paint.mtl \r\nv 0 0 0\n# mtllib no.mtl\n"
    )
    assert names_in(tmp_path / "a.obj") == {"a.mtl": True, "b.mtl": True, "my paint.mtl": True}
    (tmp_path / "b.mtl").write_text(
        "newmtl m\n\tmap_Kd\t-s 1 1 1 wood.png\nmap_Bump -bm 0.2 grain.png\nnorm n.png\nKd 1 1 1\n"
    )
    assert names_in(tmp_path / "b.mtl") == {"wood.png": True, "grain.png": False, "n.png": False}


def test_a_ply_and_a_3ds_name_their_pictures(tmp_path: Path) -> None:
    write_ply(tmp_path, "a picture.png")
    assert names_in(tmp_path / "quad.ply") == {"a picture.png": True}
    name = b"WOOD.JPG\0"
    chunk = b"\x00\xa3" + struct.pack("<I", 6 + len(name)) + name
    (tmp_path / "a.3ds").write_bytes(b"MM" + 30 * b"\1" + chunk + b"\x00\xa3\0\0\0\0none\0")
    assert names_in(tmp_path / "a.3ds") == {"WOOD.JPG": True}


def test_a_gltf_names_its_buffers_and_pictures(tmp_path: Path) -> None:
    uris = {
        "buffers": [{"uri": "a%20b.bin"}, {"uri": "data:application/octet-stream;base64,AAAA"}],
        "images": [{"uri": "textures/wood.png"}, {"bufferView": 0}, {"uri": "https://x.y/z.png"}],
    }
    (tmp_path / "a.gltf").write_text(json.dumps(uris))
    assert names_in(tmp_path / "a.gltf") == {"a b.bin": True, "textures/wood.png": True}


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.gltf", "a.glb"])
@pytest.mark.parametrize("data", [b"", b"\xff\0\xfe", b'{"images": 7, "buffers": [3]}'])
def test_damaged_files_name_nothing(tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    assert names_in(tmp_path / name) == {}
    assert names_in(tmp_path / "gone.obj") == {}


ENDLESS = {
    "a.dae": "<image><init_from> wood.png </init_from></image>" + "<image>" * 120_000,
    "a.mtl": "bump" + " " * 900_000 + "\nmap_Kd wood.png",
    "a.obj": "mtllib" + "\t" * 900_000 + "\nmtllib wood.png",
}
"""Small files that took minutes."""


@pytest.mark.parametrize("name", ENDLESS)
def test_no_small_file_is_searched_for_names_for_ever(tmp_path: Path, name: str) -> None:
    assert names_in(write(tmp_path / name, ENDLESS[name])) == {"wood.png": True}


@pytest.mark.parametrize(("place", "written"), [
    ("source/wood.png", "wood.png"),
    ("source/wood.png", "C:\\Users\\me\\wood.png"),
    ("source/WOOD.PNG", "wood.png"),
    ("source/" + unicodedata.normalize("NFD", "é.png"), unicodedata.normalize("NFC", "é.png")),
    ("source/textures/wood.png", "wood.png"),
    ("textures/wood.png", "wood.png"),
])  # fmt: skip
def test_what_is_named_is_found_where_programs_put_it(tmp_path: Path, place, written) -> None:
    path = tmp_path / place
    (tmp_path / "source").mkdir()
    path.parent.mkdir(exist_ok=True)
    path.touch()
    assert find_named(tmp_path / "source", written) == path
    assert find_named(tmp_path / "source", "steel.png") is None
    assert find_named(tmp_path / "source", "\0" + 5000 * "x") is None
