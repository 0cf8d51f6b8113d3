"""What the panel says of a session."""

from __future__ import annotations

from poseviewer.app.page.panels import focal_note
from poseviewer.app.workers.exporting import record_of
from tests.app.state.documents import PERSPECTIVE, make_photo, make_session


def test_a_focal_length_that_is_a_guess_is_said_in_the_panel_and_in_the_file():
    assumed = make_photo().default_camera()
    for camera, guessed in ((assumed, True), (PERSPECTIVE, False)):
        session = make_session(camera)
        assert ("is assumed" in focal_note(session)) == guessed
        assert any("is assumed" in note for note in record_of(session).notes) == guessed
