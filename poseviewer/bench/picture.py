"""The report of a run as what a picture of it shows."""

from __future__ import annotations

from collections.abc import Sequence

from poseviewer.bench.paths import NAMES
from poseviewer.bench.report import PAPER_MS, by_path, main_rows
from poseviewer.bench.run import Report
from poseviewer.bench.scaling import COVERED, PHOTO, TRIANGLES, ScalingRow
from poseviewer.bench.timing import Row
from poseviewer.figures.bench_sheet import Bar, BenchSheet, Curve, Panel

STAGES = {
    "render": "draw",
    "rasterise": "draw",
    "moments": "sum",
    "moments and loss": "sum",
    "loss": "loss",
}
CURVES = {
    ("a", "total"): "pyrender and NumPy",
    ("d", "total"): "fused",
    ("d", "rasterise"): "  of it: rasterise",
    ("d", "moments"): "  of it: sum",
}
LABELS = {
    TRIANGLES: "triangles",
    COVERED: "pixels that the model covers",
    PHOTO: "pixels of the photo; the same number covered",
}


def make_sheet(report: Report) -> BenchSheet:
    """Bars of the paths' stages in the main case, and the scaling where it was measured."""
    rows = main_rows(report)
    case = rows[0]
    title = (
        f"One evaluation of a pose: {case.triangles:,} triangles, {case.width}×{case.height}, "  # noqa: RUF001
        f"{case.covered_px:,} covered pixels"
    )
    cpu, count = report.machine["cpu"], report.machine["cores"]
    opengl = report.versions["opengl"] or "none"
    subtitle = (
        f"{cpu}, {count} cores; OpenGL: {opengl}. Medians. "
        "The paper's own figures (pale) are from its machine of 2010."
    )
    series = dict.fromkeys(point.series for point in report.scaling)
    panels = (_panel(name, [p for p in report.scaling if p.series == name]) for name in series)
    return BenchSheet(title, subtitle, tuple(_bars(rows)), tuple(panels))


def _bars(rows: Sequence[Row]) -> list[Bar]:
    paths = by_path(rows)
    plain = paths.get("a", {}).get("total")
    bars = []
    for letter, found in paths.items():
        stages = [(STAGES[s], row.ms_median) for s, row in found.items() if s in STAGES]
        gain = plain.ms_median / found["total"].ms_median if plain and letter != "a" else 0.0
        note = f"{found['total'].ms_median:.3g} ms"
        note += f"   {gain:.1f} times as fast as a" if gain > 1.0 else ""
        bars.append(Bar(f"{letter}  {NAMES[letter]}", tuple(stages), note))
    paper = (("draw", PAPER_MS[0]), ("loss", PAPER_MS[1]))
    return [*bars, Bar("the paper's own, in 2010", paper, f"{sum(PAPER_MS):.0f} ms", True)]


def _panel(series: str, points: Sequence[ScalingRow]) -> Panel:
    curves = []
    for (path, stage), label in CURVES.items():
        some = _curve(points, path, stage)
        # Stages come from ``covers``, whose picture of the whole photo the fused path has not.
        if some and (stage == "total" or series != PHOTO):
            whole = some if stage == "total" else []
            curves.append(
                Curve(
                    label,
                    tuple(p.x for p in some),
                    tuple(p.row.ms_median for p in some),
                    tuple(p.row.ms_min for p in whole),
                    tuple(p.row.ms_max for p in whole),
                )
            )
    return Panel(LABELS[series], tuple(curves), _note(points))


def _note(points: Sequence[ScalingRow]) -> str:
    """How each path's time grew, and what the fused one's is made of at both ends."""
    lines = [
        f"{name}: {_growth(some)}"
        for letter, name in (("a", "pyrender and NumPy"), ("d", "fused"))
        if (some := _curve(points, letter, "total"))
    ]
    draw, sums = _curve(points, "d", "rasterise"), _curve(points, "d", "moments")
    if draw and sums and points[0].series != PHOTO:
        lines.append(
            f"fused, first to last: {_share(sums[0], draw[0])}, {_share(sums[-1], draw[-1])}"
        )
    return "\n".join(lines)


def _growth(curve: Sequence[ScalingRow]) -> str:
    first, last = curve[0], curve[-1]
    more, longer = last.x / first.x, last.row.ms_median / first.row.ms_median
    return f"{more:,.3g} times as many take {longer:.2g} times as long"


def _share(sums: ScalingRow, draw: ScalingRow) -> str:
    whole = max(sums.row.ms_median + draw.row.ms_median, 1e-9)
    return f"{sums.row.ms_median / whole:.0%} is the sum"


def _curve(points: Sequence[ScalingRow], letter: str, stage: str) -> list[ScalingRow]:
    """In the order of x."""
    some = [p for p in points if (p.row.path, p.row.stage) == (letter, stage)]
    return sorted(some, key=lambda p: p.x)
