"""PLY: a header that names the columns, then text or bytes (Turk 1994)."""

import re
from dataclasses import replace
from pathlib import Path
from struct import Struct, calcsize, unpack_from
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.files.mesh import parts as p
from poseviewer.files.mesh.polygons import polygon_corners, strip_corners

TYPES = {
    "char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I",
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float": "f", "float32": "f", "double": "d", "float64": "d",
}  # fmt: skip
"""Letters of both ``struct`` and NumPy."""
ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
COLOUR_NAMES = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"),
                ("r", "g", "b"), ("gray",) * 3, ("grey",) * 3)  # fmt: skip
COLOUR = re.compile("red|green|blue|colou?r|rgb|gr[ae]y|intensity|reflect")
"""Words in names of columns that may be colours."""
MAX_HEADER_BYTES = 1_000_000
ELEMENTS = ("vertex", "face", "tristrips", "edge", "camera")
"""Those that are read, and those that say nothing of the surface."""
INDEX_NAMES = ("vertex_indices", "vertex_index")

Kind = tuple[str | None, str]
Element = tuple[str, int, list[tuple[str, Kind]]]
"""Name of a table of the file, its number of rows, and its columns."""
Columns = dict[str, Any]
"""By name: numbers (N,), or of lists the counts (N,) and all the values one after another."""


def read_ply(path: Path) -> p.ModelParts:
    """The parts (one for each texture) of a PLY file, and notes for the user."""
    data = path.read_bytes()
    elements, encoding, textures, at = _read_header(data)
    order, body = ORDERS[encoding], memoryview(data)
    if encoding == "ascii":  # made the bytes of a file in which all is a double
        text = data[at:].decode("ascii", "replace")
        at, body = 0, memoryview(np.fromstring(text, sep=" ").tobytes())
    tables: dict[str, Columns] = {}
    for name, rows, columns in elements:
        kinds: list[Kind] = [
            (count and order + ("d" if encoding == "ascii" else count),
             order + ("d" if encoding == "ascii" else value))
            for _, (count, value) in columns
        ]  # fmt: skip
        values, at = _read_table(rows, body, at, kinds) or _walk(rows, body, at, kinds)
        tables[name] = {
            key: column if count else column.astype(value)
            for (key, (count, value)), column in zip(columns, values, strict=True)
        }
    if encoding == "ascii" and at < len(body):
        raise ValueError("rows are longer than the header says")
    strips = tables.get("tristrips", {})
    strips = next((strips[k] for k in INDEX_NAMES if k in strips), None)
    parts = _parts(path, tables.get("vertex", {}), tables.get("face", {}), strips, textures)
    if others := [name for name, rows, _ in elements if rows and name not in ELEMENTS]:
        parts.notes.append(f"Elements of the PLY, left out: {', '.join(others)[:120]}.")
    return parts


def _read_header(data: bytes) -> tuple[list[Element], str, list[str], int]:
    end = data.find(b"end_header")
    start = data.find(b"\n", end) + 1
    if not data.startswith(b"ply") or end < 0 or start == 0:
        raise ValueError("no PLY header")
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
                    elements.append((words[1], int(words[2]), []))
                case ["property"] if words[1] == "list":
                    elements[-1][2].append((words[4], (TYPES[words[2]], TYPES[words[3]])))
                case ["property"]:
                    elements[-1][2].append((words[2].lower(), (None, TYPES[words[1]])))
        except (IndexError, KeyError, ValueError):
            raise ValueError(f"the header's line {line.strip()[:60]!r} makes no sense") from None
    if encoding not in ORDERS or any(rows < 0 for _, rows, _ in elements):
        raise ValueError(f"a count below 0 in the header, or the format {encoding!r}")
    return elements, encoding, textures, start


def _read_table(
    rows: int, data: memoryview, at: int, kinds: list[Kind]
) -> tuple[list[Any], int] | None:
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


def _walk(rows: int, data: memoryview, at: int, kinds: list[Kind]) -> tuple[list[Any], int]:
    """Read columns of rows of any lengths, and where they end.

    Raises:
        struct.error: the file ends before.
    """
    plan = [([], [], Struct(n) if n else None, kind, calcsize(kind)) for n, kind in kinds]
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
    for names in choices:
        if all(name in columns and not isinstance(columns[name], tuple) for name in names):
            return np.stack([columns[name] for name in names], axis=1)
    return None


def _parts(
    path: Path, vertex: Columns, face: Columns, strips: Any, textures: list[str]
) -> p.ModelParts:
    vertices = _stack(vertex, ("x", "y", "z"))
    if vertices is None:
        raise ValueError("no vertices x, y, z in the header")
    counts, indices = next((face[k] for k in INDEX_NAMES if k in face), (np.zeros(0),) * 2)
    indices, triangles = indices.astype(np.int64), np.maximum(counts - 2, 0)
    p.check_indices(indices, len(vertices))
    corners = polygon_corners(counts, vertices[indices])
    faces = indices[corners]
    if strips:  # a row is one or more of them, with -1 between
        faces = strip_corners(np.insert(strips[1], np.cumsum(strips[0])[:-1], -1))
        p.check_indices(faces, len(vertices))
    normals, uvs = _stack(vertex, ("nx", "ny", "nz")), _stack(vertex, *UV_NAMES)
    part = p.Part("", vertices, faces, normals, _stack(vertex, *COLOUR_NAMES), uvs)
    texcoord = face.get("texcoord", (None,))
    per_corner = np.array_equal(texcoord[0], 2 * counts)
    of_faces = _stack(face, *COLOUR_NAMES) if part.colours is None else None
    if per_corner or of_faces is not None:
        part = part.corners_of(slice(None))
    if per_corner:
        part = replace(part, uvs=texcoord[1].reshape(-1, 2)[corners.ravel()])
    if of_faces is not None:
        part = replace(part, colours=np.repeat(np.repeat(of_faces, triangles, axis=0), 3, axis=0))
    notes: list[str] = []
    if part.colours is not None:
        part = replace(part, colours=p.colours_from_numbers(part.colours, notes))
    elif unread := [name for name in (*vertex, *face) if COLOUR.search(name)]:
        notes.append(f"Columns of the PLY that may be colours, left out: {', '.join(unread)}.")
    if not textures or part.uvs is None:
        return p.ModelParts([part], notes)
    pictures, number = p.load_textures(path.parent, textures, notes), face.get("texnumber")
    if number is None or len(textures) == 1:
        return p.ModelParts([replace(part, texture=pictures.get(textures[0]))], notes)
    which, end = np.repeat(number, triangles).astype(np.int64), len(textures)
    of_texture = p.indices_by_group(np.where((which < 0) | (which > end), end, which), end + 1)
    parts = [
        replace(part.corners_of(own), texture=pictures.get(name))
        for name, own in zip([*textures, "?"], of_texture, strict=True)
        if len(own)
    ]
    return p.ModelParts(parts, notes)
