"""Trials: the fit of a case from a start, and how far it ends from the truth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from poseviewer.api import make_scene
from poseviewer.confidence.verdict import Features
from poseviewer.errors import PoseViewerError, SettingsError
from poseviewer.evaluation.cases import Case
from poseviewer.files.photo import load_photo
from poseviewer.fit.problem import pose_loss
from poseviewer.fit.scene import LoadedModel, Scene, SceneObject, scene_at
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.symmetry_group import Symmetry
from poseviewer.geometry.view import View
from poseviewer.processes import run_in_processes
from poseviewer.render.renderers import make_renderer
from poseviewer.render.types import Renderer
from poseviewer.starts.loading import load_model

FOUND_PX, FOUND_PERCENT = 1.0, 1.0
"""Largest error of a pose that is found: on photos drawn by OpenGL, and beyond the truth's own."""
MODELS_KEPT = 16
"""Models kept in each process: more than there are in one photo."""
FEATURES = tuple(field.name for field in fields(Features))
"""Names of the verdict's features."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """A row of ``trials.csv``: errors as in ``PoseError``, losses on the photo; 0 or nan: none."""

    case: str
    set: str
    """Kind of photo, or the set of the case."""
    method: str
    pixels: str
    reading: str = ""
    """Whether ``percent`` is of a parameter's own value (relative) or of its scale (absolute)."""
    percent: float = 0.0
    """Deviation of the start: of each parameter ..."""
    degrees: int = 0
    """... or as an angle."""
    draw: int = 0
    accuracy_percent: float
    found: bool
    end: str
    """The parameters of the chart about the start, with blanks between them."""
    error_percent_start: float
    error_percent_end: float
    error_px_start: float
    error_px_end: float
    loss_start: float
    loss_end: float
    loss_truth: float
    mssd_start: float = math.nan
    """MSSD of the BOP challenge, as a share of the model's diameter."""
    mssd_end: float = math.nan
    mspd_start: float = math.nan
    """MSPD of the BOP challenge, px of a photo that is 640 px wide."""
    mspd_end: float = math.nan
    evaluations: int
    seconds: float
    status: str
    """Name of the ``Status``, or of the error that kept the fit from beginning."""
    verdict: str
    """The verdict on the end; empty where there is none."""
    evidence: str
    """The features that the verdict comes from: ``name=value``, with blanks between them."""


KEY = ("case", "method", "pixels", "reading", "percent", "degrees", "draw")
"""Columns that tell a trial from all others of a table."""


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """A trial that is to be run."""

    case: Case
    start: Pose
    settings: FitSettings
    reading: str = ""
    percent: float = 0.0
    degrees: int = 0
    draw: int = 0
    others: tuple[Case, ...] = ()
    """Other models of the photo, whose true poses are given."""

    @property
    def identity(self) -> dict[str, Any]:
        """Values of the columns ``KEY``."""
        own = {name: getattr(self, name) for name in KEY[3:]}
        settings = self.settings
        return {"case": self.case.name, "method": settings.method, "pixels": settings.pixels} | own

    def open(self) -> tuple[Scene, Renderer]:
        """Photo, model and start, the others locked, and a renderer of the model."""
        case = self.case
        model, renderer = open_model(case.mesh)
        keypoints = model.keypoints if self.settings.chart == "vehicle" else None
        symmetry = case.bop.symmetry if case.bop else model.whole_symmetry
        model = replace(model, keypoints=keypoints, whole_symmetry=symmetry)
        photo = open_photo(case.photo)
        view = View(photo.name, photo, self.start.camera)
        scene = scene_at(view, model, self.start, self.settings)
        others = tuple(
            SceneObject(
                one.name,
                open_model(one.mesh)[0],
                scene.views[0].world_from_model(one.truth),
                locked=True,
            )
            for one in self.others
        )
        return replace(scene, objects=(*scene.objects, *others)), renderer

    def run(self) -> Trial:
        """Fit from the start, and compare its end with the truth.

        A start that no fit can begin from is also where it ends. A truth whose camera the start's
        chart does not have has the loss of the chart's nearest pose.
        """
        scene, renderer = self.open()
        model = scene.objects[0].model
        case, truth = self.case, self.case.truth
        poses = {"start": self.start, "end": self.start}
        outcome: dict[str, Any] = dict.fromkeys(("loss_start", "loss_end", "loss_truth"), math.nan)
        outcome |= {"end": "", "evaluations": 0, "verdict": "", "evidence": ""}
        began = perf_counter()
        try:
            result = make_scene(scene, renderer, 0).fit()
        except PoseViewerError as error:
            outcome |= {"seconds": round(perf_counter() - began, 3), "status": type(error).__name__}
        else:
            seconds, progress = perf_counter() - began, result.progress
            assert progress is not None  # it was searched for
            problem, verdict = result.problem, progress.verdict
            poses["end"] = result.pose
            outcome |= {
                "end": " ".join(repr(float(number)) for number in progress.parameters),
                "loss_start": progress.start_loss,
                "loss_end": progress.loss,
                "loss_truth": pose_loss(problem, renderer, problem.chart.from_pose(truth)),
                "evaluations": progress.evaluations,
                "seconds": round(seconds, 3),
                "status": progress.status.name,
                "verdict": "" if verdict is None else verdict.word,
                "evidence": "" if verdict is None else _as_text(verdict.features),
            }
        vertices, symmetry = model.mesh.vertices, model.symmetry
        for name, pose in poses.items():
            error = pose_error(model.mesh, pose, truth, symmetry)
            outcome[f"error_percent_{name}"] = error.percent
            outcome[f"error_px_{name}"] = error.reprojection_px
            if case.bop:
                in_space, in_photo = symmetric_distances(vertices, pose, truth, symmetry)
                outcome[f"mssd_{name}"] = in_space / case.bop.diameter
                outcome[f"mspd_{name}"] = in_photo * 640.0 / scene.views[0].photo.width
        is_found = outcome["error_percent_end"] < case.accuracy_percent + FOUND_PERCENT
        if case.is_drawn:
            is_found = outcome["error_px_end"] < FOUND_PX
        return Trial(
            **self.identity, **outcome, set=case.set, found=is_found,
            accuracy_percent=case.accuracy_percent,
        )  # fmt: skip


def _as_text(features: Features | None) -> str:
    names = () if features is None else FEATURES
    return " ".join(f"{name}={float(getattr(features, name)):.6g}" for name in names)


def symmetric_distances(
    vertices: FloatArray, pose: Pose, truth: Pose, symmetry: Symmetry
) -> tuple[float, float]:
    """MSSD and MSPD (Hodan et al., *BOP Challenge 2020*), in the model's unit and in px.

    The largest distance of a vertex from its true position, the least over the symmetries.
    """
    points, pixels = pose.camera_from_model.apply(vertices), pose.project(vertices)
    in_space = in_photo = np.inf
    for motion in symmetry.transforms():
        moved = motion.apply(vertices)
        off = np.linalg.norm(points - truth.camera_from_model.apply(moved), axis=1).max()
        in_space = min(in_space, float(off))
        off = np.linalg.norm(pixels - truth.project(moved), axis=1).max()
        in_photo = min(in_photo, float(off) if np.isfinite(off) else np.inf)
    return in_space, in_photo


@lru_cache(maxsize=MODELS_KEPT)
def open_model(path: Path) -> tuple[LoadedModel, Renderer]:
    """LRU cache of models and their renderers; raises what ``load_model`` raises."""
    model = load_model(path)
    return model, make_renderer(model.mesh)


@lru_cache(maxsize=2)
def open_photo(path: Path) -> Photo:
    """LRU cache of photos; raises what ``load_photo`` raises."""
    return load_photo(path)


def run_all(tasks: Sequence[Task], jobs: int) -> Iterator[Trial]:
    """Run tasks, yielding each row when it is done; one job runs them here, in order."""
    if jobs == 1:
        yield from (task.run() for task in tasks)
        return
    for _, trial in run_in_processes(Task.run, tasks, jobs):
        if trial is None:
            raise SettingsError(
                "a process of the study was ended from outside, perhaps for want of memory; what "
                "was done is kept: run the same again, with fewer --jobs"
            )
        yield trial
