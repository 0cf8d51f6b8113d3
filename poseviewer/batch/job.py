"""One job from its files to its result, in a process of this machine or on a cluster."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from poseviewer.api import FitResult, load
from poseviewer.batch.results import (
    PICTURES,
    POSES,
    JobResult,
    as_row_of,
    failed_result,
    load_result,
    save_result,
)
from poseviewer.batch.table import COLUMNS, LAST, Job, file_stamp
from poseviewer.errors import BatchError, PoseViewerError, SettingsError
from poseviewer.files.photo import save_image
from poseviewer.fit.registration import LoadedModel
from poseviewer.fit.settings import FitSettings
from poseviewer.render.overlay.looks import Picture
from poseviewer.render.pool import Cloneable
from poseviewer.render.renderers import make_renderer
from poseviewer.render.types import Renderer
from poseviewer.starts.automatic import AUTOMATIC
from poseviewer.starts.registration import load_model

_log = logging.getLogger(__name__)

MODELS_KEPT = 8
"""How many models stay loaded in each process."""
PICTURE_SIDE = 480
"""Longer side of the pictures of the poses, px."""


@dataclass(frozen=True, slots=True)
class BatchPlan:
    """What all jobs of a batch share."""

    folder: Path
    """Of the results, absolute."""
    settings: FitSettings
    mask: Path | None = None


class StoppedError(Exception):
    """The batch was told to stop in the middle of a job."""


def run_job(job: Job, plan: BatchPlan, stopped: Callable[[], bool] = lambda: False) -> JobResult:
    """Fit a row and keep its result; at once where that was done before.

    Raises:
        BatchError: the result cannot be written, so that no other could.
        StoppedError: ``stopped`` became true.
    """
    found = load_result(plan.folder, job.key)
    if found is not None:
        return as_row_of(job, found)
    try:
        fitted = _fit(job, plan, stopped)
        picture = smaller(fitted.picture())
    except PoseViewerError as error:
        return failed_result(job, str(error))
    except StoppedError:
        raise
    except Exception as error:  # noqa: BLE001 - one row's trouble is not the others'
        _log.debug("row %d", job.row, exc_info=error)
        return failed_result(job, f"{type(error).__name__}: {error}")
    return _keep(job, plan, fitted, picture)


def _fit(job: Job, plan: BatchPlan, stopped: Callable[[], bool]) -> FitResult:
    for column in COLUMNS:
        if not getattr(job, column):
            raise SettingsError(f"the row has no {column}; name a file in the column {column!r}.")
    model_path = job.path(job.model)
    model, renderer = _open_model(model_path, file_stamp(model_path), plan.settings)

    def watch(_progress: object = None) -> None:
        if stopped():
            raise StoppedError

    case = load(
        job.path(job.photo),
        model,
        _start_of(job, plan),
        plan.settings,
        box=job.rectangle(),
        watch=watch,
        mask=plan.mask,
        # A renderer is for one thread at a time, and a cluster's worker may have several.
        renderer=renderer.clone() if isinstance(renderer, Cloneable) else None,
    )
    return case.fit(watch=watch)


def _start_of(job: Job, plan: BatchPlan) -> str | Path:
    if job.start == AUTOMATIC:
        return AUTOMATIC
    if job.start != LAST:
        return job.path(job.start)
    above = (load_result(plan.folder, key) for key in job.above)
    nearest = next((result for result in above if result is not None), None)
    if nearest is None:
        raise SettingsError(
            "the start is 'last', and no row just above ended in a pose; name a pose file in the "
            "first row of a series."
        )
    return plan.folder / nearest.pose


@lru_cache(maxsize=MODELS_KEPT)
def _open_model(
    path: Path,
    stamp: tuple[int, int],  # noqa: ARG001 - of the file, which may change: workers live long
    settings: FitSettings,
) -> tuple[LoadedModel, Renderer | None]:
    """A model and its renderer, once for all rows that name it while the file is the same."""
    model = load_model(path)
    model = replace(model, mesh=model.mesh.without(settings.without or ()))
    return model, make_renderer(model.mesh) if settings.renderer == "software" else None


def _keep(job: Job, plan: BatchPlan, fitted: FitResult, picture: Picture) -> JobResult:
    """Write the pose, the picture and, last, the result."""
    pose, drawn = result_files(job)
    progress = fitted.progress
    assert progress is not None  # it was searched for
    verdict = progress.verdict
    result = JobResult(
        job.row,
        job.photo,
        job.model,
        job.start,
        progress.status.value,
        loss=progress.loss,
        start_loss=progress.start_loss,
        unexplained=progress.unexplained,
        start_unexplained=progress.start_unexplained,
        evaluations=progress.evaluations,
        seconds=round(progress.seconds, 3),
        pose=pose,
        picture=drawn,
        verdict=verdict.word if verdict else "",
        probability=round(verdict.probability, 4) if verdict else None,
        reasons="\n".join(verdict.reasons) if verdict else "",
    )
    try:
        fitted.save(plan.folder / pose)
        save_image(plan.folder / drawn, picture)
        save_result(plan.folder, job, result)
    except PoseViewerError as error:
        raise BatchError(f"{error} What is finished is kept: run it again to go on.") from error
    return result


def result_files(job: Job) -> tuple[str, str]:
    """Where a job's pose and its picture are kept, from the folder of results."""
    name = f"{Path(job.photo).stem[:60]}-{job.key}"
    return f"{POSES}/{name}.json", f"{PICTURES}/{name}.jpg"


def smaller(picture: Picture) -> Picture:
    """A picture (height, width, 3) in the size of the report's."""
    height, width = picture.shape[:2]
    share = min(1.0, PICTURE_SIDE / max(height, width))
    size = max(1, round(share * width)), max(1, round(share * height))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
