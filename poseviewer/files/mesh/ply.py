"""PLY: a header that names the columns, then text or bytes (Turk 1994).

Read here rather than by ``plyfile``, which takes two to ten times as long on models in text.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from struct import Struct, calcsize, unpack_from
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.parts import (
    Part,
    colours_from_numbers,
    fan_corners,
    load_textures,
    no_faces,
    numbers_from_text,
    split_by,
)

TYPES = {
    "char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I",
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float": "f", "float32": "f", "double": "d", "float64": "d",
}  # fmt: skip
"""Letters of both ``struct`` and NumPy."""
ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
COLOUR_NAMES = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
LONGEST_HEADER = 1_000_000
"""Bytes."""
INDEX_NAMES = ("vertex_indices", "vertex_index")

Lists = tuple[NDArray[np.int64], NDArray]
"""Counts of values in each row (N,), and all the values one after another."""
Columns = dict[str, Any]
"""By name: an array (N,) of numbers, or Lists."""


@dataclass
class Element:
    """A table of the file, as its header announces it."""

    name: str
    count: int
    """Rows."""
    properties: list[tuple[str, str | None, str]] = field(default_factory=list)
    """Name, type of the count (lists only), type of the values."""


def read_ply(path: Path) -> tuple[list[Part], list[str]]:
    """The parts (one for each texture) of a PLY file, and notes for the user."""
    data = path.read_bytes()
    elements, encoding, textures, at = read_header(path.name, data)
    order, body = ORDERS[encoding], memoryview(data)
    if encoding == "ascii":  # made the bytes of a file in which all is a double
        numbers = numbers_from_text(data[at:].decode("ascii", "replace"))
        at, body = 0, memoryview(numbers.tobytes())
    columns = {}
    for element in elements:
        kinds = [
            (count and order + ("d" if encoding == "ascii" else count),
             order + ("d" if encoding == "ascii" else value))
            for _, count, value in element.properties
        ]  # fmt: skip
        table = _read_table(element.count, body, at, kinds)
        values, at = table or _walk(element.count, body, at, kinds)
        columns[element.name] = {
            name: found if count else found.astype(value)
            for (name, count, value), found in zip(element.properties, values, strict=True)
        }
    return _parts(path, columns, textures)


def read_header(name: str, data: bytes) -> tuple[list[Element], str, list[str], int]:
    """Elements, encoding, names of textures, and where the header ends, of a PLY file's bytes."""
    end = data.find(b"end_header")
    start = data.find(b"\n", end) + 1
    if not data.startswith(b"ply") or end < 0 or start == 0:
        raise MeshFileError(f"{name}: no PLY header; is it a PLY file, and whole? Export it again.")
    elements: list[Element] = []
    encoding, textures = "", []
    for line in data[:end].decode("utf-8", "replace").splitlines():
        words = line.split()
        try:
            match words[:1]:
                case ["format"]:
                    encoding = words[1]
                case ["comment"] if len(words) > 2 and words[1].lower() == "texturefile":
                    textures.append(line.split(None, 2)[2].strip())
                case ["element"]:
                    elements.append(Element(words[1], int(words[2])))
                case ["property"] if words[1] == "list":
                    elements[-1].properties.append((words[4], TYPES[words[2]], TYPES[words[3]]))
                case ["property"]:
                    elements[-1].properties.append((words[2], None, TYPES[words[1]]))
        except (IndexError, KeyError, ValueError):
            raise MeshFileError(
                f"{name}: the PLY header's line {line.strip()[:60]!r} makes no sense; "
                "export it again."
            ) from None
    if encoding not in ORDERS:
        raise MeshFileError(f"{name}: PLY format {encoding!r}; wanted ascii or binary.")
    if any(element.count < 0 for element in elements):
        raise MeshFileError(f"{name}: a negative count in the PLY header; export it again.")
    return elements, encoding, textures, start


Kinds = list[tuple[str | None, str]]
"""NumPy's types as they are stored: of the count (lists only), and of the values."""


def _read_table(rows: int, data: memoryview, at: int, kinds: Kinds) -> tuple[list[Any], int] | None:
    """Columns of rows all as long as the first, and where they end; None where they are not."""
    fields: list[Any] = []
    for i, (count, value) in enumerate(kinds):
        shape = ()
        if count:
            start = at + np.dtype(fields).itemsize
            shape = (int(np.frombuffer(data, count, 1, start)[0]) if rows else 0,)
            fields.append((f"count {i}", count))
        fields.append((f"{i}", value, shape))
    row = np.dtype(fields)
    end = at + rows * row.itemsize
    if end > len(data):
        return None
    table = np.frombuffer(data, row, rows if row.itemsize else 0, at)
    columns = []
    for i, (count, _) in enumerate(kinds):
        values = table[f"{i}"]
        if count:
            counts = table[f"count {i}"].astype(np.int64)
            if np.any(counts != values.shape[1]):
                return None
            values = counts, values.ravel()
        columns.append(values)
    return columns, end


def _walk(rows: int, data: memoryview, at: int, kinds: Kinds) -> tuple[list[Any], int]:
    """Columns of rows of any lengths; raises struct.error where the file ends before."""
    plan = [
        ([], [], Struct(count) if count else None, value, calcsize(value)) for count, value in kinds
    ]
    for _ in range(rows):
        for counts, values, count, value, size in plan:
            length = 1
            if count:
                length = int(count.unpack_from(data, at)[0])
                at += count.size
                counts.append(length)
            values += unpack_from(f"{value[0]}{length}{value[1]}", data, at)
            at += length * size
    return [
        (np.array(counts), np.array(values, float)) if count else np.array(values, value)
        for counts, values, count, value, _ in plan
    ], at


def _stack(columns: Columns, *choices: tuple[str, ...]) -> NDArray | None:
    """The first of the choices of columns that is there, side by side."""
    for names in choices:
        if all(name in columns and not isinstance(columns[name], tuple) for name in names):
            return np.stack([columns[name] for name in names], axis=1)
    return None


def _parts(
    path: Path, columns: dict[str, Columns], textures: list[str]
) -> tuple[list[Part], list[str]]:
    vertex, face = columns.get("vertex", {}), columns.get("face", {})
    vertices = _stack(vertex, ("x", "y", "z"))
    if vertices is None:
        raise MeshFileError(f"{path.name}: no vertices x, y, z in the PLY header; export it again.")
    polygons: Lists | None = next((face[k] for k in INDEX_NAMES if k in face), None)
    if polygons is None or not len(polygons[0]):
        return no_faces(vertices), []
    corners = fan_corners(polygons[0])
    faces = polygons[1][corners].astype(np.int64)
    colours = _stack(vertex, *COLOUR_NAMES)
    normals, uvs = _stack(vertex, ("nx", "ny", "nz")), _stack(vertex, *UV_NAMES)
    face_colours = _stack(face, *COLOUR_NAMES) if colours is None else None
    texcoord: Lists | None = face.get("texcoord")
    per_corner = texcoord is not None and np.array_equal(texcoord[0], 2 * polygons[0])
    triangles = np.maximum(polygons[0] - 2, 0)
    if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
        return [Part("", vertices, faces)], []  # refused where indices are checked
    if face_colours is not None or per_corner:
        # What belongs to faces is given to corners, each a vertex of its own.
        source, faces = faces.ravel(), np.arange(faces.size).reshape(-1, 3)
        vertices = vertices[source]
        normals = None if normals is None else normals[source]
        colours = None if colours is None else colours[source]
        if face_colours is not None:
            colours = np.repeat(np.repeat(face_colours, triangles, axis=0), 3, axis=0)
        if per_corner and texcoord is not None:
            uvs = texcoord[1].reshape(-1, 2)[corners.ravel()]
    colours = None if colours is None else colours_from_numbers(colours)
    part = Part("", vertices, faces, normals, colours, uvs)
    if not textures or uvs is None:
        return [part], []
    notes: list[str] = []
    pictures = load_textures(path.parent, textures, notes)
    numbers = face.get("texnumber")
    if numbers is None or len(textures) == 1:
        return [replace(part, texture=pictures.get(textures[0]))], notes
    which = np.repeat(numbers, triangles).astype(np.int64)
    which[(which < 0) | (which >= len(textures))] = len(textures)
    parts = []
    for name, own in zip([*textures, "?"], split_by(which, len(textures) + 1), strict=True):
        if len(own):
            parts.append(replace(part.of_faces(own), texture=pictures.get(name)))
    return parts, notes
