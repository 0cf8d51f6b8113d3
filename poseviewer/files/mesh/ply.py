"""PLY: a header that names the columns, then text or bytes (Turk 1994)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.part import (
    Part,
    colours_from_numbers,
    fan_corners,
    fan_size,
    refuse_if_huge,
)
from poseviewer.files.mesh.ply_columns import (
    TYPES,
    Columns,
    Element,
    Lists,
    columns_from_bytes,
    columns_from_text,
)
from poseviewer.files.mesh.texture import load_texture

UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
COLOUR_NAMES = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
INDEX_NAMES = ("vertex_indices", "vertex_index")


def read_ply(path: Path) -> tuple[list[Part], list[str]]:
    """The parts (one for each texture) of a PLY file, and notes for the user.

    Raises:
        MeshFileError: not a PLY file, cut short, or without the columns that a surface needs.
    """
    data = path.read_bytes()
    elements, encoding, textures, start = _read_header(path.name, data)
    for element in elements:
        what = {"vertex": "vertices", "face": "faces"}.get(element.name, "rows")
        refuse_if_huge(path.name, element.count, what)
    if encoding == "ascii":
        columns = columns_from_text(path.name, elements, data[start:])
    else:
        order = {"binary_little_endian": "<", "binary_big_endian": ">"}[encoding]
        columns = columns_from_bytes(path.name, elements, data, start, order)
    return _parts(path, columns, textures)


def _read_header(name: str, data: bytes) -> tuple[list[Element], str, list[str], int]:
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
    if encoding not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise MeshFileError(f"{name}: PLY format {encoding!r}; wanted ascii or binary.")
    if any(element.count < 0 for element in elements):
        raise MeshFileError(f"{name}: a negative count in the PLY header; export it again.")
    return elements, encoding, textures, start


def _stack(columns: dict, *choices: tuple[str, ...]) -> NDArray | None:
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
        return [Part("", vertices, np.zeros((0, 3), int))], []
    refuse_if_huge(path.name, fan_size(polygons[0]))
    corners = fan_corners(polygons[0])
    faces = polygons[1][corners].astype(np.int64)
    colours = _stack(vertex, *COLOUR_NAMES)
    normals, uvs = _stack(vertex, ("nx", "ny", "nz")), _stack(vertex, *UV_NAMES)
    face_colours = _stack(face, *COLOUR_NAMES) if colours is None else None
    texcoord: Lists | None = face.get("texcoord")
    per_corner = texcoord is not None and np.array_equal(texcoord[0], 2 * polygons[0])
    if face_colours is not None or per_corner:
        if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
            return [Part("", vertices, faces)], []  # refused by whoever checks the indices
        # What belongs to faces is given to corners, each a vertex of its own.
        source, faces = faces.ravel(), np.arange(faces.size).reshape(-1, 3)
        vertices = vertices[source]
        normals = None if normals is None else normals[source]
        colours = None if colours is None else colours[source]
        if face_colours is not None:
            polygon = np.repeat(np.arange(len(polygons[0])), np.maximum(polygons[0] - 2, 0))
            colours = np.repeat(face_colours[polygon], 3, axis=0)
        if per_corner and texcoord is not None:
            uvs = texcoord[1].reshape(-1, 2)[corners.ravel()]
    if colours is not None:
        colours = colours_from_numbers(colours)
    part = Part("", vertices, faces, normals, colours, uvs)
    return _with_textures(path, part, textures, face.get("texnumber"), polygons[0])


def _with_textures(
    path: Path, part: Part, textures: list[str], numbers: NDArray | None, counts: NDArray
) -> tuple[list[Part], list[str]]:
    """Cut the part by the texture of its faces; a texture that is missing is a note."""
    if not textures or part.uvs is None:
        return [part], []
    which = np.zeros(len(part.faces), dtype=int)
    if numbers is not None and len(textures) > 1:
        which = np.repeat(numbers, np.maximum(counts - 2, 0)).astype(int)
    parts, notes = [], []
    for i in np.unique(which):
        texture = None
        try:
            texture = load_texture(path.parent, textures[i] if 0 <= i < len(textures) else "?")
        except OSError as error:
            notes.append(f"Texture left out: {error}.")
        faces = part.faces[which == i]
        parts.append(Part("", part.vertices, faces, part.normals, part.colours, part.uvs, texture))
    return parts, notes
