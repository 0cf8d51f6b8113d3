"""A registration whose start comes from marks on the photo, instead of a pose file."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from poseviewer.errors import QuickStartError, SettingsError
from poseviewer.files.camera.calibration import Calibration
from poseviewer.files.marks import PointPairs
from poseviewer.files.photo.calibrated import load_calibrated_photo
from poseviewer.fit.loss import lighting_loss, registration_loss
from poseviewer.fit.problem import make_photo_attributes
from poseviewer.fit.registration import LoadedModel, Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.photo import Photo
from poseviewer.render.renderers import make_renderer
from poseviewer.starts.focal_from_pairs import focal_from_pairs
from poseviewer.starts.pair_choice import likeliest
from poseviewer.starts.point_pairs import FEWEST_FOR_FOCAL, PairFit, poses_from_pairs
from poseviewer.starts.registration import load_model
from poseviewer.starts.wheel_search import find_wheel_pairs
from poseviewer.vehicle.keypoints import VehicleKeypoints
from poseviewer.vehicle.wheel_pose import WheelFit, Wheels, poses_from_wheels

Rectangle = tuple[int, int, int, int]

LONGER = (1.6, 2.6, 4.2)
"""Focal lengths that are tried beside a guessed one, which is a wide lens's: in times of it."""
ABOUT = 0.2
"""Of a rectangle's sides: what is looked at beyond each of them."""


@dataclass(frozen=True, slots=True)
class StartCamera:
    """What is known of the camera where no pose file says it."""

    parallel: bool = False
    focal_px: float | None = None
    """None: EXIF's; without that, the pairs' where they tell it, else a view of 50 degrees."""
    free_focal: bool = False
    """Find it from the pairs even where it is known."""

    def of(self, photo: Photo) -> Camera:
        """The camera: its principal point is the photo's middle."""
        camera = photo.default_camera()
        if self.parallel:
            return Parallel(1.0, camera.cx, camera.cy, camera.width, camera.height)
        if self.focal_px is not None:
            camera = replace(camera, fx=self.focal_px, fy=self.focal_px)
        return camera

    def knows_focal(self, photo: Photo) -> bool:
        """Whether a focal length was given, or stands in the photo."""
        return self.focal_px is not None or photo.focal_length_35mm is not None


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """A start pose, and what is to be said about it."""

    pose: Pose
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """What a start is found for."""

    photo: Photo
    mesh: Mesh
    keypoints: VehicleKeypoints | None


def load_unplaced(
    photo_path: Path,
    model: Path | LoadedModel,
    find: Callable[[Material], Start],
    calibration: Calibration | None = None,
) -> Registration:
    """Photo and model (a file, or one that is loaded), and a start that ``find`` finds; its notes
    are last.

    Raises:
        PoseViewerError: a file cannot be used, or no start is found, or one for a photo of another
            size.
    """
    if not callable(find):
        raise SettingsError(
            f"a start of type {type(find).__name__}; wanted a pose file, a pose, "
            '"auto", or a function that finds a start on the photo.'
        )
    photo = load_calibrated_photo(photo_path, calibration)
    model = model if isinstance(model, LoadedModel) else load_model(model)
    mesh, keypoints = model.mesh, model.keypoints
    start = find(Material(photo, mesh, keypoints))
    if not isinstance(start, Start):
        raise SettingsError(
            f"the function that finds a start gave {type(start).__name__}; "
            "wanted a quick_start.Start."
        )
    camera = start.pose.camera
    if (camera.width, camera.height) != (photo.width, photo.height):
        raise SettingsError(
            f"a start for photos of {camera.width}x{camera.height} px, and {photo.name} has "
            f"{photo.width}x{photo.height}; use pose.scaled, if it is the same photo made smaller "
            "or larger."
        )
    notes = (
        *(f"{photo.name}: {note}" for note in photo.notes),
        *(f"{model.name}: {note}" for note in mesh.notes),
        *start.notes,
    )
    return Registration(photo, mesh, model.name, model.sha256, keypoints, start.pose, notes)


def start_from_pairs(material: Material, pairs: PointPairs, known: StartCamera) -> Start:
    """The start that point pairs give; of mirror images the one whose points can be seen.

    Raises:
        QuickStartError: they give none.
    """
    camera, points, pixels = known.of(material.photo), pairs.points, pairs.pixels
    notes: list[str] = []
    fits: tuple[PairFit, ...] = ()
    unknown = not known.parallel and (known.free_focal or not known.knows_focal(material.photo))
    if unknown and (len(points) >= FEWEST_FOR_FOCAL or known.free_focal):
        fits = _with_focal(camera, pairs, notes, required=known.free_focal)
    fit = likeliest(fits or poses_from_pairs(points, pixels, camera), points, material.mesh)
    errors = ", ".join(f"{error:.1f}" for error in fit.errors_px)
    notes.append(f"start from {len(points)} point pairs, off by {errors} px.")
    return Start(fit.pose, tuple(notes))


def _with_focal(
    camera: Camera, pairs: PointPairs, notes: list[str], required: bool
) -> tuple[PairFit, ...]:
    assert isinstance(camera, Perspective)  # asked for under perspective alone
    try:
        found = focal_from_pairs(pairs.points, pairs.pixels, camera)
    except QuickStartError:
        if required:
            raise
        return ()
    seen = found.fit.pose.camera
    assert isinstance(seen, Perspective)
    notes.append(f"focal length from the pairs: {seen.fx:.0f} px, to {found.doubt:.0%}.")
    return (found.fit,)


def start_from_wheels(material: Material, wheels: Wheels, known: StartCamera) -> Start:
    """The start that the wheels' ellipses give; of equal ones the one of least loss.

    Raises:
        QuickStartError: they give none, or the model has no wheels.
    """
    fits = poses_from_wheels(wheels, _wheels_known(material), known.of(material.photo))
    fit = fits[0] if len(fits) == 1 else least_loss(material, fits)
    return _placed(fit, "two wheels")


def _wheels_known(material: Material) -> VehicleKeypoints:
    if material.keypoints is None:
        raise QuickStartError(
            "The model has no wheels that poseviewer knows of; a start from wheels needs "
            "MODEL.keypoints.json beside the model, or parts named like wheels: use point pairs."
        )
    return material.keypoints


def _placed(fit: WheelFit, what: str) -> Start:
    note = f"start from {what} of radius {fit.radius:.3g}, off by {fit.error_px:.1f} px."
    return Start(fit.pose, (note,))


@dataclass(frozen=True, slots=True, eq=False)
class FoundWheels:
    """The wheels that were found, and the pose that they give."""

    wheels: Wheels
    fit: WheelFit


def start_from_found_wheels(material: Material, rectangle: Rectangle, known: StartCamera) -> Start:
    """The start of the wheels that are found in a rectangle (left, top, width, height), px.

    Raises:
        QuickStartError: none are found that this car has, or the model has no wheels.
    """
    camera, is_guess = known.of(material.photo), not known.knows_focal(material.photo)
    found = find_wheels(material, rectangle, camera, is_guess)
    return _placed(found.fit, "two wheels that were found")


def find_wheels(
    material: Material, rectangle: Rectangle, camera: Camera, is_guess: bool = False
) -> FoundWheels:
    """As ``likely_wheels``: the likeliest."""
    return likely_wheels(material, rectangle, camera, is_guess)[0]


def likely_wheels(
    material: Material, rectangle: Rectangle, camera: Camera, is_guess: bool = False
) -> list[FoundWheels]:
    """The wheels in a rectangle (left, top, width, height), px, as a camera sees them: all likely
    pairs, looking left or right, by their loss in the rectangle and about it, the least first; one
    at least. Poses below the axles are left out where there are others. Where the focal length
    ``is_guess``, longer ones are tried too, up to ``LONGER``.

    Raises:
        QuickStartError: none are found that this car has, or the model has no wheels.
    """
    keypoints = _wheels_known(material)
    cameras = [camera]
    if is_guess and isinstance(camera, Perspective):
        cameras += [replace(camera, fx=k * camera.fx, fy=k * camera.fy) for k in LONGER]
    found: list[FoundWheels] = []
    for pair in find_wheel_pairs(material.photo.grey(), rectangle):
        for wheels in (Wheels(pair.left, pair.right), Wheels(pair.right, pair.left)):
            for seen_by in cameras:
                with suppress(QuickStartError):  # a pair that this car has not
                    fits = poses_from_wheels(wheels, keypoints, seen_by)
                    found += [FoundWheels(wheels, fit) for fit in fits]
    if not found:
        raise QuickStartError(
            "The ellipses found in the rectangle are no two wheels of this model; lay it closer "
            "about the car, or outline the wheels yourself (--wheels)."
        )
    found = [one for one in found if one.fit.from_above] or found
    left, top, width, height = rectangle
    across, down = round(ABOUT * width), round(ABOUT * height)
    about = left - across, top - down, width + 2 * across, height + 2 * down
    settings = FitSettings(pixels="whole", region=about)
    seen = make_photo_attributes(material.photo, material.mesh, found[0].fit.pose, settings)
    renderer = make_renderer(material.mesh)
    losses = [registration_loss(renderer.moments(one.fit.pose, seen)) for one in found]
    return [found[index] for index in np.argsort(losses, kind="stable")]


def least_loss(material: Material, fits: tuple[WheelFit, ...] | list[WheelFit]) -> WheelFit:
    """The pose that some lighting explains best, all judged over the whole photo."""
    photo, mesh = material.photo, material.mesh
    attributes = make_photo_attributes(photo, mesh, fits[0].pose, FitSettings(pixels="whole"))
    renderer = make_renderer(mesh)
    losses = [lighting_loss(renderer.moments(fit.pose, attributes)) for fit in fits]
    return fits[int(np.argmin(losses))]
