"""BOP's ``models_info.json`` and tables of results, as the BOP toolkit's docs say; in mm."""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct, field

from poseviewer.files.checks import MAX_DATA_BYTES, InputFile, Number, Positive, Three
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.symmetry_group import Symmetry
from poseviewer.geometry.transform import RigidTransform, nearest_rotation

MODELS_INFO = "models_info.json"
RESULTS = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")
MAX_ROUNDING = 0.01
"""Difference of a rotation's product with its transpose from 1: files round to two digits."""


class Axis(Struct, frozen=True):
    """A direction of any length above 0."""

    axis: Three

    def __post_init__(self) -> None:
        if not np.linalg.norm(self.axis) > 0.0:
            raise ValueError(".axis has no length; wanted a direction")

    @property
    def unit(self) -> FloatArray:
        """Direction (3,) of length 1."""
        return np.array(self.axis) / np.linalg.norm(self.axis)


class BopTurns(Axis, frozen=True):
    """All turns about an axis."""

    offset: Three


class BopModel(Struct, frozen=True):
    """Size and symmetry of an object's model, mm."""

    diameter: Positive
    discrete: tuple[Annotated[tuple[Number, ...], Meta(min_length=16, max_length=16)], ...] = field(
        name="symmetries_discrete", default=()
    )
    continuous: tuple[BopTurns, ...] = field(name="symmetries_continuous", default=())

    def __post_init__(self) -> None:
        for number, matrix in enumerate(np.reshape(self.discrete, (-1, 4, 4))[:, :3, :3]):
            off = np.abs(matrix @ matrix.T - np.eye(3)).max()
            if off > MAX_ROUNDING or np.linalg.det(matrix) < 0.0:
                found = f".symmetries_discrete[{number}] is no rotation and shift"
                raise ValueError(f"{found}; wanted a 4x4 rigid transform")
        try:
            _ = self.symmetry
        except ValueError as error:
            raise ValueError(f": its symmetries {error}; mend them") from None

    @property
    def symmetry(self) -> Symmetry:
        """The symmetry as the program has it."""
        matrices = np.reshape(self.discrete, (-1, 4, 4))
        discrete = [RigidTransform.from_matrix(matrix) for matrix in matrices]
        continuous = [(t.unit, np.array(t.offset)) for t in self.continuous]
        return Symmetry.from_transforms(discrete, continuous, self.diameter)


@dataclass(frozen=True, slots=True, eq=False)
class BopEstimate:
    """A row of a table of results."""

    scene: int
    image: int
    object_id: int
    score: float
    camera_from_model: RigidTransform


def load_bop_models(path: Path) -> dict[int, BopModel]:
    """The objects of a ``models_info.json``, by their numbers."""
    file = InputFile(path, kind=MODELS_INFO)
    models = file.load_object()
    for name in models:
        if not name.isdecimal():
            raise file.error(f"an object is called {name[:40]!r}", "wanted its number")
    return {int(name): file.decode(data, BopModel, name) for name, data in models.items()}


def load_bop_estimates(path: Path) -> list[BopEstimate]:
    """The rows of a table of results."""
    file = InputFile(path, kind="table of BOP results", largest=MAX_DATA_BYTES)
    lines = csv.reader(file.load_text().splitlines())
    head = next(lines, [])
    if tuple(head) != RESULTS:
        raise file.error(f"its head is {','.join(head)[:80]!r}", f"wanted {','.join(RESULTS)}")
    estimates = []
    for number, cells in enumerate(lines, 2):
        if not any(cells):
            continue
        what = f"line {number}"
        if len(cells) != len(RESULTS):
            raise file.error(f"{what} has {len(cells)} cells", f"wanted {len(RESULTS)}")
        scene, image, thing, score = file.flat_numbers(" ".join(cells[:4]), what)
        rotation = np.reshape(file.flat_numbers(cells[4], what, 9), (3, 3))
        shift = file.flat_numbers(cells[5], what, 3)
        # Estimators give what their network gave: what is near a rotation is meant as one.
        place = RigidTransform(nearest_rotation(rotation), np.array(shift))
        estimates.append(BopEstimate(int(scene), int(image), int(thing), score, place))
    return estimates
