"""The model drawn over the photo, among others."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from poseviewer.app.state.document import Document, SceneObject
from poseviewer.app.state.session import OverlayRequest, Session
from poseviewer.app.workers.exporting import export
from poseviewer.app.workers.overlay import OverlayDrawer
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.fit.visibility import visibility
from poseviewer.render.software.renderer import SoftwareRenderer
from tests.several import MESHES, TRUTH, make_photo


def ball_behind_box() -> Document:
    photo = make_photo()
    ball, box = (
        SceneObject(
            Registration(photo, one.mesh, "m.ply", str(n) * 64, None, one.pose, ()),
            one.pose,
            FitSettings(),
            number=n,
        )
        for n, one in enumerate(TRUTH[:2], 1)
    )
    return Document.of(ball, None, (box,))


@pytest.mark.parametrize("look", ["solid", "relit", "residual", "normals"])
def test_no_look_draws_what_is_behind_another(look: str):
    document = ball_behind_box()
    own = document.registration
    request = OverlayRequest(own, document.settings, document.pose, document.pose, look)
    (overlay,) = OverlayDrawer(SoftwareRenderer(MESHES[0])).draw(request)
    assert overlay.picture is not None
    seen = visibility(TRUTH[:2])
    behind = seen.drawn[0] & ~seen.seen(0)
    assert np.count_nonzero(behind) > 200
    photo = own.photo.as_rgb8(own.photo.width, own.photo.height)
    assert np.array_equal(overlay.picture[behind], photo[behind])
    shown = seen.seen(0)
    assert np.mean(np.abs(overlay.picture[shown].astype(int) - photo[shown])) > 2.0


def test_the_picture_that_is_sent_does_not_either():
    document = ball_behind_box()
    session = Session(document)
    (data,) = export("overlay", session).values()
    picture = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR))
    seen = visibility(TRUTH[:2])
    photo = document.registration.photo.as_rgb8(320, 240)
    # Well inside: an outline is wider than a pixel.
    behind = cv2.erode((seen.drawn[0] & ~seen.seen(0)).astype(np.uint8), np.ones((9, 9))) > 0
    assert behind.any()
    assert np.array_equal(picture[behind][:, ::-1], photo[behind])
