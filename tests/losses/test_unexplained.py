"""The scale that losses are read on."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poseviewer.geometry.transform import RigidTransform
from poseviewer.losses.default_loss import DEFAULT, EDGE_WEIGHT, UnexplainedScale
from poseviewer.losses.loss import LossScale
from poseviewer.losses.paper_loss import PAPER
from poseviewer.render.attributes import PhotoAttributes
from poseviewer.render.pyramid.levels import with_structure
from tests.fit.test_paper import POSE, make_photo
from tests.fit.test_problem import RENDERER
from tests.losses.test_lighting_loss import SEEDS, make_moments, make_samples

SCALE = UnexplainedScale(worst=4 * np.log1p(1e3) + 2 * EDGE_WEIGHT, correlations=4, colours=3)


@given(SEEDS, st.floats(0.0, 1.0), st.floats(0.05, 20.0))
def test_it_is_the_geometric_mean_of_its_parts(seed, cosine, noise):
    _, photo, model = make_samples(seed, 8, 4, noise)
    moments = replace(make_moments(photo, model), edge_cosine=cosine)
    found = SCALE.read(DEFAULT.of_moments(moments), moments)
    assert len(found.parts) == 3
    assert found.total**3 == pytest.approx(float(np.prod(found.parts)), rel=1e-6)
    assert all(0.0 <= part <= 1.0 for part in found.parts)


def test_it_keeps_the_order_of_poses():
    losses = np.linspace(0.0, 4 * np.log1p(1e3) + EDGE_WEIGHT, 50)
    assert np.all(np.diff(SCALE.as_unexplained(losses)) > 0.0)
    assert SCALE.as_unexplained(float(losses[-1])) == pytest.approx(1.0)
    assert SCALE.as_unexplained(float(losses[-1]) + 1.0) == 1.0
    assert np.isnan(SCALE.as_unexplained(np.array([np.nan, 1.0]))).tolist() == [True, False]


def test_the_papers_loss_is_shown_as_it_is():
    scale = PAPER.scale(make_photo(clipped=True, ground=0.5))
    assert scale.text(0.378) == "loss 0.378 of 1"
    assert (scale.as_shown(0.378), scale.as_unexplained(0.378)) == (0.378, 0.378)
    assert LossScale(3.0).as_unexplained(1.5) == 0.5


def test_it_tells_the_right_pose_from_others():
    """A pose that shows nothing leaves all unexplained."""
    grey = make_photo(clipped=False, ground=0.1)
    photo = with_structure(PhotoAttributes(grey.channels, grey.weights, clipped=False), 1)
    scale = DEFAULT.scale(photo)

    def unexplained_at(degrees: float, shift: float = 0.0) -> float:
        turn = RigidTransform.from_rotation_vector([0.0, np.radians(degrees), 0.0], [shift, 0, 0])
        pose = replace(POSE, camera_from_model=POSE.camera_from_model @ turn)
        moments = RENDERER.moments(pose, photo)
        return scale.read(DEFAULT.of_moments(moments), moments).total

    at = [unexplained_at(degrees) for degrees in (0.0, 2.0, 5.0, 15.0)]
    assert at == sorted(at)
    assert at[0] < 0.5 * at[-1]
    assert unexplained_at(0.0, shift=100.0) == 1.0
    assert scale.as_unexplained(scale.worst) == 1.0
