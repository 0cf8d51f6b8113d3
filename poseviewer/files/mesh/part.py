"""What the readers of model files give: parts as the file has them, before anything is mended."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import MeshFileError

MAX_FACES = 20_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A piece of a model with one name and at most one texture."""

    name: str
    vertices: NDArray
    """(V, 3)."""
    faces: NDArray
    """(F, 3) indices into ``vertices``, unchecked."""
    normals: NDArray | None = None
    """(V, 3), as the file has them."""
    colours: NDArray | None = None
    """(V, 3) or (3,) RGB in [0, 1], display-encoded; a factor where there is a texture."""
    uvs: NDArray | None = None
    """(V, 2), v upwards."""
    texture: NDArray[np.uint8] | None = None
    """(h, w, 3) RGB."""


def refuse_if_huge(name: str, count: int, what: str = "faces") -> None:
    """Raise MeshFileError when a file has or promises more than poseviewer takes."""
    if count > MAX_FACES:
        raise MeshFileError(
            f"{name}: {count:,} {what}; poseviewer takes up to {MAX_FACES:,}, "
            "simplify the model first."
        )


def numbers_from_text(text: str) -> NDArray[np.float64]:
    """The numbers of a text, separated by white space; ValueError for anything else."""
    return np.fromstring(text, dtype=np.float64, sep=" ")


def fan_size(counts: NDArray) -> int:
    """How many triangles polygons with ``counts`` corners (N,) fall into."""
    return int(np.maximum(np.asarray(counts, dtype=np.int64) - 2, 0).sum())


def fan_corners(counts: NDArray) -> NDArray[np.int64]:
    """(T, 3) corners of the triangles that polygons with ``counts`` corners (N,) fall into.

    Corners are numbered through all polygons; polygons of fewer than 3 corners give none.
    """
    counts = np.asarray(counts, dtype=np.int64)
    triangles = np.maximum(counts - 2, 0)
    starts = np.repeat(np.cumsum(counts) - counts, triangles)
    step = np.arange(len(starts)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([starts, starts + step + 1, starts + step + 2], axis=1)


def colours_from_numbers(values: NDArray) -> NDArray[np.float64]:
    """Colours in [0, 1] from whole numbers (their type's range) or floats (0-1, or 0-255)."""
    if np.issubdtype(values.dtype, np.integer):
        return values / float(np.iinfo(values.dtype).max)
    scale = 255.0 if values.max(initial=0.0) > 1.0 else 1.0
    return np.clip(np.nan_to_num(values) / scale, 0.0, 1.0)


def moved_part(part: Part, matrix: NDArray) -> Part:
    """The part moved by a (4, 4) matrix; a mirroring one turns the faces over."""
    if np.allclose(matrix, np.eye(4), rtol=0.0, atol=1e-15):
        return part
    linear = matrix[:3, :3]
    vertices = part.vertices @ linear.T + matrix[:3, 3]
    normals, faces = part.normals, part.faces
    if normals is not None:
        # Normals go with the cofactors, which need no inverse (Abert et al. 2017).
        cofactors = np.cross(np.roll(linear, -1, axis=0), np.roll(linear, -2, axis=0))
        normals = normals @ cofactors.T
    if np.linalg.det(linear) < 0.0:
        faces = np.asarray(faces)[:, ::-1]
        normals = None if normals is None else -normals
    return Part(part.name, vertices, faces, normals, part.colours, part.uvs, part.texture)
