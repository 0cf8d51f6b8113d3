"""Models of other proportions than the thing in the photo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.api import make_scene
from poseviewer.fit.scene import Scene
from poseviewer.starts.loading import load_model, open_photo


def stretched(scene, *factors: float) -> Scene:
    """The small scene, from its start, with its model stretched along x, y and z."""
    model = load_model(scene.model)
    normals = model.mesh.normals / factors
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    mesh = replace(model.mesh, vertices=model.mesh.vertices * factors, normals=normals)
    return open_photo(scene.photo, replace(model, mesh=mesh), scene.start)


@pytest.mark.parametrize("axis", [0, 2])
def test_a_model_25_percent_too_long_along_an_axis_is_not_found(scene, axis: int):
    factors = np.where(np.arange(3) == axis, 1.25, 1.0)
    verdict = make_scene(stretched(scene, *factors)).fit().verdict
    assert verdict is not None
    assert verdict.word == "doubtful"
    assert "another model?" in verdict.reasons[0]


def test_a_model_that_fits_stays_found(scene):
    verdict = make_scene(stretched(scene, 1.0, 1.0, 1.0)).fit().verdict
    assert verdict is not None
    assert verdict.word == "found"
    assert not any("another model?" in reason for reason in verdict.reasons)
