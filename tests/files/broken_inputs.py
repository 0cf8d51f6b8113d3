"""Files that cannot be used, one of each kind that users come with."""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import trimesh
from PIL import Image

Kind = Literal["photo", "model", "pose"]


@dataclass(frozen=True)
class BrokenInput:
    name: str
    """What is wrong with it; unique."""
    kind: Kind
    path: Path


def make_broken_inputs(folder: Path) -> list[BrokenInput]:
    """Write all broken files into ``folder``."""
    made = []
    groups: list[tuple[Kind, Contents]] = [
        ("model", _models()),
        ("photo", _photos(folder)),
        ("pose", _poses()),
    ]
    for kind, contents in groups:
        for name, (suffix, data) in contents.items():
            path = folder / f"{kind}-{name.replace(' ', '-')}{suffix}"
            if data is FOLDER:
                path.mkdir()
            elif data is PIPE:
                os.mkfifo(path)
            elif data is DEVICE:
                path.symlink_to("/dev/zero")
            elif data is HOLE:
                with path.open("wb") as file:
                    file.truncate(HOLE_SIZE)
            elif data is not None:
                path.write_bytes(data if isinstance(data, bytes) else data.encode())
            made.append(BrokenInput(name, kind, path))
    return made


FOLDER = b"<make a folder>"
PIPE = b"<make a pipe that nobody writes to>"
DEVICE = b"<make a link to a device without end>"
HOLE = b"<make a file without content that seems to be huge>"
HOLE_SIZE = 3_000_000_000
ODD = {"pipe": PIPE, "device": DEVICE, "hole": HOLE}
if not hasattr(os, "mkfifo"):
    ODD = {"hole": HOLE}
Contents = dict[str, tuple[str, bytes | str | None]]

CUBE_OBJ = (
    "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1))
    + "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
)

PLY_HEAD = (
    "ply\nformat {format} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n"
    "property float z\nelement face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
)
TRIANGLE = "0 0 0\n1 0 0\n0 1 0\n"


def _models() -> Contents:
    box = trimesh.creation.box()
    glb, ply, stl = (_exported(box, kind) for kind in ("glb", "ply", "stl"))
    text_ply, off = _exported(box, "ply", encoding="ascii"), _exported(box, "off")
    head = PLY_HEAD.format
    endings = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf", ".3ds")
    odd: Contents = {f"{what} {e[1:]}": (e, data) for what, data in ODD.items() for e in endings}
    return odd | {
        "missing obj": (".obj", None),
        "missing glb": (".glb", None),
        "folder obj": (".obj", FOLDER),
        "empty obj": (".obj", b""),
        "empty ply": (".ply", b""),
        "empty stl": (".stl", b""),
        "empty glb": (".glb", b""),
        "unknown extension": (".xyz", "0 0 0\n"),
        "no extension": ("", CUBE_OBJ),
        "cut glb": (".glb", glb[: len(glb) // 2]),
        "glb with a cut header": (".glb", glb[:17]),
        "cut binary ply": (".ply", ply[:-20]),
        "cut ply header": (".ply", ply[:60]),
        "cut text ply": (".ply", text_ply[:-25]),
        "text ply cut in the vertices": (".ply", text_ply[: text_ply.index(b"end_header") + 60]),
        "cut binary stl": (".stl", stl[:-30]),
        "cut text stl": (".stl", _exported(box, "stl_ascii")[:-150]),
        "cut obj vertex": (".obj", CUBE_OBJ[: CUBE_OBJ.index("v 1 1 1") + 5] + "\nf 1 2 3\n"),
        "cut obj face": (".obj", CUBE_OBJ.replace("f 2 6 8 4", "f 2/")),
        "cut off": (".off", off[: len(off) * 2 // 3]),
        "text as ply": (".ply", "Dear all,\nplease find the model attached.\n"),
        "text as glb": (".glb", "Dear all,\nplease find the model attached.\n"),
        "text as stl": (".stl", "Dear all,\nplease find the model attached.\n" * 5),
        "text as off": (".off", "Dear all,\nplease find the model attached.\n"),
        "text as obj": (".obj", "Dear all,\nplease find the model attached.\n"),
        "text as gltf": (".gltf", "Dear all,\n"),
        "gltf without meshes": (".gltf", '{"asset": {"version": "2.0"}}'),
        "gltf list": (".gltf", "[1, 2]"),
        "gltf with a missing buffer": (".gltf", small_gltf("not-there.bin")),
        "point cloud obj": (".obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
        "point cloud ply": (".ply", head(format="ascii", vertices=3, faces=0) + TRIANGLE),
        "off of too few lines": (".off", "OFF\n4 1 0\n" + TRIANGLE + "3 0 1 2\n"),
        "off of too many lines": (".off", "OFF\n3 1 0\n" + TRIANGLE + "3 0 1 2\n3 0 1 2\n"),
        "off of a short face": (".off", "OFF\n3 1 0\n" + TRIANGLE + "3 0 1\n"),
        "gltf of flat positions": (".gltf", small_gltf(type="VEC2")),
        "gltf table beyond its buffer": (".gltf", small_gltf(count=6_000_000)),
        "zero faces off": (".off", "OFF\n3 0 0\n" + TRIANGLE),
        "zero faces stl": (".stl", bytes(84)),
        "flat stl": (".stl", bytes(80) + struct.pack("<I", 1) + bytes(50)),
        "nan vertex obj": (".obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        "inf vertex ply": (
            ".ply",
            head(format="ascii", vertices=3, faces=1) + "inf 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        ),
        "nan vertex stl": (".stl", _nan_stl()),
        "huge coordinates obj": (".obj", "v 1e200 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        "index out of range obj": (".obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
        "index zero obj": (".obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n"),
        "uv index out of range obj": (
            ".obj",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/7\n",
        ),
        "index out of range ply": (
            ".ply",
            head(format="ascii", vertices=3, faces=1) + TRIANGLE + "3 0 1 5\n",
        ),
        "negative index ply": (
            ".ply",
            head(format="ascii", vertices=3, faces=1) + TRIANGLE + "3 0 1 -1\n",
        ),
        "index out of range off": (".off", "OFF\n3 1 0\n" + TRIANGLE + "3 0 1 5\n"),
        "words for numbers obj": (".obj", "v zero 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        "words for numbers ply": (
            ".ply",
            head(format="ascii", vertices=3, faces=1) + "a b c\n" + TRIANGLE,
        ),
        "unknown ply type": (
            ".ply",
            head(format="ascii", vertices=3, faces=1).replace("float y", "text y") + TRIANGLE,
        ),
        "too many faces ply": (
            ".ply",
            head(format="binary_little_endian", vertices=3, faces=30_000_000_000),
        ),
        "too many faces stl": (".stl", bytes(80) + struct.pack("<I", 4_000_000_000) + bytes(500)),
        "too many faces off": (".off", "OFF\n3 30000000000 0\n" + TRIANGLE),
        "text as 3ds": (".3ds", "Dear all,\nplease find the model attached.\n"),
    }


def _exported(mesh: trimesh.Trimesh, kind: str, **options: str) -> bytes:
    data = mesh.export(file_type=kind, **options)
    return data.encode() if isinstance(data, str) else bytes(data)


def _nan_stl() -> bytes:
    numbers = np.array([0, 0, 1, np.nan, 0, 0, 1, 0, 0, 0, 1, 0], "<f4")
    return bytes(80) + struct.pack("<I", 1) + numbers.tobytes() + bytes(2)


def small_gltf(uri: str = "data:;base64," + "AACAPwAA" * 9, **table: object) -> str:
    """A glTF file of one triangle in a buffer of 54 bytes, at the ``uri``; ``table``: what is
    another in its accessor.
    """
    accessor = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "buffers": [{"uri": uri, "byteLength": 54}],
            "bufferViews": [{"buffer": 0, "byteLength": 54}],
            "accessors": [accessor | table],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "nodes": [{"mesh": 0}],
            "scenes": [{"nodes": [0]}],
        }
    )


def _photos(folder: Path) -> Contents:
    rng = np.random.default_rng(3)
    picture = Image.fromarray(rng.integers(0, 256, (64, 80, 3), dtype=np.uint8))
    contents: Contents = {
        "missing": (".jpg", None),
        "folder": (".png", FOLDER),
        "empty jpg": (".jpg", b""),
        "empty png": (".png", b""),
        "text as png": (".png", "Dear all,\nplease find the photo attached.\n"),
        "text as jpg": (".jpg", "Dear all,\nplease find the photo attached.\n"),
        "svg": (".svg", '<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"/>'),
        "zeros as jpg": (".jpg", bytes(1000)),
        "bomb png": (".png", png_header(60_000, 60_000)),
        "bomb tiff": (".tiff", _tiff_header(60_000, 60_000)),
        "just too large tiff": (".tiff", _tiff_header(10_001, 10_000)),
        "just too large png": (".png", png_header(10_001, 10_000)),
        "png of no width": (".png", png_header(0, 10)),
        **{f"{what} {e[1:]}": (e, odd) for what, odd in ODD.items() for e in (".jpg", ".heic")},
    }
    for suffix in (".jpg", ".png", ".tiff", ".webp", ".bmp"):
        path = folder / f"whole{suffix}"
        picture.save(path)
        data = path.read_bytes()
        path.unlink()
        contents[f"cut {suffix[1:]}"] = (suffix, data[: len(data) // 2])
        contents[f"{suffix[1:]} cut after 20 bytes"] = (suffix, data[:20])
    return contents


def png_header(width: int, height: int) -> bytes:
    """A PNG that promises a size, with hardly anything behind."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        checksum = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + checksum

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = chunk(b"IDAT", zlib.compress(bytes(1000)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + body + chunk(b"IEND", b"")


def _tiff_header(width: int, height: int) -> bytes:
    """A grey TIFF that promises a size in one compressed strip, with hardly anything behind."""
    strip = zlib.compress(bytes(1000))
    short, long = 3, 4
    tags = [
        (256, long, width),
        (257, long, height),
        (258, short, 8),
        (259, short, 8),  # Deflate
        (262, short, 1),
        (273, long, 8),
        (277, short, 1),
        (278, long, height),
        (279, long, len(strip)),
    ]
    entries = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in tags)
    directory = struct.pack("<H", len(tags)) + entries + bytes(4)
    return struct.pack("<2sHI", b"II", 42, 8 + len(strip)) + strip + directory


def good_pose() -> dict:
    """A pose file's contents, the least that is needed."""
    return {
        "projection": "perspective",
        "camera": {"fx": 500.0, "fy": 500.0, "cx": 39.5, "cy": 31.5},
        "camera_from_model": {
            "rotation": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            "translation": [0.0, 0.0, 5.0],
        },
    }


def _poses() -> Contents:
    def changed(change: Callable[[dict], object]) -> tuple[str, str]:
        pose = good_pose()
        change(pose)
        return ".json", json.dumps(pose)

    def rotation(matrix: object) -> tuple[str, str]:
        return changed(lambda pose: pose["camera_from_model"].update(rotation=matrix))

    def camera(**values: object) -> tuple[str, str]:
        return changed(lambda pose: pose["camera"].update(values))

    text = json.dumps(good_pose())
    return {
        "missing": (".json", None),
        "folder": (".json", FOLDER),
        "empty": (".json", b""),
        "cut": (".json", text[: len(text) // 2]),
        "text": (".json", "fx = 500\n"),
        "binary": (".json", bytes(range(256))),
        "list": (".json", "[1, 2, 3]"),
        "null": (".json", "null"),
        "deep": (".json", "[" * 100_000),
        "empty object": (".json", "{}"),
        **{what: (".json", data) for what, data in ODD.items()},
        "fx beyond any lens": camera(fx=1e9),
        "cy beyond any picture": camera(cy=1e12),
        "huge translation": changed(
            lambda pose: pose["camera_from_model"].update(translation=[0, 1e300, 5])
        ),
        "very long projection": changed(lambda pose: pose.update(projection="x" * 100_000)),
        "number of 5000 digits": (".json", text.replace("39.5", "1" + "0" * 5000)),
        "nan cx": camera(cx=float("nan")),
        "whole number beyond floats": (".json", text.replace("39.5", "1" + "0" * 400)),
        "reflection": rotation([[1, 0, 0], [0, 1, 0], [0, 0, -1]]),
        "not a rotation": rotation([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]),
        "scaled rotation": rotation([[2, 0, 0], [0, 2, 0], [0, 0, 2]]),
        "zero rotation": rotation([[0, 0, 0], [0, 0, 0], [0, 0, 0]]),
        "nan rotation": rotation([[float("nan"), 0, 0], [0, 1, 0], [0, 0, 1]]),
        "chart of unequal lengths": changed(
            lambda pose: pose.update(chart={"name": "free", "names": ["x"], "numbers": [1, 2]})
        ),
    }
