"""A model without some of its parts."""

from __future__ import annotations

import numpy as np
import pytest

from poseviewer.errors import SettingsError
from poseviewer.geometry.mesh import kept_lately
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


def test_parts_come_back():
    mesh = make_two_boxes()
    body = mesh.without(["mirror"])
    assert body.without([]) is mesh
    assert body.without(["mirror"]) is body
    assert mesh.without([]) is mesh
    assert body.without(["body"]).left_out == ("body",)


def test_a_part_that_is_not_there_is_said_with_those_that_are():
    with pytest.raises(SettingsError, match=r"no part 'antenna'; it has body, mirror"):
        make_two_boxes().without(["antenna"])


def test_the_last_part_cannot_be_left_out():
    with pytest.raises(SettingsError, match=r"nothing would be left.*body, mirror; leave one"):
        make_two_boxes().without(["body", "mirror"])


@pytest.mark.parametrize(("most", "faces", "kept"), [(2, 100, 2), (5, 30, 2), (5, 1, 1)])
def test_what_is_made_of_models_is_kept_for_those_asked_for_last(monkeypatch, most, faces, kept):
    """Boxes have twelve faces; of a model larger than all that is kept there is one at least."""
    monkeypatch.setattr("poseviewer.geometry.mesh.MOST_FACES_KEPT", faces)
    made = []

    @kept_lately(most)
    def number(mesh, more: int = 0) -> int:
        made.append((mesh, more))
        return len(made)

    boxes = [make_box() for _ in range(4)]
    assert [number(box) for box in boxes] == [1, 2, 3, 4]
    assert [number(box) for box in reversed(boxes[-kept:])] == [4, 3, 2, 1][:kept]
    assert number(boxes[-1]) == 4
    assert number(boxes[0]) == 5
    assert number(boxes[0], 1) == 6
