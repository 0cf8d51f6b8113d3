"""Run a study, or the rest of one: trials on all processors, a row each as soon as it is done."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from poseviewer.errors import SettingsError
from poseviewer.evaluation.bop import BopPlan, BopTask, BopTrial, bop_table, bop_tasks
from poseviewer.evaluation.photos import (
    DRAWN,
    Kind,
    Studio,
    StudyPhoto,
    load_backgrounds,
    load_cars,
    make_photos,
)
from poseviewer.evaluation.plan import RealPlan, StudyPlan, open_folder
from poseviewer.evaluation.pool import run_all
from poseviewer.evaluation.report import real_table, study_panels, study_table
from poseviewer.evaluation.trials import RealTask, RealTrial, Task, Trial, real_tasks
from poseviewer.figures.save import save_figure
from poseviewer.figures.study_sheet import make_study_sheet
from poseviewer.figures.text_table import Table
from poseviewer.files.table import RowTable
from poseviewer.files.writing import make_folder, write_whole
from poseviewer.starts.registration import load_model

TRIALS, SUMMARY, FIGURE, PHOTOS = "trials.csv", "study.md", "study.png", "photos"
AnyTrial = TypeVar("AnyTrial", Trial, RealTrial, BopTrial)
AnyTask = Task | RealTask | BopTask


@dataclass(frozen=True, slots=True, eq=False)
class Run(Generic[AnyTrial]):
    """A study with its folder open."""

    out: Path
    table: RowTable[AnyTrial]
    """With the rows of earlier runs."""
    left: Sequence[AnyTask]
    """The tasks that have no row yet."""
    targets: int = 0
    """Of a BOP data set: how many there are, with and without an estimate."""
    groups: Mapping[str, str] = field(default_factory=dict)
    """Of photos with known poses: the line of the report that a case belongs to."""

    def trials(self, jobs: int) -> Iterator[AnyTrial]:
        """Run what is left; each row is in the file when it comes."""
        for row in run_all(self.left, jobs):
            self.table.append(row)
            yield row


def open_study(plan: StudyPlan | RealPlan | BopPlan, tell: Callable[[str], None]) -> Run[Any]:
    """Make the photos, or find them made, or read cases and starts; see which trials are left."""
    about, targets = plan.about(), 0
    tasks: Sequence[AnyTask] = []
    if isinstance(plan, RealPlan):
        tasks = real_tasks(
            plan.folder, plan.degrees, plan.draws, plan.cases, plan.settings, plan.among_others
        )
    elif isinstance(plan, BopPlan):
        tasks, targets = bop_tasks(plan)
    open_folder(plan.out, about)
    table: RowTable[Any]
    if isinstance(plan, RealPlan):
        table = RowTable(plan.out / TRIALS, RealTrial)
    elif isinstance(plan, BopPlan):
        table = RowTable(plan.out / TRIALS, BopTrial)
    else:
        table = RowTable(plan.out / TRIALS, Trial)
        tasks = _study_tasks(plan, tell)
    names = list(tasks[0].identity) if tasks else []
    done = {tuple(getattr(row, name) for name in names) for row in table.rows}
    left = [task for task in tasks if tuple(task.identity.values()) not in done]
    groups = {task.case.name: task.case.group for task in tasks if isinstance(task, RealTask)}
    return Run(plan.out, table, left, targets, groups)


def write_report(run: Run[Any]) -> Table:
    """Write the summary of all rows in the folder, and their figure; the table, for a terminal."""
    rows = run.table.rows
    words = f"{len(rows):,} trials; `{TRIALS}` has them all."
    if isinstance(rows[0], BopTrial):
        title, table = "Fits from published estimates", bop_table(rows, run.targets)
        words += " A target without an estimate counts as not found."
    elif isinstance(rows[0], RealTrial):
        title, table = "Fits on photos with known poses", real_table(rows, run.groups)
        words += (
            " Found, +2 %: within the accuracy of the truth + 1 %, + 2 %. Made worse: by more than "
            "that accuracy. Called found: by the verdict; wrongly: what is not within + 2 %."
        )
    else:
        title, table = "Reliability", study_table(rows)
        save_figure(run.out / FIGURE, make_study_sheet(study_panels(rows)))
        words += f"\n\n![Reliability]({FIGURE})"
    text = f"# {title}\n\n{table.as_markdown()}\n\n{words}\n"
    write_whole(run.out / SUMMARY, text.encode(), SettingsError)
    return table


def _study_tasks(plan: StudyPlan, tell: Callable[[str], None]) -> list[Task]:
    tasks = []
    for kind in plan.kinds:
        photos = _photos(plan, kind, tell)
        # Photo by photo: what a process has loaded serves the next trials as well.
        for draw in sorted(range(plan.starts), key=lambda draw: draw % len(photos)):
            tasks += [
                Task(photos[draw % len(photos)], settings, reading, percent, draw, plan.seed)
                for settings in plan.settings(kind)
                for reading in plan.readings
                for percent in plan.deviations
            ]
    return tasks


def _photos(plan: StudyPlan, kind: Kind, tell: Callable[[str], None]) -> list[StudyPhoto]:
    if kind not in DRAWN:
        return load_cars(kind, plan.cars)
    folder = plan.out / PHOTOS
    make_folder(folder, SettingsError)
    tell(f"{kind}: drawing photos, or taking those in {folder}")
    path = plan.model_path
    model = load_model(path)
    if model.keypoints is None:
        raise SettingsError(
            f"{path}: the study needs a vehicle, with MODEL.keypoints.json beside it or parts "
            "named like wheels"
        )
    backgrounds = load_backgrounds(plan.backgrounds) if kind == "background" else []
    studio = Studio(
        path,
        model.mesh,
        model.keypoints,
        plan.size,
        plan.projection == "parallel",
        backgrounds,
        plan.seed,
    )
    return list(make_photos(studio, kind, min(plan.photos, plan.starts), folder))
