"""SVG over the photo, in its px: region, box, pins, and marks of a quick start."""

from collections.abc import Iterator
from contextlib import suppress

import cv2
import htpy as h
import numpy as np

from poseviewer.app.page.controls import as_html, jpeg_url, on_press
from poseviewer.app.page.measure_panel import distance_text
from poseviewer.app.state.document import MARKING, is_shown, label_of
from poseviewer.app.state.dragging import pins_in_photo
from poseviewer.app.state.hiding import HIDING
from poseviewer.app.state.marking import marks_in_photo
from poseviewer.app.state.session import Session
from poseviewer.errors import QuickStartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.vehicle.chart import VehicleChart

PIN_COLOURS = ("#ffb03b", "#78e66e", "#ff6ec8")
PIN_LABELS = (("rear wheel", -4), ("front wheel", -4), ("axle", 16))
"""Text of each pin's label, and its base line, px below the pin."""
LINK_COLOUR = "#e6e6e6"
REGION_COLOUR = "#ffe278"
BOX_COLOUR = "#96ffa0"
OTHER_END_COLOUR = "#ff78dc"
PROPOSED_COLOUR = "#ffd166"
"""Colour of the likeliest proposal, for a model that is placed nowhere yet."""
QUALITY = 85
"""JPEG quality of the model alone."""
MARK_COLOUR = "#ffe246"
"""Colour of a mark on the photo."""
MODEL_MARK_COLOUR = "#ff78dc"
"""Colour of the model's point that belongs to a mark."""
PIN = h.circle(r="11"), h.path(d="M4 0H16M-4 0H-16M0 4V16M0-4V-16")
CROSS = h.path(d="M2 0H8M-2 0H-8M0 2V8M0-2V-8")
"""SVG of a mark on the photo, px of the screen about its place."""
DIAMOND = h.path(d="M5 0L0 5L-5 0L0-5Z")
"""SVG of a point of the model, px of the screen about its place."""


def handles_of(session: Session) -> str:
    """SVG of all handles, those on top of the others last."""
    document, alone = session.document, session.display.photo_alone
    proposals, is_placed = session.proposals, document.object.is_placed
    proposed = proposals.outlines[:1] if proposals and not is_placed else ()
    drawn = [
        _rectangle(document.in_view.region, REGION_COLOUR),
        _rectangle(session.shown_box, BOX_COLOUR),
        *(_lines(lines, OTHER_END_COLOUR) for lines in session.other_outlines if not alone),
        *(_lines(lines, PROPOSED_COLOUR) for lines in proposed if not alone),
    ]
    if session.tool in MARKING:
        drawn += () if alone else _marks(session)
    elif session.tool == "measure":
        drawn += () if alone else _measurement(session)
    elif session.tool not in HIDING and not alone and is_shown(document.object):
        drawn += _pins(session)
    return as_html(drawn)


def _pins(session: Session) -> Iterator[h.Node]:
    """The pins of the pose at hand; a vehicle's have names."""
    document = session.document
    pins = pins_in_photo(document)
    has_names = isinstance(document.chart, VehicleChart) and not document.state.pins
    if has_names:
        yield _lines(pins[[[0, 1], [0, 2]]], LINK_COLOUR)
    for pin, colour in zip(pins, PIN_COLOURS, strict=False):
        yield _at(pin, PIN, colour, "pv-pin")
    for pin, (text, below) in zip(pins, PIN_LABELS if has_names else (), strict=False):
        yield _at(pin, h.text(x="4", y=below)[text])


def _marks(session: Session) -> Iterator[h.Node]:
    """Crosses at the clicks, diamonds at the model's points, lines between, and wheels."""
    marks, pose = session.document.marks, session.document.pose
    photo = marks_in_photo(marks, session.tool)
    if session.tool == "wheels":
        with suppress(QuickStartError):
            for ellipse in marks.ellipses:
                rim = ellipse.outline()
                yield _lines(np.stack([rim, np.roll(rim, -1, axis=0)], axis=1), MARK_COLOUR)
        hubs = () if session.document.model.keypoints is not None else marks.hubs
        model = pose.project(np.array(hubs).reshape(-1, 3))
    else:
        model = pose.project(np.array(marks.points).reshape(-1, 3))
    if not session.document.object.is_placed:
        model = np.full_like(model, np.nan)  # it is not drawn
    if session.tool == "pairs":
        yield _lines(np.stack([photo, model[: len(photo)]], axis=1), MODEL_MARK_COLOUR)
    for place in photo:
        yield _at(place, CROSS, MARK_COLOUR)
    for i, place in enumerate(model):
        yield _at(place, DIAMOND, MODEL_MARK_COLOUR)
        if i < len(photo):
            yield _at(photo[i], h.text(x="4", y="-4")[i + 1])


def _measurement(session: Session) -> Iterator[h.Node]:
    """Numbered crosses at the measured pixels, a line between two, and their distance."""
    pixels = session.measurement_pixels
    for number, pixel in enumerate(pixels, 1):
        yield _at(pixel, (CROSS, h.text(x="6", y="-6")[number]), MARK_COLOUR)
    if len(pixels) > 1:
        yield _lines(np.array([pixels]), MARK_COLOUR)
        label = h.text(y="22", text_anchor="middle")[distance_text(session)]
        yield _at(np.mean(pixels, axis=0), label)


def model_html(session: Session) -> str:
    """The model alone with the points that are marked on it (HTML): a press marks one, a drag
    turns it.
    """
    if session.results.alone is None or not session.shows_model:
        return ""
    (pose, pixels), marks = session.results.alone, session.document.marks
    height, width = pixels.shape[:2]
    url = jpeg_url(pixels[..., ::-1], QUALITY)
    drawn = [h.image(href=url, width="100%", height="100%")]
    for number, place in enumerate(marks.hubs if session.tool == "wheels" else marks.points, 1):
        x, y = pose.project(place)
        at = {"transform": f"translate({x:.1f} {y:.1f})"}
        drawn.append(h.g(at, stroke=MODEL_MARK_COLOUR)[DIAMOND])
        drawn.append(h.g(at)[h.text(x="8", y="-8")[number]])
    box = {"viewBox": f"0 0 {width} {height}", "data-turns": "turn model"}
    return as_html(h.div(".pv-model")[h.svg(box, on_press("mark model"))[drawn]])


def model_card(session: Session) -> str:
    """The model beside its name, small (HTML); "" once it is placed."""
    item, alone = session.document.object, session.results.alone
    if item.is_placed:
        return ""
    drawn = None
    if alone is not None:
        small = np.asarray(cv2.resize(alone[1], None, fx=0.25, fy=0.25), np.uint8)
        drawn = h.img(src=jpeg_url(small[..., ::-1], QUALITY), alt="")
    return as_html(h.div(".pv-card")[drawn, h.b[label_of(item)]])


def _rectangle(rectangle: Rectangle | None, colour: str) -> h.Node:
    if rectangle is None:
        return None
    left, top, width, height = rectangle
    path = f"M{left:.2f} {top:.2f}h{width:.2f}v{height:.2f}h{-width:.2f}Z"
    return h.path(".pv-line", stroke=colour, d=path)


def _lines(lines: FloatArray, colour: str) -> h.Element:
    """Lines (n, 2, 2); those of which an end is nowhere are left out."""
    path = path_of(lines[np.isfinite(lines).all(axis=(1, 2))])
    return h.path(".pv-line", stroke=colour, d=path)


def path_of(lines: FloatArray) -> str:
    """SVG of line segments (n, 2, 2)."""
    return "".join(f"M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}" for (a, b), (c, d) in lines.tolist())


def _at(place: FloatArray, drawing: h.Node, colour: str = "none", name: str = "") -> h.Node:
    """A drawing in px of the screen about a place (2,); None for one that is nowhere."""
    if not np.isfinite(place).all():
        return None
    x, y = place
    at = h.g(class_=name, transform=f"translate({x:.2f} {y:.2f})", stroke=colour)
    return at[h.g(".pv-px")[drawing]]
