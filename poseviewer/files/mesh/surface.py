"""Mesh of the parts of a model file: checked, mended, with normals and a reflectance."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import MeshFileError, printable
from poseviewer.files.checks import MAX_NUMBER as MAX_COORDINATE
from poseviewer.files.mesh.parts import (
    GREY,
    MAX_FACES,
    MAX_PARTS,
    Part,
    check_count,
    check_indices,
)
from poseviewer.geometry import normals as n
from poseviewer.geometry.mesh import Mesh

MIN_COSINE = 0.25
"""A normal contradicts a face when it is further off (75 degrees); on a smooth cube it is 55."""
BAD_NORMALS_SHARE = 0.1
"""A file's normals are not used when they contradict the faces on more than this of the area."""
MAX_NOTE_LETTERS = 300


def as_mesh(name: str, parts: list[Part], notes: list[str]) -> Mesh:
    """One Mesh of the parts of the file ``name``, mended, with notes."""
    _check(name, parts)
    parts = [replace(part, name=printable(part.name)) for part in parts if len(part.faces)]
    mesh = _without_useless_faces(_merge(parts, notes))
    if np.any(mesh.normals):
        mesh = _orient_by_normals(mesh)
    if not np.any(mesh.normals):
        mesh = _with_computed_normals(mesh)
    return _average_tints(mesh).of_faces(slice(None))


def _check(name: str, parts: list[Part]) -> None:
    if not any(len(part.faces) for part in parts):
        wanted = "poseviewer needs a surface mesh, not a point cloud or an empty file"
        points = sum(len(part.vertices) for part in parts)
        raise MeshFileError(f"{name}: 0 triangles, {points:,} points; {wanted}.")
    check_count(name, "faces", sum(len(part.faces) for part in parts), MAX_FACES)
    check_count(name, "parts", len(parts), MAX_PARTS)
    for part in parts:
        if bad := int(np.sum(~(np.abs(part.vertices) <= MAX_COORDINATE).all(axis=1))):
            raise ValueError(f"{bad:,} vertices are not finite or beyond {MAX_COORDINATE:g}")
        check_indices(np.asarray(part.faces), len(part.vertices))


def _merge(parts: list[Part], notes: list[str]) -> Mesh:
    textures = {id(part.texture): part.texture for part in parts if part.texture is not None}
    numbers = {key: i for i, key in enumerate(textures)}
    names = {name: i for i, name in enumerate(dict.fromkeys(part.name for part in parts))}
    sizes = [len(part.faces) for part in parts]
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts])
    lacks_some = any(part.normals is None for part in parts)
    normals = [np.zeros_like(p.vertices) if lacks_some else np.asarray(p.normals) for p in parts]
    colours = [_columns(p.colours, GREY if p.texture is None else 1.0, p, 3) for p in parts]
    uvs = [_columns(None if p.texture is None else p.uvs, 0.0, p, 2) for p in parts]
    return Mesh(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([p.faces + o for p, o in zip(parts, offsets, strict=False)]),
        normals=np.nan_to_num(np.concatenate(normals), posinf=0.0, neginf=0.0),
        colours=np.concatenate(colours), uvs=np.concatenate(uvs),
        face_texture=np.repeat([numbers.get(id(part.texture), -1) for part in parts], sizes),
        face_part=np.repeat([names[part.name] for part in parts], sizes),
        textures=tuple(textures.values()), part_names=tuple(names),
        has_reflectance=any(p.colours is not None or p.texture is not None for p in parts),
        notes=tuple(printable(note, MAX_NOTE_LETTERS) for note in dict.fromkeys(notes)),
    )  # fmt: skip


def _columns(values: Any, default: float, part: Part, width: int) -> NDArray[np.float32]:
    values = np.asarray(default if values is None else values, np.float32)
    columns = np.broadcast_to(values, (len(part.vertices), width))
    return np.nan_to_num(columns, posinf=0.0, neginf=0.0)


def _with_note(mesh: Mesh, note: str, count: int, **changes: Any) -> Mesh:
    """The mesh with changes, and with a note of how many triangles they mend, unless none."""
    notes = (*mesh.notes, f"{note}: {count:,}.") if count else mesh.notes
    return replace(mesh, notes=notes, **changes)


def _without_useless_faces(mesh: Mesh) -> Mesh:
    """Leave out faces that have no area, and second copies, turned either way."""
    _, areas = n.face_normals_and_areas(mesh.vertices, mesh.faces)
    solid = np.flatnonzero(areas > 0.0)
    if not len(solid):
        raise ValueError(f"none of its triangles ({len(areas):,}) has an area")
    places = np.sort(n.weld(mesh.vertices)[mesh.faces[solid]], axis=1)
    order = np.lexsort(places.T)
    repeated = np.all(places[order][1:] == places[order][:-1], axis=1)
    # lexsort is stable: the copy that comes first in the file stays.
    keep = solid[np.sort(order[np.concatenate([[True], ~repeated])])]
    mesh = _with_note(mesh, "Triangles without area, left out", len(areas) - len(solid))
    return _with_note(
        mesh, "Doubled triangles, left out", int(repeated.sum()), faces=mesh.faces[keep],
        face_texture=mesh.face_texture[keep], face_part=mesh.face_part[keep],
    )  # fmt: skip


def _orient_by_normals(mesh: Mesh) -> Mesh:
    """Turn faces to the side of the file's normals, or drop these where they contradict."""
    length = np.linalg.norm(mesh.normals, axis=1)
    normals = mesh.normals / np.where(length > 0.0, length, 1.0)[:, None]
    face_normals, areas = n.face_normals_and_areas(mesh.vertices, mesh.faces)
    cosine = np.einsum("fij,fj->fi", normals[mesh.faces], face_normals)
    turned = cosine.sum(axis=1) < 0.0
    cosine[turned] *= -1.0
    invalid = (length == 0.0)[mesh.faces].any(axis=1)
    contradict = invalid | (cosine < MIN_COSINE).any(axis=1)
    if areas[contradict].sum() > BAD_NORMALS_SHARE * areas.sum():
        note = "The file's normals contradict its faces; they were computed anew."
        return replace(mesh, normals=np.zeros_like(normals), notes=(*mesh.notes, note))
    face_normals[turned] *= -1.0
    faces = np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces)
    note = "Triangles turned to the side of their normals"
    mesh = _with_note(mesh, note, int(turned.sum()), faces=faces, normals=normals)
    return _detach_faces(mesh, invalid, normals=face_normals)


def _detach_faces(mesh: Mesh, which: NDArray[np.bool_], **values: NDArray) -> Mesh:
    """Give some faces vertices of their own, with values of each face (F, 3) at all its corners."""
    count, faces = len(mesh.vertices), mesh.faces.copy()
    source = np.concatenate([np.arange(count), faces[which].ravel()])
    faces[which] = np.arange(count, len(source)).reshape(-1, 3)
    corners = {name: np.repeat(of_faces[which], 3, axis=0) for name, of_faces in values.items()}
    own = {name: np.concatenate([getattr(mesh, name), own]) for name, own in corners.items()}
    return replace(mesh.with_vertices(source, faces), **own)


def _average_tints(mesh: Mesh) -> Mesh:
    """Give each textured face one colour to multiply its texture by, the mean of its corners'."""
    colours = mesh.colours[mesh.faces]
    varies = np.any(colours != colours[:, :1], axis=(1, 2)) & (mesh.face_texture >= 0)
    if not np.any(varies):
        return mesh
    note = "Textured triangles with different colours at their corners, shown in the mean of these"
    mesh = _with_note(mesh, note, int(varies.sum()))
    return _detach_faces(mesh, varies, colours=colours.mean(axis=1))


def _with_computed_normals(mesh: Mesh) -> Mesh:
    # Vertices alike in all that they carry are made one (STL has three for each triangle).
    columns = [a for a in (mesh.colours, mesh.uvs) if np.any(a != a[0])]
    same = n.weld(np.concatenate([mesh.vertices, *columns], axis=1, dtype=float))
    _, first = np.unique(same, return_index=True)
    mesh = mesh.with_vertices(first, same[mesh.faces])
    flip = n.faces_to_flip(mesh.vertices, mesh.faces)
    faces = np.where(flip[:, None], mesh.faces[:, ::-1], mesh.faces)
    note = "Triangles turned to face the way of their neighbours"
    source, faces, normals = n.crease_normals(mesh.vertices, faces)
    return _with_note(mesh.with_vertices(source, faces), note, int(flip.sum()), normals=normals)
