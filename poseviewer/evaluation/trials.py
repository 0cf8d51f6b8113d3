"""Trials: the fit of a case from a start, and how far it ends from the truth."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from poseviewer.api import FitResult, make_registration
from poseviewer.errors import PoseViewerError
from poseviewer.evaluation.cases import Case
from poseviewer.files.photo import load_photo
from poseviewer.files.scene_assets import load_model
from poseviewer.fit.problem import pose_loss
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import LOG_FOCAL
from poseviewer.geometry.image import Photo
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.symmetry_group import Symmetry
from poseviewer.render.attributes import Renderer
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene, SceneObject, View, scene_at

FOUND_PX = 1.0
"""Largest error of a pose that is found on a photo drawn by OpenGL."""
FOUND_PERCENT = 1.0
"""Largest error of a pose that is found, beyond the truth's own, by the model's size."""
FOCAL_DEVIATIONS = "focal_deviations"
"""Name of the error of a focal length among the evidence."""
MODELS_KEPT = 16
"""Models kept in each process: more than there are in one photo."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """A row of ``trials.csv``: errors as in ``PoseError``, losses on the photo; 0 or nan: none."""

    case: str
    set: str
    """Kind of photo, or the set of the case."""
    visible: float = math.nan
    """Fraction of the model's pixels that nothing occludes."""
    traits: str = ""
    """Properties that make the case easy or hard, with commas between."""
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
    end: str = ""
    """The parameters of the chart about the start, with blanks between them."""
    error_percent_start: float
    error_percent_end: float
    error_px_start: float
    error_px_end: float
    loss_start: float = math.nan
    loss_end: float = math.nan
    loss_truth: float = math.nan
    mssd_start: float = math.nan
    """MSSD of the BOP challenge, as a share of the model's diameter."""
    mssd_end: float = math.nan
    mspd_start: float = math.nan
    """MSPD of the BOP challenge, px of a photo that is 640 px wide."""
    mspd_end: float = math.nan
    evaluations: int = 0
    seconds: float
    status: str
    """Name of the ``Status``, or of the error that kept the fit from beginning."""
    verdict: str = ""
    """The verdict on the end; empty where there is none."""
    probability: float = math.nan
    """Stated probability that the end is right."""
    evidence: str = ""
    """The features that the verdict comes from, and the error of a focal length that was searched
    for, in its stated deviations: ``name=value``, with blanks between them."""

    @property
    def evidence_by_name(self) -> dict[str, float]:
        """Values of the evidence."""
        parts = (part.split("=", 1) for part in self.evidence.split())
        return {name: float(value) for name, value in parts}


KEY = ("case", "method", "pixels", "reading", "percent", "degrees", "draw")
"""Columns that tell a trial from all others of a table."""


@dataclass(frozen=True, slots=True, eq=False)
class TrialTask:
    """A trial to run."""

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
        settings, start = self.settings, {name: getattr(self, name) for name in KEY[3:]}
        case = {"case": self.case.name, "method": settings.method, "pixels": settings.pixels}
        return case | start

    def open(self) -> tuple[Scene, Renderer]:
        """Photo, model and start, the others locked, and a renderer of the model."""
        case = self.case
        model, renderer = fetch_model(case.mesh)
        keypoints = model.keypoints if self.settings.chart == "vehicle" else None
        symmetry = case.bop.symmetry if case.bop else model.symmetry
        model = model.with_content(keypoints=keypoints, said_symmetry=symmetry)
        view = View(PhotoFile.of(fetch_photo(case.photo)), self.start.camera)
        scene = scene_at(view, model, self.start, settings=self.settings)
        for other in self.others:
            truth = scene.views[0].world_from_model(other.truth)
            known = SceneObject(
                id=other.name, model=fetch_model(other.mesh)[0], world_from_model=truth, locked=True
            )
            scene = replace(scene, objects=(*scene.objects, known))
        return scene, renderer

    def run(self) -> Trial:
        """Compare the end of a fit, or the start where none can begin, with the truth."""
        scene, renderer = self.open()
        model, case = scene.objects[0].model, self.case
        truth = case.truth
        result, outcome = None, dict[str, Any]()
        began = perf_counter()
        try:
            result = make_registration(scene, renderer, 0).fit()
        except PoseViewerError as error:
            outcome["status"] = type(error).__name__
        outcome["seconds"] = round(perf_counter() - began, 3)
        if result is not None:
            outcome |= _outcome(result, truth)
        poses = {"start": self.start, "end": self.start if result is None else result.pose}
        for name, pose in poses.items():
            error = pose_error(model.mesh, pose, truth, model.symmetry)
            outcome[f"error_percent_{name}"] = error.percent
            outcome[f"error_px_{name}"] = error.reprojection_px
            if case.bop:
                distances = symmetric_distances(model.mesh.vertices, pose, truth, model.symmetry)
                outcome[f"mssd_{name}"] = distances[0] / case.bop.diameter
                outcome[f"mspd_{name}"] = distances[1] * 640.0 / scene.views[0].photo.width
        is_found = outcome["error_percent_end"] < case.accuracy_percent + FOUND_PERCENT
        if case.is_drawn:
            is_found = outcome["error_px_end"] < FOUND_PX
        about = {"set": case.set, "found": is_found, "accuracy_percent": case.accuracy_percent}
        about |= {"visible": case.visible, "traits": ", ".join(self._traits(model))}
        return Trial(**self.identity, **about, **outcome)

    def _traits(self, model: ModelFile) -> Iterator[str]:
        colours = model.mesh.colours
        has_colours = bool(model.mesh.textures) or bool(np.ptp(colours, axis=0).any())
        yield "model with colours" if has_colours else "model of one colour"
        if self.settings.free_focal:
            yield "focal length free"
        if not model.symmetry.is_none:
            yield "symmetric"


def _outcome(result: FitResult, truth: Pose) -> dict[str, Any]:
    """Columns of a search that ended; the truth's loss is that of the chart's nearest pose."""
    progress, problem = result.progress, result.problem
    assert progress is not None  # it was searched for
    verdict = progress.verdict
    evidence, sure = {} if verdict is None else dict(verdict.features), progress.covariance
    if sure is not None and sure.extra == LOG_FOCAL:
        off = abs(float(sure.deviation(truth)[6])) / math.sqrt(sure.matrix[6, 6])
        evidence[FOCAL_DEVIATIONS] = off
    return {
        "end": " ".join(repr(float(number)) for number in progress.parameters),
        "loss_start": progress.start_loss,
        "loss_end": progress.loss,
        # Of the pose in the chart nearest to the truth.
        "loss_truth": pose_loss(problem, result.renderer, problem.chart.from_pose(truth)),
        "evaluations": progress.evaluations,
        "status": progress.status.name,
        "verdict": "" if verdict is None else verdict.label,
        "probability": math.nan if verdict is None else verdict.probability,
        "evidence": " ".join(f"{name}={value:.6g}" for name, value in evidence.items()),
    }


def symmetric_distances(
    vertices: FloatArray, pose: Pose, truth: Pose, symmetry: Symmetry
) -> tuple[float, float]:
    """Compute MSSD (in the model's unit) and MSPD (px) of Hodan et al., *BOP Challenge 2020*.

    Args:
        vertices: (V, 3), of the model.
        pose: the estimate.
        truth: the true pose.
        symmetry: symmetry of the model.
    """
    points, pixels = pose.camera_from_model.apply(vertices), pose.project(vertices)
    off = []
    for equal in (motion.apply(vertices) for motion in symmetry.transforms()):
        away = points - truth.camera_from_model.apply(equal), pixels - truth.project(equal)
        off.append([np.linalg.norm(distances, axis=1).max() for distances in away])
    in_space, in_photo = np.nan_to_num(off, nan=np.inf, posinf=np.inf).min(axis=0)
    return float(in_space), float(in_photo)


@lru_cache(maxsize=MODELS_KEPT)
def fetch_model(path: Path) -> tuple[ModelFile, Renderer]:
    """Load a model and make its renderer, once for each path.

    Raises:
        MeshFileError: the file cannot be used.
    """
    model = load_model(path)
    return model, make_renderer(model.mesh)


@lru_cache(maxsize=2)
def fetch_photo(path: Path) -> Photo:
    """Load a photo, once for each path.

    Raises:
        PhotoFileError: the file cannot be used.
    """
    return load_photo(path)
