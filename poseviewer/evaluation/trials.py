"""Trials: a start beside the truth, the fit from it, and how far it ends from the truth."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any, Literal, get_args

import numpy as np

from poseviewer.api import make_case
from poseviewer.errors import PoseViewerError, SingularChartError
from poseviewer.evaluation.photos import StudyPhoto, make_seed
from poseviewer.evaluation.real_cases import RealCase, RealStart, load_cases, load_starts
from poseviewer.files.photo import load_photo
from poseviewer.fit.problem import pose_loss
from poseviewer.fit.registration import LoadedModel, PlacedModel, Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.fit.verdict import Features
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.photo import Photo
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.renderers import make_renderer
from poseviewer.render.types import Renderer
from poseviewer.starts.registration import load_model
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.keypoints import VehicleKeypoints

Reading = Literal["relative", "absolute"]
"""``relative``: each parameter is off by up to a share of its own value, as in the paper.
``absolute``: by up to that share of its scale, which is harder for parameters near 0."""
READINGS: tuple[Reading, ...] = get_args(Reading)
DRAWS = 1000
"""Draws of a start before it is given up that one is a pose of the chart."""
MODELS_KEPT = 16
"""In each process: more than there are in one photo."""
FEATURES = tuple(field.name for field in fields(Features))
"""Names of the verdict's features."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What both studies write down of a fit: errors as in ``PoseError``, losses on the photo."""

    error_percent_start: float
    error_percent_end: float
    error_px_start: float
    error_px_end: float
    rotation_deg_start: float
    rotation_deg_end: float
    add_start: float
    add_end: float
    loss_start: float
    loss_end: float
    loss_truth: float
    evaluations: int
    seconds: float
    status: str
    """Name of the ``Status``, or of the error that kept the fit from beginning."""
    verdict: str
    """What the fit itself says of its end; empty where it says nothing."""
    evidence: str
    """The features that the verdict comes from: ``name=value``, with blanks between them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial(Outcome):
    """A row of the table of the study of deviations."""

    method: str
    kind: str
    pixels: str
    reading: str
    percent: float
    draw: int
    photo: str
    seed: int
    names: str
    """Of the chart's parameters, with blanks between them, as for the next three."""
    truth: str
    start: str
    end: str
    found: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RealTrial(Outcome):
    """A row of the table of the study of real photos."""

    case: str
    degrees: int
    draw: int
    method: str
    pixels: str
    set: str
    accuracy_percent: float
    end: str
    """The parameters of the chart about the start, with blanks between them."""


@dataclass(frozen=True, slots=True)
class Task:
    """A trial of the study of deviations that is to be run."""

    photo: StudyPhoto
    settings: FitSettings
    """Without the chart, the focal length and the seed."""
    reading: Reading
    percent: float
    draw: int
    study_seed: int

    @property
    def identity(self) -> dict[str, Any]:
        """The columns that tell it from all others of the study."""
        return {
            "method": self.settings.method,
            "kind": self.photo.kind,
            "pixels": self.settings.pixels,
            "reading": self.reading,
            "percent": self.percent,
            "draw": self.draw,
        }

    @property
    def seed(self) -> int:
        """Of the start and of the search: the same for every method."""
        where = self.photo.kind, self.photo.index, self.reading, f"{self.percent:g}", self.draw
        return make_seed(self.study_seed, *where)

    def run(self) -> Trial:
        """Draw the start, fit, and see how far it is from the truth."""
        photo = self.photo
        model, renderer = open_model(photo.model)
        keypoints = model.keypoints
        assert keypoints is not None  # the study takes vehicles alone
        chart = VehicleChart.near(keypoints, photo.centre, photo.free_focal)
        parameters = chart.from_pose(photo.centre)
        start = draw_start(
            parameters,
            chart.scales(parameters),
            self.reading,
            self.percent / 100.0,
            self.seed,
            lambda wanted: _is_regular(chart, keypoints, wanted),
        )
        settings = replace(
            self.settings, chart="vehicle", free_focal=photo.free_focal, seed=self.seed
        )
        registration = Registration(
            open_photo(photo.photo), model.mesh, model.name, "", keypoints, chart.to_pose(start),
            (),
        )  # fmt: skip
        outcome = fit_from(registration, settings, renderer, photo.truth)
        return Trial(
            **self.identity,
            photo=photo.photo.name,
            seed=self.seed,
            names=" ".join(chart.names),
            truth=_listed(parameters),
            start=_listed(start),
            found=photo.is_found(outcome["error_px_end"], outcome["error_percent_end"]),
            **outcome,
        )


@dataclass(frozen=True, slots=True, eq=False)
class RealTask:
    """A trial on a real photo that is to be run."""

    case: RealCase
    start: RealStart
    settings: FitSettings
    others: tuple[RealCase, ...] = ()
    """Other models of the photo, whose true poses are given."""

    @property
    def identity(self) -> dict[str, Any]:
        """The columns that tell it from all others."""
        return {
            "case": self.case.name,
            "degrees": self.start.degrees,
            "draw": self.start.draw,
            "method": self.settings.method,
            "pixels": self.settings.pixels,
        }

    def open(self) -> tuple[Registration, Renderer]:
        """Photo, model and start, and a renderer of the model."""
        model, renderer = open_model(self.case.mesh)
        start = Pose(self.case.truth.camera, self.start.camera_from_model)
        named = (open_photo(self.case.photo), model.mesh, model.name, "", None, start, ())
        others = tuple(PlacedModel(open_model(one.mesh)[0].mesh, one.truth) for one in self.others)
        return Registration(*named, others=others, whole_symmetry=model.whole_symmetry), renderer

    def run(self) -> RealTrial:
        """Fit from the start. The free-body chart is used throughout: starts are off in rotation
        and place, and most models are no vehicles.
        """
        registration, renderer = self.open()
        return RealTrial(
            **self.identity,
            set=self.case.set,
            accuracy_percent=self.case.accuracy_percent,
            **fit_from(registration, self.settings, renderer, self.case.truth),
        )


def real_tasks(
    folder: Path,
    degrees: Sequence[int],
    draws: int,
    pattern: str,
    settings: FitSettings,
    among_others: bool = False,
) -> list[RealTask]:
    """The trials of all cases that match the pattern, case by case; ``among_others``: each is given
    the true poses of all other cases of its photo.
    """
    starts = load_starts(folder, degrees, draws)
    of_photo: dict[Path, list[RealCase]] = defaultdict(list)
    for case in load_cases(folder) if among_others else ():
        of_photo[case.photo].append(case)
    return [
        RealTask(
            case,
            start,
            settings,
            tuple(one for one in of_photo[case.photo] if one.name != case.name),
        )
        for case in load_cases(folder, pattern)
        for start in starts
        if start.case == case.name
    ]


def fit_from(
    registration: Registration, settings: FitSettings, renderer: Renderer, truth: Pose
) -> dict[str, Any]:
    """Fit from the registration's start: the fields of ``Outcome``, and ``end``, the chart's
    parameters there.

    A start that no fit can begin from is also where it ends, without parameters. ``truth`` may be
    of a camera that the start's chart does not have; its loss is then that of the chart's nearest
    pose.
    """
    poses = {"start": registration.start, "end": registration.start}
    outcome: dict[str, Any] = dict.fromkeys(("loss_start", "loss_end", "loss_truth"), math.nan)
    outcome |= {"end": "", "evaluations": 0, "verdict": "", "evidence": ""}
    began = perf_counter()
    try:
        found = make_case(registration, settings, renderer=renderer).fit()
    except PoseViewerError as error:
        outcome |= {"seconds": round(perf_counter() - began, 3), "status": type(error).__name__}
    else:
        seconds, progress = perf_counter() - began, found.progress
        assert progress is not None  # it was searched for
        problem, verdict = found.case.problem, progress.verdict
        poses["end"] = found.pose
        outcome |= {
            "end": _listed(progress.parameters),
            "loss_start": progress.start_loss,
            "loss_end": progress.loss,
            "loss_truth": pose_loss(problem, renderer, problem.chart.from_pose(truth)),
            "evaluations": progress.evaluations,
            "seconds": round(seconds, 3),
            "status": progress.status.name,
            "verdict": "" if verdict is None else verdict.word,
            "evidence": features_as_text(None if verdict is None else verdict.features),
        }
    for name, pose in poses.items():
        error = pose_error(registration.mesh, pose, truth, registration.symmetry)
        outcome[f"error_percent_{name}"] = error.percent
        outcome[f"error_px_{name}"] = error.reprojection_px
        outcome[f"rotation_deg_{name}"] = float(error.rotation_deg)
        outcome[f"add_{name}"] = error.add
    return outcome


def features_as_text(features: Features | None) -> str:
    """``name=value`` of each number, with blanks between them; empty for none."""
    if features is None:
        return ""
    return " ".join(f"{name}={float(getattr(features, name)):.6g}" for name in FEATURES)


def draw_start(
    parameters: FloatArray,
    scales: FloatArray,
    reading: Reading,
    share: float,
    seed: int,
    is_pose: Callable[[FloatArray], bool],
) -> FloatArray:
    """(d,): ``parameters`` (d,), each off by a uniform draw within +- ``share``; the same for the
    same seed. ``scales`` (d,) are the chart's 100 %. Draws that are no pose are drawn again.

    Raises:
        SingularChartError: there is none in a thousand draws.
    """
    random = np.random.default_rng(seed)
    size = np.abs(parameters) if reading == "relative" else scales
    for _ in range(DRAWS):
        start = parameters + share * size * random.uniform(-1.0, 1.0, len(parameters))
        if is_pose(start):
            return start
    raise SingularChartError(
        f"none of {DRAWS} starts up to {share:.0%} off is a pose of the vehicle chart; "
        "choose smaller --deviations"
    )


def _is_regular(chart: VehicleChart, keypoints: VehicleKeypoints, parameters: FloatArray) -> bool:
    """Whether a fit can start there, on the same side of the vehicle."""
    try:
        there = VehicleChart.near(keypoints, chart.to_pose(parameters), chart.free_focal)
    except (OutsideChartError, SingularChartError):
        return False
    return there.side is chart.side


def _listed(parameters: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in parameters)


@lru_cache(maxsize=MODELS_KEPT)
def open_model(path: Path) -> tuple[LoadedModel, Renderer]:
    """A model and a renderer of it, the last ones kept; raises what ``load_model`` raises."""
    model = load_model(path)
    return model, make_renderer(model.mesh)


@lru_cache(maxsize=2)
def open_photo(path: Path) -> Photo:
    """A photo, the last ones kept; raises what ``load_photo`` raises."""
    return load_photo(path)
