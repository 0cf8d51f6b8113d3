"""A comparison of both methods from the start: a table of where they end."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from poseviewer.app.page.controls import Controls, kept
from poseviewer.app.state import commands as c
from poseviewer.app.state.session import SearchUpdate
from poseviewer.fit.settings import METHODS
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error


def add_comparison(controls: Controls) -> None:
    """A button that compares the methods, their ends, and which of them to take."""
    controls.action("compare", icon="arrows-diff", disabled=lambda s: s.searching)
    controls.html(
        kept(lambda s: (s.ends,), lambda s: ends_table(s.ends, s.document.mesh) if s.ends else "")
    )
    takes = {name.capitalize(): c.take_end(index) for index, name in enumerate(METHODS)}
    controls.choices("Take", takes, visible=lambda s: bool(s.ends))


def ends_table(ends: Sequence[SearchUpdate], mesh: Mesh) -> str:
    """A column for each end, and how far the two are from each other (HTML)."""
    names = [end.settings.method.capitalize() for end in ends]
    found = [end.progress for end in ends]
    scales = [end.problem.scale for end in ends]
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
    one, other = (progress.pose for progress in found[:2])
    apart = pose_error(mesh, other, one)
    said = (
        f"The ends lie {apart.reprojection_px:.1f} px apart ({apart.percent:.2g} % of the model's "
        f"size in the photo), turned by {apart.rotation_deg:.2g}°."
    )
    head = "".join(f"<th>{escape(name)}</th>" for name in ("", *names))
    body = "".join(
        f"<tr><td>{escape(what)}</td>{''.join(f'<td>{value}</td>' for value in values)}</tr>"
        for what, values in rows
    )
    return (
        f'<div class="pv-ends-table"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody>'
        f"</table><p>{escape(said)}</p></div>"
    )
