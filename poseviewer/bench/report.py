"""The report of a run: as JSON, and as tables to read or to paste."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from poseviewer.bench.paths import NAMES
from poseviewer.bench.run import Report
from poseviewer.bench.searches import FitTime, MapsTime
from poseviewer.bench.timing import Row
from poseviewer.figures.text_table import Table

PAPER_MS = (170.0, 40.0)
"""What the paper says it needed to render, and for its loss."""
PAPER = {
    "source": "Jayawardena, Hutter and Brewer, measured on their machine of 2010 (C and OpenGL)",
    "render_ms": PAPER_MS[0],
    "loss_ms": PAPER_MS[1],
    "pose": "about a minute",
}
DRAWING, SUMMING = ("render", "rasterise"), ("moments", "moments and loss")
NONE = "–"  # noqa: RUF001 - a dash in a table
PAPER_NAME = "the paper's own, on its machine of 2010"


def as_json(report: Report) -> dict[str, Any]:
    """All of it, for a file."""
    return {
        "machine": report.machine,
        "versions": report.versions,
        "rows": [asdict(row) for row in report.rows],
        "fits": [{**asdict(fit), "end": fit.end} for fit in report.fits],
        "maps": [{**asdict(m), "cut_short": m.cut_short, "end": m.end} for m in report.maps],
        "scaling": [{"series": s.series, "x": s.x, **asdict(s.row)} for s in report.scaling],
        "paper": PAPER,
        "notes": list(report.notes),
    }


def as_json_bytes(report: Report) -> bytes:
    """``as_json`` as a file's content."""
    return (json.dumps(as_json(report), indent=1, allow_nan=False) + "\n").encode()


def as_text(report: Report, markdown: bool = False) -> str:
    """The header and the tables, for a terminal or for a README."""
    tables = [stage_table(report), *_total_tables(report), whole_table(report)]
    parts = [table.as_markdown() if markdown else table.as_text() for table in tables]
    return "\n\n".join([header(report), *parts, *report.notes])


def header(report: Report) -> str:
    """The machine and the versions."""
    cpu, count = report.machine["cpu"], report.machine["cores"]
    load, opengl = report.machine["load"], report.versions["opengl"]
    busy = f", load {load:.1f} at the start" if load is not None else ""
    packages = ", ".join(f"{k} {v}" for k, v in report.versions.items() if k != "opengl")
    return f"{cpu}, {count} cores{busy}; OpenGL: {opengl or 'none'}.\n{packages}."


def stage_table(report: Report) -> Table:
    """The stages of each path, in the case that all share."""
    main = main_rows(report)
    case = main[0]
    stages = by_path(main)
    plain = stages.get("a", {}).get("total")
    rows = []
    for letter, found in stages.items():
        total = found["total"]
        gain = NONE if plain is None else f"{plain.ms_median / total.ms_median:.1f}"
        rows.append(
            (
                f"{letter}  {NAMES[letter]}",
                _ms(_first(found, DRAWING)),
                _ms(_first(found, SUMMING)),
                _ms(found.get("loss")),
                _ms(total),
                f"{total.ms_min:.3g} to {total.ms_max:.3g}",
                _ms(found["evaluation"]),
                _ms(found["search"]),
                gain,
            )
        )
    paper = f"{PAPER_MS[0]:.0f}", "", f"{PAPER_MS[1]:.0f}", f"{sum(PAPER_MS):.0f}"
    rows.append((PAPER_NAME, *paper, NONE, NONE, NONE, NONE))
    return Table(
        f"One evaluation, ms: {case.triangles:,} triangles, {case.width}x{case.height}, "
        f"{case.covered_px:,} covered pixels; medians",
        ("path", "draw", "sum", "loss", "total", "least to most", "by chart", "search", "a / this"),
        tuple(rows),
    )


def _total_tables(report: Report) -> Iterable[Table]:
    """The totals of all cases, where there is more than one."""
    totals = [row for row in report.rows if row.stage == "total"]
    cases = list(dict.fromkeys((r.width, r.height, r.triangles) for r in totals))
    if len(cases) < 2:
        return
    rows = []
    for letter in dict.fromkeys(row.path for row in totals):
        of_path = {(r.width, r.height, r.triangles): r for r in totals if r.path == letter}
        rows.append((f"{letter}  {NAMES[letter]}", *(_ms(of_path[case]) for case in sorted(cases))))
    names = (f"{w}x{h}, {t // 1000}k" for w, h, t in sorted(cases))
    yield Table(
        "One evaluation from pose to loss, ms: size of the photo, triangles; medians",
        ("path", *names),
        tuple(rows),
    )


def whole_table(report: Report) -> Table:
    """Searches and maps."""
    cells = [(_fit_name(f), f.seconds, f.evaluations, f.end) for f in report.fits]
    cells += [(_maps_name(m), m.seconds, m.evaluations, m.end) for m in report.maps]
    rows = [
        (name, f"{seconds:.3g}", f"{count:,}", f"{1e3 * seconds / max(count, 1):.3g}", end)
        for name, seconds, count, end in cells
    ]
    rows.append((f"a pose, {PAPER_NAME}", "about 60", NONE, NONE, NONE))
    columns = ("what", "seconds", "evaluations", "ms each", "end")
    return Table("Searches and maps", columns, tuple(rows))


def _fit_name(fit: FitTime) -> str:
    level = "" if fit.factor == 1 else f" ({fit.coarse_evaluations:,} on the photo / {fit.factor})"
    cores = "1 core" if fit.threads == 1 else f"{fit.threads} cores"
    if fit.method != "lit":
        return f"fit of the demo, --method {fit.method}, {cores}{level}"
    return f"search of the demo from 8 % off, path {fit.path}, {cores}{level}"


def _maps_name(maps: MapsTime) -> str:
    of = "" if maps.factor == 1 else f" of the photo / {maps.factor}"
    return f"{maps.maps} maps of {maps.size}x{maps.size}{of}, {maps.threads} cores"


def main_rows(report: Report) -> list[Row]:
    """Those of the 50,000 triangles at 640x480, or of the first case."""
    wanted = [r for r in report.rows if (r.triangles, r.width, r.height) == (50_000, 640, 480)]
    first = report.rows[0]
    size = first.triangles, first.width, first.height
    return wanted or [r for r in report.rows if (r.triangles, r.width, r.height) == size]


def by_path(rows: Sequence[Row]) -> dict[str, dict[str, Row]]:
    """The rows of one case: path, then stage."""
    found: dict[str, dict[str, Row]] = {}
    for row in rows:
        found.setdefault(row.path, {})[row.stage] = row
    return found


def _first(stages: dict[str, Row], names: Sequence[str]) -> Row | None:
    return next((stages[name] for name in names if name in stages), None)


def _ms(row: Row | None) -> str:
    return "" if row is None else f"{row.ms_median:.3g}"
