"""Landscapes in files: everything comes back, and half a file never stays."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from poseviewer.errors import SettingsError
from poseviewer.files.landscape_file import KEYS, load_landscape, save_landscape
from poseviewer.fit.landscape import Slice

NAMES = ("mu_x", "mu_y", "psi_x")


def make_slices(size: int = 5) -> list[Slice]:
    random = np.random.default_rng(0)
    pieces = []
    for first, second in combinations(range(3), 2):
        losses = random.uniform(size=(size, size))
        losses[1, 2] = np.nan
        x, y = (np.linspace(i, i + 1.0, size) for i in (first, second))
        pieces.append(Slice(first, second, x, y, losses))
    return pieces


def test_what_is_saved_comes_back(tmp_path):
    slices = make_slices()
    save_landscape(tmp_path / "a.npz", NAMES, [1.0, 2.0, 3.0], [0.1, 0.2, 1.0], slices)
    arrays = load_landscape(tmp_path / "a.npz")
    assert tuple(arrays) == KEYS
    assert tuple(arrays["names"]) == NAMES
    assert np.array_equal(arrays["centre"], [1.0, 2.0, 3.0])
    assert np.array_equal(arrays["spans"], [0.1, 0.2, 1.0])
    for i, piece in enumerate(slices):
        assert tuple(arrays["pairs"][i]) == (piece.first, piece.second)
        assert np.array_equal(arrays["first_values"][i], piece.first_values)
        assert np.array_equal(arrays["second_values"][i], piece.second_values)
        assert np.array_equal(arrays["losses"][i], piece.losses, equal_nan=True)


def test_files_hold_no_pickles(tmp_path):
    save_landscape(tmp_path / "a.npz", NAMES, np.zeros(3), np.ones(3), make_slices())
    with np.load(tmp_path / "a.npz", allow_pickle=False) as archive:
        assert all(archive[key].dtype.kind in "Ufi" for key in archive.files)


def test_the_old_file_is_replaced_and_nothing_else_stays(tmp_path):
    for centre in (np.zeros(3), np.ones(3)):
        save_landscape(tmp_path / "a.npz", NAMES, centre, np.ones(3), make_slices())
    assert np.array_equal(load_landscape(tmp_path / "a.npz")["centre"], np.ones(3))
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_a_missing_folder_is_said(tmp_path):
    with pytest.raises(SettingsError, match="check that the folder exists"):
        save_landscape(tmp_path / "no" / "a.npz", NAMES, np.zeros(3), np.ones(3), make_slices())
