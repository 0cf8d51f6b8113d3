"""Fits end at the truth on a bundled path-traced photo; on more, see ``tests/measure``."""

import pytest

from poseviewer.api import load
from poseviewer.evaluation.photos import demo_photo
from poseviewer.files.demo import demo_case
from poseviewer.geometry.pose_error import pose_error


@pytest.mark.slow
@pytest.mark.long
def test_the_bundled_photo_is_registered():
    files, truth = demo_case("parallel"), demo_photo("photo-parallel").truth
    found = load(files.photo, files.model, files.start).fit()
    before, after = (pose_error(found.mesh, one.pose, truth) for one in (found.start, found))
    assert before.percent > 4.0
    assert after.percent < 1.5
