"""Fits from the fixed starts of a folder of photos with known poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo.load import load_photo
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.photo import Photo
from poseviewer.render.renderers import make_renderer
from poseviewer.render.types import Renderer
from poseviewer.study.outcome import Outcome, fit_from
from poseviewer.study.real_cases import RealCase, RealStart, load_cases, load_starts

Key = tuple[str, int, int, str, str]


@dataclass(frozen=True, slots=True, eq=False)
class RealTask:
    """A trial that is to be run."""

    case: RealCase
    start: RealStart
    settings: FitSettings

    @property
    def key(self) -> Key:
        """What tells it from all others."""
        start, settings = self.start, self.settings
        return start.case, start.degrees, start.draw, settings.method, settings.pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class RealTrial(Outcome):
    """A row of the table."""

    case: str
    degrees: int
    draw: int
    method: str
    pixels: str
    set: str
    accuracy_percent: float
    end: str
    """The numbers of the chart about the start, with blanks between them."""

    @property
    def key(self) -> Key:
        """As the task's."""
        return self.case, self.degrees, self.draw, self.method, self.pixels


def real_tasks(
    folder: Path, degrees: Sequence[int], draws: int, pattern: str, settings: FitSettings
) -> list[RealTask]:
    """The trials of all cases that match the pattern, case by case.

    Raises:
        PoseFileError: the folder does not hold cases and starts.
        SettingsError: there is no such case, or no such start.
    """
    starts = load_starts(folder, degrees, draws)
    return [
        RealTask(case, start, settings)
        for case in load_cases(folder, pattern)
        for start in starts
        if start.case == case.name
    ]


def run_real_trial(task: RealTask) -> RealTrial:
    """Fit from the start. The free-body chart is used throughout: starts are off in rotation and
    place, and most models are no vehicles.

    Raises:
        PoseViewerError: photo or model cannot be read.
    """
    case, start = task.case, task.start
    registration, renderer = open_real_task(task)
    end, outcome = fit_from(registration, task.settings, renderer, case.truth)
    return RealTrial(
        case=case.name,
        degrees=start.degrees,
        draw=start.draw,
        method=task.settings.method,
        pixels=task.settings.pixels,
        set=case.set,
        accuracy_percent=case.accuracy_percent,
        end=" ".join(repr(float(number)) for number in end),
        **asdict(outcome),
    )


def open_real_task(task: RealTask) -> tuple[Registration, Renderer]:
    """Photo, model and start of a trial, and a renderer of the model.

    Raises:
        PoseViewerError: photo or model cannot be read.
    """
    case = task.case
    mesh, renderer = _load_model(case.mesh)
    start = Pose(case.truth.camera, task.start.camera_from_model)
    photo = _load_photo(case.photo)
    return Registration(photo, mesh, case.mesh.name, "", None, start, ()), renderer


@lru_cache(maxsize=2)
def _load_model(path: Path) -> tuple[Mesh, Renderer]:
    mesh = load_mesh(path)
    return mesh, make_renderer(mesh)


@lru_cache(maxsize=2)
def _load_photo(path: Path) -> Photo:
    return load_photo(path)
