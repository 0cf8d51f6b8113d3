"""The registration problem: photo, chart and start; its loss; and how it is made from settings."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import SettingsError, SingularChartError
from poseviewer.fit.loss import fewest_pixels, registration_loss, worst_registration_loss
from poseviewer.fit.paper import paper_loss
from poseviewer.fit.registration import PlacedModel, Registration
from poseviewer.fit.settings import ChartName, FitSettings, Limits, Method
from poseviewer.fit.unexplained import LossScale
from poseviewer.fit.visibility import hiding
from poseviewer.geometry.arrays import FloatArray, frozen_array
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import Chart, OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh, hull_points
from poseviewer.geometry.photo import Photo
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.symmetry import NO_SYMMETRY, Symmetry
from poseviewer.optimise.restarts import RestartOptions
from poseviewer.render.pyramid.levels import smaller, structured
from poseviewer.render.types import Moments, PhotoAttributes, Renderer
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.keypoints import VehicleKeypoints


class Strategy(enum.Enum):
    """Which stages a search has."""

    FIRST = "all, from the user's start"
    COARSE = "the coarsest level alone, from the user's start"
    CONTINUE = "all but the coarsest level, from near the end of the search before"


@dataclass(frozen=True, slots=True, eq=False)
class OtherView:
    """The same thing on another photo, whose camera's pose to the problem's own is known."""

    photo: PhotoAttributes
    fine_photo: PhotoAttributes | None
    """As of ``FitProblem``; there where the problem has one."""
    chart: Chart
    """The pose in this photo, by the problem's own parameters."""


@dataclass(frozen=True, slots=True, eq=False)
class FitProblem:
    """All that a search needs but a renderer; nothing in it changes."""

    photo: PhotoAttributes
    chart: Chart
    start: FloatArray
    """(d,): the chart's parameters of the start pose."""
    free: tuple[bool, ...] = ()
    """(d,): which parameters the search may change; empty: all."""
    options: RestartOptions = field(default_factory=RestartOptions)
    limits: Limits = field(default_factory=Limits)
    seed: int = 0
    method: Method = "default"
    """Ours, or that of ``fit.paper``."""
    fine_photo: PhotoAttributes | None = None
    """A finer pyramid level, without structure, on which a search is refined. None: there is none.
    """
    strategy: Strategy = Strategy.FIRST
    symmetry: Symmetry = NO_SYMMETRY
    """The model's: poses that differ by it are one."""
    others: tuple[OtherView, ...] = ()
    """More photos of the same pose: the loss is the mean over all."""
    keep_start: bool = False
    """Whether the start is given back where no end is sure to be better."""
    free_indices: NDArray[np.intp] = field(init=False, repr=False)
    """The indices of the free parameters."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", frozen_array(self.start, (len(self.chart.names),)))
        if not self.free:
            object.__setattr__(self, "free", (True,) * len(self.start))
        if len(self.free) != len(self.start) or not any(self.free):
            raise ValueError("`free` must name each parameter, and free one at least")
        object.__setattr__(self, "free_indices", np.flatnonzero(self.free))

    @property
    def views(self) -> tuple[FitProblem, ...]:
        """The problem on each of its photos alone; the parameters are those of all."""
        alone = replace(self, others=())
        return alone, *(
            replace(alone, photo=one.photo, fine_photo=one.fine_photo, chart=one.chart)
            for one in self.others
        )

    @property
    def worst_loss(self) -> float:
        """The loss of parameters that show nothing of the model, or stand for no pose."""
        photos = (self.photo, *(one.photo for one in self.others))
        return sum(map(worst_registration_loss, photos)) / len(photos)

    @property
    def scale(self) -> LossScale:
        """How its losses are read."""
        return LossScale.of(self.photo)

    def complete(self, free_parameters: FloatArray) -> FloatArray:
        """(..., d): the start's parameters with the free ones replaced by (..., k)."""
        parameters = np.empty((*free_parameters.shape[:-1], len(self.start)))
        parameters[...] = self.start
        parameters[..., self.free_indices] = free_parameters
        return parameters


def pose_loss(
    problem: FitProblem,
    renderer: Renderer,
    parameters: FloatArray,
    photo: PhotoAttributes | None = None,
) -> float:
    """The loss at ``parameters`` (d,): the mean over the problem's photos; or on one level of its
    own photo alone.
    """
    if photo is None and problem.others:
        losses = [pose_loss(view, renderer, parameters) for view in problem.views]
        return sum(losses) / len(losses)
    photo = problem.photo if photo is None else photo
    try:
        pose = problem.chart.to_pose(parameters)
    except OutsideChartError:
        return problem.worst_loss
    return loss_of(problem.method, renderer.moments(pose, photo), photo)


def loss_of(method: Method, moments: Moments, photo: PhotoAttributes) -> float:
    """What a method minimises, from the ``moments`` of a pose on a photo."""
    if method == "paper":
        return paper_loss(moments, photo.clipped)
    return registration_loss(moments)


LEAST_COLOUR = 0.02
"""Standard deviation across the main line of a photo's colours, of 1, from which it has colours: 5
grey levels of 255, above a sensor's noise."""
NEAR_MARGIN = 0.25
"""How far the pixels ``near`` the start reach, as a share of the diagonal of its box."""
WORKING_PIXELS = 20_000
"""Of the model's convex outline at the start: a photo that shows more is reduced. Half a pixel of
these is less than a hundredth of the model's size."""
FINE_PIXELS = 150_000
"""The same for the photo that a search is refined on: there the minimum is nearer to the truth."""


def make_problem(registration: Registration, settings: FitSettings) -> tuple[FitProblem, str]:
    """The problem of fitting from the start pose, and a note on the chart ("" if none is due).

    Raises:
        SettingsError: the settings do not go with the photo or the model.
        SingularChartError: the wanted chart has no parameters at the start pose.
    """
    mesh, pose = registration.mesh, registration.start
    chart, note = choose_chart(
        settings.chart, mesh, registration.keypoints, pose, settings.free_focal
    )
    free = free_numbers(chart, settings)
    photo, fine, is_finer = compared_photos(registration, settings)
    problem = FitProblem(
        photo,
        chart,
        chart.from_pose(pose),
        free,
        settings.options,
        settings.limits,
        settings.seed,
        settings.method,
        fine() if is_finer else None,
        symmetry=registration.symmetry,
        keep_start=settings.keep_start,
    )
    return problem, note


def free_numbers(chart: Chart, settings: FitSettings) -> tuple[bool, ...]:
    """Which of the chart's numbers a search may change.

    Raises:
        SettingsError: it has not one that the settings lock, or none is left.
    """
    unknown = set(settings.lock) - set(chart.names)
    if unknown:
        raise SettingsError(
            f"--lock {sorted(unknown)[0]}: the {chart.name} chart has no such number; "
            f"it has {', '.join(chart.names)}"
        )
    free = tuple(name not in settings.lock for name in chart.names)
    if not any(free):
        raise SettingsError("--lock holds every number of the chart; leave one free at least")
    return free


def compared_photos(
    registration: Registration, settings: FitSettings
) -> tuple[PhotoAttributes, Callable[[], PhotoAttributes], bool]:
    """The level that poses are compared on; what makes the one that a search is refined on; and
    whether that is a finer one.

    Raises:
        SettingsError: as of ``make_photo_attributes``.
    """
    mesh, pose = registration.mesh, registration.start
    plain = _plain_attributes(registration, settings)
    photo = _compared(plain, registration, settings)
    fine_factor = working_factor(mesh, pose, FINE_PIXELS)
    is_finer = photo.structure is not None and fine_factor < working_factor(mesh, pose)
    return photo, lambda: smaller(plain, fine_factor), is_finer


def choose_chart(
    wanted: ChartName,
    mesh: Mesh,
    keypoints: VehicleKeypoints | None,
    pose: Pose,
    free_focal: bool = False,
) -> tuple[Chart, str]:
    """The chart about ``pose``, and why it is not the vehicle chart where it is not (or "").

    ``auto`` takes the vehicle chart where the model has key points and the pose is regular.

    Raises:
        SettingsError: the vehicle chart is wanted of a model without key points.
        SingularChartError: the wanted chart has no parameters at the pose.
    """
    reason = "the model has no wheels that poseviewer knows of"
    if wanted != "free-body" and keypoints is not None:
        try:
            return VehicleChart.near(keypoints, pose, free_focal), ""
        except SingularChartError as error:
            if wanted == "vehicle":
                raise SingularChartError(f"{error}; use --chart free-body") from error
            reason = str(error)
    elif wanted == "vehicle":
        raise SettingsError(
            f"{reason}; the vehicle chart needs MODEL.keypoints.json beside the model, or parts "
            f"named like wheels; or use --chart free-body"
        )
    chart = FreeBodyChart.near(mesh, pose, free_focal)
    return chart, "" if wanted == "free-body" else reason


def make_photo_attributes(registration: Registration, settings: FitSettings) -> PhotoAttributes:
    """F and P of a photo, about the start.

    Raises:
        SettingsError: the region lies outside the photo, has no pixel near the start, or fewer
            than a fit needs; or the model stands wholly behind others.
    """
    return _compared(_plain_attributes(registration, settings), registration, settings)


def shown_attributes(photo: PhotoAttributes) -> PhotoAttributes:
    """The attributes that a pose is shown relit by: the model's own pixels, and all its colours."""
    coloured = photo.channels.shape[2] == 3
    return replace(photo, clipped=True, colour_reflectance=coloured, structure=None)


def _plain_attributes(registration: Registration, settings: FitSettings) -> PhotoAttributes:
    """F and P at the photo's own size, without structure."""
    photo, mask = registration.photo, registration.mask
    weights = np.ones((photo.height, photo.width), np.float32) if mask is None else mask.weights
    if photo.covered is not None:
        weights = weights * photo.covered
    if registration.others:
        placed = PlacedModel(registration.mesh, registration.start)
        found = hiding(placed, registration.others)
        if found.is_whole:
            raise SettingsError(
                "the model stands wholly behind other objects of the photo, so that nothing of it "
                "can be compared: move it or them, or leave these out"
            )
        weights = weights * ~found.with_margin
    if settings.region is not None:
        region = settings.region.mask(photo.height, photo.width)
        if not region.any():
            left, top, width, height = settings.region
            raise SettingsError(
                f"--region {left},{top},{width},{height} has no pixel in the photo of "
                f"{photo.width}x{photo.height} px; give left,top,width,height in px"
            )
        weights = weights * region
    if settings.pixels == "near" and np.any(weights > 0.0):
        near = box_near(registration.mesh, registration.start)
        weights = weights * near.mask(photo.height, photo.width)
        if not np.any(weights > 0.0):
            raise SettingsError(
                "no pixel that counts lies near the start pose: bring the start onto the photo "
                "and the region, mask less, or use --pixels whole"
            )
    coloured = not settings.grey and _has_colour(photo, weights)
    channels = photo.as_float() if coloured else photo.grey()[..., None]
    is_clipped = settings.pixels == "clip"
    return PhotoAttributes(channels, weights, is_clipped, settings.colour_reflectance)


def _compared(
    plain: PhotoAttributes, registration: Registration, settings: FitSettings
) -> PhotoAttributes:
    """The level that poses are compared on, with its structure where that is used."""
    photo, counted = plain, np.count_nonzero(plain.weights)
    if counted and not plain.clipped and settings.method == "default":
        factor, finest = (
            working_factor(registration.mesh, registration.start, most)
            for most in (WORKING_PIXELS, FINE_PIXELS)
        )
        photo = structured(plain, factor, is_steep=factor == finest)
    fewest = fewest_pixels(photo.photo_channels + photo.model_channels)
    if counted < fewest:
        raise SettingsError(
            f"{registration.photo.name}: {counted} pixels count, and a fit needs at least "
            f"{fewest}; use a larger photo or region, or hide less of it"
        )
    return photo


def _has_colour(photo: Photo, weights: NDArray[np.float32]) -> bool:
    """Whether the colours of the pixels that count leave a line in RGB by more than noise.

    The loss takes every channel for as good as any other, whatever its range: in a grey scene it
    would weigh the noise of the colours.
    """
    if photo.pixels.shape[2] == 1:
        return False
    colours = photo.pixels[weights > 0.0] / np.iinfo(photo.pixels.dtype).max
    if len(colours) < 2:
        return False
    variances = np.linalg.eigvalsh(np.cov(colours.T))
    return bool(variances[1] > LEAST_COLOUR**2)


def box_near(mesh: Mesh, start: Pose) -> Rectangle:
    """The box of the model at the start, with a margin around it, px."""
    size = np.array([start.camera.width, start.camera.height])
    seen = start.project(hull_points(mesh))
    seen = seen[np.all(np.isfinite(seen), axis=1)]
    if not len(seen):
        return Rectangle(0.0, 0.0, 0.0, 0.0)
    # Where the start fills the photo and more, the photo is all there is to look at.
    low, high = np.clip([seen.min(axis=0), seen.max(axis=0)], -size, 2 * size)
    margin = NEAR_MARGIN * float(np.linalg.norm(high - low))
    return Rectangle.from_corners(*np.floor(low - margin), *np.ceil(high + margin))


def working_factor(mesh: Mesh, start: Pose, most: float = WORKING_PIXELS) -> int:
    """How many times a photo is reduced: the model about the start then has ``most`` pixels."""
    seen = start.project(hull_points(mesh))
    seen = seen[np.all(np.isfinite(seen), axis=1)].astype(np.float32)
    if len(seen) < 3:
        return 1
    whole = float(start.camera.width * start.camera.height)
    area = min(float(cv2.contourArea(cv2.convexHull(seen))), whole)
    return max(1, math.ceil(math.sqrt(area / most)))
