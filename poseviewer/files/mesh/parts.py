"""What the readers of model files give, before anything is mended: parts with their textures; and
the limits on them, since small files can promise huge models.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.named import bare_name, find_named
from poseviewer.files.quiet import quiet_libraries

MAX_FACES = 20_000_000
CHUNK = 1 << 24
"""Bytes of a file looked at in one piece."""
LARGEST_SIDE = 8192
"""px of a texture; longer ones are shrunk."""


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

    def moved(self, matrix: NDArray) -> Part:
        """The part moved by a (4, 4) matrix; a mirroring one turns the faces over."""
        if np.allclose(matrix, np.eye(4), rtol=0.0, atol=1e-15):
            return self
        linear = matrix[:3, :3]
        normals, faces = self.normals, self.faces
        if normals is not None:
            # Normals go with the cofactors, which need no inverse (Abert et al. 2017).
            cofactors = np.cross(np.roll(linear, -1, axis=0), np.roll(linear, -2, axis=0))
            normals = normals @ cofactors.T
        if np.linalg.det(linear) < 0.0:
            faces = np.asarray(faces)[:, ::-1]
            normals = None if normals is None else -normals
        vertices = self.vertices @ linear.T + matrix[:3, 3]
        return replace(self, vertices=vertices, faces=faces, normals=normals)


def no_faces(vertices: NDArray) -> list[Part]:
    """A cloud of points (V, 3), to be refused with its size."""
    return [Part("", vertices, np.zeros((0, 3), int))]


def refuse_if_huge(name: str, count: int, what: str = "faces") -> None:
    """Raise MeshFileError when a file has or promises more than poseviewer takes."""
    if count > MAX_FACES:
        raise MeshFileError(
            f"{name}: {count:,} {what}; poseviewer takes up to {MAX_FACES:,}, "
            "simplify the model first."
        )


def refuse_many_words(path: Path, shortest: int, words: Mapping[bytes, str]) -> None:
    """Raise MeshFileError where a text has too many of some words, by what they stand for.

    Each word comes with at least ``shortest`` bytes, so that most files need not be looked at.
    """
    if path.stat().st_size > MAX_FACES * shortest:
        for word, what in words.items():
            refuse_if_huge(path.name, count_of_word(path, word), what)


def count_of_word(path: Path, word: bytes) -> int:
    """How often a word stands in a file, in any case; read piece by piece."""
    count, kept = 0, b""
    with path.open("rb") as file:
        while chunk := file.read(CHUNK):
            text = kept + chunk.lower()
            count += text.count(word)
            # One byte less than the word: what is kept cannot hold it a second time.
            kept = text[max(0, len(text) - len(word) + 1) :]
    return count


def numbers_from_text(text: str) -> NDArray[np.float64]:
    """The numbers of a text, separated by white space; ValueError for anything else."""
    try:
        return np.fromstring(text, dtype=np.float64, sep=" ")
    except DeprecationWarning as error:
        raise ValueError(str(error)) from None


def fan_corners(name: str, counts: NDArray) -> NDArray[np.int64]:
    """(T, 3) corners of the triangles that polygons with ``counts`` corners (N,) fall into.

    Corners are numbered through all polygons; polygons of fewer than 3 corners give none. Raises
    MeshFileError where the triangles of the file ``name`` are too many.
    """
    counts = np.asarray(counts, dtype=np.int64)
    triangles = np.maximum(counts - 2, 0)
    refuse_if_huge(name, int(triangles.sum()))
    starts = np.repeat(np.cumsum(counts) - counts, triangles)
    step = np.arange(len(starts)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([starts, starts + step + 1, starts + step + 2], axis=1)


def colours_from_numbers(values: NDArray) -> NDArray[np.float64]:
    """Colours in [0, 1] from whole numbers (their type's range) or floats (0-1, or 0-255)."""
    if np.issubdtype(values.dtype, np.integer):
        return values / float(np.iinfo(values.dtype).max)
    scale = 255.0 if values.max(initial=0.0) > 1.0 else 1.0
    return np.clip(np.nan_to_num(values) / scale, 0.0, 1.0)


def load_texture(folder: Path, name: str, notes: list[str]) -> NDArray[np.uint8] | None:
    """The picture ``name`` of a model in ``folder`` as RGB (h, w, 3); None, and a note, where there
    is none that can be read.
    """
    path = find_named(folder, name)
    if path is None:
        notes.append(f"Texture left out: {bare_name(name)} is not there.")
        return None
    try:
        with quiet_libraries(), Image.open(path) as image:
            return texture_from_image(image)
    except Image.DecompressionBombError:
        notes.append(f"Texture left out: {path.name} has too many pixels.")
    except OSError as error:
        notes.append(f"Texture left out: {error}.")
    return None


def texture_from_image(image: Image.Image) -> NDArray[np.uint8]:
    """RGB (h, w, 3) of a picture; raises OSError where it is damaged or has too many pixels."""
    try:
        if max(image.size) > LARGEST_SIDE:
            image.thumbnail((LARGEST_SIDE, LARGEST_SIDE))
        return np.asarray(image.convert("RGB"))
    except (SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise OSError(str(error)) from error
