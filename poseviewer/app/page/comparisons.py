"""A comparison of both methods from the start: a table of where they end."""

from __future__ import annotations

from collections.abc import Sequence

from poseviewer.app.page.controls import Controls, kept
from poseviewer.app.state import commands as c
from poseviewer.app.state.session import SearchUpdate
from poseviewer.fit.settings import METHODS
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error


def add_comparison(controls: Controls) -> None:
    """A button that compares the methods, their ends, and which of them to take."""
    controls.action("compare", icon="arrows-diff", disabled=lambda s: s.searching)
    controls.text(
        kept(lambda s: (s.ends,), lambda s: ends_table(s.ends, s.document.mesh) if s.ends else "")
    )
    takes = {name.capitalize(): c.take_end(index) for index, name in enumerate(METHODS)}
    controls.choices("Take", takes, visible=lambda s: bool(s.ends))


def ends_table(ends: Sequence[SearchUpdate], mesh: Mesh) -> str:
    """A column for each end, and how far the two are from each other (markdown)."""
    progress = [end.progress for end in ends]
    rows = {"": [end.settings.method.capitalize() for end in ends], "---": ["--:"] * len(ends)}
    for i, end in enumerate(ends):
        scale = end.problem.scale
        losses = [f"{scale.shown(other.losses[i]):.3f}" for other in ends]
        rows[f"{end.settings.method.capitalize()}: {scale.name}"] = losses
    rows |= {
        "seconds": [f"{p.seconds:.1f}" for p in progress],
        "evaluations": [f"{p.evaluations:,}" for p in progress],
        "restarts": [str(p.restart) for p in progress],
        "verdict": ["-" if p.verdict is None else p.verdict.word for p in progress],
    }
    table = "\n".join(f"| {name} | {' | '.join(values)} |" for name, values in rows.items())
    first, second = (p.pose for p in progress[:2])
    apart = pose_error(mesh, second, first)
    return (
        f"{table}\n\nThe ends lie {apart.reprojection_px:.1f} px apart ({apart.percent:.2g} % of "
        f"the model's size in the photo), turned by {apart.rotation_deg:.2g}°."
    )
