"""Small pictures with outlines: the strip of several photos, and the row of proposed starts."""

from dataclasses import replace
from functools import lru_cache

import htpy as h
import numpy as np

from poseviewer.app.below_viser.client_script import ClientScript
from poseviewer.app.page.above_steps import ICONS, object_colour
from poseviewer.app.page.controls import as_html, jpeg_url, on_press
from poseviewer.app.page.handles import path_of
from poseviewer.app.page.time_line import frame_times, said_of_view, time_line
from poseviewer.app.state.session import Session
from poseviewer.errors import percent
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import size_at_scale
from poseviewer.geometry.image import Photo
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.overlay.styles import LINE_COLOUR

THUMBNAIL = 240
"""Pixels of a small picture's longer side."""
UNITS = 1000
"""Units of the outline over a small picture, along each side."""
BESIDE = 0.3
"""Share of an outline's sides by which more of the photo is shown about it."""
MAX_PROBABILITY = 0.99
"""Largest probability that is shown: no start is certain."""
QUALITY = 80
"""JPEG quality of the small pictures."""


def show_strip(script: ClientScript, session: Session) -> None:
    """Bring the strip, or the time line, on all pages to the session, where it has changed."""
    views = session.document.scene.views
    is_strip = len(views) > 1 and not session.document.stepped
    photos = tuple(view.photo for view in views) if is_strip else ()
    script.show("setPictures", _small_pictures(photos))
    cells = as_html(_cell(session, index) for index in range(len(photos)))
    script.show("setTimes", frame_times(session.document.scene.frames))
    script.show("setStrip", cells or time_line(session))


@lru_cache(maxsize=1)
def _small_pictures(photos: tuple[Photo, ...]) -> list[str]:
    return list(map(_small_picture, photos))


def _small_picture(photo: Photo) -> str:
    factor = min(1.0, THUMBNAIL / max(photo.width, photo.height))
    size = size_at_scale(photo.width, photo.height, factor)
    return jpeg_url(photo.as_rgb8(*size)[..., ::-1], QUALITY)


def _cell(session: Session, index: int) -> h.Element:
    """A photo in the strip; a press makes it the large one."""
    document = session.document
    view, is_compared = document.scene.views[index], document.object.in_views[index].is_compared
    is_large = index == document.view_index
    hint = "do not compare it" if is_compared else "compare it again"
    compare = on_press("compare photo", view_index=index, on=not is_compared)
    names = ["pv-photo", {"pv-at": is_large, "pv-off": not is_compared}]
    title = "the large photo" if is_large else "press: make it the large one"
    shape = f"aspect-ratio:{view.photo.width}/{view.photo.height}"
    box = h.svg(viewBox=f"0 0 {UNITS} {UNITS}", preserveAspectRatio="none")
    eye = h.button(compare, type="button", title=hint)[ICONS["eye"]]
    return h.div(on_press("photo", view_index=index), class_=names, tabindex="0", title=title)[
        h.div(".pv-small", style=shape)[box[_outlines(session, index)]],
        h.div(".pv-said")[eye, h.b[view.name], h.span[said_of_view(session, index)]],
    ]


def proposals_row(session: Session) -> str:
    """HTML of the proposed starts with their odds, each a piece of the photo; a press takes it."""
    proposals = session.proposals
    if proposals is None or not proposals.starts:
        return ""
    photo, cells = session.document.photo, list[h.Element]()
    for index, (start, lines) in enumerate(zip(proposals.starts, proposals.outlines, strict=True)):
        url, part = _piece(photo, lines)
        left, top, width, height = map(str, part)
        at, press = {"pv-at": index == proposals.index}, on_press("start", index=index)
        title = f"proposal {index + 1}: press to start from it"
        picture = h.svg(viewBox=f"{left} {top} {width} {height}")[
            h.image(href=url, x=left, y=top, width=width, height=height),
            _outline(path_of(lines), LINE_COLOUR),
        ]
        probability = percent(min(start.probability, MAX_PROBABILITY))
        button = h.button(press, type="button", class_=at, title=title)
        cells.append(button[picture, probability])
    return as_html(h.div(".pv-starts")[cells])


def _piece(photo: Photo, outline: FloatArray) -> tuple[str, Rectangle]:
    """URL and place of the part of the photo about an outline (n, 2, 2); else of all of it."""
    whole = Rectangle(0, 0, photo.width, photo.height)
    part = whole
    if outline.size:
        about = Rectangle.from_corners(outline.min(axis=(0, 1)), outline.max(axis=(0, 1)))
        part = about.expand(BESIDE).intersection(whole)
    left, top, right, bottom = map(int, (part.left, part.top, part.right, part.bottom))
    pixels = np.ascontiguousarray(photo.pixels[top : bottom + 1, left : right + 1])
    url = _small_picture(replace(photo, pixels=pixels))
    return url, Rectangle(left, top, pixels.shape[1], pixels.shape[0])


def _outline(path: str, colour: tuple[int, int, int]) -> h.Node:
    return h.path(".pv-halo", d=path), h.path(stroke=f"rgb{colour}", d=path)


def _outlines(session: Session, index: int) -> h.Node:
    """The objects' outlines over a small picture."""
    outlines = session.results.outlines
    is_hidden = session.display.photo_alone or session.display.style == "none"
    if is_hidden or outlines is None or index >= len(outlines.small):
        return None
    drawn = outlines.small[index].items()
    return [_outline(path_of(UNITS * lines), object_colour(number)) for number, lines in drawn]
