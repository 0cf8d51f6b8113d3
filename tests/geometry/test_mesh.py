"""A model without some of its parts."""

import numpy as np
import pytest

from poseviewer.errors import SettingsError
from tests.meshes import make_box, make_two_boxes


def test_a_part_that_is_left_out_leaves_the_others_as_they_are():
    mesh = make_two_boxes()
    body = mesh.without(["mirror"])
    assert body.part_names == ("body",)
    assert body.left_out == ("mirror",)
    assert body.whole is mesh
    assert np.array_equal(body.vertices[body.faces], make_box().vertices[make_box().faces])
    assert np.array_equal(body.bounds, make_box().bounds)  # of what is left alone
    mirror = mesh.without(["body"])
    assert set(mirror.face_part.tolist()) == {0}
    assert mirror.part_names == ("mirror",)


def test_a_part_that_is_not_there_is_said_with_those_that_are():
    with pytest.raises(SettingsError, match=r"no part 'antenna'; it has body, mirror"):
        make_two_boxes().without(["antenna"])


def test_the_last_part_cannot_be_left_out():
    with pytest.raises(SettingsError, match=r"nothing would be left.*body, mirror; leave one"):
        make_two_boxes().without(["body", "mirror"])
