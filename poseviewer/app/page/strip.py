"""The strip of a set's photos, below the large one: small pictures with the model's outline, what
each says of the pose, and whether it is compared.
"""

from __future__ import annotations

import base64
from typing import Any

import cv2
import numpy as np

from poseviewer.app.below_viser.client_script import ClientScript
from poseviewer.app.state.photo_set import PhotoSet
from poseviewer.app.state.session import Session
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.view_set import View

THUMBNAIL = 240
"""Pixels of a small picture's longer side."""
UNITS = 1000
"""Units of the outline over a small picture, along each side."""
QUALITY = 80
"""JPEG quality of the small pictures."""


class PhotoStrip:
    """Brings the strip on all pages to the session."""

    def __init__(self, script: ClientScript) -> None:
        self._script = script
        self._photos: object = None

    def show(self, session: Session) -> None:
        """Bring it to the session; what has not changed is not sent."""
        views = session.document.views
        photos = None if views is None else views.views
        if photos is not self._photos:
            self._photos = photos
            small = [] if views is None else list(map(_small, views.views.views))
            self._script.show("setStrip", small)
            self._script.show("setStripRows", [])
        if views is not None:
            rows = [_row(session, views, index) for index in range(len(views.own))]
            self._script.show("setStripRows", rows)


def _small(view: View) -> dict[str, Any]:
    photo = view.photo
    factor = min(1.0, THUMBNAIL / max(photo.width, photo.height))
    width, height = (max(1, round(side * factor)) for side in (photo.width, photo.height))
    pixels = photo.as_rgb8(width, height)[..., ::-1]
    data = np.asarray(cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1])
    picture = f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode()}"
    return {"name": view.name, "picture": picture, "width": width, "height": height}


def _row(session: Session, views: PhotoSet, index: int) -> dict[str, Any]:
    strip, drawn = session.strip, ""
    is_shown = not session.look.hidden and session.look.name != "none"
    if is_shown and strip is not None and index < len(strip.lines):
        drawn = outline_path(strip.lines[index])
    return {
        "large": index == views.at,
        "off": not views.compared[index],
        "said": said_of(session, views, index),
        "word": word_of(session, views, index),
        "path": drawn,
    }


def outline_path(lines: FloatArray) -> str:
    """SVG, of line segments (N, 2, 2) in shares of the picture."""
    whole = np.rint(lines * UNITS).astype(int).tolist()
    return "".join(f"M{a} {b}L{c} {d}" for (a, b), (c, d) in whole)


def said_of(session: Session, views: PhotoSet, index: int) -> str:
    """Say what a photo leaves unexplained at the pose at hand, or why that is not known."""
    if not views.compared[index]:
        return "not compared"
    overlay = session.overlay
    if session.searching or overlay is None or not overlay.of_photos:
        return ""
    found = overlay.of_photos.get(index)
    return "not seen" if found is None else f"{found.scale.shown(found.loss):.3f}"


def word_of(session: Session, views: PhotoSet, index: int) -> str:
    """The verdict by a photo alone on the pose at hand; "": there is none."""
    end = session.document.own_of_photos[index].end
    return end.alone if end is not None and end.record.pose is views.poses[index] else ""
