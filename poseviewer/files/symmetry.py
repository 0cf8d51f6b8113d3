"""A model's symmetry from a file: one beside the model, or BOP's ``models_info.json``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import MeshFileError
from poseviewer.files.checks import Reading, kind_of
from poseviewer.files.formats.bop_models import MODELS_INFO, load_bop_models
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.symmetry import MOST_FOLD, NO_SYMMETRY, Symmetry, Turn

FORMAT = "poseviewer-symmetry"
KIND = "symmetry file"
ANY = "any"
"""The fold of a continuous symmetry, in files."""
MOST_TURNS = 100
BOP_MODEL = re.compile(r"obj_(\d{6})\.ply")


def symmetry_path(mesh_path: str | Path) -> Path:
    """Where the symmetry of a model stands: ``can.symmetry.json`` beside ``can.ply``."""
    return Path(mesh_path).with_suffix(".symmetry.json")


def load_symmetry(mesh_path: str | Path, mesh: Mesh) -> Symmetry:
    """A model's symmetry, from the file beside it or its BOP data set; none where neither is."""
    mesh_path = Path(mesh_path)
    beside, info = symmetry_path(mesh_path), mesh_path.parent / MODELS_INFO
    if beside.exists():
        return read_symmetry(beside, mesh)
    if BOP_MODEL.fullmatch(mesh_path.name) and info.is_file():
        return read_symmetry(info, mesh, mesh_path.name)
    return NO_SYMMETRY


def read_symmetry(path: Path, mesh: Mesh, model_name: str = "") -> Symmetry:
    """The symmetry that a file says of a model; a ``models_info.json``, of the one so called."""
    reading = Reading(path, error_type=MeshFileError, kind=KIND)
    if path.name == MODELS_INFO:
        models, number = load_bop_models(path), BOP_MODEL.fullmatch(model_name)
        if number is None:
            found = f"says nothing of {model_name}"
            raise reading.error(found, "its models are called as obj_000001.ply")
        known = models.get(int(number[1]))
        symmetry = NO_SYMMETRY if known is None else known.symmetry
    else:
        with reading.naming_errors():
            data = reading.load_object()
            reading.require_format(data, FORMAT)
            reading.require_unit(data, mesh.unit)
            symmetry = symmetry_from_json(reading, data, "")
    return symmetry


def symmetry_as_json(symmetry: Symmetry) -> dict[str, Any]:
    """``centre`` and ``turns`` as files say them."""
    turns = [
        {"axis": [float(value) for value in axis], "fold": fold or ANY}
        for axis, fold in symmetry.turns
    ]
    return {"centre": [float(value) for value in symmetry.centre], "turns": turns}


def symmetry_from_json(reading: Reading, value: Any, what: str) -> Symmetry:
    """What ``symmetry_as_json`` gives; raises the reading's error."""
    value, where = reading.object(value, what or "its content"), f"{what}." if what else ""
    centre = reading.numbers(value.get("centre"), f"{where}centre")
    listed = value.get("turns")
    if not isinstance(listed, list) or len(listed) > MOST_TURNS:
        found = f"{where}turns is {kind_of(listed)}"
        raise reading.error(found, f"wanted a list of turns, of {MOST_TURNS} at most")
    turns = [_turn(reading, turn, f"{where}turns[{i}]") for i, turn in enumerate(listed)]
    try:
        return Symmetry.from_turns(centre, turns)
    except ValueError as error:
        raise reading.error(f"its turns {error}", "mend their axes and folds") from None


def _turn(reading: Reading, value: Any, what: str) -> Turn:
    (axis,) = reading.fields(value, what, axis=Reading.numbers)
    length = float(np.linalg.norm(axis))
    if not length > 0.0:
        raise reading.error(f"{what}.axis has no length", "wanted a direction")
    fold = value.get("fold")
    if fold == ANY:
        return Turn(np.array(axis) / length, 0)
    if not isinstance(fold, int) or isinstance(fold, bool) or not 2 <= fold <= MOST_FOLD:
        wanted = f"wanted a whole number from 2 to {MOST_FOLD}, or {ANY!r}"
        raise reading.error(f"{what}.fold is {kind_of(fold)}", wanted)
    return Turn(np.array(axis) / length, fold)
