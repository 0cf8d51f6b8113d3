"""Maps of the loss in files: each kind holds them, and half a file never stays."""

from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from poseviewer.errors import SettingsError
from poseviewer.figures.map_archive import LossMaps
from poseviewer.fit.slices import Slice
from poseviewer.geometry.arrays import freeze_array
from poseviewer.losses.loss import LossScale

SCALE = LossScale(1.0)
PAIRS = ((0, 1), (0, 2), (1, 2))


NAMES = ("mu_x", "mu_y", "psi_x")


def make_maps(*sizes: int) -> LossMaps:
    """A slice of each pair, of these numbers of points a side; one loss is not known."""
    random, slices = np.random.default_rng(0), []
    for (i, j), size in zip(PAIRS, sizes or (5, 5, 5), strict=False):
        losses = random.uniform(size=(size, size))
        losses[1:2, 2:3] = np.nan
        x, y = (np.linspace(start, start + 1, size) for start in (i, j))
        slices.append(Slice(i, j, x, y, losses))
    centre, scales = freeze_array(np.arange(3) + 0.5, (3,)), freeze_array([0.1, 0.2, 1.0], (3,))
    return LossMaps(slices, NAMES, centre, scales, SCALE, "About a pose", "p.jpg")


def arrays_of(data: bytes) -> dict[str, NDArray]:
    """The arrays of an archive, as anybody reads it."""
    with np.load(BytesIO(data), allow_pickle=False) as archive:
        return dict(archive)


@pytest.mark.parametrize("kind", ["png", "pdf", "svg", "npz"])
def test_a_file_is_what_a_download_is(tmp_path, kind):
    maps = make_maps()
    maps.save(tmp_path / f"maps.{kind.upper()}")
    kept = (tmp_path / f"maps.{kind.upper()}").read_bytes()
    data = maps.as_bytes(kind)
    if kind == "png":
        ours, theirs = (
            np.asarray(cv2.imdecode(np.frombuffer(d, np.uint8), 1)) for d in (kept, data)
        )
        assert np.array_equal(ours, theirs)
        assert ours.std() > 1.0
    elif kind == "npz":
        arrays = arrays_of(kept)
        assert (tuple(arrays["names"]), str(arrays["photo"])) == (NAMES, "p.jpg")
        assert np.array_equal(arrays["centre"], maps.centre)
        assert np.array_equal(arrays["spans"], maps.scales)
        assert arrays["pairs"].tolist() == [list(pair) for pair in PAIRS]
        for name in ("first_values", "second_values", "losses"):
            own = [getattr(piece, name) for piece in maps.slices]
            assert np.array_equal(arrays[name], own, equal_nan=True)
    else:
        assert kept[:5] == data[:5] == {"pdf": b"%PDF-", "svg": b"<?xml"}[kind]


def test_coarser_slices_stand_on_the_grid_of_the_finest():
    """They stand beside finer ones in the app, while maps become finer."""
    maps = make_maps(3, 5)
    arrays, (coarse, fine) = arrays_of(maps.as_bytes("npz")), maps.slices
    assert np.array_equal(arrays["first_values"][0][::2], coarse.first_values)
    assert np.array_equal(arrays["losses"][0][::2, ::2], coarse.losses, equal_nan=True)
    assert np.isnan(arrays["losses"][0][1::2]).all()
    assert np.array_equal(arrays["losses"][1], fine.losses, equal_nan=True)
    assert arrays_of(make_maps(1).as_bytes("npz"))["losses"].shape == (1, 1, 1)


def test_a_kind_that_there_is_none_of_is_said(tmp_path):
    with pytest.raises(SettingsError, match=r"a\.xlsx: .*\.npz for the"):
        make_maps().save(Path(tmp_path / "a.xlsx"))
    assert not list(tmp_path.iterdir())
