"""A study: its plan, its folder, trials on all processors (a row each as soon as it is done)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, Literal, get_args

from poseviewer.errors import PoseFileError, SettingsError
from poseviewer.evaluation.bop_estimates import bop_folder, bop_tasks
from poseviewer.evaluation.cases import CASES, STARTS, Case, load_cases, load_starts
from poseviewer.evaluation.photos import (
    DRAWN,
    KINDS,
    Kind,
    Reading,
    demo_photo,
    draw_start,
    make_photos,
    make_seed,
)
from poseviewer.evaluation.report import bop_table, study_table
from poseviewer.evaluation.trials import KEY, Task, Trial, open_model, run_all
from poseviewer.figures.text_table import Table
from poseviewer.files.checks import read_json
from poseviewer.files.demo import demo_case
from poseviewer.files.formats.bop_models import MODELS_INFO
from poseviewer.files.table import RowTable
from poseviewer.files.writing import make_folder, sha256_of, write_json, write_whole
from poseviewer.fit.settings import FitSettings, Limits, Method, PixelsName
from poseviewer.geometry.camera import Pose

ABOUT, TRIALS, SUMMARY, PHOTOS = (
    *("study.json", "trials.csv", "study.md"),
    "photos",
)
READINGS: tuple[Reading, ...] = get_args(Reading)
SMALLEST_SIDE_PX, LARGEST_PERCENT = 32, 100.0
EXPLAINED = (
    "Found: within 1 px where OpenGL drew the photo, else within the accuracy of the truth + 1 % "
    "of the model's size in the photo, as which errors at start and end (medians) are given. Made "
    "worse: by more than 1 % and that accuracy. Called found: by the verdict; wrongly: what is not "
    "within + 2 %."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Plan of a study: the paper's deviations of a vehicle's parameters; with ``real`` fixed
    starts on photos with known poses; with ``bop`` published estimates.
    """

    out: Path
    method: Method = "default"
    pixels: PixelsName | None = None
    """None: all that the method has for a kind of photo."""
    limits: Limits = field(default_factory=Limits)
    starts: int = 10
    """For each kind of photo, pixels, reading and deviation."""
    photos: int = 5
    """Synthetic ones of each kind; starts take turns on them."""
    deviations: tuple[float, ...] = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
    """Per cent."""
    readings: tuple[Reading, ...] = READINGS
    kinds: tuple[Kind, ...] = tuple(KINDS)
    size: tuple[int, int] = (640, 480)
    """Size of synthetic photos, px."""
    model: Path | None = None
    """Model of a vehicle for synthetic photos; None: the bundled one."""
    seed: int = 0
    real: Path | None = None
    """Folder of ``cases.json`` and ``starts.json``."""
    degrees: tuple[int, ...] = (5, 15)
    cases: str = ""
    """A pattern of their ids, see ``load_cases``; empty: all."""
    draws: int = 5
    among_others: bool = False
    """Whether the true poses of the other cases of each photo are given."""
    bop: Path | None = None
    """A table of BOP results."""
    dataset: Path | None = None
    """Folder of ``models`` and ``test``; None: the nearest above the table."""

    def __post_init__(self) -> None:
        for name, known in (("readings", READINGS), ("kinds", KINDS)):
            for item in getattr(self, name):
                if item not in known:
                    raise SettingsError(f"--{name} {item}: there are {', '.join(known)}")
        if max(self.deviations) > LARGEST_PERCENT:
            raise SettingsError(f"--deviations {max(self.deviations):g}: 100 % is the most")
        if min(self.size) < SMALLEST_SIDE_PX:
            raise SettingsError(f"--size: each side needs {SMALLEST_SIDE_PX} px at least")

    def settings(self, kind: Kind) -> list[FitSettings]:
        """Settings of fits of a kind.

        The paper's method takes the whole photo on black ground, as the paper did; both sets of
        pixels on another background; the clipped one on the demo's photos.
        """
        names: tuple[PixelsName, ...]
        if self.pixels:
            names = (self.pixels,)
        elif self.method == "default":
            names = ("near",)
        else:
            names = {"plain": ("whole",), "background": ("whole", "clip")}.get(kind, ("clip",))
        return [
            FitSettings(self.method, "vehicle", pixels=name, limits=self.limits) for name in names
        ]

    @property
    def free_body_settings(self) -> FitSettings:
        """Settings of fits of models that may be no vehicles."""
        pixels = self.pixels or "near"
        return FitSettings(self.method, "free-body", pixels=pixels, limits=self.limits)

    @property
    def kind(self) -> Literal["deviations", "real", "bop"]:
        """Name of the study."""
        return "bop" if self.bop else "real" if self.real else "deviations"

    def about(self) -> dict[str, Any]:
        """Describe what all rows of a folder have in common."""
        files, more = [self.model or demo_case().model], {}
        if self.bop:
            files = [self.bop, bop_folder(self.bop, self.dataset) / "models" / MODELS_INFO]
        elif self.real:
            files, more = (
                [self.real / CASES, self.real / STARTS],
                {"among_others": self.among_others},
            )
        else:
            more = {"size": [*self.size], "photos": self.photos, "seed": self.seed}
        for path in files:
            if not path.is_file():
                raise PoseFileError(f"{path}: there is no such file; name one that is there")
        hashes = {path.name: sha256_of(path) for path in files}
        return {"evaluations": self.limits.evaluations, "study": self.kind, **more, "files": hashes}


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A study with its folder open."""

    out: Path
    table: RowTable[Trial]
    """With the rows of earlier runs."""
    left: Sequence[Task]
    """The tasks that have no row yet."""
    targets: int
    """Targets of a BOP data set, with and without an estimate."""
    groups: Mapping[str, str]
    """Lines of the report by the names of cases."""

    def trials(self, jobs: int) -> Iterator[Trial]:
        """Run what is left; each row is in the file when it comes."""
        for row in run_all(self.left, jobs):
            self.table.append(row)
            yield row


def open_study(plan: Plan, tell: Callable[[str], None]) -> Run:
    """Make the photos, or read cases and starts; see which trials are left."""
    about, targets = plan.about(), 0
    tasks: Sequence[Task] = ()
    settings = plan.free_body_settings
    if plan.bop:
        folder = bop_folder(plan.bop, plan.dataset)
        tasks, targets = bop_tasks(plan.bop, folder, replace(settings, keep_start=True))
    elif plan.real:
        chosen = plan.real, plan.degrees, plan.draws, plan.cases
        tasks = real_tasks(*chosen, settings, plan.among_others)
    _open_folder(plan.out, about)
    table = RowTable(plan.out / TRIALS, Trial)
    tasks = tasks or deviation_tasks(plan, tell)
    done = {tuple(getattr(row, name) for name in KEY) for row in table.rows}
    left = [task for task in tasks if tuple(task.identity.values()) not in done]
    return Run(plan.out, table, left, targets, {task.case.name: task.case.group for task in tasks})


def write_report(run: Run) -> Table:
    """Write the summary of all rows in the folder; returns its table."""
    table, explained = study_table(run.table.rows, run.groups), EXPLAINED
    if run.targets:
        table = bop_table(run.table.rows, run.targets)
        explained = "A target without an estimate counts as not found."
    words = f"{len(run.table.rows):,} trials; `{TRIALS}` has them all. {explained}"
    text = f"# Reliability\n\n{table.as_markdown()}\n\n{words}\n"
    write_whole(run.out / SUMMARY, text.encode(), SettingsError)
    return table


def deviation_tasks(plan: Plan, tell: Callable[[str], None]) -> list[Task]:
    """Make the photos of all kinds, or take those that are there, and draw the starts."""
    tasks = []
    for kind in plan.kinds:
        cases = [demo_photo(kind)] if kind not in DRAWN else _drawn(plan, kind, tell)
        free_focal = kind == "photo-perspective"
        # Photo by photo: what a process has loaded serves the next trials as well.
        for draw in sorted(range(plan.starts), key=lambda draw: draw % len(cases)):
            index = draw % len(cases)
            case = cases[index]
            keypoints = open_model(case.mesh)[0].keypoints
            assert keypoints is not None  # it is a vehicle
            for settings, reading, percent in product(
                plan.settings(kind), plan.readings, plan.deviations
            ):
                seed = make_seed(plan.seed, kind, index, reading, f"{percent:g}", draw)
                share = percent / 100.0
                start = draw_start(keypoints, case.truth, free_focal, reading, share, seed)
                settings = replace(settings, free_focal=free_focal, seed=seed)
                tasks.append(Task(case, start, settings, reading, percent, draw=draw))
    return tasks


def _drawn(plan: Plan, kind: Kind, tell: Callable[[str], None]) -> list[Case]:
    folder = plan.out / PHOTOS
    tell(f"{kind}: drawing photos, or taking those in {folder}")
    count, model = min(plan.photos, plan.starts), plan.model or demo_case().model
    return make_photos(kind, count, folder, model, plan.size, plan.seed)


def real_tasks(
    folder: Path,
    degrees: Sequence[int],
    draws: int,
    pattern: str,
    settings: FitSettings,
    among_others: bool = False,
) -> list[Task]:
    """Make the trials of matching cases, ``among_others`` with their photo's other true poses."""
    starts = load_starts(folder, degrees, draws)
    givers = load_cases(folder) if among_others else []
    tasks = []
    for case in load_cases(folder, pattern):
        others = tuple(c for c in givers if c.photo == case.photo and c.name != case.name)
        for start in starts:
            if start.case == case.name:
                pose = Pose(case.truth.camera, start.camera_from_model)
                off = start.degrees, start.draw
                tasks.append(Task(case, pose, settings, "", 0.0, *off, others))
    return tasks


def _open_folder(out: Path, about: Mapping[str, Any]) -> None:
    """Make the folder, or see that its rows were made in the same way."""
    make_folder(out, SettingsError)
    path = out / ABOUT
    if not path.exists():
        write_json(path, about, SettingsError)
        return
    before = read_json(path)
    for key, value in about.items():
        if not isinstance(before, dict) or before.get(key) != value:
            was = before.get(key) if isinstance(before, dict) else before
            raise SettingsError(
                f"{out}: holds trials of another study ({key} was {was}, and is {value} now); "
                "name another folder"
            )
