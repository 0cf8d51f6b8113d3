"""Audit of given poses: each is searched for from where it is, and judged there and at the end.

An audit is a batch whose starts are the given poses. Its review accepts the pose found, or keeps
the given one.
"""

import csv
import math
from collections.abc import Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from poseviewer.api import FitResult
from poseviewer.batch.bop_rows import STARTS, save_start
from poseviewer.batch.job_table import COLUMNS, Job, with_keys
from poseviewer.batch.result_folder import MOVED, REJECTED, UNEXPLAINED, Batch, Row, load_batch
from poseviewer.confidence.pose_covariance import PINV, PoseCovariance
from poseviewer.errors import BatchError
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_json import as_saved, load_scene, pose_json, save_scene
from poseviewer.files.writing import make_folder, write_whole
from poseviewer.fit.judge import judge_end
from poseviewer.fit.progress import FitProgress
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import hull_in_photo
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.overlay.styles import ModelInPhoto, Picture, draw_style
from poseviewer.render.overlay.window import Window
from poseviewer.scene.sequence import show_frame, store_key
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene

AUDITED = "audited.csv"
"""File of the table of jobs from given or, where accepted, found poses."""
MIN_MOVED_PERCENT = 1.5
"""Move in % of the object's size up to which nothing is listed: no eye tells it."""
MIN_MOVED_DEVIATIONS = 5.0
"""Move in stated standard deviations up to which it may be the search's error."""
MIN_UNEXPLAINED = 0.65
"""Share that a lost given pose leaves unexplained: exact ones behind occluders leave 0.61."""
BEHIND = "At one of the two poses a part of the model is behind the camera: no distance in px."
HIDDEN = "Nothing of the object is visible, says the scene (visib_fract 0): no finding."
PANEL_SIDE = 300
"""Longer side of each of the three pictures, in px: one pixel of a label shows."""
MARGIN = 0.3
"""Margin about both outlines in the pictures, as a share of their size."""


def load_given_jobs(results: Path, settings: FitSettings) -> tuple[Job, ...]:
    """Make rows that start from the poses of a batch, but rejected ones.

    Raises:
        BatchError: the batch has no pose.
    """
    rows = [row for row in load_batch(results).rows() if not row.result.failed]
    rows = [row for row in rows if row.result.review != REJECTED]
    if not rows:
        raise BatchError(f"{results}: no row of the batch has a pose; nothing to audit.")
    jobs = [replace(row.job, start=str(results / row.result.pose), box="") for row in rows]
    return with_keys(jobs, settings)


def load_scene_file_jobs(path: Path, out: Path, settings: FitSettings) -> tuple[Job, ...]:
    """Make rows of the poses in a sequence's frames, or in the photos of a set, and save these
    poses in ``out``.

    Raises:
        BatchError: there is none.
    """
    scene, jobs = load_scene(path), list[Job]()
    for number in range(len(scene.frames) or len(scene.views)):
        shown, view = (show_frame(scene, number), 0) if scene.frames else (scene, number)
        saved = as_saved(shown)
        for index, item in enumerate(shown.objects):
            if not _is_given(shown, index, view):
                continue
            make_folder(out / STARTS, BatchError)
            start = out / STARTS / f"{number:06d}-{index}.json"
            masks = shown.mask(index, view), shown.occluders(index, view)
            save_start(start, pose_json(saved, index, view), *masks)
            photo = shown.frame.file if shown.frame else shown.views[view].file
            files = str(photo.location), str(item.model.location)
            jobs.append(Job(len(jobs) + 1, *files, str(start), str(path.parent)))
    if not jobs:
        wanted = "name the scene of a sequence, or of several photos"
        raise BatchError(f"{path.name}: no pose in a photo of it; {wanted}.")
    return with_keys(jobs, settings)


def _is_given(scene: Scene, object_index: int, view_index: int) -> bool:
    """Tell whether an object has a pose in the shown frame, or is seen and compared in a view."""
    item = scene.objects[object_index]
    if scene.frame is not None:
        return item.id in scene.frame.poses
    is_compared = scene.in_view(object_index, view_index).is_compared
    return item.is_placed and is_compared and scene.model_at(object_index, view_index).is_seen


def name_doubted(batch: Batch, rows: Sequence[Row]) -> list[str]:
    """Name the objects of a set of photos whose pose seems wrong, as most of their rows have a
    finding, and then the photos whose camera seems wrong, by the other objects' rows; a sentence
    each.
    """
    scene = None if batch.sequence is None else load_scene(batch.sequence)
    if scene is None or scene.frames or len(scene.views) == 1:
        return []
    found = dict[tuple[int, int], bool]()
    for row in rows:
        number, index = map(int, Path(row.job.start).stem.split("-"))
        found[number, index] = bool(row.result.finding)
    lines, doubted = list[str](), set[int]()
    for index, item in enumerate(scene.objects):
        own = [is_found for (_, other), is_found in found.items() if other == index]
        if sum(own) > len(own) / 2.0:
            doubted.add(index)
            lines.append(f"{item.id}: {_count(own, 'photo')}; its pose or model seems wrong.")
    for number, view in enumerate(scene.views):
        own = [
            is_found for (other, index), is_found in found.items()
            if other == number and index not in doubted
        ]  # fmt: skip
        if sum(own) > max(1.0, len(own) / 2.0):
            lines.append(f"{view.name}: {_count(own, 'object')}; its camera seems wrong.")
    return lines


def _count(found: Sequence[bool], what: str) -> str:
    return f"a finding in {sum(found)} of {len(found)} {what}{'' if len(found) == 1 else 's'}"


def save_audited(batch: Batch, rows: Sequence[Row]) -> None:
    """Write ``AUDITED``, and the scene of a sequence, with the accepted poses for given ones."""
    given = None if batch.sequence is None else load_scene(batch.sequence)
    if batch.sequence is not None and given is not None and given.frames:
        scene = given
        width, height = given.views[0].file.width, given.views[0].file.height
        for row in (row for row in rows if row.result.is_accepted):
            number, index = map(int, Path(row.job.start).stem.split("-"))
            pose = load_pose(batch.folder / row.result.pose, width, height).pose
            scene = store_key(show_frame(scene, number).with_pose(index, pose), index)
        scene = show_frame(scene, given.frame_index)
        save_scene(batch.folder / Path(batch.sequence).name, as_saved(scene))
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for row in rows:
        files = [row.job.path(name) for name in (row.job.photo, row.job.model, row.job.start)]
        if row.result.is_accepted:
            files[-1] = batch.folder / row.result.pose
        table.writerow(files)
    write_whole(batch.folder / AUDITED, text.getvalue().encode(), BatchError)


def audit_numbers(fit: FitResult, is_hidden: bool = False, question: str = "") -> dict[str, Any]:
    """Compare the pose found with the given one: the fields of ``JobResult`` for an audit.

    Nothing is found about an object that ``is_hidden`` in the photo, and none is ``unexplained``
    by its pose where there is a ``question`` about its files.
    """
    given, symmetry = fit.start, fit.object.symmetry
    before = judge_end(replace(FitProgress.at_start(given.problem), loss=given.loss), fit.renderer)
    assert fit.progress is not None  # a fit ends with it
    labels = str(before.verdict), str(fit.verdict)
    moved, deviations = pose_error(fit.mesh, fit.pose, given.pose, symmetry), math.nan
    if fit.covariance is not None:
        nearest = symmetry.nearest_pose(given.pose, fit.pose)
        deviations = round(count_deviations(fit.covariance, nearest), 2)
    finding = find_finding(labels, deviations, fit.progress.start_unexplained)
    is_near, is_known = moved.percent <= MIN_MOVED_PERCENT, math.isfinite(moved.percent)
    is_open = is_near or is_hidden or (bool(question) and finding == UNEXPLAINED)
    return {
        "finding": "" if is_open else finding,
        "moved_percent": round(moved.percent, 3) if is_known else None,
        "moved_px": round(moved.reprojection_px, 3) if is_known else None,
        "moved_deviations": None if math.isnan(deviations) else deviations,
        "given_verdict": labels[0],
        "reasons": [*([] if is_known else [BEHIND]), *([HIDDEN] if is_hidden else [])],
    }


def find_finding(labels: tuple[str, str], deviations: float, unexplained: float) -> str:
    """Say what is wrong with a given pose that the search has left; "": nothing.

    ``labels`` are the verdicts at the given pose and at the one found, ``deviations`` are between
    them, and ``unexplained`` is the share that the given pose leaves.
    """
    if labels == ("lost", "lost") and unexplained > MIN_UNEXPLAINED:
        return UNEXPLAINED
    return MOVED if labels[1] == "found" and deviations > MIN_MOVED_DEVIATIONS else ""


def count_deviations(covariance: PoseCovariance, pose: Pose) -> float:
    """Return the Mahalanobis distance of a pose from the covariance's, in standard deviations."""
    away = covariance.deviation(pose) / covariance.scales
    units = np.outer(covariance.scales, covariance.scales)
    inverse = np.linalg.pinv(covariance.matrix / units, PINV)
    return float(np.sqrt(away @ inverse @ away))


def draw_comparison(fit: FitResult) -> Picture:
    """Draw the photo, the given outline and the one found, side by side and magnified."""
    poses, size = (fit.start.pose, fit.pose), np.array([fit.photo.width, fit.photo.height])
    corners = np.vstack([hull_in_photo(fit.mesh, pose) for pose in poses])
    low, high = (corners.min(axis=0), corners.max(axis=0)) if len(corners) else (0 * size, size)
    margin = MARGIN * (high - low)
    left, top = np.clip(low - margin, 0, size - 1).astype(int).tolist()
    right, bottom = np.clip(high + margin, [left + 1, top + 1], size).astype(int).tolist()
    width, height = right - left, bottom - top
    window = Window(left, top, width, height, PANEL_SIDE / max(width, height))
    drawn = [window.pose(pose) for pose in poses]
    photo = fit.photo.as_rgb8(*size.tolist())[window.of_photo(*size.tolist())]
    shown = drawn[0].camera.width, drawn[0].camera.height
    panel = np.asarray(cv2.resize(photo, shown, interpolation=cv2.INTER_CUBIC), np.uint8)
    models = [ModelInPhoto(panel, fit.mesh, fit.renderer, pose) for pose in drawn]
    return np.hstack([panel, *(draw_style("outline", model) for model in models)])
