"""Landscapes as files hold them: everything comes back."""

from __future__ import annotations

from io import BytesIO
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from poseviewer.files.landscape import landscape_npz_bytes
from poseviewer.fit.slices import Slice

NAMES = ("mu_x", "mu_y", "psi_x")
KEYS = {"names", "centre", "spans", "pairs", "first_values", "second_values", "losses", "photo"}


def load(data: bytes) -> dict[str, NDArray]:
    """The arrays of an archive, as anybody reads it."""
    with np.load(BytesIO(data), allow_pickle=False) as archive:
        return dict(archive)


def make_slices(size: int = 5) -> list[Slice]:
    random = np.random.default_rng(0)
    pieces = []
    for first, second in combinations(range(3), 2):
        losses = random.uniform(size=(size, size))
        losses[1:2, 2:3] = np.nan
        x, y = (np.linspace(i, i + 1.0, size) for i in (first, second))
        pieces.append(Slice(first, second, x, y, losses))
    return pieces


def test_what_is_saved_comes_back():
    slices, about = make_slices(), (NAMES, [1.0, 2.0, 3.0], [0.1, 0.2, 1.0])
    arrays = load(landscape_npz_bytes(*about, slices, "p.jpg, undistorted"))
    assert set(arrays) == KEYS
    assert tuple(arrays["names"]) == NAMES
    assert str(arrays["photo"]) == "p.jpg, undistorted"
    assert np.array_equal(arrays["centre"], [1.0, 2.0, 3.0])
    assert np.array_equal(arrays["spans"], [0.1, 0.2, 1.0])
    assert arrays["pairs"].tolist() == [[piece.first, piece.second] for piece in slices]
    for name in ("first_values", "second_values", "losses"):
        assert np.array_equal(arrays[name], [getattr(p, name) for p in slices], equal_nan=True)


def test_slices_that_are_known_on_coarser_grids_are_among_the_others():
    """Coarser slices stand beside finer ones in the app, while maps become finer."""
    (coarse, *_), (_, *fine) = make_slices(3), make_slices(5)
    arrays = load(landscape_npz_bytes(NAMES, np.zeros(3), np.ones(3), [coarse, *fine]))
    assert np.array_equal(arrays["first_values"][0][::2], coarse.first_values)
    assert np.array_equal(arrays["losses"][0][::2, ::2], coarse.losses, equal_nan=True)
    assert np.isnan(arrays["losses"][0][1::2]).all()
    assert np.array_equal(arrays["losses"][1], fine[0].losses, equal_nan=True)
    arrays = load(landscape_npz_bytes(NAMES, np.zeros(3), np.ones(3), make_slices(1)[:1]))
    assert arrays["losses"].shape == (1, 1, 1)
