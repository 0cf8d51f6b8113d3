"""Wavefront OBJ with its MTL: parts by ``o`` and ``g``, materials by ``usemtl``.

Read here rather than by trimesh, which loses group names where materials change inside a group,
and gets relative indices in mid-file wrong.
"""

from __future__ import annotations

import re
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
    numbers_from_text,
    split_by,
)

KINDS = ("v", "vt", "vn", "f")


Material = tuple[NDArray | None, NDArray[np.uint8] | None]
"""An MTL file's diffuse RGB (3,) in [0, 1], and texture."""


@dataclass
class _Lines:
    """The lines of an OBJ file, sorted by what they say."""

    values: dict[str, list[str]] = field(default_factory=lambda: {k: [] for k in KINDS})
    """Behind ``v``, ``vt``, ``vn`` and ``f``."""
    changes: list[tuple[int, str, str]] = field(default_factory=list)
    """(faces so far, part name, material name)."""
    libraries: list[str] = field(default_factory=list)


def read_obj(path: Path) -> tuple[list[Part], list[str]]:
    """The parts of an OBJ file, one for each part name and material, and notes for the user."""
    lines = _sort_lines(path.read_text(encoding="utf-8", errors="replace"))
    v, vt, vn, f = (lines.values[kind] for kind in KINDS)
    vertices, colours = _read_vertices(path.name, v)
    uvs, normals = read_table(path.name, "vt", vt, 2), read_table(path.name, "vn", vn, 3)
    notes: list[str] = []
    counts, corners = _read_faces(path.name, f)
    triangles = fan_corners(counts)
    _check_range(path.name, corners, (len(vertices), len(uvs), len(normals)))
    if len(counts) and counts[-1] < 3:
        raise MeshFileError(
            f"{path.name}: the last face has {counts[-1]} corners; the file is cut short, "
            "copy or export it again."
        )
    if np.any(counts < 3):
        notes.append(f"Faces of fewer than 3 corners, left out: {np.sum(counts < 3):,}.")
    materials = _read_materials(path, lines.libraries, notes)
    which, keys = _part_of_face(lines)
    of_part = split_by(np.repeat(which, np.maximum(counts - 2, 0)), len(keys))
    parts = []
    missing = sorted({m for _, m in keys if m and m not in materials})
    if missing and materials:
        notes.append(f"Materials not in the MTL file: {', '.join(missing)[:120]}.")
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
            is_relative = word == "f" and "-" in rest
            values[word].append(_absolute(rest, values) if is_relative else rest)
        elif word in ("o", "g", "usemtl"):
            rest = rest.strip()
            thing, group = (rest, "") if word == "o" else (thing, rest if word == "g" else group)
            material = rest if word == "usemtl" else material
            name = " ".join(dict.fromkeys(n for n in (thing, group) if n))
            lines.changes.append((len(values["f"]), name, material))
        elif word == "mtllib":
            lines.libraries.append(rest.strip())
    return lines


def _absolute(face: str, values: dict[str, list[str]]) -> str:
    """Indices that count backwards from the line they stand in, made to count from the start."""
    ends = [len(values[kind]) for kind in KINDS[:3]]

    def one(index: str, end: int) -> str:
        return str(end + 1 + int(index)) if index.startswith("-") else index

    try:
        return " ".join(
            "/".join(one(index, end) for index, end in zip(corner.split("/"), ends, strict=False))
            for corner in face.split()
        )
    except ValueError:
        return face  # not a number: refused where the faces are read


def read_table(name: str, kind: str, lines: list[str], columns: int) -> NDArray:
    """(N, columns) of the first numbers of each line; further ones are dropped."""
    if not lines:
        return np.zeros((0, columns))
    try:
        table = numbers_from_text("\n".join(lines)).reshape(len(lines), -1)
        widths = {len(lines[0].split()), len(lines[-1].split())}
        if widths == {table.shape[1]} and table.shape[1] >= columns:
            return table[:, :columns]
    except ValueError:
        pass
    rows = []
    for line in lines:
        try:
            rows.append([float(word) for word in line.split()[:columns]])
        except ValueError:
            rows.append([])
        if kind == "vt" and len(rows[-1]) == 1:
            rows[-1].append(0.0)
        if len(rows[-1]) < columns:
            raise MeshFileError(
                f"{name}: the line {f'{kind} {line}'[:60]!r} does not hold {columns} numbers; "
                "the file is damaged or cut short, export it again."
            )
    return np.array(rows)


def _read_vertices(name: str, lines: list[str]) -> tuple[NDArray, NDArray | None]:
    """Vertices (V, 3), and colours (V, 3) where every vertex line has them behind its place."""
    has_colours = bool(lines) and len(lines[0].split()) >= 6
    if has_colours and all(len(line.split()) >= 6 for line in lines):
        table = read_table(name, "v", lines, 6)
        return table[:, :3], colours_from_numbers(table[:, 3:])
    return read_table(name, "v", lines, 3), None


def _read_faces(name: str, lines: list[str]) -> tuple[NDArray, NDArray]:
    """Corners of each face (N,), and (C, 3) their indices into v, vt, vn; from 0, -1 for none."""
    words = [line.split() for line in lines]
    counts = np.fromiter(map(len, words), dtype=np.int64, count=len(words))
    joined = " ".join(lines)
    total, slashes, empty = int(counts.sum()), joined.count("/"), joined.count("//")
    columns = None
    if slashes == 0:
        columns = (0,)
    elif slashes == total:
        columns = (0, 1)
    elif slashes == 2 * total and empty in (0, total):
        columns = (0, 2) if empty else (0, 1, 2)
    corners = np.full((total, 3), -1, dtype=np.int64)
    if columns is not None:
        try:
            numbers = numbers_from_text(joined.replace("/", " "))
            if len(numbers) == total * len(columns) and np.all(numbers == np.rint(numbers)):
                corners[:, columns] = numbers.reshape(total, len(columns)).astype(np.int64) - 1
                return counts, corners
        except ValueError:
            pass
    at = 0
    for line in words:
        for word in line:
            corners[at] = _read_corner(name, word)
            at += 1
    return counts, corners


def _read_corner(name: str, word: str) -> list[int]:
    try:
        indices = [int(index) - 1 if index else -1 for index in word.split("/")]
        if word[0] != "/" and len(indices) <= 3:
            return indices + [-1] * (3 - len(indices))
    except ValueError:
        pass
    raise MeshFileError(
        f"{name}: a face has the corner {word[:40]!r}; wanted whole numbers such as 3/1/2, "
        "the file is damaged, export it again."
    )


def _check_range(name: str, corners: NDArray, sizes: tuple[int, int, int]) -> None:
    for column, (kind, size) in enumerate(zip(("v", "vt", "vn"), sizes, strict=True)):
        least = 0 if column == 0 else -1
        bad = (corners[:, column] < least) | (corners[:, column] >= size)
        if np.any(bad):
            raise MeshFileError(
                f"{name}: a face asks for {kind} number {corners[bad, column][0] + 1}, but there "
                f"are {size}; the file is damaged or cut short, export it again."
            )


def _part_of_face(lines: _Lines) -> tuple[NDArray, list[tuple[str, str]]]:
    """(N,) which of the (part name, material) each face belongs to, in order of appearance."""
    changes = [(0, "", ""), *lines.changes]
    keys = list(dict.fromkeys((name, material) for _, name, material in changes))
    number = {key: i for i, key in enumerate(keys)}
    starts = np.array([start for start, _, _ in changes] + [len(lines.values["f"])])
    which = [number[name, material] for _, name, material in changes]
    return np.repeat(which, np.diff(starts)), keys


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
