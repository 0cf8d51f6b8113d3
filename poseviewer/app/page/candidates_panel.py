"""The folder "Which model is it?": the models that the photo may show, and their table."""

from __future__ import annotations

from html import escape

import viser

from poseviewer.app.page.fields import Post, button, set_property
from poseviewer.app.page.files_panel import upload_button
from poseviewer.app.state import commands as c
from poseviewer.app.state.candidates import CandidateRow, Comparison
from poseviewer.app.state.requests import Request
from poseviewer.app.state.session import Session


class CandidatesPanel:
    """Folder "Which model is it?"."""

    def __init__(self, gui: viser.GuiApi, post: Post) -> None:
        self._running = False
        self._shown: object = None
        with gui.add_folder("Which model is it?", expand_by_default=False):
            self._text = gui.add_markdown("")
            upload_button(gui, post, "model", "Add a model ...", "cube-plus", beside=True)
            self._go = button(gui, "Tell them apart", post, lambda _: self._asked(), color="cyan")
            self._table = gui.add_html("", visible=False)

    def _asked(self) -> Request:
        return c.StopIdentifying() if self._running else c.Identify()

    def show(self, session: Session) -> None:
        """Bring the table to the session."""
        candidates, document = session.candidates, session.document
        key = candidates, document.registration
        if self._shown == key:
            return
        self._shown = key
        compared = candidates.comparison_about(document)
        self._running = compared is not None and compared.running
        set_property(self._go, "label", "Stop" if self._running else "Tell them apart")
        set_property(self._go, "icon", "player-stop" if self._running else None)
        set_property(self._text, "content", candidates_text(compared))
        rows = candidates.rows(document)
        set_property(self._table, "visible", bool(rows))
        at_hand = document.registration.mesh_sha256
        set_property(self._table, "content", candidates_table(rows, at_hand, self._running))


def candidates_text(compared: Comparison | None) -> str:
    """What can be done, or how far it is (markdown)."""
    if compared is None or compared.latest is None:
        running = compared is not None and compared.running
        return (
            "Preparing ..."
            if running
            else "Add models that the photo may show. All are fitted from the pose at hand, and "
            "ranked by their loss over the same pixels."
        )
    latest, count = compared.latest, len(compared.models)
    if compared.running and latest.at is not None:
        loss = "" if latest.progress is None else f", loss {latest.progress.loss:.3f}"
        return f"Fitting model {latest.at + 1} of {count}{loss}"
    if len(latest.ranked) < count:
        return f"Stopped: {len(latest.ranked)} of {count} models are fitted."
    return "Press a row to see its fit. A small margin is no answer: look at the residual (5)."


def candidates_table(rows: tuple[CandidateRow, ...], at_hand: str, running: bool) -> str:
    """A row for each model (HTML); ``at_hand``: the one that is drawn, by its fingerprint."""
    body = "".join(_row(row, row.candidate.model.sha256 == at_hand, running) for row in rows)
    return (
        f'<div class="pv-models"><style>{_STYLE}</style><table><thead><tr><th></th><th>model</th>'
        f"<th>loss</th><th>margin</th><th></th></tr></thead><tbody>{body}</tbody></table></div>"
    )


def _row(row: CandidateRow, is_at_hand: bool, running: bool) -> str:
    name = escape(row.candidate.model.name)
    rank, loss, margin = "", "", ""
    if row.ranked is not None:
        rank, loss = str(row.ranked.rank), f"{row.ranked.candidate.loss:.3f}"
        if row.ranked.margin is not None:
            margin = f"+{row.ranked.margin:.3f}"
    elif row.is_being_fitted:
        loss = "..."
    show, drop = (f"window.poseviewerModel('{wish}',{row.index})" for wish in ("show", "drop"))
    away = (
        ""
        if running
        else f'<button type="button" title="{name}: take it away" aria-label="Take {name} away" '
        f'onpointerdown="event.stopPropagation();{drop}" '
        f"onkeydown=\"if(event.key=='Enter'){{event.stopPropagation();{drop}}}\">&times;</button>"
    )
    return (
        f'<tr{" class=pv-at" if is_at_hand else ""} tabindex="0" title="{name}: show it" '
        f'onpointerdown="{show}" onkeydown="if(event.key==\'Enter\'){{{show}}}">'
        f"<td>{rank}</td><td>{name}</td><td>{loss}</td><td>{margin}</td><td>{away}</td></tr>"
    )


_STYLE = """
.pv-models{padding:2px 10px 8px;font-size:12px;line-height:1.3;color:inherit}
.pv-models table{width:100%;border-collapse:collapse;table-layout:fixed;
font-variant-numeric:tabular-nums}
.pv-models th{font-weight:400;opacity:.65;text-align:left;padding:2px 3px}
.pv-models td{padding:4px 3px;overflow:hidden;text-overflow:ellipsis;white-space:nowrap}
.pv-models th:nth-child(1){width:18px}
.pv-models th:nth-child(3),.pv-models th:nth-child(4){width:50px}
.pv-models th:nth-child(5){width:18px}
.pv-models th:nth-child(n+3),.pv-models td:nth-child(n+3){text-align:right}
.pv-models tbody tr{cursor:pointer;border-top:1px solid rgba(255,255,255,.08)}
.pv-models tbody tr:hover,.pv-models tbody tr:focus-visible{background:rgba(255,255,255,.08)}
.pv-models tbody .pv-at{background:rgba(53,230,255,.16)}
.pv-models button{border:0;background:none;color:inherit;opacity:.5;cursor:pointer;padding:0;
font-size:14px;line-height:1}
.pv-models td:last-child{text-overflow:clip}
.pv-models button:hover,.pv-models button:focus-visible{opacity:1}
""".strip().replace("\n", "")
