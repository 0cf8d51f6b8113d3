"""Small pictures with outlines: the strip of several photos, and the row of proposed starts."""

from dataclasses import replace
from functools import lru_cache
from html import escape

import numpy as np

from poseviewer.app.below_viser.client_script import ClientScript
from poseviewer.app.page.above_steps import ICONS, object_colour
from poseviewer.app.page.controls import jpeg_url, on_press, percent
from poseviewer.app.page.handles import path_of
from poseviewer.app.page.time_line import time_line
from poseviewer.app.state.session import Session
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import size_at_scale
from poseviewer.geometry.image import Photo
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.overlay.styles import LINE_COLOUR
from poseviewer.scene.types import SceneObject

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
    photos = tuple(view.photo for view in session.document.scene.views)
    photos = photos if len(photos) > 1 else ()
    script.show("setPictures", _small_pictures(photos))
    cells = "".join(_cell(session, index) for index in range(len(photos)))
    script.show("setStrip", cells or time_line(session))


@lru_cache(maxsize=1)
def _small_pictures(photos: tuple[Photo, ...]) -> list[str]:
    return list(map(_small_picture, photos))


def _small_picture(photo: Photo) -> str:
    factor = min(1.0, THUMBNAIL / max(photo.width, photo.height))
    size = size_at_scale(photo.width, photo.height, factor)
    return jpeg_url(photo.as_rgb8(*size)[..., ::-1], QUALITY)


def _cell(session: Session, index: int) -> str:
    """HTML of a photo in the strip; a press makes it the large one."""
    document = session.document
    view, is_compared = document.scene.views[index], document.object.in_views[index].is_compared
    at = " pv-at" if index == document.view_index else ""
    hint = "do not compare it" if is_compared else "compare it again"
    said = " · ".join(
        filter(None, (_loss_text(session, index), _verdict_text(document.object, index)))
    )
    return (
        f'<div class="pv-photo{at}{"" if is_compared else " pv-off"}" tabindex="0" '
        f'title="{"the large photo" if at else "press: make it the large one"}" '
        f"{on_press('photo', view_index=index)}>"
        f'<div class="pv-small" style="aspect-ratio:{view.photo.width}/{view.photo.height}">'
        f'<svg viewBox="0 0 {UNITS} {UNITS}" preserveAspectRatio="none">'
        f"{_outlines(session, index)}</svg></div>"
        f'<div class="pv-said"><button type="button" title="{hint}" '
        f"{on_press('compare photo', view_index=index, on=not is_compared)}>"
        f'<svg viewBox="0 0 16 16">{ICONS["eye"]}</svg></button>'
        f"<b>{escape(view.name)}</b><span>{escape(said)}</span></div></div>"
    )


def proposals_row(session: Session) -> str:
    """HTML of the proposed starts with their odds, each a piece of the photo; a press takes it."""
    proposals = session.proposals
    if proposals is None or not proposals.starts:
        return ""
    photo, cells = session.document.photo, ""
    for index, (start, lines) in enumerate(zip(proposals.starts, proposals.outlines, strict=True)):
        url, part = _piece(photo, lines)
        left, top, width, height = part
        at = ' class="pv-at"' if index == proposals.index else ""
        probability = percent(min(start.probability, MAX_PROBABILITY))
        cells += (
            f'<button type="button"{at} title="proposal {index + 1}: press to start from it" '
            f'{on_press("start", index=index)}><svg viewBox="{left} {top} {width} {height}">'
            f'<image href="{url}" x="{left}" y="{top}" width="{width}" height="{height}"/>'
            f"{_outline(path_of(lines), LINE_COLOUR)}</svg>{probability}</button>"
        )
    return f'<div class="pv-starts">{cells}</div>'


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


def _outline(path: str, colour: tuple[int, int, int]) -> str:
    return f'<path class="pv-halo" d="{path}"/><path stroke="rgb{colour}" d="{path}"/>'


def _outlines(session: Session, index: int) -> str:
    """SVG of the objects' outlines over a small picture."""
    outlines, drawn = session.results.outlines, ""
    is_hidden = session.display.photo_alone or session.display.style == "none"
    if is_hidden or outlines is None or index >= len(outlines.small):
        return ""
    for number, lines in outlines.small[index].items():
        drawn += _outline(path_of(UNITS * lines), object_colour(number))
    return drawn


def _loss_text(session: Session, index: int) -> str:
    """Say what a photo leaves unexplained at the current pose, or why that is not known."""
    losses = session.results.losses
    if not session.document.object.in_views[index].is_compared:
        return "not compared"
    if (
        session.is_searching
        or not session.document.object.is_placed
        or losses is None
        or not losses.by_view
    ):
        return ""
    result = losses.by_view.get(index)
    return "not seen" if result is None else f"{result.scale.as_shown(result.loss):.3f}"


def _verdict_text(scene_object: SceneObject, index: int) -> str:
    """The verdict by a view alone on an object's pose; "": there is none."""
    result = scene_object.result
    if result is None or result.verdict is None:
        return ""
    compared = {i for i, share in enumerate(result.seen) if share is not None} - {result.view}
    verdicts = zip((result.view, *sorted(compared)), result.verdict.views, strict=False)
    return {i: verdict.label for i, verdict in verdicts}.get(index, "")
