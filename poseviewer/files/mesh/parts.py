"""Parts with their textures, as the readers of model files give them before mending."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from poseviewer.errors import MeshFileError
from poseviewer.files.checks import MAX_DATA_BYTES, InputFile, quiet_libraries
from poseviewer.files.mesh.named import NO_TEXTURE, bare_name, find_named

Key = TypeVar("Key")
MAX_SIDE_PX = 8192
"""px of a texture; longer ones are shrunk."""
MAX_TEXELS = 100_000_000
"""Limit of a model's textures together, and of one before it is shrunk: no photo shows more."""
MAX_TEXTURES = 2000
MAX_PARTS = 50_000
"""Each is cut out and mended by itself: this number of them takes half a minute."""
MAX_FACES = 20_000_000
FREE_COPIES = 2_000_000
"""Faces, and vertices, that a small file may have built by naming the same ones again and again:
they take 1 GB and 15 s.
"""
BYTES_PER_FACE = 6
"""Fewest bytes of a file in which each face stands once: three indices of two bytes, or a strip's
with its vertex.
"""
MAX_FACTOR = 10.0
"""Largest colour taken for one from 0 to 1: colours up to 255 are nearly black below it."""
GREY = 0.8
"""Reflectance where a file says nothing about colour."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A piece of a model with one name and at most one texture."""

    name: str
    vertices: NDArray
    """(V, 3)."""
    faces: NDArray = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    """(F, 3) indices into ``vertices``, unchecked."""
    normals: NDArray | None = None
    """(V, 3), as the file has them."""
    colours: NDArray | None = None
    """(V, 3) or (3,) RGB in [0, 1], display-encoded; a factor where there is a texture."""
    uvs: NDArray | None = None
    """(V, 2), v upwards."""
    texture: NDArray[np.uint8] | None = None

    def transform(self, matrix: NDArray) -> Part:
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

    def corners_of(self, which: NDArray | slice) -> Part:
        """The part of some of its faces, each of their corners a vertex of its own."""
        source = np.asarray(self.faces)[which].ravel()
        values = {name: getattr(self, name) for name in ("vertices", "normals", "colours", "uvs")}
        own = {k: v if v is None or v.ndim == 1 else v[source] for k, v in values.items()}
        return replace(self, faces=np.arange(len(source)).reshape(-1, 3), **own)


class ModelParts(NamedTuple):
    """Content that a reader gives of a model file."""

    parts: list[Part]
    notes: list[str]
    metres: float | None = None
    """Length of the file's unit, where the file says it."""
    y_up: bool = False


def check_count(name: str, what: str, count: int, most: int) -> None:
    """Raise MeshFileError where the model file ``name`` has more than ``most`` of something."""
    if count > most:
        wanted = f"poseviewer takes up to {most:,}, simplify the model first"
        raise MeshFileError(f"{name}: {count:,} {what}; {wanted}.")


def check_counts(name: str, size: int, parts: int, faces: int, vertices: int) -> None:
    """Raise MeshFileError where a model file has too much to be built, all copies counted.

    Args:
        name: name of the file.
        size: bytes of the file and of those that it names.
        parts: number of parts.
        faces: number of triangles.
        vertices: number of vertices.
    """
    check_count(name, "parts", parts, MAX_PARTS)
    most = FREE_COPIES + size // BYTES_PER_FACE
    check_count(name, "faces with all copies", faces, min(MAX_FACES, most))
    check_count(name, "vertices with all copies", vertices, most)


def take_parts(name: str, size: int, parts: Iterable[Part]) -> list[Part]:
    """List parts as they are built; raise as ``check_counts`` does as soon as they are too many."""
    taken, faces, vertices = list[Part](), 0, 0
    for part in parts:
        taken.append(part)
        faces, vertices = faces + len(part.faces), vertices + len(part.vertices)
        check_counts(name, size, len(taken), faces, vertices)
    return taken


def check_indices(indices: NDArray, size: int, kind: str = "vertex") -> None:
    """Raise ValueError unless all indices in faces are from 0 to below ``size``."""
    wrong = indices[(indices < 0) | (indices >= size)]
    if wrong.size:
        raise ValueError(f"a face asks for {kind} number {wrong[0]} (counted from 0) of {size:,}")


def colours_from_numbers(values: NDArray, notes: list[str]) -> NDArray[np.float64]:
    """Scale colours to [0, 1] from 0 to 1, 255, 65,535 or more, as their largest says.

    Numbers with a fraction a little above 1 (baked light) are cut to 1 with a note.
    """
    if values.dtype.kind in "iu" and values.itemsize == 1:
        return values.astype(np.uint8) / 255.0
    numbers = np.nan_to_num(values.astype(float), posinf=0.0, neginf=0.0)
    largest, is_whole = numbers.max(initial=0.0), np.array_equal(numbers, np.rint(numbers))
    if not is_whole and 1.0 < largest < MAX_FACTOR:
        notes.append(f"Colours above 1, cut to 1: {np.sum((numbers > 1.0).any(axis=1)):,}.")
        largest = 1.0
    scale = next((top for top in (1.0, 255.0, 65535.0) if largest <= top), 2.0**32 - 1.0)
    return np.clip(numbers / scale, 0.0, 1.0)


def note_edges(uvs: NDArray, is_wrapped: Sequence[bool], notes: list[str]) -> None:
    """Note coordinates (V, 2) beyond a texture that does not go on there as ours do, wrapped."""
    if np.any(np.abs(uvs - 0.5).max(axis=0, initial=0.0)[~np.array(is_wrapped)] > 0.51):
        notes.append("A texture that is clamped or mirrored, repeated instead.")


def indices_by_group(which: NDArray, count: int) -> list[NDArray[np.int64]]:
    """List for each number below ``count`` where it stands in ``which`` (N,), in order."""
    order = np.argsort(which, kind="stable")
    return np.split(order, np.searchsorted(which[order], np.arange(1, count)))


def load_textures(
    folder: Path, names: Iterable[str], notes: list[str]
) -> dict[str, NDArray[np.uint8]]:
    """The named pictures that are there and sound, as RGB (h, w, 3); others are noted."""
    names = list(dict.fromkeys(names))
    if len(names) > MAX_TEXTURES:
        notes.append(f"Textures left out: all but {MAX_TEXTURES:,} of {len(names):,}.")
    paths = {name: find_named(folder, name) for name in names[:MAX_TEXTURES]}
    images: dict[Path | None, tuple[str, Image.Image]] = {}
    for name, path in paths.items():
        if path is None:
            notes.append(NO_TEXTURE.format(bare_name(name)))
        elif path not in images:
            file = InputFile(path, [], MeshFileError, "picture", MAX_DATA_BYTES)
            with note_errors(path.name, notes):
                # From a file, Pillow reads as many bytes as a damaged chunk says it has.
                images[path] = path.name, Image.open(BytesIO(file.load_bytes()))
    textures = textures_from_images(images, notes)
    return {name: textures[path] for name, path in paths.items() if path in textures}


def textures_from_images(
    images: Mapping[Key, tuple[str, Image.Image]], notes: list[str]
) -> dict[Key, NDArray[np.uint8]]:
    """RGB (h, w, 3) of pictures with their names, shrunk to have few texels together."""
    sizes = np.array([image.size for _, image in images.values()], float).reshape(-1, 2)
    side = MAX_SIDE_PX
    areas = sizes.prod(axis=1)
    longest = sizes.max(axis=1, initial=1.0)
    while side > 1 and np.sum(areas * np.minimum(1.0, side / longest) ** 2) > MAX_TEXELS:
        side = side * 4 // 5
    if side < MAX_SIDE_PX:
        notes.append(f"Textures shrunk to {side} px: together they are very large.")
    textures: dict[Key, NDArray[np.uint8]] = {}
    for key, (name, image) in images.items():
        with note_errors(name, notes), image:
            if image.width * image.height > MAX_TEXELS:
                raise Image.DecompressionBombError
            if max(image.size) > side:
                image.thumbnail((side, side))
            if image.mode.startswith("I"):  # 16 bits, of which Pillow cuts off all above 255
                image = Image.fromarray((np.asarray(image) // 256).astype(np.uint8))
            textures[key] = np.asarray(image.convert("RGB"))
    return textures


@contextmanager
def note_errors(name: str, notes: list[str]) -> Iterator[None]:
    """Make what goes wrong with a picture a note: a model without it is still one."""
    try:
        with quiet_libraries():
            yield
    except Image.DecompressionBombError:
        notes.append(f"Texture left out: {name} has too many pixels.")
    except Exception as error:  # noqa: BLE001 - Pillow's readers raise errors of all kinds
        said = str(error).rstrip(".") or type(error).__name__
        notes.append(f"Texture left out: {said if name in said else f'{name}: {said}'}.")
