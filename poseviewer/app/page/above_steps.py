"""HTML of the left panel: list of objects, parts left out, bars of loss and of compiling."""

from html import escape

from poseviewer.app.page.controls import Controls, on_press, plain
from poseviewer.app.state.document import label_of, verdict_of
from poseviewer.app.state.session import Session
from poseviewer.errors import percent
from poseviewer.geometry.mesh import Mesh
from poseviewer.scene.types import SceneObject

COLOURS = "00e8ff", "ffa640", "a8f060", "ff80c8", "b096ff", "ffe260", "ff6860", "60a8ff"
"""RGB (hexadecimal) of the objects' outlines by their ids."""
ICONS = {
    "eye": '<path d="M1 8s2.6-4.5 7-4.5S15 8 15 8s-2.6 4.5-7 4.5S1 8 1 8z"/><circle cx="8" cy="8" '
    'r="2"/>',
    "lock": '<rect x="3" y="7" width="10" height="7" rx="1"/><path d="M5 7V5a3 3 0 016 0v2"/>',
    "open": '<rect x="3" y="7" width="10" height="7" rx="1"/><path d="M5 7V4a3 3 0 016 0"/>',
    "away": '<path d="M4 4l8 8M12 4l-8 8"/>',
}
"""SVG, 16 x 16."""


def object_colour(number: int) -> tuple[int, int, int]:
    """RGB of an object's outline, picked or not."""
    red, green, blue = bytes.fromhex(COLOURS[(number - 1) % len(COLOURS)])
    return red, green, blue


def objects_list(session: Session) -> str:
    """A row for each object (HTML); "" for one alone."""
    objects, active = session.document.scene.objects, session.document.object_id
    if len(objects) == 1:
        return ""
    rows = "".join(_row(item, int(item.id) == active) for item in objects)
    return f'<div class="pv-objects"><table><tbody>{rows}</tbody></table></div>'


def _row(item: SceneObject, is_picked: bool) -> str:
    name, number = escape(label_of(item)), int(item.id)
    colour = object_colour(number)
    at, pick = " class=pv-at" if is_picked else "", on_press("pick object", object_id=number)
    hide, lock = ("show" if item.hidden else "hide"), ("unlock" if item.locked else "lock")
    hiding, locking = (
        on_press("alter object", object_id=number, what=what, on=not getattr(item, what))
        for what in ("hidden", "locked")
    )
    icons = "".join(
        f'<button type="button" title="{verb} it" aria-label="{verb} {number}" '
        f"{'class=pv-faint ' if is_faint else ''}{press}>"
        f'<svg viewBox="0 0 16 16">{ICONS[icon]}</svg></button>'
        for verb, icon, is_faint, press in (
            (hide, "eye", item.hidden, hiding),
            (lock, "lock" if item.locked else "open", not item.locked, locking),
            ("remove", "away", False, on_press("remove object", object_id=number)),
        )
    )
    return (
        f'<tr{at} tabindex="0" title="{name}: pick it" {pick}>'
        f'<td><i style="background:rgb{colour}"></i></td><td>{name}</td>'
        f"<td>{escape(verdict_of(item))}</td><td>{icons}</td></tr>"
    )


COMPILING = (
    "**Compiling, this once: {share}**  \n"
    "Place the model meanwhile, by a sketch of its outline. Loss, maps and a search that is asked "
    "for begin by themselves."
)


def add_preparing(controls: Controls) -> None:
    """A sentence and a bar while kernels are compiled."""

    def share(session: Session) -> float | None:
        return session.preparation and session.preparation.share

    def text(session: Session) -> str:
        preparation, compiled = session.preparation, share(session)
        if compiled is not None:
            return COMPILING.format(share=percent(compiled))
        return f"**{plain(preparation.trouble)}**" if preparation and preparation.trouble else ""

    controls.text(text)
    controls.add(
        controls.gui.add_progress_bar(0.0, visible=False, color="cyan", animated=True),
        value=lambda s: 100.0 * (share(s) or 0.0),
        visible=lambda s: share(s) is not None,
    )


def parts_left_out(mesh: Mesh) -> str:
    """The parts that are left out, each with a button that brings it back (HTML)."""
    rows = "".join(
        f'<li>{escape(name or "(unnamed)")}<button type="button" '
        f"{on_press('part', index=index)}>Bring back</button></li>"
        for index, name in enumerate(mesh.left_out)
    )
    return f'<div class="pv-parts">Left out of the model:<ul>{rows}</ul></div>' if rows else ""


def loss_bar(session: Session) -> str:
    """HTML; empty while nothing is known. The tooltip says what light, classes and edges leave."""
    losses, latest = session.results.losses, session.own_progress
    if not session.document.object.is_placed:
        return ""
    pose, parts = None if losses is None else losses.mean, ""
    marks: dict[str, float | None] = {}  # the later over the earlier ones, and smaller
    if latest is not None and session.is_searching:
        scale = latest.progress.scale
        marks = {"start": latest.progress.start_loss, "best": latest.progress.loss}
    elif losses is not None and pose is not None:
        scale, marks = pose.scale, {"start": losses.start}
    else:
        return ""
    if pose is not None and not session.is_searching:  # of a search's poses the parts are not asked
        marks["pose"] = pose.loss
        parts = f" This pose: {pose.parts_text}." if pose.parts_text else ""
    drawn = key = ""
    for name, loss in marks.items():
        if loss is not None:
            left = 100.0 * scale.as_unexplained(loss)
            drawn += f'<i class="pv-{name}" style="left:{left:.1f}%"></i>'
            key += f'<span><i class="pv-{name}"></i>{name}</span>'
    said = escape(f"What is unexplained: 0, nothing is, to 1, all is.{parts}")
    return (
        f'<div class="pv-loss" title="{said}"><div><span>0</span><div class="pv-line">{drawn}</div>'
        f"<span>1</span></div><div>{key}</div></div>"
    )
