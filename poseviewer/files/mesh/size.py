"""How large a model is, found out before it is read: small files can promise huge ones."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.part import MAX_FACES, refuse_if_huge

LARGEST_FILE = 4_000_000_000
"""Bytes: 200 for each face of the largest model."""
CHUNK = 1 << 24
TRIANGLES = 4
"""glTF's mode for a list of triangles; strips and fans have nearly a face for each corner."""


def refuse_large_file(path: Path) -> None:
    """Raise MeshFileError for a file that is larger than any model that poseviewer takes."""
    size = path.stat().st_size
    if size > LARGEST_FILE:
        raise MeshFileError(
            f"{path.name}: {size:,} bytes; poseviewer takes up to {LARGEST_FILE:,}, "
            "simplify the model first."
        )


def refuse_many_words(path: Path, shortest: int, words: Mapping[bytes, str]) -> None:
    """Raise MeshFileError where a text has too many of some words, by what they stand for.

    Each word comes with at least ``shortest`` bytes, so that most files need not be looked at.
    """
    if path.stat().st_size > MAX_FACES * shortest:
        for word, what in words.items():
            refuse_if_huge(path.name, count_of_word(path, word), what)


def count_of_word(path: Path, word: bytes) -> int:
    """How often a word stands in a file, in any case; read piece by piece."""
    count, kept = 0, b""
    with path.open("rb") as file:
        while chunk := file.read(CHUNK):
            text = kept + chunk.lower()
            count += text.count(word)
            # One byte less than the word: what is kept cannot hold it a second time.
            kept = text[max(0, len(text) - len(word) + 1) :]
    return count


def refuse_huge_gltf(name: str, header: dict[str, Any]) -> None:
    """Raise MeshFileError where a glTF header promises too much.

    A mesh counts as often as nodes show it, and a table without bytes in the file is made of
    zeros: both make much of little.
    """
    accessors = header.get("accessors", [])
    faces = [
        sum(_faces_of(primitive, accessors) for primitive in mesh.get("primitives", []))
        for mesh in header.get("meshes", [])
    ]
    shown = [node["mesh"] for node in header.get("nodes", []) if "mesh" in node]
    refuse_if_huge(name, sum(faces[mesh] for mesh in shown))
    refuse_if_huge(name, max((a["count"] for a in accessors), default=0) // 3, "triples of numbers")
    empty = sum(a["count"] for a in accessors if "bufferView" not in a)
    refuse_if_huge(name, empty // 3, "triples of zeros")


def _faces_of(primitive: dict[str, Any], accessors: list[dict[str, Any]]) -> int:
    table = primitive.get("indices", primitive.get("attributes", {}).get("POSITION"))
    corners = 0 if table is None else accessors[table]["count"]
    return corners // 3 if primitive.get("mode", TRIANGLES) == TRIANGLES else corners
