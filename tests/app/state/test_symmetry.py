"""A model's symmetry is looked for where it is asked for, can be undone, and is kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.objects import DropSymmetry, UseSymmetry, symmetry_text
from poseviewer.app.state.session import Session
from poseviewer.app.workers.autosaving import Autosaver
from poseviewer.app.workers.exporting import record_of
from poseviewer.app.workers.opening import open_files, restore
from poseviewer.app.workers.tasks import find_symmetry_of_model
from poseviewer.errors import QuickStartError
from poseviewer.files.state.autosave import load_autosave
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.symmetry import Symmetry, Turn
from tests.app.state.documents import PERSPECTIVE, after, make_session
from tests.meshes import make_box, make_bumpy, make_mesh, make_two_boxes
from tests.scene import make_scene_of

PLAIN = make_mesh(make_box().vertices, make_box().faces)
"""A box of one colour."""


def found_in(session):
    (found,) = find_symmetry_of_model(session)
    return after(session, *found.requests)


def test_it_is_looked_for_used_and_dropped_and_all_of_it_is_undone():
    session = make_session(PERSPECTIVE, mesh=PLAIN)
    assert "told apart" in symmetry_text(session.document.registration)
    used = found_in(session)
    own = used.document.registration
    assert len(own.symmetry.transforms()) == 4
    assert "half a turn about" in symmetry_text(own)
    dropped = after(used, DropSymmetry())
    assert dropped.document.registration.symmetry.is_none
    assert len(after(dropped, c.Undo()).document.registration.symmetry.transforms()) == 4
    assert after(dropped, c.Undo(), c.Undo()).document.registration.symmetry.is_none


@pytest.mark.parametrize(("mesh", "said"), [(make_bumpy(3), "break"), (make_box(), "colours")])
def test_where_there_is_none_that_is_said(mesh, said):
    with pytest.raises(QuickStartError, match=said):
        next(find_symmetry_of_model(make_session(PERSPECTIVE, mesh=mesh)))


def test_that_of_another_model_is_not_taken():
    session = make_session(PERSPECTIVE, mesh=PLAIN)
    other = UseSymmetry(make_box(), Symmetry.from_turns(np.zeros(3), [Turn(np.eye(3)[2], 2)]))
    assert after(session, other) is session


def test_with_parts_left_out_there_is_none():
    session = make_session(PERSPECTIVE, mesh=make_two_boxes())
    whole = session.document.registration.mesh
    symmetry = Symmetry.from_turns(np.zeros(3), [Turn(np.eye(3)[0], 2)])
    used = after(session, UseSymmetry(whole, symmetry)).document.registration
    used = replace(used, mesh=whole.without(["mirror"]))
    assert used.symmetry.is_none
    assert "parts left out" in symmetry_text(used)


def test_it_is_saved_and_there_after_a_crash(tmp_path: Path):
    scene = make_scene_of(PLAIN, tmp_path)
    (opened,) = [open_files(scene.photo, scene.model, scene.start)]
    session = found_in(Session(opened.document))
    assert record_of(session).symmetry is session.document.registration.symmetry
    autosaver = Autosaver(tmp_path / "state")
    autosaver.close(session)
    (path,) = (tmp_path / "state" / "sessions").iterdir()
    (again,) = restore(load_autosave(path))
    own = again.document.registration
    assert own.symmetry.words == session.document.registration.symmetry.words
    off = pose_error(own.mesh, again.document.pose, session.document.pose, own.symmetry)
    assert off.reprojection_px < 1e-6
