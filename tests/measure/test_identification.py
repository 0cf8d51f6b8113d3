"""Identification on real photos: every model of a set is fitted, from where the own one starts."""

from __future__ import annotations

import numpy as np
import pytest

from poseviewer.files.mesh.load import load_mesh
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from tests.measure.identification import (
    Identification,
    placed,
    run_identifications,
    summary,
)


@pytest.mark.slow
def test_each_model_of_the_set_is_fitted(shared_data):
    settings = FitSettings(limits=Limits(evaluations=30))
    found = list(run_identifications(shared_data, settings, pattern="0000-light0-mustard"))
    (one,) = found
    assert (one.set, one.models) == ("hope", 3)
    assert 1 <= one.rank <= 3
    assert (one.rank == 1) == (one.margin > 0.0)
    assert one.best_other in {"bbq_sauce.ply", "AlphabetSoup.ply"}
    assert 0.0 < one.loss < np.inf
    assert (one.rank == 1) == (one.loss < one.best_other_loss)


def test_another_model_is_laid_where_the_own_one_is(shared_data):
    own, other = (load_mesh(shared_data / "hope" / f"{name}.ply") for name in ("mustard", "bbq_sauce"))  # fmt: skip  # noqa: E501
    shifted = RigidTransform.from_rotation_vector([0.3, -0.5, 0.2], [10.0, 20.0, 900.0])
    pose = Pose(Perspective(500.0, 500.0, 320.0, 240.0, 640, 480), shifted)
    laid = placed(own, other, pose).camera_from_model
    np.testing.assert_allclose(
        laid.apply(other.centre[None]), shifted.apply(own.centre[None]), atol=1e-9
    )
    np.testing.assert_array_equal(laid.rotation, shifted.rotation)
    np.testing.assert_allclose(
        placed(own, own, pose).camera_from_model.translation, shifted.translation, atol=1e-9
    )


def test_the_summary_counts_first_places():
    one = Identification("lmo", "a", 5, 1, 0.5, "b.ply", 0.6, 0.2, 1.0)
    two = Identification("lmo", "c", 5, 3, 0.5, "b.ply", 0.4, -0.2, 1.0)
    assert summary([one, two]).splitlines()[1].split() == ["lmo", "2", "5", "1", "20%", "0.000"]
