"""One registration: a photo, a model, a start; the problem they pose, and the record of a pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import RendererUnavailableError, SettingsError
from poseviewer.files.calibrated_photo import load_calibrated_photo, matched
from poseviewer.files.calibration_file import Calibration
from poseviewer.files.keypoints_file import load_keypoints
from poseviewer.files.mesh_file import load_mesh
from poseviewer.files.photo_file import Photo
from poseviewer.files.pose_file import (
    ChartNumbers,
    ModelReference,
    PhotoReference,
    PoseRecord,
    check_against,
    load_pose,
)
from poseviewer.files.pose_verdict import RecordedVerdict
from poseviewer.files.writing import sha256_of
from poseviewer.fit.loss import fewest_pixels
from poseviewer.fit.near import FINEST_PIXELS, box_near, inside, working_factor
from poseviewer.fit.pose_fit import FitProblem, Limits, Method
from poseviewer.fit.restarts import RestartRules
from poseviewer.fit.verdict import Verdict
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.chart_choice import ChartName, choose_chart
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.vehicle import VehicleKeypoints
from poseviewer.render.attributes import Renderer
from poseviewer.render.levels import smaller, structured
from poseviewer.render.moments import PhotoAttributes

RendererName = Literal["software", "opengl"]
PixelsName = Literal["near", "whole", "clip"]

LEAST_COLOUR = 0.02
"""Standard deviation, across the photo's own main line of colour, from which on it has colours:
5 grey levels of 255. Sensor noise has 1 or 2; the real photos we know have 10 and more."""


CHOICES: dict[str, tuple[str, ...]] = {
    "method": get_args(Method),
    "chart": get_args(ChartName),
    "pixels": get_args(PixelsName),
    "renderer": get_args(RendererName),
}


@dataclass(frozen=True, slots=True)
class FitSettings:
    """What a user chooses for a fit; the default is all of the photo's colour, near the start.

    Of the method ``paper`` are grey, grey reflectance, and ``clip`` unless ``whole`` is chosen:
    settings that say otherwise are set so.
    """

    method: Method = "default"
    """Ours, or exactly the paper's (``fit.paper``), kept as a reference."""
    chart: ChartName = "auto"
    free_focal: bool = False
    """Search for the focal length as well: a seventh number."""
    lock: tuple[str, ...] = ()
    """Names of the chart's numbers that stay as they are."""
    grey: bool = False
    """Photo attributes grey (n = 1) even where the photo has colour (n = 3). A photo without
    colour to speak of, by ``LEAST_COLOUR``, is compared in grey in any case."""
    colour_reflectance: bool = False
    """Model attributes of RGB reflectance (m = 12) instead of grey (m = 4)."""
    pixels: PixelsName = "near"
    """P: a fixed box about the start, or the whole photo, both with the surroundings of the model
    speaking against a wrong outline; or, as in the paper, what the model covers at each pose."""
    region: tuple[int, int, int, int] | None = None
    """Rectangle (left, top, width, height) in px that P lies in."""
    mask: str | None = None
    """File name of the mask, for the record."""
    renderer: RendererName = "software"
    rules: RestartRules = field(default_factory=RestartRules)
    limits: Limits = field(default_factory=Limits)
    seed: int = 0

    def __post_init__(self) -> None:
        """Raises ``SettingsError`` where there is no such choice."""
        for name, choices in CHOICES.items():
            if getattr(self, name) not in choices:
                raise SettingsError(
                    f"{name}={getattr(self, name)!r}: there is no such choice; "
                    f"take one of {', '.join(choices)}."
                )
        if self.method == "paper":
            object.__setattr__(self, "grey", True)
            object.__setattr__(self, "colour_reflectance", False)
            if self.pixels == "near":
                object.__setattr__(self, "pixels", "clip")


@dataclass(frozen=True, slots=True, eq=False)
class LoadedModel:
    """A model file as it was read: many photos can share one."""

    mesh: Mesh
    name: str
    """The file's name, without its folder."""
    sha256: str
    keypoints: VehicleKeypoints | None


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """What is open: the photo, the model and where the model starts."""

    photo: Photo
    mesh: Mesh
    mesh_name: str
    mesh_sha256: str
    keypoints: VehicleKeypoints | None
    start: PoseRecord
    warnings: tuple[str, ...]


def load_model(path: str | Path) -> LoadedModel:
    """A model and its key points.

    Raises:
        PoseViewerError: one of them cannot be used.
    """
    mesh = load_mesh(path)
    return LoadedModel(mesh, Path(path).name, sha256_of(path), load_keypoints(path, mesh))


def load_registration(
    photo_path: str | Path,
    model: str | Path | LoadedModel,
    pose_path: str | Path,
    calibration: Calibration | None = None,
) -> Registration:
    """Photo, model (a file, or one that is loaded) and start, checked against one another; the
    photo undistorted, where a calibration or the pose file says by which lens it was taken.

    Raises:
        PoseViewerError: one of them cannot be used.
    """
    photo = load_calibrated_photo(photo_path, calibration)
    photo, start, notes = matched(photo, load_pose(pose_path, photo.width, photo.height))
    model = model if isinstance(model, LoadedModel) else load_model(model)
    warnings = (
        *(f"{photo.name}: {note}" for note in photo.notes),
        *(f"{model.name}: {note}" for note in model.mesh.notes),
        *start.warnings,
        *check_against(start, photo.sha256, model.sha256),
        *notes,
    )
    return Registration(
        photo, model.mesh, model.name, model.sha256, model.keypoints, start, warnings
    )


def make_photo_attributes(
    photo: Photo,
    mesh: Mesh,
    start: Pose,
    settings: FitSettings,
    mask: NDArray[np.float32] | None = None,
) -> PhotoAttributes:
    """F and P of a photo; ``mask`` (height, width) weighs its pixels.

    Raises:
        SettingsError: the region lies outside the photo, has no pixel near the start, or fewer
            than a fit needs.
    """
    plain = _plain_attributes(photo, mesh, start, settings, mask)
    return _as_compared(plain, photo.name, mesh, start, settings)


def _as_compared(
    plain: PhotoAttributes, name: str, mesh: Mesh, start: Pose, settings: FitSettings
) -> PhotoAttributes:
    found = plain
    if not plain.clipped and settings.method == "default":
        found = structured(plain, working_factor(mesh, start))
    wanted = fewest_pixels(found.photo_channels + found.model_channels)
    if np.count_nonzero(plain.weights) < wanted:
        raise SettingsError(
            f"{name}: {np.count_nonzero(plain.weights)} pixels count, and a fit needs at least "
            f"{wanted}; use a larger photo or region"
        )
    return found


def _finer(
    plain: PhotoAttributes, mesh: Mesh, start: Pose, settings: FitSettings
) -> PhotoAttributes | None:
    """What a search ends on, if that is finer than what it goes through."""
    if plain.clipped or settings.method == "paper":
        return None
    factor = working_factor(mesh, start, FINEST_PIXELS)
    if factor >= working_factor(mesh, start):
        return None
    return smaller(plain, factor)


def _plain_attributes(
    photo: Photo,
    mesh: Mesh,
    start: Pose,
    settings: FitSettings,
    mask: NDArray[np.float32] | None = None,
) -> PhotoAttributes:
    """F and P before the photo is made smaller and told apart."""
    weights = np.ones((photo.height, photo.width), np.float32) if mask is None else mask
    if photo.covered is not None:
        weights = weights * photo.covered
    if settings.region is not None:
        weights = weights * _rectangle(photo, settings.region)
    if settings.pixels == "near" and np.any(weights > 0.0):
        weights = weights * inside((photo.height, photo.width), box_near(mesh, start))
        if not np.any(weights > 0.0):
            raise SettingsError(
                "no pixel that counts lies near the start pose: bring the start onto the photo "
                "and the region, or use --pixels whole"
            )
    clipped = settings.pixels == "clip"
    coloured = not settings.grey and _has_colour(photo, weights)
    channels = photo.as_float() if coloured else photo.grey()[..., None]
    return PhotoAttributes(channels, weights, clipped, settings.colour_reflectance)


def make_problem(
    registration: Registration, settings: FitSettings, mask: NDArray[np.float32] | None = None
) -> tuple[FitProblem, str]:
    """The problem of fitting from the start pose, and a note on the chart ("" if none is due).

    Raises:
        SettingsError: the settings do not go with the photo or the model.
        SingularChartError: the wanted chart has no numbers at the start pose.
    """
    pose = registration.start.pose
    chart, note = choose_chart(
        settings.chart, registration.mesh, registration.keypoints, pose, settings.free_focal
    )
    unknown = set(settings.lock) - set(chart.names)
    if unknown:
        raise SettingsError(
            f"--lock {sorted(unknown)[0]}: the {chart.name} chart has no such number; "
            f"it has {', '.join(chart.names)}"
        )
    free = tuple(name not in settings.lock for name in chart.names)
    if not any(free):
        raise SettingsError("--lock holds every number of the chart; leave one free at least")
    mesh = registration.mesh
    plain = _plain_attributes(registration.photo, mesh, pose, settings, mask)
    problem = FitProblem(
        _as_compared(plain, registration.photo.name, mesh, pose, settings),
        chart,
        chart.from_pose(pose),
        free,
        settings.rules,
        settings.limits,
        settings.seed,
        settings.method,
        _finer(plain, mesh, pose, settings),
    )
    return problem, note


def make_renderer(mesh: Mesh, name: RendererName = "software") -> Renderer:
    """The renderer called ``name``; the first one on a machine takes the time of compiling.

    Raises:
        RendererUnavailableError: ``opengl`` on a machine without it.
    """
    if name == "software":
        from poseviewer.render.compiled import compile_kernels
        from poseviewer.render.software import SoftwareRenderer

        compile_kernels()
        return SoftwareRenderer(mesh)
    from poseviewer.render.opengl import OpenGLRenderer, opengl_unavailable_reason

    reason = opengl_unavailable_reason()
    if reason:
        raise RendererUnavailableError(reason)
    return OpenGLRenderer(mesh)


def shown_attributes(photo: PhotoAttributes) -> PhotoAttributes:
    """The attributes by which a pose is shown relit: the model's own pixels, and all its colours.

    The search may look at less, or at more, than what the light on the model is best judged by.
    """
    coloured = photo.channels.shape[2] == 3
    return replace(photo, clipped=True, colour_reflectance=coloured, structure=None)


def make_record(
    registration: Registration,
    settings: FitSettings,
    problem: FitProblem,
    pose: Pose,
    loss: float,
    verdict: Verdict | None = None,
) -> PoseRecord:
    """All that the pose file of a fit says."""
    photo, chart = registration.photo, problem.chart
    numbers = tuple(float(number) for number in chart.from_pose(pose))
    return PoseRecord(
        pose,
        PhotoReference(photo.name, photo.width, photo.height, photo.sha256),
        ModelReference(registration.mesh_name, registration.mesh_sha256, registration.mesh.unit),
        ChartNumbers(chart.name, chart.names, numbers),
        loss,
        {**settings_as_json(settings), "photo_channels": problem.photo.channels.shape[2]},
        {"name": "poseviewer", "version": version("poseviewer")},
        photo.undistortion,
        None if verdict is None else as_recorded(verdict),
    )


def as_recorded(verdict: Verdict) -> RecordedVerdict:
    """The verdict as a pose file says it."""
    evidence = {} if verdict.evidence is None else asdict(verdict.evidence)
    numbers = {name: value for name, value in evidence.items() if name != "weak"}
    return RecordedVerdict(verdict.word, verdict.probability, verdict.reasons, numbers)


def settings_as_json(settings: FitSettings) -> dict[str, Any]:
    """The settings as JSON holds them; what is not set is left out."""
    return {key: value for key, value in asdict(settings).items() if value is not None}


def settings_from_json(data: Mapping[str, Any]) -> FitSettings:
    """The settings from ``settings_as_json``; what is not known, or makes no sense, is left out."""
    known = {field.name for field in fields(FitSettings)}
    given = {key: value for key, value in data.items() if key in known}
    try:
        if "rules" in given:
            given["rules"] = RestartRules(**given["rules"])
        if "limits" in given:
            given["limits"] = Limits(**given["limits"])
        for key in ("lock", "region"):
            if key in given:
                given[key] = tuple(given[key])
        return FitSettings(**given)
    except TypeError:
        return FitSettings()


def _has_colour(photo: Photo, weights: NDArray[np.float32]) -> bool:
    """Whether the colours of the pixels that count leave a line in RGB by more than noise.

    The loss takes every channel for as good as any other, whatever its range: beside a grey scene
    it would weigh the noise of its colours.
    """
    if photo.pixels.shape[2] == 1:
        return False
    colours = photo.pixels[weights > 0.0] / np.iinfo(photo.pixels.dtype).max
    if len(colours) < 2:
        return False
    variances = np.linalg.eigvalsh(np.cov(colours.T))
    return bool(variances[1] > LEAST_COLOUR**2)


def _rectangle(photo: Photo, region: tuple[int, int, int, int]) -> NDArray[np.float32]:
    left, top, width, height = region
    found = inside((photo.height, photo.width), (left, top, left + width, top + height))
    if not found.any():
        raise SettingsError(
            f"--region {left},{top},{width},{height} has no pixel in the photo of "
            f"{photo.width}x{photo.height} px; give left,top,width,height in px"
        )
    return found
