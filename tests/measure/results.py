"""Tables of ``assets/docs/results.md`` and the README: ``python -m tests.measure.results FOLDER``.

Measures what FOLDER does not hold yet, so that a run that was cut off goes on, and writes the
tables between their marks: speed, the study on photos drawn here by both methods, the study on the
photos with known poses in $POSEVIEWER_DATA (../shared/data) and on its path-traced tabletops, each
object alone and among the others. Hours on two cores with ten starts; ``--starts``, ``--draws`` and
``--quick`` make it shorter.
"""

import argparse
import csv
import io
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import redirect_stdout
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from poseviewer.cli import main as cli
from poseviewer.evaluation.cases import CASES, load_cases
from tests.measure.real import DATA

ROOT = Path(__file__).resolve().parents[2]
PAGE, README = ROOT / "assets" / "docs" / "results.md", ROOT / "README.md"
SETS = {
    "bmw_traced": "path-traced cars, painted otherwise than the model (exact truth)",
    "hope": "groceries, sharp and textured (truth good to 1 %)",
    "lmo": "small objects in clutter (truth off by up to 6 %)",
    "visp_dragon": "a printed dragon",
    "m3t_shampoo": "a shampoo bottle without texture",
    "car_audi_tts": "a car whose model is not exact",
}
"""What the sets of photos are called, in the order of the table."""
LMO_PERCENT = 6.0
"""How far the annotations of LINEMOD-Occlusion are off, of the object's size."""
Row = dict[str, str]


def measure(folder: Path, options: argparse.Namespace) -> None:
    """Run what is not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    speed = folder / "speed.md"
    if not speed.exists():
        printed = io.StringIO()
        with redirect_stdout(printed):
            _run("bench", *(["--quick"] if options.quick else []))
        speed.write_text(printed.getvalue().strip() + "\n", encoding="utf-8")
    for method in ("default", "paper"):
        _run("study", "--out", folder / "study", "--method", method, "--starts", options.starts)
    real = "--real", DATA, "--degrees", options.degrees, "--draws", options.draws
    _run("study", "--out", folder / "real", *real)
    tabletops = "--real", DATA / "clutter", "--degrees", "15", "--draws", 1
    _run("study", "--out", folder / "clutter", *tabletops)
    _run("study", "--out", folder / "among", *tabletops, "--among-others")


def _run(*words: object) -> None:
    code = cli.main([str(word) for word in words])
    if code:
        sys.exit(code)


def page_tables(folder: Path, options: str) -> dict[str, str]:
    """Contents of the page's marks, from what the folder holds, measured with ``options``."""
    rows = {name: _rows(folder / name / "trials.csv") for name in ("real", "clutter", "among")}
    newest = max(path.stat().st_mtime for path in folder.glob("*/trials.csv"))
    day = datetime.fromtimestamp(newest, UTC).date()
    real = {
        (title, f"{degrees}°"): [
            row for row in rows["real"] if (row["set"], row["degrees"]) == (name, degrees)
        ]
        for name, title in SETS.items()
        for degrees in ("5", "15", "30")
    }
    shares = 1.0, 1.5, 2.0, 3.0
    study = (folder / "study" / "study.md").read_text(encoding="utf-8").splitlines()
    return {
        "measured": f"Measured on {day} by one command, `python -m tests.measure.results FOLDER "
        f"{options}`, on {os.cpu_count()} processors.",
        "real": _error_table(real, (1.0, 2.0, 5.0)),
        "clutter": _error_table(_by_seen(rows["clutter"]), shares),
        "among": _error_table(_by_seen(rows["among"]), shares),
        "verdict": _verdict_table({"first table": rows["real"], "tabletops": rows["clutter"]}),
        "study": "\n".join(line for line in study if not line.startswith(("# ", "!["))).strip(),
        "speed": (folder / "speed.md").read_text(encoding="utf-8").strip(),
    }


def readme_rows(folder: Path) -> str:
    """Four rows for the README."""
    real, clutter = (_rows(folder / name / "trials.csv") for name in ("real", "clutter"))
    near = [row for row in real if row["degrees"] in ("5", "15")]
    seen = _by_seen(clutter)["90 % and more", "15°"]
    groups = {
        "path-traced cars": [row for row in near if row["set"] == "bmw_traced"],
        "groceries": [row for row in near if row["set"] == "hope"],
        "path-traced tabletops, object seen to 90 % and more": seen,
        "small objects in clutter (annotations off by up to 6 %)": [
            row for row in near if row["set"] == "lmo"
        ],
    }
    lines = [
        "| starts up to 15 degrees off | fits | error, median | within 1 % | within 5 % |",
        "|---|---:|---:|---:|---:|",
    ]
    for name, some in groups.items():
        end = _errors(some, "end")
        median = f"{np.median(end):.2f} %" if some else "-"
        lines.append(_line(name, len(some), median, *(_share(end <= x) for x in (1.0, 5.0))))
    return "\n".join(lines)


def _rows(table: Path) -> list[Row]:
    with table.open(newline="", encoding="utf-8") as file:
        return [row for row in csv.DictReader(file) if row["method"] == "default"]


def _by_seen(rows: Sequence[Row]) -> dict[tuple[str, str], list[Row]]:
    """Rows by how much of its object the photo shows; all of them last."""
    folder = DATA / "clutter"
    cases = load_cases(folder) if (folder / CASES).is_file() else []
    seen = {case.name: case.visible or 0.0 for case in cases}
    limits = {"90 % and more": (0.9, 1.1), "50 to 90 %": (0.5, 0.9), "35 to 50 %": (0.0, 0.5)}
    groups = {
        (name, "15°"): [row for row in rows if low <= seen.get(row["case"], 1.0) < high]
        for name, (low, high) in limits.items()
    }
    return {**groups, ("all", "15°"): list(rows)}


def _error_table(groups: Mapping[tuple[str, str], list[Row]], limits: Sequence[float]) -> str:
    within = [f"within {limit:g} %" for limit in limits]
    lines = [
        _line("photos", "off by", "fits", "start", "end", *within, "nearer"),
        f"|---|{'---:|' * (len(limits) + 5)}",
    ]
    for (name, off), rows in groups.items():
        if rows:
            start, end = _errors(rows, "start"), _errors(rows, "end")
            medians = f"{np.median(start):.1f} %", f"{np.median(end):.2f} %"
            shares = [_share(end <= limit) for limit in limits]
            lines.append(_line(name, off, len(rows), *medians, *shares, _share(end < start)))
    return "\n".join(lines)


def _verdict_table(groups: Mapping[str, Sequence[Row]]) -> str:
    lines = [
        _line("photos", "verdict", "fits", "right", "more than 5 % off"),
        "|---|---|---:|---:|---:|",
    ]
    for name, rows in groups.items():
        for word in ("found", "doubtful", "lost"):
            some = [row for row in rows if row["verdict"] == word]
            known = [LMO_PERCENT if row["set"] == "lmo" else 0.0 for row in some]
            limits = np.maximum([float(row["accuracy_percent"]) for row in some], known) + 1.0
            end = _errors(some, "end")
            right, wrong = np.sum(end <= limits), np.sum(end > 5.0)
            lines.append(_line(name, f"`{word}`", len(some), right, wrong))
    return "\n".join(lines)


def _errors(rows: Iterable[Row], which: str) -> np.ndarray:
    return np.array([float(row[f"error_percent_{which}"]) for row in rows])


def _share(chosen: np.ndarray) -> str:
    return f"{np.mean(chosen):.0%}".replace("%", " %") if len(chosen) else "-"


def _line(*cells: object) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def fill(path: Path, tables: Mapping[str, str]) -> None:
    """Replace what stands between the marks of each table of a file."""
    text = path.read_text(encoding="utf-8")
    for name, table in tables.items():
        begin, end = (f"<!-- {name}: {which} -->" for which in ("begin", "end"))
        before, rest = text.split(begin)
        text = f"{before}{begin}\n{table}\n{end}{rest.split(end)[1]}"
    path.write_text(text, encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--starts", type=int, default=10, help="of each point of the study (10)")
    parser.add_argument("--draws", type=int, default=2, help="starts of each real case (2)")
    parser.add_argument("--degrees", default="5,15,30", help="of the real starts (5,15,30)")
    parser.add_argument("--quick", action="store_true", help="the quick benchmark")
    options = parser.parse_args(arguments)
    measure(options.folder, options)
    chosen = f"--starts {options.starts} --draws {options.draws} --degrees {options.degrees}"
    fill(PAGE, page_tables(options.folder, chosen + " --quick" * options.quick))
    fill(README, {"results": readme_rows(options.folder)})
    return 0


if __name__ == "__main__":
    sys.exit(main())
