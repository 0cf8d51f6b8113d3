"""BOP's models and estimated poses: ``models_info.json``, and tables of results.

As published in the BOP toolkit's ``docs/bop_datasets_format.md`` and
``docs/bop_challenge_2019.md``; lengths in mm; symmetries map the model onto itself.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.files.checks import Reading
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.symmetry_group import Symmetry
from poseviewer.geometry.transform import RigidTransform, nearest_rotation

MODELS_INFO = "models_info.json"
RESULTS = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")
"""The columns of a table of results."""
NO_ROTATION = 0.01
"""By how much a rotation's product with its own transpose may differ from 1: files round, to two
digits at worst."""


@dataclass(frozen=True, slots=True, eq=False)
class BopModel:
    """Size and symmetry of an object's model."""

    diameter: float
    """mm."""
    symmetry: Symmetry


@dataclass(frozen=True, slots=True, eq=False)
class BopEstimate:
    """A row of a table of results."""

    scene: int
    image: int
    object_id: int
    score: float
    place: RigidTransform
    """Camera from model, mm."""


def load_bop_models(path: Path) -> dict[int, BopModel]:
    """The objects of a ``models_info.json``, by their numbers."""
    reading = Reading(path, kind=MODELS_INFO)
    found = {}
    for name, data in reading.load_object().items():
        if not name.isdecimal():
            raise reading.error(f"an object is called {name[:40]!r}", "wanted its number")
        info = reading.object(data, name)
        diameter = reading.positive(info.get("diameter"), f"{name}.diameter")
        found[int(name)] = BopModel(diameter, _symmetry(reading, info, name, diameter))
    return found


def load_bop_estimates(path: Path) -> list[BopEstimate]:
    """The rows of a table of results."""
    reading = Reading(path, kind="table of BOP results", largest=1_000_000_000)
    lines = csv.reader(reading.load_text().splitlines())
    head = next(lines, [])
    if tuple(head) != RESULTS:
        raise reading.error(f"its head is {','.join(head)[:80]!r}", f"wanted {','.join(RESULTS)}")
    found = []
    for number, cells in enumerate(lines, 2):
        what = f"line {number}"
        if len(cells) != len(RESULTS):
            raise reading.error(f"{what} has {len(cells)} cells", f"wanted {len(RESULTS)}")
        scene, image, thing, score = reading.flat_numbers(" ".join(cells[:4]), what)
        rotation = np.reshape(reading.flat_numbers(cells[4], what, 9), (3, 3))
        shift = reading.flat_numbers(cells[5], what, 3)
        # Estimators give what their network gave: what is near a rotation is meant as one.
        place = RigidTransform(nearest_rotation(rotation), np.array(shift))
        found.append(BopEstimate(int(scene), int(image), int(thing), score, place))
    return found


def _symmetry(reading: Reading, info: dict[str, Any], name: str, diameter: float) -> Symmetry:
    discrete, axes, offsets = [], [], []
    for i, entry in enumerate(_listed(reading, info, "symmetries_discrete", name)):
        what = f"{name}.symmetries_discrete[{i}]"
        matrix = np.reshape(reading.numbers(entry, what, 16), (4, 4))
        discrete.append(RigidTransform(_rotation(reading, matrix[:3, :3], what), matrix[:3, 3]))
    for i, entry in enumerate(_listed(reading, info, "symmetries_continuous", name)):
        what = f"{name}.symmetries_continuous[{i}]"
        said = reading.object(entry, what)
        axis, offset = (
            reading.numbers(said.get(key), f"{what}.{key}") for key in ("axis", "offset")
        )
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            raise reading.error(f"{what}.axis has no length", "wanted a direction")
        axes.append(np.array(axis) / length)
        offsets.append(offset)
    try:
        return Symmetry.from_transforms(discrete, axes, offsets, diameter)
    except ValueError as error:
        raise reading.error(f"the symmetries of {name} {error}", "mend them") from None


def _rotation(reading: Reading, matrix: FloatArray, what: str) -> FloatArray:
    off = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
    if off > NO_ROTATION or np.linalg.det(matrix) < 0.0:
        raise reading.error(f"{what} is no rotation and shift", "wanted a 4x4 rigid transform")
    return nearest_rotation(matrix)


def _listed(reading: Reading, info: dict[str, Any], key: str, name: str) -> list[Any]:
    found = info.get(key, [])
    if not isinstance(found, list):
        raise reading.error(f"{name}.{key} is not a list", "wanted a list of symmetries")
    return found
