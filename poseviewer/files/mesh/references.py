"""Names of files in a model file."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from urllib.parse import unquote

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.load import gltf_header
from poseviewer.files.mesh.obj import without_options
from poseviewer.files.mesh.parts import material_text
from poseviewer.files.mesh.ply import LONGEST_HEADER, read_header

PICTURE_WORDS = ("bump", "disp", "decal", "norm", "refl")
"""Words of an MTL file that name pictures, beside all that begin with ``map_``."""
MTLLIB = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", re.MULTILINE)
PICTURE_3DS = re.compile(rb"\x00\xa3(.{4})([^\x00]{1,255})\x00", re.DOTALL)
"""The chunk 0xA300, the file name of a material's picture: its id, its length, the name."""
CHUNK_HEADER = 6
"""Bytes of a 3DS chunk's id and length."""


def names_in(path: Path) -> dict[str, bool]:
    """Files that a model or MTL file names, and whether they are read; {} where it is damaged."""
    reader = NAMES.get(path.suffix.lower())
    try:
        return {} if reader is None else reader(path)
    except (OSError, ValueError, AttributeError, TypeError, RecursionError, MeshFileError):
        return {}  # damaged: who reads the model will say so


def _of_obj(path: Path) -> dict[str, bool]:
    found = MTLLIB.findall(path.read_bytes())
    return dict.fromkeys((name.decode("utf-8", "replace").strip() for name in found), True)


def _of_mtl(path: Path) -> dict[str, bool]:
    names: dict[str, bool] = {}
    for line in material_text(path).splitlines():
        word, _, rest = line.strip().partition(" ")
        name, word = without_options(rest.strip()), word.lower()
        if name and (word.startswith("map_") or word in PICTURE_WORDS):
            names[name] = names.get(name, False) or word == "map_kd"
    return names


def _of_ply(path: Path) -> dict[str, bool]:
    with path.open("rb") as file:
        return dict.fromkeys(read_header(path.name, file.read(LONGEST_HEADER))[2], True)


def _of_gltf(path: Path) -> dict[str, bool]:
    header = gltf_header(path)
    entries = [*header.get("buffers", []), *header.get("images", [])]
    uris = [str(entry["uri"]) for entry in entries if entry.get("uri")]
    return {unquote(uri): True for uri in uris if not re.match(r"data:|https?:", uri)}


def _of_3ds(path: Path) -> dict[str, bool]:
    return {
        name.decode("latin-1"): True
        for length, name in PICTURE_3DS.findall(path.read_bytes())
        if struct.unpack("<I", length)[0] == CHUNK_HEADER + len(name) + 1
    }


NAMES = {
    ".obj": _of_obj,
    ".mtl": _of_mtl,
    ".ply": _of_ply,
    ".gltf": _of_gltf,
    ".glb": _of_gltf,
    ".3ds": _of_3ds,
}
