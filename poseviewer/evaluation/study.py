"""Studies: their folders, trials on all processors, and reports.

Poses of a BOP data set are scored as in Hodan et al., *BOP Challenge 2020 on 6D Object
Localization* (2020). Where a fit is not sure to be better, its estimate is kept.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.cluster import run_on_cluster
from poseviewer.errors import SettingsError
from poseviewer.evaluation.cases import CASES, STARTS, Case, load_cases, load_starts
from poseviewer.evaluation.photos import draw_start, make_photos, make_seed
from poseviewer.evaluation.plan import Plan
from poseviewer.evaluation.report import (
    bop_table,
    calibration_table,
    reliability_panels,
    study_table,
)
from poseviewer.evaluation.trials import KEY, Trial, TrialTask, fetch_model, fetch_photo
from poseviewer.figures.landscape_sheet import figure_bytes
from poseviewer.figures.study_sheet import make_study_sheet
from poseviewer.files.checks import InputFile
from poseviewer.files.demo import demo_case
from poseviewer.files.formats.bop import MODEL_FILE, load_bop_images
from poseviewer.files.formats.bop_models import MODELS_INFO, load_bop_estimates, load_bop_models
from poseviewer.files.table import append_row, load_rows
from poseviewer.files.writing import make_folder, sha256_of, write_json, write_whole
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh
from poseviewer.processes import run_in_processes
from poseviewer.scene.settings import FitSettings

ABOUT = "study.json"
"""File that tells how a study was made."""
TRIALS = "trials.csv"
"""Table of trials."""
SUMMARY = "study.md"
"""Report."""
FIGURE = "reliability.png"
"""Figure of the report."""
FOCAL_OFF = 1.1, 1.0 / 1.1
"""Factors of the starts' focal lengths, where these are searched for."""
EXPLAINED = (
    "Found, and right: within 1 px where OpenGL drew the photo, else within the accuracy of the "
    "truth + 1 %. Errors at start and end are medians, in % of the model's size in the photo. "
    "Called found: by the verdict. Intervals hold the true share with 95 %."
)
"""Legend of the tables."""


@dataclass(frozen=True, slots=True, eq=False)
class StudyRun:
    """A study with its folder open."""

    out: Path
    rows: list[Trial]
    """Rows of the table, those of earlier runs first."""
    left: Sequence[TrialTask]
    """The tasks that have no row yet."""
    targets: int
    """Targets of a BOP data set, with and without an estimate."""

    def trials(self, jobs: int, scheduler: str | None = None) -> Iterator[Trial]:
        """Run what is left, on a Dask ``scheduler`` or in ``jobs`` processes (1: in this one).

        Each row is in the file when it is yielded.
        """
        trials = ((task, task.run()) for task in self.left)
        if scheduler:
            named = {f"study-{self.out}-{[*task.identity.values()]}": task for task in self.left}
            trials = run_on_cluster(TrialTask.run, named, scheduler)
        elif jobs > 1:
            trials = run_in_processes(TrialTask.run, self.left, jobs)
        for _, trial in trials:
            if trial is None:
                raise SettingsError(
                    "a process of the study was ended from outside, perhaps for want of memory; "
                    "what was done is kept: run the same again, with fewer jobs"
                )
            append_row(self.out / TRIALS, trial)
            self.rows.append(trial)
            yield trial


def open_study(plan: Plan, tell: Callable[[str], None]) -> StudyRun:
    """Make photos, or read cases and starts, and find which trials are left."""
    tasks, targets = None, 0
    given = {name: getattr(plan, name) for name in ("out", "model", "real", "bop", "dataset")}
    # Workers of a cluster have another working folder.
    plan = replace(plan, **{name: path.resolve() for name, path in given.items() if path})
    if plan.bop:
        folder = bop_folder(plan.bop, plan.dataset)
        settings = replace(plan.settings()[0], keep_start=True)
        tasks, targets = bop_tasks(plan.bop, folder, settings)
        about, files = {"study": "bop"}, [plan.bop, folder / "models" / MODELS_INFO]
    elif plan.real:
        tasks = real_tasks(plan, plan.real)
        about = {"study": "real", "among_others": plan.among_others}
        about |= {"free_focal": True} if plan.free_focal else {}
        files = [plan.real / CASES, plan.real / STARTS]
    else:
        about = {"study": "deviations", "size": [*plan.size], "photos": plan.photos}
        about |= {"seed": plan.seed}
        files = [plan.model or demo_case().model]
    _open_folder(plan, about, files)  # photos are drawn into it
    tasks = deviation_tasks(plan, tell) if tasks is None else tasks
    rows = load_rows(plan.out / TRIALS, Trial)
    done = {tuple(getattr(row, name) for name in KEY) for row in rows}
    left = [task for task in tasks if tuple(task.identity.values()) not in done]
    return StudyRun(plan.out, rows, left, targets)


def write_report(run: StudyRun) -> str:
    """Write the summary of all rows, with a figure of deviations; returns its tables (Markdown)."""
    tables, explained = [study_table(run.rows)], EXPLAINED
    figure = ""
    if run.targets:
        tables = [bop_table(run.rows, run.targets)]
        explained = "A target without an estimate counts as not found."
    elif any(row.percent for row in run.rows):
        sheet = figure_bytes(make_study_sheet(reliability_panels(run.rows)))
        write_whole(run.out / FIGURE, sheet, SettingsError)
        figure = f"![Share found against the deviation]({FIGURE})\n\n"
    tables.append(calibration_table(run.rows))
    shown = "\n\n".join(table.as_markdown() for table in tables)
    words = f"{len(run.rows):,} trials; `{TRIALS}` has them all. {explained}"
    text = f"# Reliability\n\n{figure}{shown}\n\n{words}\n"
    write_whole(run.out / SUMMARY, text.encode(), SettingsError)
    return shown


def deviation_tasks(plan: Plan, tell: Callable[[str], None]) -> list[TrialTask]:
    """Make the photos of all kinds that are not there yet, and draw the starts."""
    tasks = []
    for kind in plan.kinds:
        cases = make_photos(plan, kind, tell)
        free_focal = kind == "photo-perspective"
        # Photo by photo: a process loads each once.
        for draw in sorted(range(plan.starts), key=lambda draw: draw % len(cases)):
            index = draw % len(cases)
            case = cases[index]
            keypoints = fetch_model(case.mesh)[0].keypoints
            assert keypoints is not None  # it is a vehicle
            for settings, reading, percent in product(
                plan.settings(kind), plan.readings, plan.deviations
            ):
                seed = make_seed(plan.seed, kind, index, reading, f"{percent:g}", draw)
                share = percent / 100.0
                start = draw_start(keypoints, case.truth, free_focal, reading, share, seed)
                settings = replace(settings, free_focal=free_focal, seed=seed)
                tasks.append(TrialTask(case, start, settings, reading, percent, draw=draw))
    return tasks


def real_tasks(plan: Plan, folder: Path) -> list[TrialTask]:
    """Make the trials of matching cases; among others with the true poses of these."""
    starts, (settings,) = load_starts(folder, plan.degrees, plan.draws), plan.settings()
    settings = replace(settings, free_focal=plan.free_focal)
    givers = load_cases(folder) if plan.among_others else []
    tasks = []
    for case in load_cases(folder, plan.cases):
        others = tuple(c for c in givers if c.photo == case.photo and c.name != case.name)
        for start in starts:
            if start.case == case.name:
                pose = Pose(case.truth.camera, start.camera_from_model.rigid)
                if plan.free_focal:
                    pose = _zoom(pose, fetch_model(case.mesh)[0].mesh, FOCAL_OFF[start.draw % 2])
                off = start.degrees, start.draw
                tasks.append(TrialTask(case, pose, settings, "", 0.0, *off, others))
    return tasks


def _zoom(pose: Pose, mesh: Mesh, factor: float) -> Pose:
    """Return the pose by another focal length at a distance where the model is as large."""
    chart = FreeBodyChart.near(mesh, pose, free_focal=True)
    return chart.to_pose(np.array([0.0] * 6 + [math.log(factor) / chart.focal_gain]))


def bop_folder(table: Path, dataset: Path | None) -> Path:
    """Find the data set's folder: the one named, or the nearest above the table."""
    for folder in table.resolve().parents if dataset is None else (dataset,):
        if (folder / "models" / MODELS_INFO).is_file():
            return folder
    raise SettingsError(
        f"{dataset or table}: no models/{MODELS_INFO} there or above; name the folder of a "
        "BOP data set"
    )


def bop_tasks(table: Path, folder: Path, settings: FitSettings) -> tuple[list[TrialTask], int]:
    """Make the fits of all targets from their best estimates by score, and count the targets."""
    models, tasks = load_bop_models(folder / "models" / MODELS_INFO), list[TrialTask]()
    targets = 0
    estimates = sorted(load_bop_estimates(table), key=lambda estimate: estimate.score)
    best = {(e.scene, e.image, e.object_id): e.camera_from_model for e in estimates}
    for scene in sorted({key[0] for key in best}):
        source = folder / "test" / f"{scene:06d}"
        for image in load_bop_images(source):
            numbers = [target.object_id for target in image.objects]
            if len(set(numbers)) < len(numbers):
                raise SettingsError(
                    f"{source}: image {image.number} has an object more than once; a study "
                    "cannot tell such objects apart"
                )
            if unknown := set(numbers) - set(models):
                raise SettingsError(
                    f"{folder / 'models' / MODELS_INFO}: no object {min(unknown)}, which image "
                    f"{image.number} has"
                )
            targets += len(numbers)
            for target in image.objects:
                number = target.object_id
                if (start := best.get((scene, image.number, number))) is None:
                    continue
                path = source / image.photo
                photo = fetch_photo(path)
                camera = replace(image.camera, width=photo.width, height=photo.height)
                name, mesh = f"object {number}", folder / "models" / MODEL_FILE.format(number)
                case = Case(
                    f"{scene}/{image.number}/{number}", name, path, mesh,
                    Pose(camera, target.camera_from_model), bop=models[number],
                )  # fmt: skip
                tasks.append(TrialTask(case, Pose(camera, start), settings))
    if not tasks:
        raise SettingsError(f"{table}: no estimate of a target in {folder / 'test'}")
    tasks.sort(key=lambda task: task.case.mesh)  # a process loads each model once
    return tasks, targets


def _open_folder(plan: Plan, about: dict[str, Any], files: Sequence[Path]) -> None:
    """Make the folder, or check that its rows were made in the same way."""
    about = {"evaluations": plan.limits.evaluations, **about}
    about["files"] = {path.name: sha256_of(path) for path in files}
    make_folder(plan.out, SettingsError)
    path = plan.out / ABOUT
    before = InputFile(path).load_object() if path.exists() else about
    if differs := [key for key, value in about.items() if before.get(key) != value]:
        raise SettingsError(
            f"{plan.out}: holds trials of another study ({', '.join(differs)} differs, see "
            f"{ABOUT}); name another folder"
        )
    write_json(path, about, SettingsError)
