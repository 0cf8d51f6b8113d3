"""Maps of the loss in files: each kind holds them, and half a file never stays."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest

from poseviewer.errors import SettingsError
from poseviewer.figures.loss_maps import LossMaps
from poseviewer.fit.loss import LossScale
from poseviewer.fit.slices import Slice
from poseviewer.geometry.arrays import frozen_array

SCALE = LossScale(most=1, colours=1, has_edges=False)
PAIRS = ((0, 1), (0, 2), (1, 2))


def make_maps(shift: float = 0.0) -> LossMaps:
    random = np.random.default_rng(0)
    slices = [
        Slice(i, j, np.linspace(i, i + 1, 5), np.linspace(j, j + 1, 5), random.uniform(size=(5, 5)))
        for i, j in PAIRS
    ]
    centre, scales = frozen_array(np.arange(3) + 0.5 + shift, (3,)), frozen_array(np.ones(3), (3,))
    return LossMaps(
        slices, ("mu_x", "mu_y", "psi_x"), centre, scales, SCALE, "About a pose", "p.jpg"
    )


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
        with np.load(BytesIO(kept), allow_pickle=False) as archive:
            assert np.array_equal(archive["losses"], [piece.losses for piece in maps.slices])
            assert str(archive["photo"]) == "p.jpg"
    else:
        assert kept[:5] == data[:5] == {"pdf": b"%PDF-", "svg": b"<?xml"}[kind]


def test_a_kind_that_there_is_none_of_is_said(tmp_path):
    with pytest.raises(SettingsError, match=r"a\.xlsx: .*\.npz for the"):
        make_maps().save(Path(tmp_path / "a.xlsx"))
    assert not list(tmp_path.iterdir())
