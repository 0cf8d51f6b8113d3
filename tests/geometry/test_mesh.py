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


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        (["antenna"], r"no part 'antenna'; it has body, mirror"),
        (["body", "mirror"], r"nothing would be left.*body, mirror; leave one"),
    ],
)
def test_an_unknown_part_and_the_last_one_cannot_be_left_out(parts, said):
    with pytest.raises(SettingsError, match=said):
        make_two_boxes().without(parts)
