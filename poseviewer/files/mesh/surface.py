"""From the parts of a model file to a Mesh: checked, mended, with normals and a reflectance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.part import Part, refuse_if_huge
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import (
    crease_normals,
    face_normals_and_areas,
    weld,
    winding_to_flip,
)

GREY = 0.8
"""Reflectance where a file says nothing about colour."""
LARGEST_COORDINATE = 1e30
"""Beyond it, products of coordinates leave the range of floating-point numbers."""
LEAST_COSINE = 0.25
"""A normal contradicts a face when it is further off (75 degrees); on a smooth cube it is 55."""
BAD_NORMALS_SHARE = 0.1
"""A file's normals are not used when they contradict the faces on more than this of the area."""


NO_NORMALS = np.zeros((0, 3))


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """All parts in one set of arrays."""

    vertices: NDArray
    faces: NDArray
    normals: NDArray
    """(V, 3), or (0, 3) where the file has none that can be used."""
    colours: NDArray
    uvs: NDArray
    face_texture: NDArray
    face_part: NDArray

    @property
    def has_normals(self) -> bool:
        return len(self.normals) > 0

    def with_faces(self, keep: NDArray) -> _Surface:
        return replace(
            self,
            faces=self.faces[keep],
            face_texture=self.face_texture[keep],
            face_part=self.face_part[keep],
        )

    def with_vertices(self, source: NDArray, faces: NDArray, normals: NDArray) -> _Surface:
        """Vertices that are copies of the vertices ``source``."""
        return replace(
            self,
            vertices=self.vertices[source],
            faces=faces,
            normals=normals,
            colours=self.colours[source],
            uvs=self.uvs[source],
        )


def as_mesh(name: str, parts: list[Part], notes: list[str], unit: str | None = None) -> Mesh:
    """One Mesh of all the parts of the file ``name``; what was mended is added to its notes.

    Raises:
        MeshFileError: no triangles, or coordinates or indices that cannot be.
    """
    _check(name, parts)
    parts = [part for part in parts if len(part.faces)]
    notes = list(dict.fromkeys(notes))
    textures, surface = _merge(parts)
    surface = _without_useless_faces(name, surface, notes)
    if surface.has_normals:
        surface = _turned_to_normals(surface, notes)
    if not surface.has_normals:
        surface = _with_new_normals(surface, notes)
    used, faces = np.unique(surface.faces, return_inverse=True)
    surface = surface.with_vertices(used, faces.reshape(-1, 3), surface.normals[used])
    return Mesh(
        vertices=surface.vertices,
        faces=surface.faces,
        normals=surface.normals,
        colours=surface.colours,
        uvs=surface.uvs,
        face_texture=surface.face_texture,
        face_part=surface.face_part,
        textures=textures,
        part_names=tuple(dict.fromkeys(part.name for part in parts)),
        has_reflectance=any(p.colours is not None or p.texture is not None for p in parts),
        unit=unit,
        notes=tuple(notes),
    )


def _check(name: str, parts: list[Part]) -> None:
    if not any(len(part.faces) for part in parts):
        points = sum(len(part.vertices) for part in parts)
        found = f"0 triangles, {points:,} points" if points else "0 triangles"
        raise MeshFileError(
            f"{name}: {found}; poseviewer needs a surface mesh, not a point cloud or an empty file."
        )
    refuse_if_huge(name, sum(len(part.faces) for part in parts))
    for part in parts:
        bad = int(np.sum(~np.isfinite(part.vertices).all(axis=1)))
        if bad:
            raise MeshFileError(
                f"{name}: coordinates that are not finite numbers (vertices: {bad:,}); "
                "repair the model or export it again."
            )
        if np.abs(part.vertices).max(initial=0.0) > LARGEST_COORDINATE:
            raise MeshFileError(
                f"{name}: coordinates beyond {LARGEST_COORDINATE:g}; "
                "the file is damaged, export it again."
            )
        size = len(part.vertices)
        if len(part.faces) and (part.faces.min() < 0 or part.faces.max() >= size):
            worst = part.faces.min() if part.faces.min() < 0 else part.faces.max()
            raise MeshFileError(
                f"{name}: a face asks for vertex number {worst} (counted from 0), but there are "
                f"{size:,}; the file is damaged, export it again."
            )


def _merge(parts: list[Part]) -> tuple[tuple[NDArray, ...], _Surface]:
    textures = {id(part.texture): part.texture for part in parts if part.texture is not None}
    texture_number = {key: i for i, key in enumerate(textures)}
    names = list(dict.fromkeys(part.name for part in parts))
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts])
    sizes = [len(part.faces) for part in parts]
    has_normals = all(part.normals is not None for part in parts)
    surface = _Surface(
        np.concatenate([np.asarray(part.vertices, dtype=float) for part in parts]),
        np.concatenate(
            [
                np.asarray(part.faces, dtype=np.int64) + offset
                for part, offset in zip(parts, offsets, strict=False)
            ]
        ),
        np.concatenate([np.asarray(p.normals, dtype=float) for p in parts])
        if has_normals
        else NO_NORMALS,
        np.concatenate([_colours(part) for part in parts]),
        np.concatenate([_uvs(part) for part in parts]),
        np.repeat([texture_number.get(id(part.texture), -1) for part in parts], sizes),
        np.repeat([names.index(part.name) for part in parts], sizes),
    )
    return tuple(textures.values()), surface


def _colours(part: Part) -> NDArray[np.float32]:
    default = GREY if part.texture is None else 1.0
    colours = default if part.colours is None else part.colours
    return np.broadcast_to(np.asarray(colours, np.float32), (len(part.vertices), 3))


def _uvs(part: Part) -> NDArray[np.float32]:
    if part.uvs is None or part.texture is None:
        return np.zeros((len(part.vertices), 2), dtype=np.float32)
    return np.nan_to_num(np.asarray(part.uvs, dtype=np.float32), posinf=0.0, neginf=0.0)


def _without_useless_faces(name: str, surface: _Surface, notes: list[str]) -> _Surface:
    """Without faces that have no area, and without second copies, turned either way."""
    _, areas = face_normals_and_areas(surface.vertices, surface.faces)
    solid = areas > 0.0
    if not np.any(solid):
        raise MeshFileError(
            f"{name}: none of its triangles ({len(areas):,}) has an area; "
            "repair the model or export it again."
        )
    if not np.all(solid):
        notes.append(f"Triangles without area, left out: {np.sum(~solid):,}.")
        surface = surface.with_faces(np.flatnonzero(solid))
    places = np.sort(weld(surface.vertices)[surface.faces], axis=1)
    order = np.lexsort(places.T)
    repeated = np.all(places[order][1:] == places[order][:-1], axis=1)
    if np.any(repeated):
        # lexsort is stable: the copy that comes first in the file stays.
        keep = np.sort(np.delete(order, np.flatnonzero(repeated) + 1))
        notes.append(f"Doubled triangles, left out: {np.sum(repeated):,}.")
        surface = surface.with_faces(keep)
    return surface


def _turned_to_normals(surface: _Surface, notes: list[str]) -> _Surface:
    """Faces turned to the side of the file's normals; without these where they contradict."""
    normals = np.nan_to_num(surface.normals, posinf=0.0, neginf=0.0)
    length = np.linalg.norm(normals, axis=1)
    normals = normals / np.where(length > 0.0, length, 1.0)[:, None]
    face_normals, areas = face_normals_and_areas(surface.vertices, surface.faces)
    cosine = np.einsum("fij,fj->fi", normals[surface.faces], face_normals)
    turned = cosine.sum(axis=1) < 0.0
    cosine[turned] *= -1.0
    invalid = (length == 0.0)[surface.faces].any(axis=1)
    contradict = invalid | (cosine < LEAST_COSINE).any(axis=1)
    if areas[contradict].sum() > BAD_NORMALS_SHARE * areas.sum():
        notes.append("The file's normals contradict its faces; they were computed anew.")
        return replace(surface, normals=NO_NORMALS)
    faces = surface.faces.copy()
    faces[turned] = faces[turned][:, ::-1]
    face_normals[turned] *= -1.0
    if np.any(turned):
        notes.append(f"Triangles turned to the side of their normals: {np.sum(turned):,}.")
    surface = replace(surface, faces=faces, normals=normals)
    return _with_flat_faces(surface, np.flatnonzero(invalid), face_normals)


def _with_flat_faces(surface: _Surface, which: NDArray, face_normals: NDArray) -> _Surface:
    """Some faces with vertices of their own and the normal of the face."""
    if not len(which):
        return surface
    count = len(surface.vertices)
    source = np.concatenate([np.arange(count), surface.faces[which].ravel()])
    faces = surface.faces.copy()
    faces[which] = count + np.arange(3 * len(which)).reshape(-1, 3)
    normals = np.concatenate([surface.normals, np.repeat(face_normals[which], 3, axis=0)])
    return surface.with_vertices(source, faces, normals)


def _with_new_normals(surface: _Surface, notes: list[str]) -> _Surface:
    """Neighbours wound alike, then normals that keep creases sharp."""
    surface = _welded(surface)
    flip = winding_to_flip(surface.vertices, surface.faces)
    faces = surface.faces.copy()
    faces[flip] = faces[flip][:, ::-1]
    if np.any(flip):
        notes.append(f"Triangles turned to face the way of their neighbours: {np.sum(flip):,}.")
    source, faces, normals = crease_normals(surface.vertices, faces)
    return surface.with_vertices(source, faces, normals)


def _welded(surface: _Surface) -> _Surface:
    """Vertices alike in all that they carry made one (STL has three for each triangle)."""
    columns = [surface.vertices]
    columns += [a for a in (surface.colours, surface.uvs) if np.any(a != a[0])]
    same = weld(np.concatenate(columns, axis=1) if len(columns) > 1 else surface.vertices)
    _, first = np.unique(same, return_index=True)
    return surface.with_vertices(first, same[surface.faces], NO_NORMALS)
