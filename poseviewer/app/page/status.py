"""The status above the steps (HTML), of one height: verdict, loss, a sentence, focal length."""

import htpy as h

from poseviewer.app.page.controls import as_html, on_page, on_press
from poseviewer.app.page.result import SOURCES, source_of
from poseviewer.app.page.texts import (
    PREPARING,
    STOPPED,
    focal_note,
    loss_text,
    pace_of_search,
    shown_loss,
)
from poseviewer.app.state.document import verdict_of
from poseviewer.app.state.session import Session
from poseviewer.confidence.verdict import percent_right
from poseviewer.geometry.camera import Parallel

FIRST = "Finds a known 3D model in a photo: Open both, Place the model, then Search."
SIGNS = {
    "found": h.path(d="M3 8.5l3.5 3.5L13 4.5"),
    "doubtful": h.path(d="M5.5 6a2.5 2.5 0 115 0c0 1.8-2.5 1.8-2.5 3.6M8 12.4v.2"),
    "lost": h.path(d="M4 4l8 8M12 4l-8 8"),
}
"""Picture of each verdict, for those who see no colours."""
LIKELY_RIGHT = "{} % likely right"


def status_html(session: Session, first: str = FIRST) -> str:
    """The status; ``first`` is its sentence until something has been done."""
    label, sentence = _said(session, first)
    result, loss = session.document.object.result, loss_text(session)
    badge, share, sure = [label], "", ""
    if label in SIGNS and result is not None and result.verdict is not None:
        badge = [h.svg(viewBox="0 0 16 16")[SIGNS[label]], f"Verdict: {label}"]
        share = LIKELY_RIGHT.format(percent_right(label, result.verdict.probability))
        sure = f"{result.verdict.share_right}."
    stop = h.button(on_press("key", code="Escape"), type="button")["Stop (Esc)"]
    return as_html(
        h.div(class_=["pv-status", {"pv-busy": session.is_searching}])[
            h.div[
                h.b(class_=f"pv-badge pv-{label}")[badge],
                h.span(title=sure or None)[share],
                session.is_at_work and stop,
            ],
            h.div(title=loss)[h.span[loss]],
            h.p(title=sentence)[sentence],
            h.div[_focal_length(session)],
            loss_bar(session),
        ]
    )


def _said(session: Session, first: str) -> tuple[str, str]:
    """The word of the badge, and the sentence below."""
    progress, preparation = session.search_progress, session.preparation
    item, losses = session.document.object, session.results.losses
    label, result = verdict_of(item), item.result
    if session.is_searching:
        if preparation is not None:
            return "waiting", "Waiting to begin; the same button stops it."
        return "searching", pace_of_search(progress) if progress else "Preparing the search ..."
    if preparation is not None and preparation.trouble:
        return label, ""  # it is said above all panels
    if result is not None and result.verdict is not None:
        return label, next(iter(result.verdict.reasons), "")
    if progress is not None and progress.progress.status.name == "RUNNING":
        return "stopped", STOPPED
    if not item.is_placed:
        return label, "The model is not placed yet."
    if first and not (session.history.past or session.search):
        return label, first
    if preparation is not None and preparation.share is not None:
        return label, "The loss comes when all is compiled."
    if losses is None or losses.mean is None:
        return label, on_page(losses.note) if losses and losses.note else PREPARING
    return label, "A search says whether the pose is right."


def _focal_length(session: Session) -> list[h.Node]:
    """Source of the focal length; one that is a guess has a button that looks for it."""
    photo, camera = session.document.photo, session.document.pose.camera
    if isinstance(camera, Parallel):
        return [h.span["parallel projection"]]
    note = focal_note(session)
    if not note:
        source = source_of(photo, camera)
        text = f"focal length {camera.fx:,.0f} px"
        return [h.span(title=SOURCES.get(source))[text + (f", {source}" if source else "")]]
    press = {} if session.is_searching else on_press("find focal length")
    hint = "Search for the pose and the focal length together"
    button = h.button(press, type="button", title=hint, disabled=session.is_searching)
    return [h.span(title=note)["⚠ assumed"], button["Find the focal length"]]


def loss_bar(session: Session) -> h.Node:
    """Bar from 0 to 1; None while nothing is known. Its tooltip has the shares by light, classes
    and edges.
    """
    losses, latest = session.results.losses, session.own_progress
    if not session.document.object.is_placed:
        return None
    parts, known = "", shown_loss(session)
    marks: dict[str, float | None] = {}  # the later over the earlier ones, and smaller
    if latest is not None and session.is_searching:
        scale = latest.progress.scale
        marks = {"start": latest.progress.start_loss, "best": latest.progress.loss}
    elif losses is not None and losses.mean is not None and known is not None:
        scale, pose, _ = known
        marks = {"start": losses.start, "pose": pose}
        parts = losses.mean.parts_text and f" This pose: {losses.mean.parts_text}."
    else:
        return None
    shares = {name: scale.as_unexplained(loss) for name, loss in marks.items() if loss is not None}
    line = [h.i(f".pv-{name}", style=f"left:{100.0 * at:.1f}%") for name, at in shares.items()]
    key = [h.span[h.i(f".pv-{name}"), name] for name in shares]
    said = f"What is unexplained: 0, nothing is, to 1, all is.{parts}"
    bar = h.div[h.span["0"], h.div(".pv-line")[line], h.span["1"]]
    return h.div(".pv-loss", title=said)[bar, h.div[key]]
