"""MTL: the materials of an OBJ file, as far as they speak of reflectance."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseviewer.files.mesh.texture import load_texture


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """What a material says about reflectance."""

    diffuse: NDArray | None = None
    """(3,) RGB in [0, 1]."""
    texture: NDArray[np.uint8] | None = None


def read_materials(path: Path, libraries: list[str], notes: list[str]) -> dict[str, Material]:
    """The materials by name in the MTL files ``libraries`` of the OBJ file ``path``.

    What is missing is added to ``notes``: a model without its colours is still a model.
    """
    materials: dict[str, Material] = {}
    for library in dict.fromkeys(libraries):
        written = Path(library.strip('"').replace("\\", "/"))
        places = [path.parent / written, path.parent / written.name]
        found = next((place for place in places if place.is_file()), None)
        if found is None:
            notes.append(f"Material file left out: {written.name} is not there.")
            continue
        text = found.read_text(encoding="utf-8", errors="replace")
        materials.update(_parse_mtl(text, found.parent, notes))
    return materials


def _parse_mtl(text: str, folder: Path, notes: list[str]) -> dict[str, Material]:
    materials: dict[str, Material] = {}
    textures: dict[str, NDArray | None] = {}
    name = None
    for line in text.splitlines():
        word, _, rest = line.strip().partition(" ")
        rest, word = rest.strip(), word.lower()
        if word == "newmtl":
            name = rest
            materials[name] = Material()
        elif name is None or not rest:
            continue
        elif word == "kd":
            materials[name] = Material(_diffuse(rest), materials[name].texture)
        elif word == "map_kd":
            file = _without_options(rest)
            if file not in textures:
                textures[file] = _texture_or_note(folder, file, notes)
            # A texture replaces Kd, as in Blender: many exporters write Kd 0 beside it.
            materials[name] = Material(materials[name].diffuse, textures[file])
    return materials


def _diffuse(text: str) -> NDArray | None:
    try:
        values = [float(word) for word in text.split()[:3]]
    except ValueError:
        return None
    values = values * 3 if len(values) == 1 else values
    return np.clip(np.nan_to_num(values), 0.0, 1.0) if len(values) == 3 else None


def _without_options(text: str) -> str:
    """The file name behind options such as ``-s 1 1 1`` or ``-clamp on``; it may hold spaces."""
    words = text.split(" ")
    while words and words[0].startswith("-"):
        words.pop(0)
        while len(words) > 1 and (_is_number(words[0]) or words[0] in ("on", "off", "")):
            words.pop(0)
    return " ".join(words)


def _is_number(word: str) -> bool:
    return word.replace(".", "", 1).replace("-", "", 1).isdigit()


def _texture_or_note(folder: Path, file: str, notes: list[str]) -> NDArray | None:
    try:
        return load_texture(folder, file)
    except OSError as error:
        notes.append(f"Texture left out: {error}.")
        return None
