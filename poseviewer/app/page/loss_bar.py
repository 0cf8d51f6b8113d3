"""A bar from 0 (all explained) to 1 (nothing): where start, pose and best lie."""

from __future__ import annotations

from html import escape

from poseviewer.app.state.session import Session


def loss_bar(session: Session) -> str:
    """HTML; empty while nothing is known. The tooltip says what light, classes and edges leave."""
    overlay, latest = session.overlay, session.own_search
    pose = None if overlay is None else overlay.unexplained
    marks: dict[str, float | None] = {}  # the later over the earlier ones, and smaller
    if latest is not None:
        progress = latest.progress
        scale = progress.scale
        marks = {"start": progress.start_loss, "best": progress.loss}
    elif overlay is not None and pose is not None:
        scale, marks = pose.scale, {"start": overlay.start_loss}
    else:
        return ""
    parts = ""
    if pose is not None and not session.searching:  # of a search's poses the parts are not asked
        marks["pose"] = pose.loss
        parts = f" This pose: {pose.parts_text}." if pose.parts_text else ""
    places = {
        name: 100.0 * scale.unexplained(loss) for name, loss in marks.items() if loss is not None
    }
    drawn = "".join(
        f'<i class="pv-{name}" style="left:{place:.1f}%"></i>' for name, place in places.items()
    )
    key = "".join(f'<span><i class="pv-{name}"></i>{name}</span>' for name in places)
    said = escape(f"What is unexplained: 0, nothing is, to 1, all is.{parts}")
    return (
        f'<div class="pv-loss" title="{said}"><div><span>0</span><div class="pv-line">{drawn}</div>'
        f"<span>1</span></div><div>{key}</div></div>"
    )
