"""Run a study, or the rest of one: trials on all processors, a row each as soon as it is done."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from poseviewer.errors import SettingsError
from poseviewer.figures.save import save_figure
from poseviewer.figures.study_sheet import make_study_sheet
from poseviewer.figures.text_table import Table
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.table import RowTable
from poseviewer.files.writing import write_whole
from poseviewer.study.backgrounds import load_backgrounds
from poseviewer.study.cars import load_cars
from poseviewer.study.photos import DRAWN, TRACED, Studio, StudyPhoto, make_photos
from poseviewer.study.plan import RealPlan, StudyPlan, open_folder
from poseviewer.study.pool import run_all
from poseviewer.study.real import RealTrial, real_tasks, run_real_trial
from poseviewer.study.real_report import real_table
from poseviewer.study.report import lines_of, panels_of, study_table
from poseviewer.study.trial import Task, Trial, run_trial

TRIALS, SUMMARY, FIGURE, PHOTOS = "trials.csv", "study.md", "study.png", "photos"

Row = TypeVar("Row", Trial, RealTrial)


@dataclass(frozen=True, slots=True, eq=False)
class Run(Generic[Row]):
    """A study with its folder open."""

    out: Path
    table: RowTable[Row]
    """With the rows of earlier runs."""
    left: Sequence[Any]
    """The tasks that have no row yet."""
    work: Callable[[Any], Row]

    def trials(self, jobs: int) -> Iterator[Row]:
        """Run what is left; each row is in the file when it comes.

        Raises:
            PoseViewerError: a file cannot be read or written.
        """
        for row in run_all(self.work, self.left, jobs):
            self.table.append(row)
            yield row


def open_study(plan: StudyPlan, tell: Callable[[str], None]) -> Run[Trial]:
    """Make the photos, or find them made, and see which trials are left.

    Raises:
        PoseViewerError: a file cannot be read or written, or there is no OpenGL to draw photos.
    """
    open_folder(plan.out, plan.about())
    table = RowTable(plan.out / TRIALS, Trial)
    done = {trial.key for trial in table.rows}
    tasks = [task for task in _study_tasks(plan, tell) if task.key not in done]
    return Run(plan.out, table, tasks, run_trial)


def open_real(plan: RealPlan) -> Run[RealTrial]:
    """Read cases and starts, and see which trials are left.

    Raises:
        PoseViewerError: a file cannot be read or written.
    """
    about = plan.about()
    tasks = real_tasks(plan.folder, plan.degrees, plan.draws, plan.pattern, plan.settings)
    open_folder(plan.out, about)
    table = RowTable(plan.out / TRIALS, RealTrial)
    done = {trial.key for trial in table.rows}
    return Run(plan.out, table, [task for task in tasks if task.key not in done], run_real_trial)


def report(run: Run[Any]) -> Table:
    """Write the summary of all rows in the folder, and their figure; the table, for a terminal.

    Raises:
        SettingsError: they cannot be written.
    """
    if isinstance(run.table.rows[0], RealTrial):
        return _report_real(run)
    return _report_study(run)


def _report_study(run: Run[Trial]) -> Table:
    lines = lines_of(run.table.rows)
    table = study_table(lines)
    save_figure(run.out / FIGURE, make_study_sheet(panels_of(lines)))
    words = f"{len(run.table.rows):,} trials; `{TRIALS}` has them all.\n\n![Reliability]({FIGURE})"
    _save_summary(run.out, "Reliability", table, words)
    return table


def _report_real(run: Run[RealTrial]) -> Table:
    table = real_table(run.table.rows)
    words = (
        f"{len(run.table.rows):,} trials; `{TRIALS}` has them all. Found: within the accuracy of "
        "the truth + 1 %. Made worse: by more than that accuracy."
    )
    _save_summary(run.out, "Fits on photos with known poses", table, words)
    return table


def _save_summary(out: Path, title: str, table: Table, words: str) -> None:
    text = f"# {title}\n\n{table.as_markdown()}\n\n{words}\n"
    write_whole(out / SUMMARY, text.encode(), SettingsError)


def _study_tasks(plan: StudyPlan, tell: Callable[[str], None]) -> Iterator[Task]:
    for kind in plan.kinds:
        photos = _photos(plan, kind, tell)
        # Photo by photo: what a process has loaded serves the next trials as well.
        draws = sorted(range(plan.starts), key=lambda draw: draw % len(photos))
        for draw in draws:
            photo = photos[draw % len(photos)]
            for settings in plan.settings(kind):
                for reading in plan.readings:
                    for percent in plan.percents:
                        yield Task(photo, settings, reading, percent, draw, plan.seed)


def _photos(plan: StudyPlan, kind: Any, tell: Callable[[str], None]) -> Sequence[StudyPhoto]:
    if kind not in (*DRAWN, *TRACED):
        return load_cars(kind, plan.cars)
    folder = plan.out / PHOTOS
    folder.mkdir(exist_ok=True)
    tell(f"{kind}: drawing photos, or taking those in {folder}")
    count = min(plan.photos, plan.starts)
    return list(make_photos(_studio(plan, kind), kind, count, folder, tell))


def _studio(plan: StudyPlan, kind: str) -> Studio:
    mesh = load_mesh(plan.model_path)
    keypoints = load_keypoints(plan.model_path, mesh)
    if keypoints is None:
        raise SettingsError(
            f"{plan.model_path}: the study needs a vehicle, with MODEL.keypoints.json beside it or "
            "parts named like wheels"
        )
    backgrounds = load_backgrounds(plan.backgrounds) if kind.startswith("background") else []
    return Studio(
        plan.model_path, mesh, keypoints, plan.size, plan.parallel, backgrounds, plan.seed
    )
