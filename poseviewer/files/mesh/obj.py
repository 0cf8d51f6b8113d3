"""Wavefront OBJ with its MTL: parts by ``o`` and ``g``, materials by ``usemtl``.

Read here rather than by trimesh, which loses group names where materials change inside a group,
and gets relative indices in mid-file wrong.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.named import bare_name, find_named
from poseviewer.files.mesh.parts import (
    Part,
    colours_from_numbers,
    fan_corners,
    load_textures,
    material_text,
    no_faces,
    split_by,
)

Material = tuple[NDArray | None, NDArray[np.uint8] | None]
"""An MTL file's diffuse RGB (3,) in [0, 1], and texture."""
KINDS = ("v", "vt", "vn", "f")


@dataclass
class _Lines:
    """The lines of an OBJ file, sorted by what they say."""

    values: dict[str, list[str]] = field(default_factory=lambda: {k: [] for k in KINDS})
    """Behind ``v``, ``vt``, ``vn`` and ``f``."""
    relative: dict[int, tuple[int, ...]] = field(default_factory=dict)
    """Numbers of ``v``, ``vt`` and ``vn`` before each face whose indices count backwards."""
    changes: list[tuple[int, str, str]] = field(default_factory=lambda: [(0, "", "")])
    """(faces so far, part name, material name)."""
    libraries: list[str] = field(default_factory=list)


def read_obj(path: Path) -> tuple[list[Part], list[str]]:
    """The parts of an OBJ file, one for each part name and material, and notes for the user."""
    lines = _sort_lines(path.read_text(encoding="utf-8", errors="replace"))
    v, vt, vn, _ = lines.values.values()
    vertices, colours = _read_vertices(v)
    uvs = read_table([f"{line} 0" for line in vt], 2)  # the second number may be left out
    normals = read_table(vn, 3)
    notes: list[str] = []
    counts, corners = _read_faces(lines)
    _check_range(path.name, corners, (len(vertices), len(uvs), len(normals)))
    if np.any(counts < 3):
        notes.append(f"Faces of fewer than 3 corners, left out: {np.sum(counts < 3):,}.")
    materials = _read_materials(path, lines.libraries, notes)
    starts = [start for start, _, _ in lines.changes]
    names = [(name, material) for _, name, material in lines.changes]
    keys = {key: number for number, key in enumerate(dict.fromkeys(names))}
    which = np.repeat([keys[key] for key in names], np.diff([*starts, len(counts)]))
    of_part = split_by(np.repeat(which, np.maximum(counts - 2, 0)), len(keys))
    missing = sorted({m for _, m in keys if m and m not in materials})
    if missing and materials:
        notes.append(f"Materials not in the MTL file: {', '.join(missing)[:120]}.")
    triangles, parts = fan_corners(counts), []
    for (name, material), own in zip(keys, of_part, strict=True):
        used = corners[triangles[own]]
        if len(used):
            found = materials.get(material, (None, None))
            parts.append(_as_part(name, used, vertices, colours, uvs, normals, found))
    return parts or no_faces(vertices), notes


def _sort_lines(text: str) -> _Lines:
    lines = _Lines()
    values = lines.values
    thing = group = material = ""
    for line in text.replace("\\\n", " ").replace("\\\r\n", " ").splitlines():
        word, _, rest = line.strip().partition(" ")
        if word in values:
            if word == "f" and "-" in rest:
                ends = tuple(len(values[kind]) for kind in KINDS[:3])
                lines.relative[len(values["f"])] = ends
            values[word].append(rest)
        elif word in ("o", "g", "usemtl"):
            rest = rest.strip()
            thing, group = (rest, "") if word == "o" else (thing, rest if word == "g" else group)
            material = rest if word == "usemtl" else material
            name = " ".join(dict.fromkeys(n for n in (thing, group) if n))
            lines.changes.append((len(values["f"]), name, material))
        elif word == "mtllib":
            lines.libraries.append(rest.strip())
    return lines


def read_table(lines: list[str], columns: int) -> NDArray:
    """(N, columns) of the first numbers of each line; raises ValueError where one has fewer."""
    if not lines:
        return np.zeros((0, columns))
    table = np.loadtxt(lines, usecols=range(columns), comments=None, ndmin=2)
    if len(table) != len(lines):
        raise ValueError("a line without numbers")
    return table


def _read_vertices(lines: list[str]) -> tuple[NDArray, NDArray | None]:
    """Vertices (V, 3), and colours (V, 3) where every vertex line has them behind its place."""
    if lines and len(lines[0].split()) >= 6:
        with suppress(ValueError):
            table = read_table(lines, 6)
            return table[:, :3], colours_from_numbers(table[:, 3:])
    return read_table(lines, 3), None


def _read_faces(lines: _Lines) -> tuple[NDArray, NDArray]:
    """Corners of each face (N,), and (C, 3) their indices into v, vt, vn; from 0, -1 for none."""
    faces = lines.values["f"]
    counts = np.array([len(line.split()) for line in faces], dtype=np.int64)
    words = " ".join(faces).replace("//", "/0/").split()
    corners = np.zeros((len(words), 3), dtype=np.int64)
    if len({word.count("/") for word in words}) > 1:
        words = [word + "/0" * (2 - word.count("/")) for word in words]
    numbers = np.array(" ".join(words).replace("/", " ").split(), dtype=np.int64)
    numbers = numbers.reshape(len(words), -1) if words else corners
    corners[:, : numbers.shape[1]] = numbers
    if lines.relative:
        ends = np.zeros((len(faces), 3), dtype=np.int64)
        ends[list(lines.relative)] = list(lines.relative.values())
        corners += np.where(corners < 0, 1 + np.repeat(ends, counts, axis=0), 0)
    return counts, corners - 1


def _check_range(name: str, corners: NDArray, sizes: tuple[int, int, int]) -> None:
    for column, (kind, size) in enumerate(zip(KINDS, sizes, strict=False)):
        least = 0 if kind == "v" else -1
        bad = (corners[:, column] < least) | (corners[:, column] >= size)
        if np.any(bad):
            raise MeshFileError(
                f"{name}: a face asks for {kind} number {corners[bad, column][0] + 1}, but there "
                f"are {size}; the file is damaged or cut short, export it again."
            )


def _as_part(
    name: str,
    used: NDArray,
    vertices: NDArray,
    colours: NDArray | None,
    uvs: NDArray,
    normals: NDArray,
    material: Material,
) -> Part:
    """A part with one vertex for each distinct corner (v, vt, vn) of ``used`` (F, 3, 3)."""
    diffuse, texture = material
    texture = texture if np.all(used[:, :, 1] >= 0) and len(uvs) else None
    has_normals = bool(np.all(used[:, :, 2] >= 0)) and len(normals) > 0
    flat = used.reshape(-1, 3)
    columns = [0, *([1] if texture is not None else []), *([2] if has_normals else [])]
    key = np.zeros(len(flat), dtype=np.int64)
    for column in columns:  # numbered anew each time, so that products of sizes fit in 64 bits
        key = np.unique(key, return_inverse=True)[1] * (flat[:, column].max() + 1)
        key += flat[:, column]
    _, first, faces = np.unique(key, return_index=True, return_inverse=True)
    v, vt, vn = flat[first].T
    tint = diffuse if texture is None else None
    return Part(
        name,
        vertices[v],
        faces.reshape(-1, 3),
        normals[vn] if has_normals else None,
        tint if colours is None or texture is not None else colours[v],
        uvs[vt] if texture is not None else None,
        texture,
    )


def _read_materials(path: Path, libraries: list[str], notes: list[str]) -> dict[str, Material]:
    """The materials by name in the MTL files ``libraries``; missing files are noted."""
    materials: dict[str, Material] = {}
    for library in dict.fromkeys(libraries):
        found = find_named(path.parent, library)
        if found is None:
            notes.append(f"Material file left out: {bare_name(library)} is not there.")
            continue
        materials.update(_parse_mtl(found, notes))
    return materials


def _parse_mtl(path: Path, notes: list[str]) -> dict[str, Material]:
    """A texture replaces the colour Kd, as in Blender: many exporters write Kd 0 beside it."""
    colours: dict[str, NDArray | None] = {}
    files: dict[str, str] = {}
    name = None
    for line in material_text(path).splitlines():
        word, _, rest = line.strip().partition(" ")
        rest, word = rest.strip(), word.lower()
        if word == "newmtl":
            name = rest
            colours[name] = None
            files.pop(name, None)
        elif name is None or not rest:
            continue
        elif word == "kd":
            colours[name] = _diffuse(rest)
        elif word == "map_kd":
            files[name] = without_options(rest)
    textures = load_textures(path.parent, files.values(), notes)
    return {n: (colour, textures.get(files.get(n, ""))) for n, colour in colours.items()}


def _diffuse(text: str) -> NDArray | None:
    try:
        values = [float(word) for word in text.split()[:3]]
    except ValueError:
        return None
    values = values * 3 if len(values) == 1 else values
    return np.clip(np.nan_to_num(values), 0.0, 1.0) if len(values) == 3 else None


def without_options(text: str) -> str:
    """The file name behind options such as ``-s 1 1 1`` or ``-clamp on``; it may hold spaces."""
    words = text.split(" ")
    while words and words[0].startswith("-"):
        words.pop(0)
        while len(words) > 1 and re.fullmatch(r"(-?(\d+\.?\d*|\.\d+)|on|off)?", words[0]):
            words.pop(0)
    return " ".join(words)
