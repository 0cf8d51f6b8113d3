"""One job from its files to its result, in a process of this machine or on a cluster."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

import cv2
import numpy as np

from poseviewer.api import FitResult, SceneCase, SetResult, load, load_views
from poseviewer.batch.results import (
    PICTURES,
    POSES,
    JobResult,
    as_row_of,
    failed_result,
    load_result,
    save_result,
    standard_deviations,
)
from poseviewer.batch.table import COLUMNS, LAST, Job, file_stamp
from poseviewer.errors import BatchError, PoseViewerError, SettingsError
from poseviewer.files.photo import save_image
from poseviewer.files.pose import ModelReference, PhotoReference, PoseRecord, save_pose
from poseviewer.files.scene import ObjectRecord, SceneRecord
from poseviewer.fit.registration import LoadedModel
from poseviewer.fit.settings import FitSettings
from poseviewer.render.overlay.looks import Picture
from poseviewer.render.pool import Cloneable
from poseviewer.render.renderers import make_renderer
from poseviewer.render.types import Renderer
from poseviewer.starts.automatic import AUTOMATIC
from poseviewer.starts.registration import among_others, load_model, load_registration

_log = logging.getLogger(__name__)

MODELS_KEPT = 8
"""How many models stay loaded in each process."""
HIDDEN = "Not searched for: it stands wholly behind other objects of the photo."
PICTURE_SIDE = 480
"""Longer side of the pictures of the poses, px."""


@dataclass(frozen=True, slots=True)
class BatchPlan:
    """What all jobs of a batch share."""

    folder: Path
    """Of the results, absolute."""
    settings: FitSettings
    mask: Path | None = None


def run_job(job: Job, plan: BatchPlan) -> JobResult:
    """Fit a row and keep its result; at once where that was done before.

    Raises:
        BatchError: the result cannot be written, so that no other could.
    """
    rows = (job, *job.mates)
    known = [load_result(plan.folder, row.key) for row in rows]
    if known[0] is not None and None not in known:
        return as_row_of(job, known[0])
    try:
        found: Sequence[FitResult | SetResult | PoseRecord]
        if job.mates:
            scene = _fit_together(rows, plan)
            pairs = zip(scene.results, scene.scene.objects, strict=True)
            found = [result or one.record for result, one in pairs]
            picture = smaller(scene.picture())
        else:
            fitted = _fit(job, plan)
            drawn = fitted.views[0] if isinstance(fitted, SetResult) else fitted
            found, picture = [fitted], smaller(drawn.picture())
    except PoseViewerError as error:
        return failed_result(job, str(error))
    except Exception as error:  # noqa: BLE001 - one row's trouble is not the others'
        _log.debug("row %d", job.row, exc_info=error)
        return failed_result(job, f"{type(error).__name__}: {error}")
    # The first row's last: where it is there, all are.
    for row, one in zip(rows[1:], found[1:], strict=True):
        _keep(row, plan, one, picture)
    return _keep(job, plan, found[0], picture)


def _fit_together(rows: Sequence[Job], plan: BatchPlan) -> SceneCase:
    """All objects of a photo, each hidden by those in front of it."""
    if plan.mask is not None:
        raise SettingsError("--mask with --together: one mask is not that of all objects.")
    photo, settings = rows[0].path(rows[0].photo), plan.settings
    alone, renderers, objects = [], [], []
    for number, row in enumerate(rows):
        path = row.path(row.model)
        model, renderer = open_model(path, settings)
        one = load_registration(photo, model, row.path(row.start))
        alone.append(one)
        cloned = renderer.clone() if isinstance(renderer, Cloneable) else None
        renderers.append(cloned or make_renderer(model.mesh, settings.renderer))
        seen = one.photo
        of_photo = PhotoReference(seen.name, seen.width, seen.height, seen.sha256)
        of_model = ModelReference(one.mesh_name, one.mesh_sha256, one.mesh.unit)
        objects.append(ObjectRecord(str(number), path, PoseRecord(one.start, of_photo, of_model)))
    scene = SceneRecord(photo, PhotoReference(), alone[0].start.camera, tuple(objects))
    case = SceneCase(scene, among_others(alone), settings, tuple(renderers), (None,) * len(rows))
    return case.fit()


def _fit(job: Job, plan: BatchPlan) -> FitResult | SetResult:
    for column in COLUMNS:
        if not getattr(job, column):
            raise SettingsError(f"the row has no {column}; name a file in the column {column!r}.")
    model, renderer = open_model(job.path(job.model), plan.settings)
    photo, start = job.path(job.photo), _start_of(job, plan)
    if photo.is_dir() or photo.suffix.lower() == ".json":
        return _fit_set(photo, model, start, plan)
    case = load(
        photo,
        model,
        start,
        plan.settings,
        box=job.rectangle(),
        mask=plan.mask,
        # A renderer is for one thread at a time, and a cluster's worker may have several.
        renderer=renderer.clone() if isinstance(renderer, Cloneable) else None,
    )
    return case.fit()


def _fit_set(
    views: Path,
    model: LoadedModel,
    start: str | Path,
    plan: BatchPlan,
) -> SetResult:
    """One pose in all photos of a set."""
    if start == AUTOMATIC or plan.mask is not None:
        what = "the start 'auto'" if start == AUTOMATIC else "--mask"
        raise SettingsError(
            f"{views.name}: {what} with a set of photos; name a pose file, and masks in the set."
        )
    return load_views(views, model, start, plan.settings).fit()


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


def open_model(path: Path, settings: FitSettings) -> tuple[LoadedModel, Renderer | None]:
    """A model and, where it can be cloned, its renderer; kept for further rows."""
    return _open_model(path, file_stamp(path), settings)


@lru_cache(maxsize=MODELS_KEPT)
def _open_model(
    path: Path,
    stamp: tuple[int, int],  # noqa: ARG001 - of the file, which may change: workers live long
    settings: FitSettings,
) -> tuple[LoadedModel, Renderer | None]:
    """A model and its renderer, once for all rows that name it while the file is the same."""
    model = load_model(path)
    model = replace(model, mesh=model.mesh.without(settings.without or ()))
    if settings.renderer == "opengl":
        return model, None
    return model, make_renderer(model.mesh, settings.renderer)


def _keep(
    job: Job, plan: BatchPlan, fitted: FitResult | SetResult | PoseRecord, picture: Picture
) -> JobResult:
    """Write the pose, the picture and, last, the result; of an object that stands wholly behind
    others the start.
    """
    named, files = (job.row, job.photo, job.model, job.start), result_files(job)
    if isinstance(fitted, PoseRecord):
        result = JobResult(*named, HIDDEN, verdict="lost", probability=0.0, reasons=HIDDEN)
        save = partial(save_pose, record=fitted)
    else:
        progress, save = fitted.progress, fitted.save
        assert progress is not None  # it was searched for
        result = JobResult(
            *named,
            progress.status.value,
            loss=progress.loss,
            start_loss=progress.start_loss,
            unexplained=progress.unexplained,
            start_unexplained=progress.start_unexplained,
            evaluations=progress.evaluations,
            seconds=round(progress.seconds, 3),
            **standard_deviations(fitted.covariance),
        )
        if (verdict := progress.verdict) is not None:
            certain, reasons = round(verdict.probability, 4), "\n".join(verdict.reasons)
            result = replace(result, verdict=verdict.word, probability=certain, reasons=reasons)
    result = replace(result, pose=files[0], picture=files[1])
    try:
        save(plan.folder / result.pose)
        save_image(plan.folder / result.picture, picture)
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
