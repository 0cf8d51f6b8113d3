"""``assets/docs/results.md`` and the rows of the README: speed, reliability, accuracy, verdict.

``python -m tests.measure.results FOLDER`` measures what FOLDER does not hold yet, so that a run
that was cut off goes on, and writes both from it: the benchmark, the study on photos drawn here by
both methods, the study on the photos with known poses in ``POSEVIEWER_DATA`` (``../shared/data``)
and on its path-traced tabletops, each object alone and among the others. Hours on two cores with
ten starts; ``--starts``, ``--draws`` and ``--quick`` make it shorter.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import redirect_stdout
from datetime import UTC, date, datetime
from pathlib import Path
from string import Template

import numpy as np

from poseviewer.cli import main as cli

ROOT = Path(__file__).resolve().parents[2]
PAGE, README = ROOT / "assets" / "docs" / "results.md", ROOT / "README.md"
BEGIN, END = "<!-- results: begin -->", "<!-- results: end -->"
SETS = {
    "bmw_traced": "path-traced cars, painted otherwise than the model (exact truth)",
    "hope": "groceries, sharp and textured (truth good to 1 %)",
    "lmo": "small objects in clutter (truth off by up to 6 %)",
    "visp_dragon": "a printed dragon",
    "m3t_shampoo": "a shampoo bottle without texture",
    "car_audi_tts": "a car whose model is not exact",
    "clutter": "path-traced tabletops (exact truth)",
}
"""What the sets of photos are called; those not named here go by their own names."""
SHARES, SHARES_OF_TABLETOPS = (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0)
"""Limits in per cent within which shares of ends are told; the truths of tabletops are exact."""
NOT_MEASURED = "Not measured in this run."
Row = dict[str, str]


def measure(folder: Path, data: Path, options: argparse.Namespace) -> None:
    """Run what is not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    page = folder / "bench.md"
    if not page.exists():
        printed = io.StringIO()
        quick = ["--quick"] if options.quick else []
        with redirect_stdout(printed):
            _run("bench", "--json", folder / "bench.json", *quick)
        text = printed.getvalue().split("\nrows: ")[0]
        page.write_text(text.strip() + "\n", encoding="utf-8")
    for method in ("default", "paper"):
        _run("study", "--out", folder / "study", "--method", method, "--starts", options.starts)
    real = "--real", data, "--degrees", options.degrees, "--draws", options.draws
    _run("study", "--out", folder / "real", *real)
    tabletops = "--real", data / "clutter", "--degrees", "15", "--draws", 1
    _run("study", "--out", folder / "clutter", *tabletops)
    _run("study", "--out", folder / "among", *tabletops, "--among-others")


def _run(*words: object) -> None:
    code = cli.main([str(word) for word in words])
    if code:
        sys.exit(code)


def page_of(folder: Path, today: date, options: str) -> str:
    """The results page, from what the folder holds; ``options`` are those it was measured with."""
    real, clutter = _rows(folder / "real"), _rows(folder / "clutter")
    study, bench = _text(folder / "study" / "study.md"), _text(folder / "bench.md")
    tables = {
        "date": today.isoformat(),
        "options": options,
        "cores": str(os.cpu_count()),
        "real": _error_table(real, lambda row: (row["set"], f"{row['degrees']}°")),
        "clutter": _error_table(clutter, _seen(), SHARES_OF_TABLETOPS),
        "among": _error_table(_rows(folder / "among"), _seen(), SHARES_OF_TABLETOPS),
        "verdict": _verdict_table((("first table", real), ("tabletops", clutter))),
        "study": _tables(study),
        "bench": bench.strip(),
    }
    page = Path(__file__).with_name("results_page.md").read_text(encoding="utf-8")
    return Template(page).substitute(tables)


def summary_of(folder: Path) -> str:
    """Four rows for the README."""
    real, clutter = _rows(folder / "real"), _rows(folder / "clutter")
    seen = _seen()
    groups = (
        ("path-traced cars", [r for r in real if _is(r, "bmw_traced")]),
        ("groceries", [r for r in real if _is(r, "hope")]),
        (
            "path-traced tabletops, object seen to 90 % and more",
            [r for r in clutter if seen(r)[0].startswith("90")],
        ),
        ("small objects in clutter (annotations off by up to 6 %)",
         [r for r in real if _is(r, "lmo")]),
    )  # fmt: skip
    lines = [
        "| starts up to 15 degrees off | fits | error, median | within 1 % | within 5 % |",
        "|---|---:|---:|---:|---:|",
        *(f"| {name} | {' | '.join(_shares(rows, (1.0, 5.0)))} |" for name, rows in groups),
    ]
    return "\n".join(lines)


def _is(row: Row, name: str) -> bool:
    return row["set"] == name and row["degrees"] in ("5", "15")


def _rows(study: Path) -> list[Row]:
    with (study / "trials.csv").open(newline="", encoding="utf-8") as file:
        return [row for row in csv.DictReader(file) if row["method"] == "default"]


def _seen() -> Callable[[Row], tuple[str, str]]:
    """How much of its object a row's photo shows, in three classes."""
    visible: dict[str, float] = {}
    cases = data_folder() / "clutter" / "cases.json"
    if cases.is_file():
        visible = {c["id"]: c["visible"] for c in json.loads(cases.read_text())["cases"]}

    def classed(row: Row) -> tuple[str, str]:
        share = visible.get(row["case"], 1.0)
        limits = ((0.9, "90 % and more"), (0.5, "50 to 90 %"), (0.0, "35 to 50 %"))
        return next(name for least, name in limits if share >= least), "15°"

    return classed


def _errors(rows: Iterable[Row], which: str) -> np.ndarray:
    return np.array([float(row[f"error_percent_{which}"]) for row in rows])


def _shares(rows: Sequence[Row], limits: Sequence[float]) -> list[str]:
    """Number of fits, median error, and shares of fits within each limit, per cent."""
    end = _errors(rows, "end")
    if not len(end):
        return ["0", *["-"] * (1 + len(limits))]
    shares = [f"{np.mean(end <= limit):.0%}".replace("%", " %") for limit in limits]
    return [str(len(end)), f"{np.median(end):.2f} %", *shares]


def _error_table(
    rows: Sequence[Row],
    group: Callable[[Row], tuple[str, str]],
    limits: Sequence[float] = SHARES,
) -> str:
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault(group(row), []).append(row)
    within = " | ".join(f"within {limit:g} %" for limit in limits)
    lines = [
        f"| photos | off by | fits | start | end | {within} | nearer |",
        f"|---|{'---:|' * (len(limits) + 5)}",
    ]
    table = sorted(groups.items(), key=lambda item: _order(item[0]))
    if len({off for _, off in groups}) == 1:
        table.append((("all", table[0][0][1]), list(rows)))
    for (name, off), some in table:
        count, end, *shares = _shares(some, limits)
        start = f"{np.median(_errors(some, 'start')):.1f} %"
        nearer = f"{np.mean(_errors(some, 'end') < _errors(some, 'start')):.0%}".replace("%", " %")
        cells = SETS.get(name, name), off, count, start, end, *shares, nearer
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _order(key: tuple[str, str]) -> tuple[int, str, int]:
    names = list(SETS)
    place = names.index(key[0]) if key[0] in names else len(names)
    return place, "" if key[0] in names else f"{100 - int(key[0][:2])}", int(key[1].rstrip("°"))


def _verdict_table(groups: Iterable[tuple[str, Sequence[Row]]]) -> str:
    lines = ["| photos | verdict | fits | right | more than 5 % off |", "|---|---|---:|---:|---:|"]
    for name, rows in groups:
        for word in ("found", "doubtful", "lost"):
            some = [row for row in rows if row["verdict"] == word]
            limits = [max(float(row["accuracy_percent"]), 6.0 * (row["set"] == "lmo")) + 1.0
                      for row in some]  # fmt: skip
            end = _errors(some, "end")
            right, wrong = int(np.sum(end <= limits)), int(np.sum(end > 5.0))
            lines.append(f"| {name} | `{word}` | {len(some)} | {right} | {wrong} |")
    return "\n".join(lines)


def _text(path: Path) -> str:
    """A part of the page; a run that was cut off may lack it."""
    return path.read_text(encoding="utf-8") if path.is_file() else NOT_MEASURED


def _tables(text: str) -> str:
    """A study's page without its title, and without its picture, which lies beside it."""
    lines = [line for line in text.splitlines() if not line.startswith(("# ", "!["))]
    return "\n".join(lines).strip()


def data_folder() -> Path:
    """Where the photos with known poses are."""
    return Path(os.environ.get("POSEVIEWER_DATA") or ROOT.parent / "shared" / "data")


def with_rows(readme: str, rows: str) -> str:
    """The README with other rows of results."""
    before, rest = readme.split(BEGIN)
    return f"{before}{BEGIN}\n{rows}\n{END}{rest.split(END)[1]}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and write the page and the README's rows."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--starts", type=int, default=10, help="of each point of the study (10)")
    parser.add_argument("--draws", type=int, default=2, help="starts of each real case (2)")
    parser.add_argument("--degrees", default="5,15,30", help="of the real starts (5,15,30)")
    parser.add_argument("--quick", action="store_true", help="the quick benchmark")
    parser.add_argument("--only-write", action="store_true", help="measure nothing")
    options = parser.parse_args(arguments)
    folder = options.folder
    if not options.only_write:
        measure(folder, data_folder(), options)
    if not all((folder / name / "trials.csv").is_file() for name in ("real", "clutter", "among")):
        parser.error(f"{folder}: holds no trials; leave out --only-write to measure them")
    newest = max(path.stat().st_mtime for path in folder.glob("*/trials.csv"))
    measured = datetime.fromtimestamp(newest, UTC).date()
    chosen = f"--starts {options.starts} --draws {options.draws} --degrees {options.degrees}"
    chosen += " --quick" if options.quick else ""
    PAGE.write_text(page_of(folder, measured, chosen), encoding="utf-8")
    text = README.read_text(encoding="utf-8")
    README.write_text(with_rows(text, summary_of(folder)), encoding="utf-8")
    print(f"page: {PAGE.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
