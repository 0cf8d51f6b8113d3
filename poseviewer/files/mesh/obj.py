"""Wavefront OBJ with its MTL: parts by ``o`` and ``g``, materials by ``usemtl``."""

import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import MeshFileError
from poseviewer.files.checks import InputFile
from poseviewer.files.mesh import parts as p
from poseviewer.files.mesh.named import NOT_THERE, bare_name, find_named
from poseviewer.files.mesh.polygons import polygon_corners
from poseviewer.geometry.normals import weld

Material = tuple[NDArray | None, NDArray[np.uint8] | None]
"""An MTL file's diffuse RGB (3,) in [0, 1], and texture."""
Relative = dict[int, tuple[int, ...]]
"""Numbers of ``v``, ``vt`` and ``vn`` before each face whose indices count backwards."""
Changes = list[tuple[int, tuple[str, str]]]
KINDS = ("v", "vt", "vn", "f", "mtllib", "#MRGB")
"""Words of lines that are read; ``#MRGB`` is ZBrush's: mask, red, green and blue of vertices."""
IDLE = ("", "s", "mg", "lod", "bevel", "c_interp", "d_interp", "usemap", "maplib", "shadow_obj")
"""Words that say nothing of shape and colour."""
MAX_LIBRARIES = 1000
"""Material files of a model: each that is missing is sought in several folders."""
OPTIONS = re.compile(r"(-\S*+ ((-?(\d++\.?\d*+|\.\d++)|on|off)? )*+)*+")
"""Options before a picture's name, which may hold spaces: ``-s 1 1 1`` or ``-clamp on``."""
NOT_NEUTRAL = re.compile(r" -?(?![01](\.0*)? )[\d.]+ ")
"""A number in them that moves or scales the picture: neither 0 nor 1."""
INVISIBLE = re.compile(r"d\s+(-halo\s+)?0(\.0*)?|Tr\s+1(\.0*)?", re.IGNORECASE)


def read_obj(path: Path) -> p.ModelParts:
    """The parts of an OBJ file, one for each part name and material, and notes for the user."""
    notes: list[str] = []
    lines, relative, changes = _sort_lines(path.read_text("utf-8-sig", "surrogateescape"), notes)
    vertices, colours = _read_vertices(lines["v"], "".join(lines["#MRGB"]), notes)
    uvs = read_table([f"{line} 0" for line in lines["vt"]], 2)  # the second may be left out
    normals = read_table(lines["vn"], 3)
    counts, corners = _read_faces(lines["f"], relative)
    for kind, column, table in zip(KINDS, corners.T, (vertices, uvs, normals), strict=False):
        p.check_indices(column if kind == "v" else column[column != -1], len(table), kind)
    if np.any(counts < 3):
        notes.append(f"Faces of fewer than 3 corners, left out: {np.sum(counts < 3):,}.")
    libraries = [name for line in lines["mtllib"] for name in library_names(line)]
    materials = _read_materials(path, libraries, notes)
    starts, names = zip(*changes, strict=True)
    keys = {key: number for number, key in enumerate(dict.fromkeys(names))}
    which = np.repeat([keys[key] for key in names], np.diff([*starts, len(counts)]))
    of_part = p.indices_by_group(np.repeat(which, np.maximum(counts - 2, 0)), len(keys))
    used = {material for _, material in keys if material}
    if materials and (missing := sorted(used - set(materials))):
        notes.append(f"Materials not in the MTL file: {', '.join(missing)[:120]}.")
    if len(materials) == 1 and not used:
        materials[""] = next(iter(materials.values()))  # as some scans have it
    elif materials and not used:
        notes.append(f"No usemtl says where its {len(materials):,} materials are: left out.")
    triangles, parts = polygon_corners(counts, vertices[corners[:, 0]]), []
    for (name, material), own in zip(keys, of_part, strict=True):
        if len(own):
            paint, of_faces = materials.get(material, (None, None)), corners[triangles[own]]
            parts.append(_as_part(name, of_faces, vertices, colours, uvs, normals, paint))
    return p.ModelParts(parts or [p.Part("", vertices)], notes)


def _sort_lines(text: str, notes: list[str]) -> tuple[dict[str, list[str]], Relative, Changes]:
    """Gather what follows each word of ``KINDS``, and where in the file indices and names count."""
    lines: dict[str, list[str]] = {kind: [] for kind in KINDS}
    relative: Relative = {}
    changes: Changes = [(0, ("", ""))]
    faces = lines["f"]
    thing = ""
    group = ""
    material = ""
    others = set[str]()
    for line in text.replace("\t", " ").replace("\\\n", " ").replace("\\\r\n", " ").splitlines():
        word, _, rest = line.strip().partition(" ")
        if word in lines:
            if word == "f" and "-" in rest:
                relative[len(faces)] = tuple(len(lines[kind]) for kind in KINDS[:3])
            lines[word].append(rest)
        elif word in ("o", "g", "usemtl"):
            rest = rest.strip()
            thing, group = (rest, "") if word == "o" else (thing, rest if word == "g" else group)
            material = rest if word == "usemtl" else material
            name = " ".join(dict.fromkeys(n for n in (thing, group) if n))
            changes.append((len(faces), (name, material)))
        elif word not in IDLE and not word.startswith("#"):
            others.add(word)
    if others:
        notes.append(f"Lines not read: {', '.join(sorted(others))[:120]}.")
    return lines, relative, changes


def library_names(text: str) -> list[str]:
    """The MTL files that a line names: one, whose name may have spaces, or several."""
    words = text.split()
    return words if all(word.lower().endswith(".mtl") for word in words) else [text.strip()]


def read_table(lines: list[str], columns: int) -> NDArray:
    """Read the first numbers of each line (N, columns).

    Raises:
        ValueError: a line has fewer.
    """
    if not lines:
        return np.zeros((0, columns))
    table = np.loadtxt(lines, usecols=range(columns), comments=None, ndmin=2)
    if len(table) != len(lines):
        raise ValueError("a line without numbers")
    return table


def _read_vertices(
    lines: list[str], polypaint: str, notes: list[str]
) -> tuple[NDArray, NDArray | None]:
    """Vertices (V, 3) and their colours (V, 3), NaN where a vertex has none, or None."""
    vertices = read_table(lines, 3)
    with suppress(ValueError):
        rgb = np.frombuffer(bytes.fromhex(polypaint), np.uint8).reshape(-1, 4)[:, 1:]
        if polypaint and len(rgb) == len(vertices):
            return vertices, rgb / 255.0
    if polypaint:
        notes.append("Colours by #MRGB, left out: they are not 8 digits for each vertex.")
    has_some = np.array([len(line.partition("#")[0].split()) >= 6 for line in lines], bool)
    if has_some.any():
        colours = np.full(vertices.shape, np.nan)
        table = read_table([lines[i] for i in np.flatnonzero(has_some)], 6)[:, 3:]
        colours[has_some] = p.colours_from_numbers(table, notes)
        return vertices, colours
    return vertices, None


def _read_faces(faces: list[str], relative: Relative) -> tuple[NDArray, NDArray]:
    """Corners of each face (N,), and (C, 3) their indices into v, vt, vn; from 0, -1 for none."""
    counts = np.array([len(line.split()) for line in faces], dtype=np.int64)
    words = " ".join(faces).replace("//", "/0/").split()
    corners = np.zeros((len(words), 3), dtype=np.int64)
    if len({word.count("/") for word in words}) > 1:
        words = [word + "/0" * (2 - word.count("/")) for word in words]
    numbers = np.array(" ".join(words).replace("/", " ").split(), dtype=np.int64)
    if words:
        corners[:, : numbers.size // len(words)] = numbers.reshape(len(words), -1)
    if relative:
        ends = np.zeros((len(faces), 3), dtype=np.int64)
        ends[list(relative)] = list(relative.values())
        corners += np.where(corners < 0, 1 + np.repeat(ends, counts, axis=0), 0)
    return counts, corners - 1


def _as_part(
    name: str, used: NDArray, vertices: NDArray, colours: NDArray | None, uvs: NDArray,
    normals: NDArray, material: Material,
) -> p.Part:  # fmt: skip
    """A part with one vertex for each distinct corner (v, vt, vn) of ``used`` (F, 3, 3)."""
    diffuse, texture = material
    flat = used.reshape(-1, 3)
    has_uvs, has_normals = np.all(flat[:, 1:] >= 0, axis=0)
    texture = texture if has_uvs else None
    columns = [2] if has_normals else []
    columns += [0] if texture is None else [1, 0]
    faces = weld(flat[:, columns])  # numbered by v first
    v, vt, vn = flat[np.unique(faces, return_index=True)[1]].T
    part = p.Part(name, vertices[v], faces.reshape(-1, 3), normals[vn] if has_normals else None)
    if texture is not None:
        return replace(part, uvs=uvs[vt], texture=texture)
    if colours is None or np.all(np.isnan(colours[v])):
        return replace(part, colours=diffuse)
    other = p.GREY if diffuse is None else diffuse
    return replace(part, colours=np.where(np.isnan(colours[v]), other, colours[v]))


def _read_materials(path: Path, libraries: list[str], notes: list[str]) -> dict[str, Material]:
    """Read the materials in MTL files; a texture replaces Kd, as in Blender."""
    materials: dict[str, Material] = {}
    if len(libraries) > MAX_LIBRARIES:
        notes.append(f"Material files left out: all but {MAX_LIBRARIES} of {len(libraries):,}.")
    for library in list(dict.fromkeys(libraries))[:MAX_LIBRARIES]:
        mtl = find_named(path.parent, library)
        if mtl is None or not mtl.stat().st_size:
            why = NOT_THERE if mtl is None else "is empty"
            notes.append(f"Material file left out: {bare_name(library)} {why}.")
            continue
        file = InputFile(mtl, [], MeshFileError, "material file")
        diffuse: dict[str, NDArray | None] = {}
        files: dict[str, str] = {}
        name = ""
        for line in file.load_bytes().decode("utf-8-sig", "surrogateescape").splitlines():
            word, _, rest = line.strip().replace("\t", " ").partition(" ")
            if word.lower() == "newmtl":
                name = rest.strip()
                diffuse[name] = None
            elif word.lower() == "map_kd":
                files[name] = OPTIONS.sub("", rest.strip(), 1)
                options = rest.strip()[: -len(files[name])] if files[name] else ""
                if "-clamp on" in options or NOT_NEUTRAL.search(options):
                    notes.append(f"Options of a texture, left out: {options.strip()}.")
            elif INVISIBLE.fullmatch(f"{word} {rest}".strip()):
                notes.append(f"Material {name} is said to be invisible, and is shown.")
            elif word.lower() == "kd" and name in diffuse:
                with suppress(ValueError):
                    values = [float(value) for value in rest.split()[:3]]
                    if len(values) in (1, 3):
                        diffuse[name] = np.clip(np.nan_to_num(np.resize(values, 3)), 0.0, 1.0)
        textures = p.load_textures(mtl.parent, filter(None, files.values()), notes)
        materials |= {key: (diffuse[key], textures.get(files.get(key, ""))) for key in diffuse}
    return materials
