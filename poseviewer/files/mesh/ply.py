"""PLY: a header that names the columns, then text or bytes (Turk 1994).

Read here rather than by ``plyfile``, which takes two to ten times as long on models in text.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field, replace
from pathlib import Path
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
"""How many values each row has (N,), and all the values one after another."""
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
    with path.open("rb") as file:
        data = file.read(LONGEST_HEADER)
        elements, encoding, textures, at = read_header(path.name, data)
        data += file.read()
    body = memoryview(data)
    if encoding == "ascii":  # made the bytes of a file in which all is a double
        try:
            body = memoryview(numbers_from_text(data[at:].decode("ascii", "replace")).tobytes())
        except ValueError:
            raise MeshFileError(
                f"{path.name}: something else than numbers below the PLY header; export it again."
            ) from None
        at = 0
    columns = {}
    for element in elements:
        columns[element.name], at = _read_element(path.name, element, body, at, encoding)
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


def _read_element(
    name: str, element: Element, data: memoryview, at: int, encoding: str
) -> tuple[Columns, int]:
    """An element's columns, from the byte ``at`` on, and where it ends."""
    order, is_text = ORDERS[encoding], encoding == "ascii"
    kinds = [  # as they are stored
        (key, order + ("d" if is_text else count), order + ("d" if is_text else value))
        if count
        else (key, "", order + ("d" if is_text else value))
        for key, count, value in element.properties
    ]
    try:
        columns, at = _read_table(element, data, at, kinds) or _walk(element, data, at, kinds)
    except (struct.error, OverflowError):
        raise MeshFileError(
            f"{name}: the header promises {element.count:,} of {element.name!r}, but the file "
            "ends before; it is cut short, copy or export it again."
        ) from None
    for key, count, value in element.properties:
        if not count:
            columns[key] = columns[key].astype(value)
    return columns, at


def _read_table(
    element: Element, data: memoryview, at: int, kinds: list[tuple[str, str, str]]
) -> tuple[Columns, int] | None:
    """Rows that are all as long as the first, cut out as a table; None where they are not."""
    fields, end = [], at  # named by their places: a file may name two columns alike
    for i, (_, count, value) in enumerate(kinds):
        if not count:
            fields.append((f"{i}", value))
        else:
            length = int(struct.unpack_from(count, data, end)[0]) if element.count else 0
            if not 0 <= length <= len(data):
                raise OverflowError
            fields += [(f"count {i}", count), (f"{i}", value, (length,))]
            end += struct.calcsize(count) + (length - 1) * struct.calcsize(value)
        end += struct.calcsize(value)
    row = np.dtype(fields)
    end = at + element.count * row.itemsize
    if end > len(data) or not row.itemsize:
        return None
    table = np.frombuffer(data, row, element.count, at)
    columns: Columns = {}
    for i, (key, count, _) in enumerate(kinds):
        columns[key] = table[f"{i}"]
        if count:
            counts = table[f"count {i}"].astype(np.int64)
            if np.any(counts != columns[key].shape[1]):
                return None
            columns[key] = counts, columns[key].ravel()
    return columns, end


def _walk(
    element: Element, data: memoryview, at: int, kinds: list[tuple[str, str, str]]
) -> tuple[Columns, int]:
    """Rows of any lengths, one by one; raises struct.error where the file ends before."""
    found: dict[str, tuple[list, list]] = {key: ([], []) for key, _, _ in kinds}
    sizes = [
        (*found[key], struct.Struct(count) if count else None, value[0], value[1],
         struct.calcsize(value))
        for key, count, value in kinds
    ]  # fmt: skip
    for _ in range(element.count):
        for counts, values, count, order, letter, width in sizes:
            length = 1
            if count is not None:
                length = int(count.unpack_from(data, at)[0])
                at += count.size
                if not 0 <= length <= len(data):
                    raise OverflowError
            counts.append(length)
            values.extend(struct.unpack_from(f"{order}{length}{letter}", data, at))
            at += length * width
    columns: Columns = {}
    for key, count, value in kinds:
        counts, values = found[key]
        columns[key] = (
            (np.array(counts, np.int64), np.array(values, float))
            if count
            else np.array(values, value)
        )
    return columns, at


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
