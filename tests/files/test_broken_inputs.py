"""Files that cannot be used, one of each kind that users come with, are refused in one sentence."""

import json
import os
import struct
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from poseviewer.errors import MeshFileError, PhotoFileError, PoseFileError
from poseviewer.files.mesh.load import READERS, load_mesh
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from tests.textured import write_gltf
from tests.writing import edit, write

LETTER = "Dear all,\nplease find the file attached.\n" * 5
CUBE = trimesh.creation.box()
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
TRIANGLE = "0 0 0\n1 0 0\n0 1 0\n"
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
)


EXPORTED: Any = {
    kind: CUBE.export(file_type=kind) for kind in ("glb", "ply", "stl", "stl_ascii", "off")
}
GLB, BINARY_PLY, STL, TEXT_STL, OFF = EXPORTED.values()
TEXT_PLY: Any = CUBE.export(file_type="ply", encoding="ascii")
POSE: dict[str, Any] = {
    "projection": "perspective",
    "camera": {"fx": 500.0, "fy": 500.0, "cx": 39.5, "cy": 31.5},
    "camera_from_model": {"rotation": np.eye(3).tolist(), "translation": [0.0, 0.0, 5.0]},
}


def png_header(width: int, height: int) -> bytes:
    """A PNG that promises a size, with hardly anything behind."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        length, check = (struct.pack(">I", n) for n in (len(data), zlib.crc32(kind + data)))
        return length + kind + data + check

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    body = chunk(b"IDAT", zlib.compress(bytes(1000)))
    return b"\x89PNG\r\n\x1a\n" + header + body + chunk(b"IEND", b"")


def picture(suffix: str) -> bytes:
    memory = BytesIO()
    pixels = np.random.default_rng(3).integers(0, 256, (64, 80, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(memory, Image.registered_extensions()[suffix])
    return memory.getvalue()


def pose(camera: dict[str, float] | None = None, **changes: object) -> str:
    return json.dumps(POSE | changes | ({"camera": POSE["camera"] | camera} if camera else {}))


def moved(rotation: object) -> str:
    return pose(camera_from_model={"rotation": rotation, "translation": [0, 0, 5]})


MODELS: dict[str, str | bytes] = {
    **{f"letter{ending}": LETTER for ending in READERS},
    **{f"empty{ending}": b"" for ending in READERS},
    "unknown.xyz": TRIANGLE,
    "no_ending": OBJ + "f 1 2 3\n",
    "cut.glb": GLB[: len(GLB) // 2],
    "cut_header.glb": GLB[:17],
    "chunk_beyond_the_file.glb": GLB[: GLB.index(b"BIN\0") - 4] + b"\xf0\xff\xff\xff" + GLB[-99:],
    "cut.ply": BINARY_PLY[:-20],
    "cut_text.ply": TEXT_PLY[:-25],
    "cut.stl": STL[:-30],
    "cut_text.stl": TEXT_STL[:-150],
    "cut_vertex.obj": OBJ + "v 1 0\nf 1 2 3\n",
    "cut_face.obj": OBJ + "f 1 2 3\nf 2/",
    "cut.off": OFF[: len(OFF) * 2 // 3],
    "list.gltf": "[1, 2]",
    "no_meshes.gltf": '{"asset": {"version": "2.0"}}',
    "point_cloud.obj": OBJ,
    "point_cloud.ply": PLY.replace("face 1", "face 0") + TRIANGLE,
    "point_cloud.off": "OFF\n3 0 0\n" + TRIANGLE,
    "too_few_lines.off": "OFF\n4 1 0\n" + TRIANGLE + "3 0 1 2\n",
    "too_many_lines.off": "OFF\n3 1 0\n" + TRIANGLE + "3 0 1 2\n3 0 1 2\n",
    "short_face.off": "OFF\n3 1 0\n" + TRIANGLE + "3 0 1\n",
    "flat.stl": bytes(80) + struct.pack("<I", 1) + bytes(50),
    "nan.obj": OBJ.replace("v 0 0 0", "v nan 0 0") + "f 1 2 3\n",
    "index_beyond.obj": OBJ + "f 1 2 9\n",
    "index_zero.obj": OBJ + "f 0 1 2\n",
    "relative_index_beyond.obj": OBJ + "f -1 -2 -4\n",
    "uv_index_beyond.obj": OBJ + "vt 0 0\nf 1/1 2/1 3/7\n",
    "index_beyond.ply": PLY + TRIANGLE + "3 0 1 5\n",
    "index_below.ply": PLY + TRIANGLE + "3 0 1 -1\n",
    "index_beyond.off": "OFF\n3 1 0\n" + TRIANGLE + "3 0 1 5\n",
    "long_rows.ply": PLY + "0 0 0 9\n1 0 0 9\n0 1 0 9\n3 0 1 2\n",
    "long_face.ply": PLY + TRIANGLE + "3 0 1 2 255\n",
    "words.ply": PLY + "a b c\n" + TRIANGLE,
    "unknown_type.ply": PLY.replace("float y", "text y") + TRIANGLE,
    "too_many_faces.ply": PLY.replace("face 1", "face 30000000000") + TRIANGLE,
    "too_many_faces.stl": bytes(80) + struct.pack("<I", 4_000_000_000) + bytes(500),
    "too_many_faces.off": "OFF\n3 30000000000 0\n" + TRIANGLE,
}
GLTF_CHANGES: dict[str, dict[str, Any]] = {
    "missing_buffer": {"buffers": [{"uri": "gone.bin", "byteLength": 9}]},
    "pipe_as_buffer": {"buffers": [{"uri": "pipe.bin", "byteLength": 9}]},
    "count_beyond_the_buffer": {"accessors": {"count": 6_000_000}},
    "count_of_words": {"accessors": {"count": "many"}},
    "flat_positions": {"accessors": {"type": "VEC2"}},
    "node_above_itself": {"nodes": [{"mesh": 0, "children": [n]} for n in (1, 0)]},
}
PHOTOS: dict[str, str | bytes] = {
    **{f"letter{suffix}": LETTER for suffix in (".jpg", ".png", ".heic")},
    "empty.jpg": b"",
    "drawing.svg": '<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"/>',
    "bomb.png": png_header(60_000, 60_000),
    "just_too_large.png": png_header(10_001, 10_000),
    "no_width.png": png_header(0, 10),
    **{
        f"cut{share}{suffix}": picture(suffix)[: len(picture(suffix)) // share]
        for suffix in (".jpg", ".png", ".tiff", ".webp", ".bmp")
        for share in (2, 500)
    },
}
POSES: dict[str, str | bytes] = {
    "empty.json": b"",
    "cut.json": pose()[:99],
    "letter.json": LETTER,
    "binary.json": bytes(range(256)),
    "list.json": "[1, 2, 3]",
    "deep.json": "[" * 100_000,
    "empty_object.json": "{}",
    "long_word.json": pose(projection="x" * 100_000),
    "digits.json": pose().replace("39.5", "1" + "0" * 5000),
    "beyond_floats.json": pose().replace("39.5", "1" + "0" * 400),
    "nan.json": pose({"cx": float("nan")}),
    "far.json": pose({"fx": 1e9}),
    "unequal_chart.json": pose(chart={"name": "free", "names": ["x"], "numbers": [1, 2]}),
    "reflection.json": moved([[1, 0, 0], [0, 1, 0], [0, 0, -1]]),
    "skewed.json": moved([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]),
    "zero.json": moved([[0, 0, 0]] * 3),
}


def refuse(path: Path, kind: str) -> str:
    """The one sentence with which a file is refused."""
    load, error_type = {
        "model": (load_mesh, MeshFileError),
        "photo": (load_photo, PhotoFileError),
        "pose": (lambda path: load_pose(path, 80, 64), PoseFileError),
    }[kind]
    with pytest.raises(error_type) as caught:
        load(path)
    sentence = str(caught.value)
    assert sentence.startswith(f"{path.name}: ")
    assert 30 < len(sentence) < 300
    return sentence


@pytest.mark.parametrize(("kind", "name", "content"), [
    (kind, name, content)
    for kind, contents in (("model", MODELS), ("photo", PHOTOS), ("pose", POSES))
    for name, content in contents.items()
], ids=lambda value: value if isinstance(value, str) and len(value) < 40 else "")  # fmt: skip
def test_a_broken_file_is_refused(tmp_path, kind, name, content):
    refuse(write(tmp_path / name, content), kind)


def test_a_pose_of_another_tool_is_named_by_its_keys(tmp_path: Path) -> None:
    found = refuse(write(tmp_path / "dope.json", {"camera_data": {}, "objects": []}), "pose")
    assert "(its keys: camera_data, objects); make one" in found
    assert "with poseviewer convert" in found


@pytest.mark.parametrize("change", GLTF_CHANGES)
def test_a_gltf_that_contradicts_itself_is_refused(tmp_path: Path, change: str) -> None:
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.bin")  # who opens it waits for ever
    ((key, value),) = GLTF_CHANGES[change].items()

    def contradict(data: dict) -> None:
        data[key] = [data[key][0] | value] if isinstance(value, dict) else value

    refuse(edit(write_gltf(tmp_path, "gone.png"), contradict), "model")


def test_a_ply_of_very_many_empty_rows_is_read_at_once(tmp_path: Path) -> None:
    empty = "".join(f"element n{number} 20000000\n" for number in range(60))
    text = PLY.replace("element face", f"{empty}element face") + TRIANGLE + "3 0 1 2\n"
    assert len(load_mesh(write(tmp_path / "empty.ply", text)).faces) == 1


@pytest.mark.parametrize("kind", ["model", "photo", "pose"])
def test_what_is_no_regular_file_of_a_usual_size_is_refused(tmp_path: Path, kind: str) -> None:
    """All files are opened in one way."""
    path = tmp_path / {"model": "a.obj", "photo": "a.jpg", "pose": "a.json"}[kind]
    assert "no such file" in refuse(path, kind)
    path.mkdir()
    assert "is a folder" in refuse(path, kind)
    path.rmdir()
    with path.open("wb") as file:
        file.truncate(3_000_000_000)
    assert "3,000,000,000 bytes; poseviewer takes a" in refuse(path, kind)
    if hasattr(os, "mkfifo"):
        path.unlink()
        os.mkfifo(path)
        assert "a pipe or a device" in refuse(path, kind)
