"""One job from its files to its result, in a process of this machine or on a cluster."""

import logging
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from poseviewer.api import AutoStart, FitResult, load
from poseviewer.batch.job_table import COLUMNS, Job, file_stamp
from poseviewer.batch.results import (
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
from poseviewer.files.photo import save_image
from poseviewer.files.scene_assets import load_model
from poseviewer.render.attributes import Renderer
from poseviewer.render.overlay.styles import Picture
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.assets import ModelFile
from poseviewer.scene.settings import FitSettings
from poseviewer.starts.automatic import AUTOMATIC

_log = logging.getLogger(__name__)

MODELS_KEPT = 8
"""Number of models that stay loaded in each process."""
PICTURE_SIDE = 480
"""Longer side of the pictures of the poses, px."""


def run_job(job: Job, plan: Batch) -> JobResult:
    """Fit a row and keep its result, unless there is one; BatchError where none can be kept."""
    known = load_result(plan.folder, job.key)
    if known is not None and not known.failed:
        return known
    try:
        fitted = _fit(job, plan)
        picture = shrink_picture(fitted.picture())
    except PoseViewerError as error:
        return save_failure(plan.folder, job, str(error))
    except Exception as error:  # noqa: BLE001 - one row's trouble is not the others'
        _log.debug("row %d", job.row, exc_info=error)
        return save_failure(plan.folder, job, f"{type(error).__name__}: {error}")
    return _keep(job, plan, fitted, picture)


def _fit(job: Job, plan: Batch) -> FitResult:
    for column in COLUMNS:
        if not getattr(job, column):
            raise SettingsError(f"the row has no {column}; name a file in the column {column!r}.")
    path, box = job.path(job.model), job.rectangle()
    model, renderer = _load_model_once(path, file_stamp(path), plan.settings)
    start = AutoStart(box) if job.start == AUTOMATIC else job.path(job.start)
    if box is not None and not isinstance(start, AutoStart):
        raise SettingsError(f"a box with the start {job.start}; it is for auto, empty the cell.")
    # A renderer is for one thread at a time, and a cluster's worker may have several.
    own, files = None if renderer is None else renderer.clone(), (job.path(job.photo), model, start)
    return load(*files, plan.settings, mask=plan.mask, renderer=own).fit()


@lru_cache(maxsize=MODELS_KEPT)
def _load_model_once(
    path: Path,
    stamp: tuple[int, int],  # noqa: ARG001 - of the file, which may change: workers live long
    settings: FitSettings,
) -> tuple[ModelFile, Renderer | None]:
    """A model and its renderer, once for all rows that name it while the file is the same."""
    model = load_model(path)
    if settings.renderer == "opengl":
        return model, None
    mesh = model.content.mesh_without(settings.without or ())
    return model, make_renderer(mesh, settings.renderer)


def _keep(job: Job, plan: Batch, fitted: FitResult, picture: Picture) -> JobResult:
    """Write the pose, the picture and, last, the result."""
    progress, verdict = fitted.progress, fitted.verdict
    assert progress is not None  # it was searched for
    pose, drawn = result_files(job)
    names = "loss", "start_loss", "unexplained", "start_unexplained", "evaluations"
    numbers = {name: getattr(progress, name) for name in names}
    numbers |= {"seconds": round(progress.seconds, 3), **standard_deviations(fitted.covariance)}
    if verdict is not None:
        numbers |= {"verdict": verdict.label, "probability": round(verdict.probability, 4)}
        numbers |= {"reasons": "\n".join(verdict.reasons)}
    result = JobResult(progress.status.value, pose=pose, picture=drawn, **numbers)
    try:
        fitted.save(plan.folder / pose)
        save_image(plan.folder / drawn, picture)
        return save_result(plan.folder, job, result)
    except PoseViewerError as error:
        raise BatchError(f"{error} What is finished is kept: run it again to go on.") from error


def result_files(job: Job) -> tuple[str, str]:
    """Paths of a job's pose and picture, relative to the folder of results."""
    name = f"{Path(job.photo).stem[:60]}-{job.key}"
    return f"{POSES}/{name}.json", f"{PICTURES}/{name}.jpg"


def shrink_picture(picture: Picture) -> Picture:
    """Shrink a picture (height, width, 3) to the size of the report's."""
    height, width = picture.shape[:2]
    share = min(1.0, PICTURE_SIDE / max(height, width))
    size = max(1, round(share * width)), max(1, round(share * height))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
