"""One trial of the study: a start beside the truth, and where the fit from it ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from poseviewer.errors import SingularChartError
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo.load import load_photo
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.photo import Photo
from poseviewer.render.renderers import make_renderer
from poseviewer.render.types import Renderer
from poseviewer.study.deviations import Reading, draw_start, make_seed
from poseviewer.study.outcome import Outcome, fit_from
from poseviewer.study.photos import StudyPhoto
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.keypoints import VehicleKeypoints

Key = tuple[str, str, str, str, float, int]


@dataclass(frozen=True, slots=True)
class Task:
    """A trial that is to be run."""

    photo: StudyPhoto
    settings: FitSettings
    """With the chart, the focal length and the seed still open."""
    reading: Reading
    percent: float
    draw: int
    study_seed: int

    @property
    def key(self) -> Key:
        """What tells it from all others of the study."""
        settings = self.settings
        kind = self.photo.kind
        return settings.method, kind, settings.pixels, self.reading, self.percent, self.draw

    @property
    def seed(self) -> int:
        """Of the start and of the search: the same for every method."""
        photo = self.photo
        where = photo.kind, photo.index, self.reading, f"{self.percent:g}", self.draw
        return make_seed(self.study_seed, *where)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial(Outcome):
    """A row of the study's table."""

    method: str
    kind: str
    pixels: str
    reading: str
    percent: float
    draw: int
    photo: str
    seed: int
    names: str
    """Of the chart's numbers, with blanks between them, as for the next three."""
    truth: str
    start: str
    end: str
    found: bool

    @property
    def key(self) -> Key:
        """As the task's."""
        return self.method, self.kind, self.pixels, self.reading, self.percent, self.draw


def run_trial(task: Task) -> Trial:
    """Draw the start, fit, and see how far it is from the truth.

    Raises:
        PoseViewerError: a file cannot be read, or no start of this deviation is a pose.
    """
    photo = task.photo
    model = _load_model(photo.model)
    chart = VehicleChart.near(model.keypoints, photo.centre, photo.free_focal)
    parameters = chart.from_pose(photo.centre)
    start = draw_start(
        parameters,
        chart.scales(parameters),
        task.reading,
        task.percent / 100.0,
        task.seed,
        lambda wanted: _is_regular(chart, model.keypoints, wanted),
    )
    settings = replace(task.settings, chart="vehicle", free_focal=photo.free_focal, seed=task.seed)
    registration = Registration(
        _load_photo(photo.photo),
        model.mesh,
        photo.model.name,
        "",
        model.keypoints,
        chart.to_pose(start),
        (),
    )
    end, outcome = fit_from(registration, settings, model.renderer, photo.truth)
    return Trial(
        method=settings.method,
        kind=photo.kind,
        pixels=settings.pixels,
        reading=task.reading,
        percent=task.percent,
        draw=task.draw,
        photo=photo.photo.name,
        seed=task.seed,
        names=" ".join(chart.names),
        truth=_listed(parameters),
        start=_listed(start),
        end=_listed(end),
        found=photo.is_found(outcome.error_px_end, outcome.error_percent_end),
        **asdict(outcome),
    )


def _is_regular(chart: VehicleChart, keypoints: VehicleKeypoints, parameters: FloatArray) -> bool:
    """Whether a fit can start there, on the same side of the vehicle."""
    try:
        there = VehicleChart.near(keypoints, chart.to_pose(parameters), chart.free_focal)
    except (OutsideChartError, SingularChartError):
        return False
    return there.side is chart.side


def _listed(parameters: Sequence[float] | FloatArray) -> str:
    return " ".join(repr(float(number)) for number in np.asarray(parameters))


@dataclass(frozen=True, slots=True, eq=False)
class _Model:
    mesh: Mesh
    keypoints: VehicleKeypoints
    renderer: Renderer


@lru_cache(maxsize=2)
def _load_model(path: Path) -> _Model:
    mesh = load_mesh(path)
    keypoints = load_keypoints(path, mesh)
    assert keypoints is not None  # the study takes vehicles alone
    return _Model(mesh, keypoints, make_renderer(mesh))


@lru_cache(maxsize=2)
def _load_photo(path: Path) -> Photo:
    return load_photo(path)
