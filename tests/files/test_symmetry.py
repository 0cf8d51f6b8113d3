"""Symmetries from files: beside a model, of a BOP data set, in pose files."""

from pathlib import Path

import jsonschema
import numpy as np
import pytest
import trimesh

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.symmetry import load_symmetry, symmetry_path
from tests.schemas import json_schema
from tests.writing import write

_, _, Z = np.eye(3)
HALF_TURN = [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]


def good() -> dict:
    turns = {"centre": [0.0, 0.0, 0.0], "turns": [{"axis": [0, 0, 2], "fold": 2}]}
    return {"format": "poseviewer-symmetry", "version": 1, **turns}


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "obj_000003.ply"
    trimesh.creation.box(extents=(2.0, 1.0, 0.5)).export(path)
    return path


@pytest.mark.parametrize(("fold", "words"), [(2, "half a turn"), ("any", "every turn")])
def test_a_file_beside_the_model_is_read(model: Path, fold, words: str) -> None:
    data = good() | {"turns": [{"axis": [0, 0, 2], "fold": fold}]}
    jsonschema.validate(data, json_schema("symmetry"))
    write(symmetry_path(model), data)
    assert load_symmetry(model, load_mesh(model)).words == f"{words} about (0, 0, 1)"


def test_that_of_a_bop_data_set_is_read(model: Path) -> None:
    info = {"3": {"diameter": 2.3, "symmetries_discrete": [HALF_TURN]}, "4": {"diameter": 1.0}}
    write(model.parent / "models_info.json", info)
    assert load_symmetry(model, load_mesh(model)).words == "half a turn about (0, 0, 1)"
    other = model.rename(model.with_name("obj_000004.ply"))
    assert load_symmetry(other, load_mesh(other)).is_none
    write(symmetry_path(other), good())  # the user's own goes before
    assert not load_symmetry(other, load_mesh(other)).is_none


@pytest.mark.parametrize(("change", "said"), [
    ({"format": "other"}, "format is 'other'"),
    ({"centre": [0, 0]}, "centre is a list of 2"),
    ({"turns": [{"axis": [0, 0, 0], "fold": 2}]}, "no length"),
    ({"turns": [{"axis": [0, 0, 1], "fold": 1}]}, r"turns\[0\].fold is 1; wanted a whole"),
    ({"turns": [{"axis": [0, 0, 1], "fold": 7}, {"axis": [3, 0, 4], "fold": 2}]},
     "more than 120 equal poses"),
])  # fmt: skip
def test_one_that_cannot_be_used_is_said(model: Path, change: dict, said: str) -> None:
    write(symmetry_path(model), good() | change)
    with pytest.raises(MeshFileError, match=rf"^obj_000003\.symmetry\.json: .*{said}"):
        load_symmetry(model, load_mesh(model))


def test_a_unit_that_is_not_the_models_is_said(model: Path) -> None:
    mesh = load_mesh(model)
    object.__setattr__(mesh, "unit", "mm")
    write(symmetry_path(model), good() | {"unit": "m"})
    with pytest.raises(MeshFileError, match=r"lengths in 'm', the model's are in 'mm'"):
        load_symmetry(model, mesh)
