"""A model's symmetry is said on the page, and kept with the session."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from poseviewer.app.state.objects import symmetry_text
from poseviewer.app.state.session import Session
from poseviewer.app.workers.autosaving import Autosaver
from poseviewer.app.workers.exporting import record_of
from poseviewer.app.workers.opening import open_files, restore
from poseviewer.files.state.autosave import load_autosave
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.symmetry import Symmetry, Turn
from tests.app.state.documents import PERSPECTIVE, make_session
from tests.meshes import make_box, make_two_boxes
from tests.scene import make_scene_of

HALF_TURN = Symmetry.from_turns(np.zeros(3), [Turn(np.eye(3)[0], 2)])


def test_with_parts_left_out_there_is_none():
    whole = replace(make_session(PERSPECTIVE, mesh=make_two_boxes()).document.registration)
    assert "told apart" in symmetry_text(whole)
    own = replace(whole, whole_symmetry=HALF_TURN)
    assert "half a turn about" in symmetry_text(own)
    own = replace(own, mesh=own.mesh.without(["mirror"]))
    assert own.symmetry.is_none
    assert "parts left out" in symmetry_text(own)


def test_it_is_saved_and_there_after_a_crash(tmp_path: Path):
    scene = make_scene_of(make_box(), tmp_path)
    document = open_files(scene.photo, scene.model, scene.start).document
    session = Session(document.compared_by(whole_symmetry=HALF_TURN))
    assert record_of(session).symmetry is HALF_TURN
    autosaver = Autosaver(tmp_path / "state")
    autosaver.close(session)
    (path,) = (tmp_path / "state" / "sessions").iterdir()
    (again,) = restore(load_autosave(path))
    own = again.document.registration
    assert own.symmetry.words == HALF_TURN.words
    off = pose_error(own.mesh, again.document.pose, session.document.pose, own.symmetry)
    assert off.reprojection_px < 1e-6
