"""Fits from published estimates of a BOP data set, scored as BOP scores poses.

Hodan et al., *BOP Challenge 2020 on 6D Object Localization* (2020): the average recall over ten
thresholds of MSSD and MSPD. Where a fit is not sure to be better, its estimate is kept.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from poseviewer.errors import SettingsError
from poseviewer.evaluation.cases import Case
from poseviewer.evaluation.trials import Task, Trial, open_photo
from poseviewer.figures.text_table import Table
from poseviewer.files.formats.bop import load_bop_images
from poseviewer.files.formats.bop_models import (
    MODELS_INFO,
    BopEstimate,
    load_bop_estimates,
    load_bop_models,
)
from poseviewer.fit.progress import Status
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose

MSSD_THRESHOLDS = np.arange(0.05, 0.501, 0.05)
"""Shares of the model's diameter."""
MSPD_THRESHOLDS = np.arange(5.0, 50.1, 5.0)
"""px of a photo that is 640 px wide."""


def bop_folder(table: Path, dataset: Path | None) -> Path:
    """Find the data set's folder: the one named, or the nearest above the table."""
    for folder in table.resolve().parents if dataset is None else (dataset,):
        if (folder / "models" / MODELS_INFO).is_file():
            return folder
    raise SettingsError(
        f"{dataset or table}: no models/{MODELS_INFO} there or above; name a BOP data set with "
        "--dataset FOLDER"
    )


def bop_tasks(table: Path, folder: Path, settings: FitSettings) -> tuple[list[Task], int]:
    """Make the fits of all targets from their best estimates by score; and count the targets."""
    models = load_bop_models(folder / "models" / MODELS_INFO)
    best: dict[tuple[int, int, int], BopEstimate] = {}
    for estimate in sorted(load_bop_estimates(table), key=lambda estimate: estimate.score):
        best[estimate.scene, estimate.image, estimate.object_id] = estimate
    tasks, targets = [], 0
    for case, number, scene, image in _cases(folder, sorted({key[0] for key in best})):
        targets += 1
        if number not in models:
            raise SettingsError(
                f"{folder / 'models' / MODELS_INFO}: no object {number}, which image {image} has"
            )
        if (scene, image, number) in best:
            photo = open_photo(case.photo)
            camera = replace(case.truth.camera, width=photo.width, height=photo.height)
            truth = replace(case.truth, camera=camera)
            start = Pose(camera, best[scene, image, number].place)
            tasks.append(Task(replace(case, truth=truth, bop=models[number]), start, settings))
    if not tasks:
        raise SettingsError(f"{table}: no estimate of a target in {folder / 'test'}")
    tasks.sort(key=lambda task: task.case.mesh)  # what a process has loaded serves again
    return tasks, targets


def _cases(folder: Path, scenes: Sequence[int]) -> Iterator[tuple[Case, int, int, int]]:
    """Each target with its object, scene and image; its camera is without the photo's size."""
    for scene in scenes:
        place = folder / "test" / f"{scene:06d}"
        for image in load_bop_images(place):
            numbers = [target.object_id for target in image.objects]
            if len(set(numbers)) < len(numbers):
                raise SettingsError(
                    f"{place}: image {image.number} has an object more than once; `study --bop` "
                    "tells no such objects apart"
                )
            for target in image.objects:
                number = target.object_id
                mesh = folder / "models" / f"obj_{number:06d}.ply"
                name, truth = f"{scene}/{image.number}/{number}", Pose(image.camera, target.place)
                case = Case(name, f"object {number}", place / image.photo, mesh, truth)
                yield case, number, scene, image.number


def average_recall(errors: FloatArray, thresholds: FloatArray, targets: int) -> float:
    """Share of ``targets`` within a threshold, mean over thresholds; no error counts as outside."""
    return float((errors[:, None] < thresholds).sum(axis=0).mean()) / targets


def bop_table(trials: Sequence[Trial], targets: int) -> Table:
    """Tabulate average recalls before and after, of all targets and of each object's fits."""
    rows = []
    for method in dict.fromkeys((trial.method, trial.pixels) for trial in trials):
        own = [trial for trial in trials if (trial.method, trial.pixels) == method]
        rows.append(_row("all targets", own, targets))
        for name in sorted({trial.set for trial in own}):
            some = [trial for trial in own if trial.set == name]
            rows.append(_row(f"fits of {name}", some, len(some)))
    return Table(
        "Average recall of BOP's MSSD and MSPD, of the estimates and after the fits",
        (
            *("targets", "method", "n", "MSSD before", "after", "MSPD before", "after"),
            *("estimate kept", "called found", "seconds"),
        ),
        tuple(rows),
    )


def _row(name: str, trials: Sequence[Trial], targets: int) -> tuple[str, ...]:
    recalls = [
        average_recall(np.array([getattr(trial, f"{key}_{when}") for trial in trials]), *limits)
        for key, limits in (
            ("mssd", (MSSD_THRESHOLDS, targets)),
            ("mspd", (MSPD_THRESHOLDS, targets)),
        )
        for when in ("start", "end")
    ]
    return (
        *(name, f"{trials[0].method}, {trials[0].pixels}", str(targets)),
        *(f"{recall:.3f}" for recall in recalls),
        f"{np.mean([trial.status == Status.KEPT.name for trial in trials]):.0%}",
        f"{np.mean([trial.verdict == 'found' for trial in trials]):.0%}",
        f"{np.median([trial.seconds for trial in trials]):.2g}",
    )
