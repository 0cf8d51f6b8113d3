"""Fits from published estimates of a BOP data set, scored as BOP scores poses.

Hodan et al., *BOP Challenge 2020 on 6D Object Localization* (2020): the greatest distance between
the vertices at the estimated and at the true pose, the least over the model's symmetries, in space
(MSSD) and in the picture (MSPD); the average recall over ten thresholds of each. Where a fit is not
sure to be better, its estimate is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import PoseFileError, SettingsError
from poseviewer.evaluation.plan import FreeBodyPlan
from poseviewer.evaluation.trials import Outcome, fit_from, open_model, open_photo
from poseviewer.figures.text_table import Table
from poseviewer.files.formats.bop import BopImage, load_bop_images
from poseviewer.files.formats.bop_models import (
    MODELS_INFO,
    BopEstimate,
    BopModel,
    load_bop_estimates,
    load_bop_models,
)
from poseviewer.files.writing import sha256_of
from poseviewer.fit.progress import Status
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.symmetry import Symmetry
from poseviewer.geometry.transform import RigidTransform

MSSD_THRESHOLDS = np.arange(0.05, 0.501, 0.05)
"""Shares of the model's diameter."""
MSPD_THRESHOLDS = np.arange(5.0, 50.1, 5.0)
"""px of a photo that is 640 px wide."""
WORSE_PX = 10.0
"""A pose that is by more than this farther off than the estimate is worse."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BopTrial(Outcome):
    """A row of the table: a target, the estimate that its fit started from, and both scores."""

    scene: int
    image: int
    object_id: int
    method: str
    pixels: str
    diameter: float
    """mm."""
    width: int
    """Of the photo, px."""
    mssd_start: float
    """mm."""
    mssd_end: float
    mspd_start: float
    """px."""
    mspd_end: float
    end: str
    """The parameters of the chart about the start, with blanks between them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BopPlan(FreeBodyPlan):
    """The study of fits from a table of estimates."""

    bop: Path
    """The table of results."""
    dataset: Path | None = None
    """The folder of ``models`` and ``test``; None: the nearest above the table."""

    @property
    def folder(self) -> Path:
        """Of the data set.

        Raises:
            SettingsError: there is none.
        """
        tried = self.bop.resolve().parents if self.dataset is None else (self.dataset,)
        for folder in tried:
            if (folder / "models" / MODELS_INFO).is_file():
                return folder
        raise SettingsError(
            f"{self.dataset or self.bop}: no models/{MODELS_INFO} there or above; name a BOP data "
            "set with --dataset FOLDER"
        )

    def about(self) -> dict[str, Any]:
        """What all rows of a folder have in common.

        Raises:
            PoseFileError: the table is not there.
        """
        if not self.bop.is_file():
            raise PoseFileError(f"{self.bop}: there is no such file; name one that is there")
        return {
            "study": "bop",
            "estimates": sha256_of(self.bop),
            "models": sha256_of(self.folder / "models" / MODELS_INFO),
            "evaluations": self.limits.evaluations,
            "keep_start": True,
        }


@dataclass(frozen=True, slots=True, eq=False)
class BopTask:
    """A fit that is to be made."""

    estimate: BopEstimate
    photo: Path
    mesh: Path
    camera: Perspective
    """Without the photo's size."""
    truth: RigidTransform
    model: BopModel
    settings: FitSettings

    @property
    def identity(self) -> dict[str, Any]:
        """The columns that tell it from all others."""
        return {
            "scene": self.estimate.scene,
            "image": self.estimate.image,
            "object_id": self.estimate.object_id,
            "method": self.settings.method,
            "pixels": self.settings.pixels,
        }

    def run(self) -> BopTrial:
        """Fit from the estimate."""
        (model, renderer), photo = open_model(self.mesh), open_photo(self.photo)
        camera = replace(self.camera, width=photo.width, height=photo.height)
        start, truth = Pose(camera, self.estimate.place), Pose(camera, self.truth)
        named = (photo, model.mesh, model.name, "", None, start, ())
        registration = Registration(*named, whole_symmetry=self.model.symmetry)
        outcome = fit_from(registration, self.settings, renderer, truth)
        end = start
        if outcome["end"]:
            chart = FreeBodyChart.near(model.mesh, start)
            end = chart.to_pose(np.array(outcome["end"].split(), float))
        scores = {}
        for name, pose in (("start", start), ("end", end)):
            found = symmetric_distances(model.mesh.vertices, pose, truth, self.model.symmetry)
            scores[f"mssd_{name}"], scores[f"mspd_{name}"] = found
        return BopTrial(
            **self.identity, diameter=self.model.diameter, width=photo.width, **scores, **outcome
        )


def symmetric_distances(
    vertices: FloatArray, pose: Pose, truth: Pose, symmetry: Symmetry
) -> tuple[float, float]:
    """MSSD and MSPD of a pose: in the model's unit, and in px; infinite where the pose has vertices
    behind the camera.
    """
    place, seen = pose.camera_from_model.apply(vertices), pose.project(vertices)
    in_space = in_picture = np.inf
    for motion in symmetry.transforms():
        same = motion.apply(vertices)
        off = np.linalg.norm(place - truth.camera_from_model.apply(same), axis=1).max()
        in_space = min(in_space, float(off))
        off = np.linalg.norm(seen - truth.project(same), axis=1).max()
        in_picture = min(in_picture, float(off) if np.isfinite(off) else np.inf)
    return in_space, in_picture


def bop_tasks(plan: BopPlan) -> tuple[list[BopTask], int]:
    """The fits of all targets that have an estimate, the best one of each by its score, and how
    many targets there are.

    Raises:
        PoseViewerError: the data set or the table cannot be read.
        SettingsError: the table has estimates of none of the targets.
    """
    folder = plan.folder
    models = load_bop_models(folder / "models" / MODELS_INFO)
    best: dict[tuple[int, int, int], BopEstimate] = {}
    for one in sorted(load_bop_estimates(plan.bop), key=lambda estimate: estimate.score):
        best[one.scene, one.image, one.object_id] = one
    tasks, targets = [], 0
    for scene in sorted({one.scene for one in best.values()}):
        place = folder / "test" / f"{scene:06d}"
        for image in load_bop_images(place).images:
            targets += len(image.objects)
            tasks += _tasks_of(image, scene, place, best, models, plan)
    if not tasks:
        raise SettingsError(f"{plan.bop}: no estimate of a target in {folder / 'test'}")
    tasks.sort(key=lambda task: task.estimate.object_id)  # what a process has loaded serves again
    return tasks, targets


def _tasks_of(
    image: BopImage,
    scene: int,
    place: Path,
    best: dict[tuple[int, int, int], BopEstimate],
    models: dict[int, BopModel],
    plan: BopPlan,
) -> list[BopTask]:
    numbers = [one.object_id for one in image.objects]
    tasks = []
    for one in image.objects:
        estimate = best.get((scene, image.number, one.object_id))
        if numbers.count(one.object_id) > 1:
            raise SettingsError(
                f"{place}: image {image.number} has object {one.object_id} more than once; "
                "`study --bop` tells no such objects apart"
            )
        if one.object_id not in models:
            raise SettingsError(
                f"{plan.folder / 'models' / MODELS_INFO}: no object {one.object_id}, which image "
                f"{image.number} has"
            )
        if estimate is not None:
            mesh = plan.folder / "models" / f"obj_{one.object_id:06d}.ply"
            model = models[one.object_id]
            tasks.append(
                BopTask(
                    *(estimate, place / image.photo, mesh, image.camera, one.place, model),
                    replace(plan.settings, keep_start=True),
                )
            )
    return tasks


def average_recall(errors: FloatArray, scales: FloatArray, thresholds: FloatArray, n: int) -> float:
    """The share of ``n`` targets that is within a threshold, the mean over all thresholds; a target
    without an error is within none. A threshold counts times a target's own scale.
    """
    within = errors[:, None] < thresholds * scales[:, None]
    return float(within.sum(axis=0).mean()) / n


def bop_table(trials: Sequence[BopTrial], targets: int) -> Table:
    """Average recalls before and after, of all targets and of each object's fits."""
    rows = []
    for method in dict.fromkeys((trial.method, trial.pixels) for trial in trials):
        own = [trial for trial in trials if (trial.method, trial.pixels) == method]
        rows.append(_row("all targets", own, targets))
        for number in sorted({trial.object_id for trial in own}):
            some = [trial for trial in own if trial.object_id == number]
            rows.append(_row(f"fits of object {number}", some, len(some)))
    return Table(
        "Average recall of BOP's MSSD and MSPD, of the estimates and after the fits",
        (
            *("targets", "method", "n", "MSSD before", "after", "MSPD before", "after"),
            *(f"worse by {WORSE_PX:.0f} px", "estimate kept", "called found", "seconds"),
        ),
        tuple(rows),
    )


def _row(name: str, trials: Sequence[BopTrial], targets: int) -> tuple[str, ...]:
    diameters = np.array([trial.diameter for trial in trials])
    widths = np.array([trial.width / 640.0 for trial in trials])
    recalls = []
    for key, scales, thresholds in (
        ("mssd", diameters, MSSD_THRESHOLDS),
        ("mspd", widths, MSPD_THRESHOLDS),
    ):
        for when in ("start", "end"):
            errors = np.array([getattr(trial, f"{key}_{when}") for trial in trials])
            recalls.append(average_recall(errors, scales, thresholds, targets))
    worse = [trial.mspd_end > trial.mspd_start + WORSE_PX for trial in trials]
    return (
        *(name, f"{trials[0].method}, {trials[0].pixels}", str(targets)),
        *(f"{recall:.3f}" for recall in recalls),
        f"{np.mean(worse):.0%}",
        f"{np.mean([trial.status == Status.KEPT.name for trial in trials]):.0%}",
        f"{np.mean([trial.verdict == 'found' for trial in trials]):.0%}",
        f"{np.median([trial.seconds for trial in trials]):.2g}",
    )
