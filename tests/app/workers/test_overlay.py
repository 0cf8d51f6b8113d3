"""The model drawn over the photo, among others, and outlines in the strip of a set."""

from contextlib import closing

import cv2
import numpy as np
import pytest

from poseviewer.app.state.document import Document
from poseviewer.app.state.objects import add_object
from poseviewer.app.state.pose_edits import make_start
from poseviewer.app.state.results import Outlines
from poseviewer.app.state.session import Display, Session
from poseviewer.app.workers.exporting import export
from poseviewer.app.workers.outlines import outlining
from poseviewer.app.workers.overlay import OverlayDrawer
from poseviewer.fit.visibility import visibility
from poseviewer.render.software.software_renderer import SoftwareRenderer
from tests import view_sets
from tests.app.state.documents import after
from tests.app.state.sets import document_of, make_set_session
from tests.several import MESHES, TRUTH


def ball_behind_box() -> Document:
    return document_of([one.pose for one in TRUTH[:2]])


@pytest.mark.parametrize("look", ["solid", "relit", "residual", "normals"])
def test_no_look_draws_what_is_behind_another(look: str):
    document = ball_behind_box()
    own = document
    request = Session(document, display=Display(look))
    overlay = OverlayDrawer(SoftwareRenderer(MESHES[0])).draw(request)
    assert overlay.picture is not None
    seen = visibility(TRUTH[:2])
    behind = seen.silhouettes[0] & ~seen.mask(0)
    assert np.count_nonzero(behind) > 200
    photo = own.photo.as_rgb8(own.photo.width, own.photo.height)
    assert np.array_equal(overlay.picture[behind], photo[behind])
    shown = seen.mask(0)
    assert np.mean(np.abs(overlay.picture[shown].astype(int) - photo[shown])) > 2.0


def test_the_picture_that_is_sent_does_not_either():
    document = ball_behind_box()
    session = Session(document)
    (data,) = export("overlay", session).values()
    picture = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR))
    seen = visibility(TRUTH[:2])
    photo = document.photo.as_rgb8(320, 240)
    # Well inside: an outline is wider than a pixel.
    behind = cv2.erode((seen.silhouettes[0] & ~seen.mask(0)).astype(np.uint8), np.ones((9, 9))) > 0
    assert behind.any()
    assert np.array_equal(picture[behind][:, ::-1], photo[behind])


def drawn_in(session: Session) -> Outlines:
    """The objects in all photos, as the worker draws it."""
    with closing(outlining()) as worker:
        worker.follow(session)
        (edit,) = worker.mailbox.take(60.0)
        outlines = edit(session).results.outlines
        assert outlines is not None
        return outlines


def test_all_objects_are_drawn_in_all_photos():
    session = after(make_set_session(), add_object(), make_start())
    for pose, drawn in zip(view_sets.TRUTH, drawn_in(session).small, strict=True):
        assert set(drawn) == {1, 2}
        assert len(drawn[2])
        lines = drawn[1]
        seen = pose.project(view_sets.MESH.vertices) / np.array(
            [pose.camera.width, pose.camera.height]
        )
        np.testing.assert_allclose(lines.min((0, 1)), seen.min(axis=0), atol=0.02)
        np.testing.assert_allclose(lines.max((0, 1)), seen.max(axis=0), atol=0.02)
