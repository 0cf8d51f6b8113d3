"""What is compared: both methods from the start, and the models that the photo may show; their ends
and ranks in tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from poseviewer.app.page.controls import Controls, set_properties
from poseviewer.app.state import commands as c
from poseviewer.app.state.candidates import CandidateRow, Comparison
from poseviewer.app.state.session import MethodEnd, Session
from poseviewer.fit.settings import METHODS
from poseviewer.fit.unexplained import LossScale
from poseviewer.geometry.pose_error import pose_error

HINT = "Search from the start pose by one method, then by the other, and set the ends side by side."


class MethodsPanel:
    """A button that compares the methods, their ends, and which of them to take."""

    def __init__(self, controls: Controls) -> None:
        self._shown: tuple[MethodEnd, ...] = ()
        self._go = controls.button(
            "Compare both methods", c.CompareMethods(), hint=HINT, icon="arrows-diff"
        )
        self._table = controls.gui.add_html("", visible=False)
        takes = {name: c.TakeEnd(index) for index, name in enumerate(METHODS.values())}
        self._take = controls.choices("Take", takes, visible=False)

    def show(self, session: Session) -> None:
        """Bring the table to the session."""
        set_properties(self._go, disabled=session.searching)
        if self._shown is session.ends:
            return
        self._shown = session.ends
        set_properties(self._take, visible=bool(session.ends))
        content = ends_table(session.ends) if session.ends else ""
        set_properties(self._table, visible=bool(content), content=content)


def ends_table(ends: Sequence[MethodEnd]) -> str:
    """A column for each end, and how far the two are from each other (HTML)."""
    names = [METHODS[end.settings.method] for end in ends]
    found = [end.update.progress for end in ends]
    scales = [LossScale.of(end.update.case.problem.photo) for end in ends]
    rows = [
        (f"{names[i]}: {scale.name}", [f"{scale.shown(end.losses[i]):.3f}" for end in ends])
        for i, scale in enumerate(scales)
    ]
    rows += [
        ("seconds", [f"{progress.seconds:.1f}" for progress in found]),
        ("evaluations", [f"{progress.evaluations:,}" for progress in found]),
        ("restarts", [str(progress.restart) for progress in found]),
        ("verdict", ["-" if p.verdict is None else p.verdict.word for p in found]),
    ]
    head = "".join(f"<th>{escape(name)}</th>" for name in ("", *names))
    body = "".join(
        f"<tr><td>{escape(what)}</td>{''.join(f'<td>{value}</td>' for value in values)}</tr>"
        for what, values in rows
    )
    return (
        f'<div class="pv-ends-table"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody>'
        f"</table><p>{escape(apart_text(ends))}</p></div>"
    )


def apart_text(ends: Sequence[MethodEnd]) -> str:
    """How far the first two ends are from each other, in a sentence."""
    one, other = ends[:2]
    apart = pose_error(
        one.update.case.registration.mesh, other.update.progress.pose, one.update.progress.pose
    )
    return (
        f"The ends lie {apart.reprojection_px:.1f} px apart ({apart.percent:.2g} % of the model's "
        f"size in the photo), turned by {apart.rotation_deg:.2g}°."
    )


class CandidatesPanel:
    """Folder "Which model is it?"."""

    def __init__(self, controls: Controls) -> None:
        self._running = False
        self._shown: object = None
        with controls.gui.add_folder("Which model is it?", expand_by_default=False):
            self._text = controls.gui.add_markdown("")
            controls.upload("Add a model ...", "model", "cube-plus", "candidate")
            self._go = controls.button_for(
                "Tell them apart",
                lambda _: c.StopIdentifying() if self._running else c.Identify(),
                "cyan",
            )
            self._table = controls.gui.add_html("", visible=False)

    def show(self, session: Session) -> None:
        """Bring the table to the session."""
        candidates, document = session.candidates, session.document
        key = candidates, document.registration
        if self._shown == key:
            return
        self._shown = key
        compared = candidates.comparison_about(document)
        self._running = compared is not None and compared.running
        set_properties(
            self._go,
            label="Stop" if self._running else "Tell them apart",
            icon="player-stop" if self._running else None,
        )
        set_properties(self._text, content=candidates_text(compared))
        rows = candidates.rows(document)
        table = candidates_table(rows, document.registration.mesh_sha256, self._running)
        set_properties(self._table, visible=bool(rows), content=table)


UNEXPLAINED = '<th title="unexplained: 0, all explained, to 1, nothing">unexpl.</th>'
"""The column's head."""


def candidates_text(compared: Comparison | None) -> str:
    """What can be done, or how far it is (markdown)."""
    if compared is None or compared.latest is None:
        running = compared is not None and compared.running
        return (
            "Preparing ..."
            if running
            else "Add models that the photo may show. All are fitted from the pose at hand, and "
            "ranked by what they leave unexplained of the same pixels, from 0 to 1."
        )
    latest, count = compared.latest, len(compared.models)
    if compared.running and latest.at is not None:
        loss = "" if latest.progress is None else f", {latest.progress.loss_text}"
        return f"Fitting model {latest.at + 1} of {count}{loss}"
    if len(latest.ranked) < count:
        return f"Stopped: {len(latest.ranked)} of {count} models are fitted."
    return "Press a row to see its fit. A small margin is no answer: look at the residual (5)."


def candidates_table(rows: tuple[CandidateRow, ...], at_hand: str, running: bool) -> str:
    """A row for each model (HTML); ``at_hand``: the one that is drawn, by its fingerprint."""
    body = "".join(_row(row, row.candidate.model.sha256 == at_hand, running) for row in rows)
    return (
        f'<div class="pv-models"><table><thead><tr><th></th><th>model</th>'
        f"{UNEXPLAINED}<th>margin</th><th></th></tr></thead><tbody>{body}</tbody></table></div>"
    )


def _row(row: CandidateRow, is_at_hand: bool, running: bool) -> str:
    name = escape(row.candidate.model.name)
    rank, loss, margin = "", "", ""
    if row.ranked is not None:
        rank, loss = str(row.ranked.rank), f"{row.ranked.candidate.fit.unexplained:.3f}"
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
