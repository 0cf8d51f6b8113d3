"""A model's symmetry is said on the page, and kept with the session."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from poseviewer.app.state.objects import symmetry_text
from poseviewer.geometry.symmetry_group import Symmetry, Turn
from tests.app.state.documents import PERSPECTIVE, make_session
from tests.meshes import make_two_boxes

HALF_TURN = Symmetry.from_turns(np.zeros(3), [Turn(np.eye(3)[0], 2)])


def test_with_parts_left_out_there_is_none():
    whole = make_session(PERSPECTIVE, mesh=make_two_boxes()).document.model
    assert symmetry_text(whole) == "no symmetry"
    own = replace(whole, whole_symmetry=HALF_TURN)
    assert "half a turn about" in symmetry_text(own)
    own = replace(own, mesh=own.mesh.without(["mirror"]))
    assert own.symmetry.is_none
    assert symmetry_text(own) == "no symmetry with parts left out"
