"""The strip of several photos, below the large one: small pictures with the objects' outlines, what
each says of the active object's pose, and whether it is compared.
"""

from functools import lru_cache
from html import escape

from poseviewer.app.below_viser.client_script import ClientScript
from poseviewer.app.page.above_steps import ICONS, object_colour
from poseviewer.app.page.controls import jpeg_url, on_press
from poseviewer.app.page.handles import path_of
from poseviewer.app.state.session import Session
from poseviewer.files.photo import Photo
from poseviewer.fit.scene import SceneObject
from poseviewer.geometry.camera import scaled_size
from poseviewer.render.overlay.looks import LINE_COLOUR

THUMBNAIL = 240
"""Pixels of a small picture's longer side."""
UNITS = 1000
"""Units of the outline over a small picture, along each side."""
QUALITY = 80
"""JPEG quality of the small pictures."""


def show_strip(script: ClientScript, session: Session) -> None:
    """Bring the strip on all pages to the session; what has not changed is not sent."""
    photos = tuple(view.photo for view in session.document.scene.views)
    photos = photos if len(photos) > 1 else ()
    script.show("setPictures", _small_pictures(photos))
    script.show("setStrip", "".join(_cell(session, index) for index in range(len(photos))))


@lru_cache(maxsize=1)
def _small_pictures(photos: tuple[Photo, ...]) -> list[str]:
    return list(map(_small_picture, photos))


def _small_picture(photo: Photo) -> str:
    factor = min(1.0, THUMBNAIL / max(photo.width, photo.height))
    size = scaled_size(photo.width, photo.height, factor)
    return jpeg_url(photo.as_rgb8(*size)[..., ::-1], QUALITY)


def _cell(session: Session, index: int) -> str:
    """HTML of a photo in the strip; a press makes it the large one."""
    document = session.document
    view, is_compared = document.scene.views[index], document.object.in_views[index].is_compared
    at = " pv-at" if index == document.at else ""
    hint = "do not compare it" if is_compared else "compare it again"
    said = " · ".join(filter(None, (said_of(session, index), word_of(document.object, index))))
    return (
        f'<div class="pv-photo{at}{"" if is_compared else " pv-off"}" tabindex="0" '
        f'title="{"the large photo" if at else "press: make it the large one"}" '
        f"{on_press('photo', index=index)}>"
        f'<div class="pv-small" style="aspect-ratio:{view.photo.width}/{view.photo.height}">'
        f'<svg viewBox="0 0 {UNITS} {UNITS}" preserveAspectRatio="none">'
        f"{_outlines(session, index)}</svg></div>"
        f'<div class="pv-said"><button type="button" title="{hint}" '
        f"{on_press('compare photo', index=index, on=not is_compared)}>"
        f'<svg viewBox="0 0 16 16">{ICONS["eye"]}</svg></button>'
        f"<b>{escape(view.name)}</b><span>{escape(said)}</span></div></div>"
    )


def _outlines(session: Session, index: int) -> str:
    """SVG of the objects' outlines over a small picture."""
    outlines, drawn = session.outlines, ""
    is_hidden = session.photo_alone or session.look == "none"
    if is_hidden or outlines is None or index >= len(outlines.small):
        return ""
    for number, lines in outlines.small[index].items():
        colour = LINE_COLOUR if number == session.document.number else object_colour(number)
        path = path_of(UNITS * lines)
        drawn += f'<path class="pv-halo" d="{path}"/><path stroke="rgb{colour}" d="{path}"/>'
    return drawn


def said_of(session: Session, index: int) -> str:
    """Say what a photo leaves unexplained at the current pose, or why that is not known."""
    losses = session.losses
    if not session.document.object.in_views[index].is_compared:
        return "not compared"
    if session.searching or losses is None or not losses.of_views:
        return ""
    result = losses.of_views.get(index)
    return "not seen" if result is None else f"{result.scale.shown(result.loss):.3f}"


def word_of(scene_object: SceneObject, index: int) -> str:
    """The verdict by a view alone on an object's pose; "": there is none."""
    result = scene_object.result
    if result is None or result.verdict is None:
        return ""
    compared = {i for i, share in enumerate(result.seen) if share is not None} - {result.view}
    verdicts = zip((result.view, *sorted(compared)), result.verdict.views, strict=False)
    return {i: verdict.word for i, verdict in verdicts}.get(index, "")
