"""Run one row from its files to its result, in a process of this machine or on a cluster."""

import logging
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from poseviewer.api import FitResult, load
from poseviewer.batch.audit import audit_numbers, draw_comparison
from poseviewer.batch.job_table import COLUMNS, Job, file_stamp
from poseviewer.batch.result_folder import (
    PICTURES,
    POSES,
    Batch,
    JobResult,
    load_result,
    save_failure,
    save_result,
    standard_deviations,
)
from poseviewer.errors import BatchError, PoseViewerError, SettingsError
from poseviewer.files.mesh.size import distance_notes
from poseviewer.files.photo import save_image
from poseviewer.files.pose import load_pose, pose_bytes
from poseviewer.files.scene_assets import load_model
from poseviewer.render.attributes import Renderer
from poseviewer.render.overlay.styles import Picture
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.assets import ModelFile
from poseviewer.scene.settings import FitSettings
from poseviewer.starts.automatic import AUTOMATIC
from poseviewer.starts.instances import AutoStart

_log = logging.getLogger(__name__)

MODELS_KEPT = 8
"""Models that stay loaded in each process: a table rarely has more at a time."""
PICTURE_SIDE = 480
"""Longer side of the pictures of poses, in px: the report has them all inside."""


def run_row(job: Job, plan: Batch) -> JobResult:
    """Fit a row and save its result, unless it was fitted before.

    Raises:
        BatchError: the result cannot be saved.
    """
    known = load_result(plan.folder, job.key)
    if known is not None and not known.failed:
        return known
    if job.problem:
        return save_failure(plan.folder, job, job.problem)
    question = ""
    try:
        _check(job, plan)
        question = _ask_unit(job, plan)
        fit = _fit(job, plan)
        picture = draw_comparison(fit) if plan.is_audit else shrink_picture(fit.picture())
        more = audit_numbers(fit, job.is_hidden, question) if plan.is_audit else {}
        pose_bytes(Path(job.photo), fit.record)  # a number that no file can have is the row's
    except PoseViewerError as error:
        return save_failure(plan.folder, job, str(error), question)
    except Exception as error:  # noqa: BLE001 - the other rows must go on
        _log.debug("row %d", job.row, exc_info=error)
        return save_failure(plan.folder, job, f"{type(error).__name__}: {error}", question)
    return _save_fit(job, plan, fit, picture, more | {"question": question})


def _check(job: Job, plan: Batch) -> None:
    for column in COLUMNS:
        if not getattr(job, column):
            raise SettingsError(f"the row has no {column}; name a file in the column {column!r}.")
    if plan.is_audit and job.start == AUTOMATIC:
        raise SettingsError("the start auto in an audit; name the file of the given pose.")
    if job.rectangle() is not None and job.start != AUTOMATIC:
        raise SettingsError(
            f"a box with the start {job.start}; a box is for the start auto, empty the cell."
        )


def _ask_unit(job: Job, plan: Batch) -> str:
    """Return the question whether pose and model are in one unit where it seems not; or nothing."""
    if job.start == AUTOMATIC:
        return ""
    path, pose = job.path(job.model), load_pose(job.path(job.start), 1, 1).pose
    model, _ = _load_model_once(path, file_stamp(path), plan.settings)
    return "".join(distance_notes(model.content.mesh_without(plan.settings.without or ()), pose))


def _fit(job: Job, plan: Batch) -> FitResult:
    path, box = job.path(job.model), job.rectangle()
    model, renderer = _load_model_once(path, file_stamp(path), plan.settings)
    is_auto = job.start == AUTOMATIC
    features = plan.features if box is None else None
    start = AutoStart(box, features=features) if is_auto else job.path(job.start)
    # A renderer is for one thread at a time, and a cluster's worker may have several.
    own, files = None if renderer is None else renderer.clone(), (job.path(job.photo), model, start)
    return load(*files, plan.settings, mask=plan.mask, renderer=own).fit()


@lru_cache(maxsize=MODELS_KEPT)
def _load_model_once(
    path: Path,
    stamp: tuple[int, int],  # noqa: ARG001 - a changed file must be loaded again
    settings: FitSettings,
) -> tuple[ModelFile, Renderer | None]:
    """Load a model and make its renderer, once for all rows while the file is the same."""
    model = load_model(path)
    if settings.renderer == "opengl":
        return model, None
    mesh = model.content.mesh_without(settings.without or ())
    return model, make_renderer(mesh, settings.renderer)


def _save_fit(
    job: Job, plan: Batch, fit: FitResult, picture: Picture, more: dict[str, Any]
) -> JobResult:
    """Write the pose, the picture and, last, the result."""
    progress, verdict = fit.progress, fit.verdict
    assert progress is not None  # a fit ends with it
    pose_name, picture_name = result_files(job)
    names = "loss", "start_loss", "unexplained", "start_unexplained", "evaluations"
    numbers = {name: getattr(progress, name) for name in names}
    numbers |= {"seconds": round(progress.seconds, 3), **standard_deviations(fit.covariance)}
    reasons = more.pop("reasons", ())
    numbers |= more
    if verdict is not None:
        numbers |= {"verdict": verdict.label, "probability": round(verdict.probability, 4)}
        reasons = *verdict.reasons, *reasons
    numbers |= {"reasons": "\n".join(reasons)}
    result = JobResult(progress.status.value, pose=pose_name, picture=picture_name, **numbers)
    try:
        fit.save(plan.folder / pose_name)
        save_image(plan.folder / picture_name, picture)
        return save_result(plan.folder, job, result)
    except PoseViewerError as error:
        raise BatchError(f"{error} What is finished is kept: run it again to go on.") from error


def result_files(job: Job) -> tuple[str, str]:
    """Return the paths of a job's pose and picture, relative to the folder of results."""
    name = f"{Path(job.photo).stem[:60]}-{job.key}"
    return f"{POSES}/{name}.json", f"{PICTURES}/{name}.jpg"


def shrink_picture(picture: Picture) -> Picture:
    """Reduce a picture (height, width, 3) to ``PICTURE_SIDE``."""
    height, width = picture.shape[:2]
    share = min(1.0, PICTURE_SIDE / max(height, width))
    size = max(1, round(share * width)), max(1, round(share * height))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
