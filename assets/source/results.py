"""Make the results page and the README's rows: ``python -m assets.source.results FOLDER``.

Measures what FOLDER does not hold yet, so that a run that was cut off goes on: speed, the paper's
experiment by both methods, and fits on the photos of $POSEVIEWER_DATA (../shared/data) and on its
path-traced tabletops, where each object is fitted alone and among the others.
"""

import argparse
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, date, datetime
from io import BytesIO
from pathlib import Path
from statistics import mean
from textwrap import fill

import msgspec
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from PIL import Image

from assets.source.data_folder import DATA
from poseviewer.api import make_registration
from poseviewer.cli import main as cli
from poseviewer.evaluation.cases import visibility_label
from poseviewer.evaluation.photos import make_photos
from poseviewer.evaluation.plan import DRAWN, Plan
from poseviewer.evaluation.report import (
    COLUMNS,
    LABELS,
    NONE,
    Share,
    calibration_table,
    group_by,
    median,
    reliability_panels,
    study_table,
)
from poseviewer.evaluation.speed import PATHS, SpeedReport
from poseviewer.evaluation.trials import KEY, Trial, TrialTask
from poseviewer.figures import landscape_sheet as sheet
from poseviewer.figures.map_archive import LossMaps
from poseviewer.figures.study_sheet import Panel, make_study_sheet
from poseviewer.figures.text_table import Table
from poseviewer.files.table import load_rows
from poseviewer.geometry.charts import short_name

ROOT = Path(__file__).resolve().parents[2]
PAGE, README = ROOT / "assets" / "docs" / "results.md", ROOT / "README.md"
CARS = "path-traced cars, painted otherwise than the model"
SINGLE = "a dragon, a bottle without texture, a car whose model is not exact"
SETS = {"bmw_traced": CARS, "hope": "groceries (truth good to 1 %)"}
SETS["lmo"] = "small objects in clutter (truth off by up to 6 %)"
SYMMETRIC = "10", "11"
"""Egg carton and glue among the objects of LINEMOD-Occlusion."""
SETS |= dict.fromkeys(("visp_dragon", "m3t_shampoo", "car_audi_tts"), SINGLE)
"""Names of the sets of photos."""
LMO_PERCENT = 6.0
"""Largest error of the annotations of LINEMOD-Occlusion, by the object's size."""
OF_PAPER, TRACED = {"whole": "plain", "clip": "background,photo-parallel"}, "bmw"
"""Photos of the study by pixels, and cases, that both searches are tried on by the paper's loss."""
SEARCHES = ("searches", "searches-real", "searches-clutter")
"""Studies by the search that is not a loss's own, from starts of the others."""
FEW = {TRACED: 2, "dragon": 4, "shampoo": 4, "audi": 4}
"""Least draws of cases that are so few, to have ten fits in a cell."""
HELD = ("delta_x", "delta_y", "psi_x", "psi_y")
"""Numbers that stay at the truth on maps of the rear wheel's place."""
FAR = 0.08
"""Deviation to which the paper finds all on a background."""
MIN_COUNT = 10
"""Fits that a point in a figure needs."""
WIDEST = 12
"""Characters of a line below an axis."""
ROW_INCHES = (3.9, 3.6)
"""Width of each of several maps side by side, and height of their sheet."""
PALETTE = 128
"""Colours of a picture."""
SEEN_FROM = (0.0, 0.5, 0.75, 0.9, 0.98)
"""Least visible shares of the classes in the figure of errors."""
Point = tuple[float, ...]
"""Place on the horizontal axis, value, and its interval."""


def measure(folder: Path, starts: int, draws: int) -> None:
    """Run what is not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "speed.json").exists():
        _run("bench", "--json", folder / "speed.json")
    for method in ("paper", "default"):
        _run("study", "--paper", "--out", folder / "paper", "--method", method, "--starts", starts)
    photos = "--out", folder / "real", "--real", DATA, "--degrees", "5,15", "--draws"
    _run("study", *photos, draws)
    for cases, least in FEW.items():
        _run("study", *photos, max(draws, least), "--cases", cases)
    tabletops = "--real", DATA / "clutter", "--degrees", "15", "--draws", (draws + 1) // 2
    _run("study", "--out", folder / "clutter", *tabletops)
    _run("study", "--out", folder / "among", *tabletops, "--among-others")
    near = "--out", folder / "searches", "--deviations", 100.0 * FAR, "--readings", "relative"
    _run("study", *near, "--search", "simplex", "--starts", starts)
    of_paper = "--loss", "paper", "--search"
    for pixels, kinds in OF_PAPER.items():
        photos = "--pixels", pixels, "--kinds", kinds
        _run("study", *near, *of_paper, "models", *photos, "--starts", starts)
    at = "--degrees", 15, "--draws"
    real = "--out", folder / "searches-real", "--real", DATA, *at
    _run("study", *real, 1, "--search", "simplex")
    clutter = "--out", folder / "searches-clutter", "--real", DATA / "clutter", *at, 1
    _run("study", *clutter, "--search", "simplex")
    for search in ("auto", "models"):
        _run("study", *real, FEW[TRACED], "--cases", TRACED, *of_paper, search)
    cars = "--cases", TRACED, "--free-focal", "--degrees", "5,15", "--draws", 3
    _run("study", "--out", folder / "focal", "--real", DATA, *cars)
    _run("study", "--out", folder / "symmetric", *_symmetric_targets(folder))


def _symmetric_targets(folder: Path) -> tuple[object, ...]:
    """Options of the study of estimates of the symmetric things of LINEMOD-Occlusion."""
    dataset, table = DATA / "lmo_bop", folder / "symmetric.csv"
    head, *lines = (dataset / "estimates" / "epos.csv").read_text().splitlines()
    table.write_text("\n".join([head, *(x for x in lines if x.split(",")[2] in SYMMETRIC)]))
    return "--bop", table, "--dataset", dataset


def _run(*words: object) -> None:
    code = cli.main([str(word) for word in words])
    if code:
        sys.exit(code)


def load_trials(folder: Path) -> dict[str, list[Trial]]:
    """Load all rows by study; an end on LINEMOD-Occlusion is right within its own accuracy."""
    studies = {}
    for name in ("paper", "real", "clutter", "among", *SEARCHES, "focal", "symmetric"):
        rows = load_rows(folder / name / "trials.csv", Trial)
        limit = LMO_PERCENT + 1.0
        rows.sort(key=lambda row: ([*SETS, row.set].index(row.set), row.degrees, -row.visible))
        studies[name] = [
            replace(row, found=row.error_percent_end < limit)
            if row.set == "lmo" or name == "symmetric"
            else row
            for row in rows
        ]
    return studies


def landscapes(folder: Path, size: int) -> dict[str, LossMaps]:
    """Maps of the paper's losses about the truth of the first drawn photos, by kind and pixels."""
    plan, maps = Plan(out=folder / "paper", loss="paper", photos=1), {}
    for kind in DRAWN:
        (case,) = make_photos(plan, kind, print)
        for settings in plan.settings(kind):
            task = TrialTask(case, case.truth, replace(settings, lock=HELD))
            registration = make_registration(*task.open(), 0)
            maps[f"{LABELS[kind]}, {settings.pixels}"] = registration.landscape(size=size)
    return maps


def landscape_row(maps: Mapping[str, LossMaps], share: float) -> Figure:
    """Draw maps side by side by their titles; a rectangle shows parameters off by a ``share``."""
    figure = Figure((ROW_INCHES[0] * len(maps), ROW_INCHES[1]), layout="constrained")
    all_axes = figure.subplots(1, len(maps), squeeze=False)[0]
    for axes, (title, of) in zip(all_axes, maps.items(), strict=True):
        piece = of.slices[0]
        scale, at = sheet.loss_range([piece.losses]), of.centre[[piece.first, piece.second]]
        sheet.draw_map(axes, piece, of.centre, scale)
        low, size = (1.0 - share) * at, 2.0 * share * at
        axes.add_patch(Rectangle(tuple(low), *size, fill=False, ls="--", ec=sheet.POSE_COLOUR))
        x, y = (short_name(of.names[index]) for index in (piece.first, piece.second))
        axes.set(title=title, xlabel=x, ylabel=y)
        figure.colorbar(ScalarMappable(scale, sheet.COLOURS), ax=axes)
    kinds = {**sheet.POSE_MARK, "label": "truth"}, sheet.MINIMUM_MARK
    marks = [Line2D([], [], ls="none", **kind) for kind in kinds]
    marks.append(Line2D([], [], label=f"{share:.0%} off", ls="--", c=sheet.POSE_COLOUR))
    figure.legend(handles=marks, loc="outside lower center", ncols=len(marks), frameon=False)
    return figure


def missed_table(trials: Iterable[Trial], maps: Mapping[str, LossMaps]) -> Table:
    """Tabulate misses of the paper's method, and where its loss is least on the maps."""
    rows, own = [], [trial for trial in trials if trial.method == "paper"]
    for name, some in group_by(own, lambda t: f"{LABELS[t.set]}, {t.pixels}").items():
        missed = [trial for trial in some if not trial.found]
        lower = sum(trial.loss_end < trial.loss_truth for trial in missed)
        least = _least(maps[name]) if name in maps else (NONE, NONE, NONE)
        rows.append((name, f"{len(missed)} of {len(some)}", str(lower), *least))
    columns = "photos", "missed", "with less loss than truth", "loss at truth", "least", "away"
    return Table("Misses of the paper's method, and the maps' least losses", columns, tuple(rows))


def _least(maps: LossMaps) -> tuple[str, ...]:
    """Losses at the centre of a map and at its minimum, and how far that is by the wheelbase."""
    (piece,) = maps.slices
    assert piece.minimum is not None  # all are known
    at, middle = [piece.first, piece.second], len(piece.losses) // 2
    away = np.linalg.norm((piece.minimum[:2] - maps.centre[at]) / maps.scales[at])
    losses = piece.losses[middle, middle], piece.minimum.loss
    return (*(f"{loss:.2f}" for loss in losses), f"{100.0 * away:.0f} %")


def error_table(studies: Mapping[str, Sequence[Trial]]) -> Table:
    """Tabulate errors by set and deviation, and on tabletops by how much is seen."""
    groups = group_by(studies["real"], lambda trial: (SETS[trial.set], trial.degrees))
    for name, words in (("clutter", "tabletops"), ("among", "tabletops, others given")):
        seen = group_by(studies[name], lambda trial: visibility_label(trial.visible))
        groups |= {(f"{words}, {label}", 15): some for label, some in seen.items()}
    rows = []
    for (name, degrees), some in groups.items():
        cells = name, f"{degrees}°", str(len(some)), COLUMNS["end"](some)
        rows.append((*cells, *(str(_within(some, limit)) for limit in (1.0, 2.0, 5.0))))
    columns = "photos", "off by", "fits", "error, %", "within 1 %", "within 2 %", "within 5 %"
    return Table(
        "Errors of fits by the default method, median and shares in % (95 % interval)",
        columns,
        tuple(rows),
    )


def _within(trials: Iterable[Trial], limit: float) -> Share:
    return Share.of(trials, lambda trial: trial.error_percent_end <= limit)


def search_table(studies: Mapping[str, Sequence[Trial]]) -> Table:
    """Tabulate each loss by each search, from the starts that both searches had."""

    def start(trial: Trial) -> tuple[object, ...]:
        named = (getattr(trial, name) for name in KEY if name != "method")
        return trial.method.partition(" by ")[0], *named

    def line(trial: Trial) -> tuple[str, str]:
        photos = "real" if trial.set in SETS else f"tabletops, {visibility_label(trial.visible)}"
        return "the study's" if trial.percent else photos, trial.method

    every = [t for name in ("paper", "real", "clutter", *SEARCHES) for t in studies[name]]
    starts, rows = group_by(every, start), []
    both = [trial for trial in every if len({t.method for t in starts[start(trial)]}) > 1]
    for names, some in sorted(group_by(both, line).items()):
        cells = *names, str(len(some)), str(Share.of(some)), COLUMNS["end"](some)
        rows.append((*cells, COLUMNS["evaluations"](some)))
    columns = "photos", "method", "fits", "right, %", "error, %", "evaluations"
    return Table("Each loss by each search: shares, and medians", columns, tuple(rows))


def error_panel(studies: Mapping[str, Sequence[Trial]]) -> Panel:
    """Errors on tabletops against the visible share."""
    lines: dict[str, list[Point]] = {}
    for study, name in {"clutter": "alone", "among": "the others' poses given"}.items():
        ordered = sorted(studies[study], key=lambda trial: trial.visible)
        classes = group_by(ordered, lambda t: int(np.searchsorted(SEEN_FROM, t.visible, "right")))
        lines[name] = [
            (100.0 * mean(t.visible for t in some), *median(t.error_percent_end for t in some))
            for some in classes.values()
            if len(some) >= MIN_COUNT
        ]
    axes = {"xlabel": "object seen, %", "ylabel": "error, %", "xlim": (30, 103), "yscale": "log"}
    return Panel(lines, axes | {"ylim": (0.1, 40.0)})


def calibration_panel(trials: Iterable[Trial]) -> Panel:
    """True share against the stated probability, by how much is seen."""
    judged = sorted((t for t in trials if t.probability >= 0.0), key=lambda t: t.probability)
    lines: dict[str, list[Point]] = {"true as stated": [(0.0,) * 4, (100.0,) * 4]}
    for label, some in sorted(group_by(judged, lambda t: visibility_label(t.visible)).items()):
        if len(some) < MIN_COUNT:
            continue
        pieces = np.array_split(range(len(some)), min(4, len(some) // MIN_COUNT))
        parts = [[some[i] for i in piece] for piece in pieces]
        lines[label or "share seen unknown"] = [
            (100.0 * mean(trial.probability for trial in part), *Share.of(part)) for part in parts
        ]
    axes = {"xlabel": "stated probability, %", "ylabel": "right, %"}
    return Panel(lines, axes | {"xlim": (-3, 103), "ylim": (-3, 103)})


def speed_panels(report: SpeedReport, trials: Sequence[Trial]) -> list[Panel]:
    """Milliseconds of an evaluation by path, and seconds of a fit by kind of photo."""
    kinds, fits = list(LABELS), {}
    groups = group_by(trials, lambda t: (f"a fit, {t.method}, {t.pixels}", kinds.index(t.set)))
    for (name, kind), some in sorted(groups.items()):
        fits.setdefault(name, []).append((kind, *median(trial.seconds for trial in some)))
    paths = [median(1e3 * seconds for seconds in path.seconds) for path in report.paths]
    times = {"an evaluation": [(place, *ms) for place, ms in enumerate(paths)]}
    names = [PATHS[path.name][1] for path in report.paths]
    return [_categories(times, names, "ms"), _categories(fits, [*LABELS.values()], "s")]


def _categories(lines: Mapping[str, list[Point]], names: Sequence[str], unit: str) -> Panel:
    """Panel of categories on a logarithmic scale."""
    words = [fill(name, WIDEST) for name in names]
    axes = {"xticks": range(len(names)), "xticklabels": words, "xlim": (-0.5, len(names) - 0.5)}
    axes |= {"ylabel": unit, "yscale": "log", "ylim": (0.2, 100.0)}
    return Panel(lines, axes, joined=False)


def write_page(folder: Path, page: Path, readme: Path, options: str, size: int = 41) -> None:
    """Write tables and figures of what the folder holds between the marks of both files."""
    studies = load_trials(folder)
    rows = [*studies["paper"], *studies["real"], *studies["clutter"]]
    rows += [*studies["focal"], *studies["symmetric"]]
    judged = [row for row in rows if row.method == "default"]
    speed = msgspec.json.decode((folder / "speed.json").read_bytes(), type=SpeedReport)
    newest = max(path.stat().st_mtime for path in folder.glob("*/trials.csv"))
    day, machine = datetime.fromtimestamp(newest, UTC).date(), speed.machine.partition(", load")[0]

    command = f"`python -m assets.source.results FOLDER{options}`"
    texts = {"measured": f"Measured until {day} by {command} on {machine}."}
    texts["searches"] = search_table(studies).as_markdown()
    maps = landscapes(folder, size)
    parts = {
        "reliability": (
            study_table(studies["paper"]),
            "Share found against the deviation of the start",
            make_study_sheet(reliability_panels(studies["paper"])),
        ),
        "landscapes": (
            missed_table(studies["paper"], maps),
            "The paper's losses about the truth, by the rear wheel's place",
            landscape_row(maps, FAR),
        ),
        "errors": (
            error_table(studies),
            "Errors on tabletops against the visible share",
            make_study_sheet([[error_panel(studies)]]),
        ),
        "verdict": (
            calibration_table(judged),
            "True share against the stated probability",
            make_study_sheet([[calibration_panel(judged)]]),
        ),
        "speed": (
            speed,
            "Times of an evaluation and of a fit",
            make_study_sheet([speed_panels(speed, studies["paper"])]),
        ),
    }
    for name, (table, words, figure) in parts.items():
        path = page.parent / "pictures" / f"results_{name}.png"
        picture = Image.open(BytesIO(sheet.figure_bytes(figure))).convert("RGB")
        picture.quantize(PALETTE).save(path, optimize=True)  # a third of the bytes
        texts[name] = f"![{words}](pictures/{path.name})\n\n{table.as_markdown()}"
    fill_in(page, texts)
    fill_in(readme, {"results": readme_table(studies, day)})


def readme_table(studies: Mapping[str, Sequence[Trial]], day: date) -> str:
    """Rows for the README, with method and day of the last measurement."""
    real = [trial for trial in studies["real"] if SETS[trial.set] != SINGLE]
    groups, rows = group_by(real, lambda trial: SETS[trial.set]), []
    groups |= group_by(studies["clutter"], lambda t: f"tabletops, {visibility_label(t.visible)}")
    for name, some in groups.items():
        shares = (str(_within(some, limit)) for limit in (1.0, 5.0))
        rows.append((name, str(len(some)), COLUMNS["end"](some), *shares))
    columns = "photos", "fits", "error, %", "within 1 %", "within 5 %"
    title = f"`--method default`, {day}, starts 5 and 15 degrees off: median error and shares in %"
    title += " (95 % interval)"
    return Table(title, columns, tuple(rows)).as_markdown()


def fill_in(path: Path, texts: Mapping[str, str]) -> None:
    """Replace what stands between the marks of each text of a file."""
    content = path.read_text(encoding="utf-8")
    for name, text in texts.items():
        begin, end = (f"<!-- {name}: {which} -->" for which in ("begin", "end"))
        before, rest = content.split(begin)
        content = f"{before}{begin}\n{text}\n{end}{rest.split(end)[1]}"
    path.write_text(content, encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and write page and README."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--starts", type=int, default=10, help="of each point of the paper's (10)")
    parser.add_argument("--draws", type=int, default=5, help="starts of each photo (5)")
    options = parser.parse_args(arguments)
    measure(options.folder, options.starts, options.draws)
    chosen = f" --starts {options.starts} --draws {options.draws}"
    write_page(options.folder, PAGE, README, chosen)
    return 0


if __name__ == "__main__":
    sys.exit(main())
