"""The report of a run: as JSON, as tables to read or to paste, and as a figure."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict

from poseviewer.bench.paths import BATCH_STAGE, BATCHES, NAMES, StageTime
from poseviewer.bench.run import COVERED, PHOTO, TRIANGLES, BenchReport, ScalingTime
from poseviewer.bench.searches import FitTime, MapsTime
from poseviewer.figures.bench_sheet import Bar, BenchSheet, Curve, Panel
from poseviewer.figures.text_table import Table

PAPER_MS = (170.0, 40.0)
"""What the paper says it needed to render, and for its loss."""
PAPER = {
    "source": "Jayawardena, Hutter and Brewer, measured on their machine of 2010 (C and OpenGL)",
    "render_ms": PAPER_MS[0],
    "loss_ms": PAPER_MS[1],
    "pose": "about a minute",
}
PAPER_NAME = "the paper's own, on its machine of 2010"
NONE = "–"  # noqa: RUF001 - a dash in a table
STAGES = {
    "render": "draw",
    "rasterise": "draw",
    "moments": "sum",
    "moments and loss": "sum",
    "loss": "loss",
}
"""The parts of a total, as tables and figure call them."""
CURVES = {
    ("a", "total"): "pyrender and NumPy",
    ("d", "total"): "fused",
    ("d", "rasterise"): "  of it: rasterise",
    ("d", "moments"): "  of it: sum",
}
ADAPTERS = {"opengl": "OpenGL", "gpu": "GPU"}
"""Among the versions: what draws for OpenGL and on the GPU."""
LABELS = {
    TRIANGLES: "triangles",
    COVERED: "pixels that the model covers",
    PHOTO: "pixels of the photo; the same number covered",
}


def as_json_bytes(report: BenchReport) -> bytes:
    """All of it as a JSON file's content."""
    data = {
        "machine": report.machine,
        "versions": report.versions,
        "rows": [asdict(row) for row in report.rows],
        "fits": [{**asdict(fit), "end": fit.end} for fit in report.fits],
        "maps": [{**asdict(m), "cut_short": m.cut_short, "end": m.end} for m in report.maps],
        "scaling": [{"series": s.series, "x": s.x, **asdict(s.row)} for s in report.scaling],
        "paper": PAPER,
        "notes": list(report.notes),
    }
    return (json.dumps(data, indent=1, allow_nan=False) + "\n").encode()


def as_text(report: BenchReport, markdown: bool = False) -> str:
    """Machine, versions and tables, for a terminal or as Markdown."""
    cpu, cores = report.machine["cpu"], report.machine["cores"]
    load, drawn_by = report.machine["load"], _drawn_by(report)
    busy = f", load {load:.1f} at the start" if load is not None else ""
    packages = ", ".join(f"{k} {v}" for k, v in report.versions.items() if k not in ADAPTERS)
    header = f"{cpu}, {cores} cores{busy}; {drawn_by}.\n{packages}."
    tables = [_stage_table(report), *_gpu_tables(report), *_total_tables(report)]
    tables.append(_whole_table(report))
    parts = [table.as_markdown() if markdown else table.as_text() for table in tables]
    return "\n\n".join([header, *parts, *report.notes])


def _drawn_by(report: BenchReport) -> str:
    return "; ".join(f"{name}: {report.versions[key] or 'none'}" for key, name in ADAPTERS.items())


def _main_rows(report: BenchReport) -> dict[str, dict[str, StageTime]]:
    """Of the 50,000 triangles at 640x480, or of the first workload: path, then stage."""
    first = report.rows[0]
    usual, any_size = (50_000, 640, 480), (first.triangles, first.width, first.height)
    sizes = {(row.triangles, row.width, row.height) for row in report.rows}
    wanted = usual if usual in sizes else any_size
    found: dict[str, dict[str, StageTime]] = {}
    for row in report.rows:
        if (row.triangles, row.width, row.height) == wanted:
            found.setdefault(row.path, {})[row.stage] = row
    return found


def _stage_table(report: BenchReport) -> Table:
    """The stages of each path."""
    paths = _main_rows(report)
    plain = paths.get("a", {}).get("total")
    rows = []
    for letter, stages in paths.items():
        total = stages["total"]
        parts = {STAGES[name]: _ms(row) for name, row in stages.items() if name in STAGES}
        rows.append(
            (
                f"{letter}  {NAMES[letter]}",
                *(parts.get(part, "") for part in ("draw", "sum", "loss")),
                _ms(total),
                f"{total.ms_min:.3g} to {total.ms_max:.3g}",
                _ms(stages["evaluation"]),
                _ms(stages["search"]),
                NONE if plain is None else f"{plain.ms_median / total.ms_median:.1f}",
            )
        )
    paper = f"{PAPER_MS[0]:.0f}", "", f"{PAPER_MS[1]:.0f}", f"{sum(PAPER_MS):.0f}"
    rows.append((PAPER_NAME, *paper, NONE, NONE, NONE, NONE))
    one = next(iter(paths.values()))["total"]
    return Table(
        f"One evaluation, ms: {one.triangles:,} triangles, {one.width}x{one.height}, "
        f"{one.covered_px:,} covered pixels; medians",
        ("path", "draw", "sum", "loss", "total", "least to most", "by chart", "search", "a / this"),
        tuple(rows),
    )


def _gpu_tables(report: BenchReport) -> Iterable[Table]:
    """What batches gain, where there is a GPU."""
    stages = _main_rows(report).get("f", {})
    names = [BATCH_STAGE.format(count) for count in BATCHES]
    names = [name for name in names if name in stages]
    if names:
        times = tuple(_ms(stages[name]) for name in names)
        title = f"One evaluation on {report.versions['gpu']}, ms: by poses at once; medians"
        yield Table(title, ("path", *names), ((f"f  {NAMES['f']}", *times),))


def _total_tables(report: BenchReport) -> Iterable[Table]:
    """The totals of all workloads, where there is more than one."""
    totals = [row for row in report.rows if row.stage == "total"]
    sizes = sorted({(r.width, r.height, r.triangles) for r in totals})
    if len(sizes) < 2:
        return
    rows = []
    for letter in dict.fromkeys(row.path for row in totals):
        of_path = {(r.width, r.height, r.triangles): r for r in totals if r.path == letter}
        rows.append((f"{letter}  {NAMES[letter]}", *(_ms(of_path[size]) for size in sizes)))
    yield Table(
        "One evaluation from pose to loss, ms: size of the photo, triangles; medians",
        ("path", *(f"{w}x{h}, {t // 1000}k" for w, h, t in sizes)),
        tuple(rows),
    )


def _whole_table(report: BenchReport) -> Table:
    """Searches and maps."""
    named = [(_fit_name(fit), fit) for fit in report.fits]
    named += [(_maps_name(maps), maps) for maps in report.maps]
    rows = [
        (
            name,
            f"{one.seconds:.3g}",
            f"{one.evaluations:,}",
            f"{1e3 * one.seconds / max(one.evaluations, 1):.3g}",
            one.end,
        )
        for name, one in named
    ]
    rows.append((f"a pose, {PAPER_NAME}", "about 60", NONE, NONE, NONE))
    columns = ("what", "seconds", "evaluations", "ms each", "end")
    return Table("Searches and maps", columns, tuple(rows))


def _fit_name(fit: FitTime) -> str:
    level = "" if fit.factor == 1 else f" ({fit.coarse_evaluations:,} on the photo / {fit.factor})"
    cores = "1 core" if fit.threads == 1 else f"{fit.threads} cores"
    if fit.method != "lit":
        free = ", focal length too" if fit.free_focal else ""
        return f"fit of the demo{free}, --method {fit.method}, {cores}{level}"
    return f"search of the demo from 8 % off, path {fit.path}, {cores}{level}"


def _maps_name(maps: MapsTime) -> str:
    of = "" if maps.factor == 1 else f" of the photo / {maps.factor}"
    by = ", most by a lighter model" if maps.error is not None else ""
    return f"{maps.maps} maps of {maps.size}x{maps.size}{of}{by}, {maps.threads} cores"


def _ms(row: StageTime) -> str:
    return f"{row.ms_median:.3g}"


def make_sheet(report: BenchReport) -> BenchSheet:
    """Bars of the paths' stages in the main workload, and the scaling where it was measured."""
    paths = _main_rows(report)
    plain = paths.get("a", {}).get("total")
    bars = []
    for letter, stages in paths.items():
        total = stages["total"].ms_median
        gain = plain.ms_median / total if plain and letter != "a" else 0.0
        note = f"{total:.3g} ms" + (f"   {gain:.1f} times as fast as a" if gain > 1.0 else "")
        parts = [(STAGES[s], row.ms_median) for s, row in stages.items() if s in STAGES]
        bars.append(Bar(f"{letter}  {NAMES[letter]}", tuple(parts), note))
    paper = (("draw", PAPER_MS[0]), ("loss", PAPER_MS[1]))
    bars.append(Bar("the paper's own, in 2010", paper, f"{sum(PAPER_MS):.0f} ms", True))
    series = dict.fromkeys(point.series for point in report.scaling)
    panels = (_panel(name, [p for p in report.scaling if p.series == name]) for name in series)
    one = next(iter(paths.values()))["total"]
    return BenchSheet(
        f"One evaluation of a pose: {one.triangles:,} triangles, {one.width}×{one.height}, "  # noqa: RUF001
        f"{one.covered_px:,} covered pixels",
        f"{report.machine['cpu']}, {report.machine['cores']} cores; "
        f"{_drawn_by(report)}. Medians. "
        "The paper's own figures (pale) are from its machine of 2010.",
        tuple(bars),
        tuple(panels),
    )


def _panel(series: str, points: Sequence[ScalingTime]) -> Panel:
    """Its note says how each path's time grew, and what the fused one's is made of at both ends."""
    found = {
        (path, stage): sorted(
            (p for p in points if (p.row.path, p.row.stage) == (path, stage)), key=lambda p: p.x
        )
        for path, stage in CURVES
        # Stages come from ``covers``, whose image of the whole photo the fused path does not make.
        if stage == "total" or series != PHOTO
    }
    found = {key: curve for key, curve in found.items() if curve}
    curves, notes = [], []
    for key, curve in found.items():
        band = curve if key[1] == "total" else []
        curves.append(
            Curve(
                CURVES[key],
                tuple(p.x for p in curve),
                tuple(p.row.ms_median for p in curve),
                tuple(p.row.ms_min for p in band),
                tuple(p.row.ms_max for p in band),
            )
        )
        if band:
            more = curve[-1].x / curve[0].x
            longer = curve[-1].row.ms_median / curve[0].row.ms_median
            notes.append(
                f"{CURVES[key]}: {more:,.3g} times as many take {longer:.2g} times as long"
            )
    if ("d", "moments") in found:
        draw, sums = found["d", "rasterise"], found["d", "moments"]
        ends = [(sums[i].row.ms_median, draw[i].row.ms_median) for i in (0, -1)]
        shares = [f"{a / max(a + b, 1e-9):.0%} is the sum" for a, b in ends]
        notes.append(f"fused, first to last: {', '.join(shares)}")
    return Panel(LABELS[series], tuple(curves), "\n".join(notes))
