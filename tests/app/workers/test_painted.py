"""Models are painted on the page: an undo step, searched with in other photos, and exported."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.page.time_line import time_line
from poseviewer.app.state.edits import undo
from poseviewer.app.state.frame_edits import edit_frames
from poseviewer.app.state.objects import unpaint
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import export
from poseviewer.app.workers.tasks import paint_active
from poseviewer.app.workers.tracking import track_edits
from poseviewer.errors import SettingsError
from poseviewer.files.mesh.load import load_mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.scene.assets import ModelFile
from poseviewer.scene.sequence import show_frame
from tests.app.sequences import COUNT, MESH, make_sequence, true_pose
from tests.app.state.documents import after


def keyed() -> Session:
    """A key in the first frame, and a model without colours."""
    grey = replace(MESH, colours=np.full_like(MESH.colours, 0.6))
    document = make_sequence().with_object(model=ModelFile.of(grey, name="m.ply"))
    return Session(document).with_document(document.at_pose(true_pose(0)))


def painted(session: Session) -> Session:
    result = paint_active().run(session, Path(), lambda *_: None)
    assert "of the surface is painted, from 1 photo." in result.notes[0]
    return after(session, *result.edits)


def test_painting_is_a_step_that_is_undone_or_taken_away():
    before = keyed()
    session = painted(before)
    item = session.document.object
    assert item.painting is not None
    assert item.painting.photos == ("0000.png",)
    assert item.drawn_mesh is item.painting.mesh
    assert item.mesh is before.document.mesh
    assert session.drawn != before.drawn  # it is drawn anew
    assert "painted from 0000.png" in time_line(session)
    assert "painted" not in time_line(before)
    assert after(session, undo()).document.object.painting is None
    bare = after(session, unpaint())
    assert bare.document.object.painting is None
    assert after(bare, unpaint()) is bare
    assert after(bare, undo()).document.object.painting is item.painting


def test_a_photo_does_not_confirm_its_own_paint():
    session = painted(keyed())
    scene, mesh = session.document.scene, session.document.mesh
    assert scene.compared_mesh(0) is mesh
    assert show_frame(scene, 1).compared_mesh(0) is session.document.object.compared_mesh


def test_paint_is_kept_where_parts_are_not_others():
    session = painted(keyed())
    other = session.document.with_object(model=ModelFile.of(MESH, name="other.ply"))
    assert other.object.drawn_mesh is MESH


@pytest.mark.slow
@pytest.mark.long
def test_a_sequence_is_propagated_with_the_paint_of_its_key():
    session = after(painted(keyed()), edit_frames("to end"))
    assert session.propagation is not None
    for edit in track_edits(session.propagation.request):
        session = after(session, edit)
    for index, frame in enumerate(session.document.scene.frames):
        pose = session.document.scene.views[0].pose(frame.poses["1"].world_from_model)
        assert pose_error(MESH, pose, true_pose(index)).percent < 2.0
    assert len(session.document.scene.frames) == COUNT


def test_a_painted_model_is_exported(tmp_path: Path):
    session = painted(keyed())
    ((name, data),) = export("painted", session).items()
    assert name == "0000.m.painted.glb"
    (tmp_path / name).write_bytes(data)
    found = load_mesh(tmp_path / name)
    np.testing.assert_allclose(found.bounds, MESH.bounds, atol=1e-5)
    with pytest.raises(SettingsError, match="paint it in the step Judge"):
        export("painted", after(session, unpaint()))


def test_a_model_that_is_not_placed_is_not_painted():
    session = keyed()
    document = session.document.with_object(is_placed=False)
    with pytest.raises(SettingsError, match="Place the model first"):
        paint_active().run(replace(session, document=document), Path(), lambda *_: None)
