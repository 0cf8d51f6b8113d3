"""The measuring tool: pixels are kept, and surface points follow from the poses."""

from dataclasses import replace

import numpy as np

from poseviewer.app.state.edits import Px, edit
from poseviewer.app.state.session import Session
from poseviewer.errors import QuickStartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.starts.measuring import measure_point


@edit
def toggle_measuring(session: Session) -> Session:
    """Take the measuring tool, with no points yet, or leave it."""
    return replace(session, tool="pose" if session.tool == "measure" else "measure", measured=())


@edit
def press_point(session: Session, x: Px, y: Px) -> Session:
    """Measure the surface at a point of the photo, and its distance from the point before."""
    document, pixel = session.document, np.array([x, y])
    if measure_point(document.scene, pixel, document.view_index) is None:
        raise QuickStartError("There is no model there to measure; press a point of one.")
    before = measurement_pixels(session)
    pixels = (*before, pixel) if len(before) == 1 else (pixel,)
    return replace(session, measured=tuple((document.photo, p) for p in pixels))


def measurement_pixels(session: Session) -> tuple[FloatArray, ...]:
    """Pixels (2,) that the measuring tool, if it is in use, has pressed in the large photo."""
    if session.tool != "measure":
        return ()
    return tuple(pixel for photo, pixel in session.measured if photo is session.document.photo)
