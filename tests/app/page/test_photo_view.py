"""What lies over the photo: colours of the objects' outlines."""

import numpy as np

from poseviewer.app.page.above_steps import objects_list
from poseviewer.app.page.photo_view import OUTLINE_NAME, _model, _other_objects
from poseviewer.app.state.edits import set_fields
from poseviewer.app.state.objects import add_object, pick_object
from poseviewer.app.state.pose_edits import nudge
from poseviewer.app.state.results import Outlines, Overlay
from poseviewer.app.state.session import Session
from tests.app.state.documents import after, make_session

LINES = np.zeros((1, 2, 2))


def colours_of(session: Session) -> dict[int, tuple[int, int, int]]:
    """Colours of the outlines by the objects' ids."""
    drawn = Overlay(session.document, session.drawn, LINES)
    other = {int(item.id): LINES for item in session.document.scene.objects}
    session = after(session, set_fields("results", overlay=drawn, outlines=Outlines(other)))
    by_name = {drawing.name: drawing.colour for drawing in _other_objects(session)}
    found = {int(n.split("/")[2]): c for n, c in by_name.items() if n.endswith("outline")}
    own = {drawing.name: drawing.colour for drawing in _model(session)}
    return found | {session.document.object_id: own[OUTLINE_NAME]}


def test_objects_keep_their_colours_whichever_is_picked():
    session = after(make_session(), add_object(), nudge("move", 9.0), pick_object(1))
    first, second = colours_of(session), colours_of(after(session, pick_object(2)))
    assert set(first) == {1, 2}
    assert first == second
    assert len(set(first.values())) == 2
    for picked in (session, after(session, pick_object(2))):
        assert all(f"background:rgb{colour}" in objects_list(picked) for colour in first.values())
