"""The strip of several photos, below the large one: small pictures with the objects' outlines, what
each says of the active object's pose, and whether it is compared.
"""

from __future__ import annotations

import base64
import math
from typing import Any

import cv2
import numpy as np

from poseviewer.app.below_viser.client_script import ClientScript
from poseviewer.app.page.above_steps import object_colour
from poseviewer.app.state.session import Session
from poseviewer.fit.scene import SceneObject
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.view import View
from poseviewer.render.overlay.looks import LINE_COLOUR

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
        views = session.document.scene.views
        photos = [view.photo for view in views]
        if photos != self._photos:
            self._photos = photos
            self._script.show("setStrip", list(map(_small, views)) if len(views) > 1 else [])
            self._script.show("setStripRows", [])
        if len(views) > 1:
            rows = [_row(session, index) for index in range(len(views))]
            self._script.show("setStripRows", rows)


def _small(view: View) -> dict[str, Any]:
    photo = view.photo
    factor = min(1.0, THUMBNAIL / max(photo.width, photo.height))
    width, height = (max(1, round(side * factor)) for side in (photo.width, photo.height))
    pixels = photo.as_rgb8(width, height)[..., ::-1]
    data = np.asarray(cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1])
    picture = f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode()}"
    return {"name": view.name, "picture": picture, "width": width, "height": height}


def _row(session: Session, index: int) -> dict[str, Any]:
    outlines, own, paths = session.outlines, session.document, []
    is_shown = not session.look.hidden and session.look.name != "none"
    if is_shown and outlines is not None and index < len(outlines.small):
        for number, lines in outlines.small[index].items():
            colour = LINE_COLOUR if number == own.number else object_colour(number)
            paths.append([outline_path(lines), f"rgb{colour}"])
    return {
        "large": index == own.at,
        "off": not own.object.in_views[index].is_compared,
        "said": said_of(session, index),
        "word": word_of(own.object, index),
        "paths": paths,
    }


def outline_path(lines: FloatArray) -> str:
    """SVG, of line segments (N, 2, 2) in shares of the picture."""
    whole = np.rint(lines * UNITS).astype(int).tolist()
    return "".join(f"M{a} {b}L{c} {d}" for (a, b), (c, d) in whole)


def said_of(session: Session, index: int) -> str:
    """Say what a photo leaves unexplained at the pose at hand, or why that is not known."""
    if not session.document.object.in_views[index].is_compared:
        return "not compared"
    overlay = session.overlay
    if session.searching or overlay is None or not overlay.losses.of_views:
        return ""
    found = overlay.losses.of_views.get(index)
    return "not seen" if found is None else f"{found.scale.shown(found.loss):.3f}"


def word_of(one: SceneObject, index: int) -> str:
    """The verdict by a view alone on an object's pose; "": there is none."""
    result = one.result
    if result is None or result.verdict is None or not result.verdict.views:
        return ""
    compared = [i for i, seen in enumerate(result.seen) if not math.isnan(seen)]
    order = sorted(compared, key=lambda i: (i != result.view, i))
    return result.verdict.views[order.index(index)].word if index in order else ""
