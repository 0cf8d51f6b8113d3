"""Starts from a vehicle's wheels: their ellipses as given, or looked for in a rectangle.

What is looked for is a proposal, not a verdict: it is to be looked at, and other starts are there.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import QuickStartError
from poseviewer.fit.loss import lighting_loss, registration_loss
from poseviewer.fit.problem import make_photo_attributes
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.camera import Camera, Perspective
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.renderers import make_renderer
from poseviewer.starts.ellipse_search import Supported, find_ellipses
from poseviewer.starts.registration import Start, StartCamera, StartInputs
from poseviewer.vehicle.ellipses import Ellipse
from poseviewer.vehicle.keypoints import VehicleKeypoints
from poseviewer.vehicle.wheel_pose import WheelFit, Wheels, poses_from_wheels

LONGER_FOCALS = (1.6, 2.6, 4.2)
"""Focal lengths that are tried beside a guessed one, which is a wide lens's: in times of it."""
MARGIN = 0.2
"""Of a rectangle's sides: what is compared beyond each of them."""
MOST_PAIRS = 10
SMALLEST_SIDE_PX = 16


@dataclass(frozen=True, slots=True)
class FoundPair:
    """Two ellipses that may be the wheels of one side, the left one in the photo first."""

    left: Ellipse
    right: Ellipse
    score: float
    """Mean support of both, less what sets them apart."""


def find_wheel_pairs(grey: NDArray[np.float32], rectangle: Rectangle) -> tuple[FoundPair, ...]:
    """The likeliest pairs in a rectangle (left, top, width, height) of a photo (height, width) in
    [0, 1], the best first.

    Raises:
        QuickStartError: the rectangle is not in the photo, or shows no two such ellipses.
    """
    left, top, width, height = (int(value) for value in rectangle)
    corner = max(left, 0), max(top, 0)
    inside = grey[corner[1] : max(top + height, 0), corner[0] : max(left + width, 0)]
    if min(inside.shape) < SMALLEST_SIDE_PX:
        raise QuickStartError(
            f"The rectangle {left},{top},{width},{height} has no 16x16 px in the photo of "
            f"{grey.shape[1]}x{grey.shape[0]} px; give left,top,width,height around the car."
        )
    ellipses = [_shifted(found, corner) for found in find_ellipses(inside)]
    pairs = [pair for two in combinations(ellipses, 2) if (pair := _pair(*two)) is not None]
    if not pairs:
        raise QuickStartError(
            f"No two wheels were found in {left},{top},{width},{height}; lay the rectangle closer "
            "about the car, or outline the wheels yourself (--wheels)."
        )
    return tuple(sorted(pairs, key=lambda pair: -pair.score)[:MOST_PAIRS])


def _pair(one: Supported, other: Supported) -> FoundPair | None:
    """Two ellipses as a pair of wheels; None for two that no car has."""
    (a, support_a), (b, support_b) = sorted(
        ((found.ellipse, found.support) for found in (one, other)), key=lambda found: found[0].cx
    )
    across, down = b.cx - a.cx, abs(b.cy - a.cy)
    size = 0.5 * (a.a + b.a)
    taller = abs(float(np.log((a.a * a.b) / (b.a * b.b)))) / 2.0
    flatter = abs(a.b / a.a - b.b / b.a)
    base = float(np.hypot(across, down)) / size
    if not 2.5 <= base <= 14.0 or down > 0.6 * across or taller > 0.6 or flatter > 0.35:
        return None
    return FoundPair(a, b, 0.5 * (support_a + support_b) - 0.3 * taller - 0.3 * flatter)


def _shifted(found: Supported, corner: tuple[int, int]) -> Supported:
    ellipse = found.ellipse
    x, y = ellipse.cx + corner[0], ellipse.cy + corner[1]
    return replace(found, ellipse=replace(ellipse, cx=x, cy=y))


def start_from_wheels(inputs: StartInputs, wheels: Wheels, known: StartCamera) -> Start:
    """The start that the wheels' ellipses give; of equal ones the one of least loss.

    Raises:
        QuickStartError: they give none, or the model has no wheels.
    """
    fits = poses_from_wheels(wheels, _wheels_known(inputs), known.of(inputs.photo))
    fit = fits[0] if len(fits) == 1 else _least_loss(inputs, fits)
    return _placed(fit, "two wheels")


def _wheels_known(inputs: StartInputs) -> VehicleKeypoints:
    if inputs.keypoints is None:
        raise QuickStartError(
            "The model has no wheels that poseviewer knows of; a start from wheels needs "
            "MODEL.keypoints.json beside the model, or parts named like wheels: use point pairs."
        )
    return inputs.keypoints


def _placed(fit: WheelFit, what: str) -> Start:
    note = f"start from {what} of radius {fit.radius:.3g}, off by {fit.error_px:.1f} px."
    return Start(fit.pose, (note,))


@dataclass(frozen=True, slots=True, eq=False)
class FoundWheels:
    """The wheels that were found, and the pose that they give."""

    wheels: Wheels
    fit: WheelFit


def start_from_found_wheels(inputs: StartInputs, rectangle: Rectangle, known: StartCamera) -> Start:
    """The start of the wheels that are found in a rectangle (left, top, width, height), px.

    Raises:
        QuickStartError: none are found that this car has, or the model has no wheels.
    """
    camera, is_guess = known.of(inputs.photo), not known.knows_focal(inputs.photo)
    found = find_wheels(inputs, rectangle, camera, is_guess)
    return _placed(found.fit, "two wheels that were found")


def find_wheels(
    inputs: StartInputs, rectangle: Rectangle, camera: Camera, is_guess: bool = False
) -> FoundWheels:
    """As ``likely_wheels``: the likeliest."""
    return likely_wheels(inputs, rectangle, camera, is_guess)[0]


def likely_wheels(
    inputs: StartInputs, rectangle: Rectangle, camera: Camera, is_guess: bool = False
) -> list[FoundWheels]:
    """The wheels in a rectangle (left, top, width, height), px, as a camera sees them: all likely
    pairs, looking left or right, by their loss in the rectangle and about it, the least first; one
    at least. Poses below the axles are left out where there are others. Where the focal length
    ``is_guess``, longer ones are tried too, up to ``LONGER_FOCALS``.

    Raises:
        QuickStartError: none are found that this car has, or the model has no wheels.
    """
    keypoints = _wheels_known(inputs)
    cameras = [camera]
    if is_guess and isinstance(camera, Perspective):
        cameras += [replace(camera, fx=k * camera.fx, fy=k * camera.fy) for k in LONGER_FOCALS]
    found: list[FoundWheels] = []
    for pair in find_wheel_pairs(inputs.photo.grey(), rectangle):
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
    across, down = round(MARGIN * width), round(MARGIN * height)
    region = Rectangle(left - across, top - down, width + 2 * across, height + 2 * down)
    settings = FitSettings(pixels="whole", region=region)
    seen = make_photo_attributes(inputs.at(found[0].fit.pose), settings)
    renderer = make_renderer(inputs.mesh)
    losses = [registration_loss(renderer.moments(one.fit.pose, seen)) for one in found]
    return [found[index] for index in np.argsort(losses, kind="stable")]


def _least_loss(inputs: StartInputs, fits: Sequence[WheelFit]) -> WheelFit:
    """The pose that some lighting explains best, all scored over the whole photo."""
    attributes = make_photo_attributes(inputs.at(fits[0].pose), FitSettings(pixels="whole"))
    renderer = make_renderer(inputs.mesh)
    losses = [lighting_loss(renderer.moments(fit.pose, attributes)) for fit in fits]
    return fits[int(np.argmin(losses))]
