"""Fits from published estimates of a BOP data set, scored as BOP scores poses.

Hodan et al., *BOP Challenge 2020 on 6D Object Localization* (2020): the average recall over ten
thresholds of MSSD and MSPD. Where a fit is not sure to be better, its estimate is kept.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from poseviewer.errors import SettingsError
from poseviewer.evaluation.cases import Case
from poseviewer.evaluation.trials import Task, open_photo
from poseviewer.files.formats.bop import MODEL_FILE, load_bop_images
from poseviewer.files.formats.bop_models import MODELS_INFO, load_bop_estimates, load_bop_models
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.camera import Pose


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
    models, tasks, targets = load_bop_models(folder / "models" / MODELS_INFO), [], 0
    estimates = sorted(load_bop_estimates(table), key=lambda estimate: estimate.score)
    best = {(one.scene, one.image, one.object_id): one.place for one in estimates}
    for scene in sorted({key[0] for key in best}):
        place = folder / "test" / f"{scene:06d}"
        for image in load_bop_images(place):
            numbers = [target.object_id for target in image.objects]
            if len(set(numbers)) < len(numbers):
                raise SettingsError(
                    f"{place}: image {image.number} has an object more than once; `study --bop` "
                    "tells no such objects apart"
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
                path = place / image.photo
                photo = open_photo(path)
                camera = replace(image.camera, width=photo.width, height=photo.height)
                name, mesh = f"object {number}", folder / "models" / MODEL_FILE.format(number)
                case = Case(
                    f"{scene}/{image.number}/{number}", name, path, mesh,
                    Pose(camera, target.place), bop=models[number],
                )  # fmt: skip
                tasks.append(Task(case, Pose(camera, start), settings))
    if not tasks:
        raise SettingsError(f"{table}: no estimate of a target in {folder / 'test'}")
    tasks.sort(key=lambda task: task.case.mesh)  # what a process has loaded serves again
    return tasks, targets
