"""HTML of the left panel: list of objects, parts left out, bars of loss and of compiling."""

import htpy as h

from poseviewer.app.page.controls import Controls, as_html, on_press, plain
from poseviewer.app.state.document import label_of, verdict_of
from poseviewer.app.state.session import Session
from poseviewer.errors import percent
from poseviewer.geometry.mesh import Mesh
from poseviewer.scene.types import SceneObject

COLOURS = "00e8ff", "ffa640", "a8f060", "ff80c8", "b096ff", "ffe260", "ff6860", "60a8ff"
"""RGB (hexadecimal) of the objects' outlines by their ids."""
_BODY = h.rect(x="3", y="7", width="10", height="7", rx="1")
_ICON = h.svg(viewBox="0 0 16 16")
ICONS = {
    "eye": _ICON[
        h.path(d="M1 8s2.6-4.5 7-4.5S15 8 15 8s-2.6 4.5-7 4.5S1 8 1 8z"),
        h.circle(cx="8", cy="8", r="2"),
    ],
    "lock": _ICON[_BODY, h.path(d="M5 7V5a3 3 0 016 0v2")],
    "open": _ICON[_BODY, h.path(d="M5 7V4a3 3 0 016 0")],
    "away": _ICON[h.path(d="M4 4l8 8M12 4l-8 8")],
}


def object_colour(number: int) -> tuple[int, int, int]:
    """RGB of an object's outline, picked or not."""
    red, green, blue = bytes.fromhex(COLOURS[(number - 1) % len(COLOURS)])
    return red, green, blue


def objects_list(session: Session) -> str:
    """A row for each object (HTML); "" for one alone."""
    objects, active = session.document.scene.objects, session.document.object_id
    if len(objects) == 1:
        return ""
    rows = [_row(item, int(item.id) == active) for item in objects]
    return as_html(h.div(".pv-objects")[h.table[h.tbody[rows]]])


def _row(item: SceneObject, is_picked: bool) -> h.Element:
    name, number = label_of(item), int(item.id)
    at, pick = {"pv-at": is_picked}, on_press("pick object", object_id=number)
    hide, lock = ("show" if item.hidden else "hide"), ("unlock" if item.locked else "lock")
    hiding, locking = (
        on_press("alter object", object_id=number, what=what, on=not getattr(item, what))
        for what in ("hidden", "locked")
    )
    icons = [
        h.button(
            press, type="button", title=f"{verb} it", aria_label=f"{verb} {number}",
            class_={"pv-faint": is_faint},
        )[ICONS[icon]]
        for verb, icon, is_faint, press in (
            (hide, "eye", item.hidden, hiding),
            (lock, "lock" if item.locked else "open", not item.locked, locking),
            ("remove", "away", False, on_press("remove object", object_id=number)),
        )
    ]  # fmt: skip
    return h.tr(pick, class_=at, tabindex="0", title=f"{name}: pick it")[
        h.td[h.i(style=f"background:rgb{object_colour(number)}")],
        h.td[name],
        h.td[verdict_of(item)],
        h.td[icons],
    ]


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
    back = "Bring back"
    rows = [
        h.li[name or "(unnamed)", h.button(on_press("part", index=index), type="button")[back]]
        for index, name in enumerate(mesh.left_out)
    ]
    return as_html(rows and h.div(".pv-parts")["Left out of the model:", h.ul[rows]])
