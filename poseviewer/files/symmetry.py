"""A model's symmetry from a file: one beside the model, or BOP's ``models_info.json``."""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct

from poseviewer.errors import MeshFileError
from poseviewer.files.checks import InputFile, Three
from poseviewer.files.formats.bop_models import MODELS_INFO, Axis, load_bop_models
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.symmetry_group import MAX_FOLD, Symmetry, SymmetryAxis

FORMAT = "poseviewer-symmetry"
KIND = "symmetry file"
ANY: Literal["any"] = "any"
BOP_MODEL = re.compile(r"obj_(\d{6})\.ply")


class TurnsAbout(Axis, frozen=True):
    """fold: in how many equal steps the turns about the axis go round; any: every turn."""

    fold: Annotated[int, Meta(ge=2, le=MAX_FOLD)] | Literal["any"]


class SymmetryTurns(Struct, frozen=True):
    """Motions of the model onto itself: the turns about axes through a centre, in the model's frame
    and unit, and all that follow from them.
    """

    centre: Three
    turns: Annotated[tuple[TurnsAbout, ...], Meta(max_length=100)]

    def __post_init__(self) -> None:
        try:
            _ = self.symmetry
        except ValueError as error:
            raise ValueError(f".turns {error}; mend their axes and folds") from None

    @property
    def symmetry(self) -> Symmetry:
        """The symmetry as the program has it."""
        return _generate_symmetry(self.centre, self.turns)

    @classmethod
    def of(cls, symmetry: Symmetry) -> SymmetryTurns | None:
        """A symmetry as files say it; None where there is none."""
        turns = [TurnsAbout(tuple(axis.tolist()), n or ANY) for axis, n in symmetry.symmetry_axes]
        return None if symmetry.is_none else cls(tuple(symmetry.centre.tolist()), tuple(turns))


@lru_cache(maxsize=16)
def _generate_symmetry(centre: tuple[float, ...], turns: tuple[TurnsAbout, ...]) -> Symmetry:
    """The symmetry of these turns; many take 50 ms."""
    groups = [SymmetryAxis(turn.unit, 0 if turn.fold == ANY else turn.fold) for turn in turns]
    return Symmetry.from_axes(centre, groups)


class SymmetryFile(SymmetryTurns, frozen=True, tag_field="format", tag=FORMAT):
    """A symmetry file; the unit has to be the model's."""

    version: Literal[1] = 1
    unit: str | None = None


def symmetry_path(mesh_path: str | Path) -> Path:
    """Path of a model's symmetry: ``can.symmetry.json`` beside ``can.ply``."""
    return Path(mesh_path).with_suffix(".symmetry.json")


def load_symmetry(mesh_path: str | Path, mesh: Mesh) -> Symmetry | None:
    """A model's symmetry, from the file beside it or its BOP data set; None where neither is."""
    path = symmetry_path(mesh_path)
    if not path.exists():
        number, info = BOP_MODEL.fullmatch(Path(mesh_path).name), path.with_name(MODELS_INFO)
        known = load_bop_models(info).get(int(number[1])) if number and info.is_file() else None
        return None if known is None else known.symmetry
    file = InputFile(path, error_type=MeshFileError, kind=KIND)
    with file.naming_errors():
        return file.decode(file.load_beside_model(FORMAT, mesh.unit), SymmetryTurns).symmetry
