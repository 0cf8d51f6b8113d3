"""Starts from a vehicle's wheels: their ellipses as given, or searched for in a rectangle.

Matched filters for outlines of ellipses are laid over the picture's edges: complex numbers whose
length tells how clear an edge is, up to 1, and whose angle is twice the gradient's, so that its
sign does not matter. The support of an ellipse is the mean agreement along its outline. All shapes
are tried at all pixels of a small picture; the best are improved on a larger one.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage, optimize

from poseviewer.errors import QuickStartError
from poseviewer.fit.problem import make_problem
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Perspective
from poseviewer.geometry.rectangle import Rectangle, non_maximum_suppression
from poseviewer.losses.default_loss import DEFAULT
from poseviewer.losses.paper_loss import lighting_loss
from poseviewer.render.attributes import Moments
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.settings import FitSettings
from poseviewer.starts.start import Start, StartCamera, StartInputs
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints
from poseviewer.vehicle.wheel_pose import Ellipse, WheelFit, Wheels, poses_from_wheels

COARSE_SIDE_PX = 256
"""Longer side of the picture where all shapes are tried: a narrow one stays small, too."""
FINE_WIDTH_PX = 640
"""Largest width of the picture where ellipses are improved."""
SIZES = np.geomspace(0.05, 0.2, 16)
"""Longer half axes, as shares of the picture's width."""
ASPECTS = (0.25, 0.33, 0.42, 0.53, 0.65, 0.78, 0.92)
"""Shorter over longer half axes."""
TILTS = np.radians([-24.0, -12.0, 0.0, 12.0, 24.0])
"""Angles of the longer half axis against the vertical."""
ROUND_ASPECT = 0.8
"""Aspect from which one tilt will do."""
MIN_SUPPORT = 0.4
"""Support of a wheel, in [-1, 1]."""
MAX_TRIED = 40
"""Ellipses that are improved."""
MAX_KEPT = 24
"""Ellipses that are paired."""
CLEAR_EDGES = 0.7
"""Quantile of the gradient's power at which an edge is half as clear as can be."""
OUTLINE_POINTS = 80
"""Points of an outline while an ellipse is improved."""
MIN_OUTLINE_POINTS = 8
"""Points of the smallest outline that is tried."""
STEPS = 150
"""Evaluations that improve an ellipse."""
LONGER_FOCALS = (1.6, 2.6, 4.2)
"""Factors of a guessed focal length that are tried, too: the guess is that of a wide lens."""
REGION_MARGIN = 0.2
"""Share of a rectangle's sides that is compared beyond each of them."""
MAX_PAIRS = 10
"""Pairs of ellipses from which poses are computed."""
MIN_CAR_SIDE_PX = 16
"""Smallest side of a rectangle about a car."""

FieldImage = NDArray[np.complex64]
"""(height, width): edges as complex numbers."""


class Supported(NamedTuple):
    """An ellipse, and the mean agreement of the picture along its outline, in [-1, 1]."""

    ellipse: Ellipse
    support: float


def find_ellipses(grey: NDArray[np.float32]) -> list[Supported]:
    """Find upright ellipses in a picture (height, width), the best supported first."""
    coarse, fine = COARSE_SIDE_PX / max(grey.shape), min(1.0, FINE_WIDTH_PX / grey.shape[1])
    field = edge_field(_resize(grey, fine))
    ellipses: list[Supported] = []
    for start in _try_everywhere(edge_field(_resize(grey, coarse))):
        parameters = _improve(field, _rescale(start, fine / coarse))
        support = _support(field, parameters)
        if support >= MIN_SUPPORT and _is_wheel_like(parameters, field.shape[1]):
            x, y, longer, shorter, tilt = _rescale(parameters, 1.0 / fine)
            ellipse = Ellipse(x, y, np.exp(longer), np.exp(shorter), tilt + np.pi / 2.0)
            ellipses.append(Supported(ellipse, support))
    ellipses.sort(key=lambda supported: -supported.support)
    return non_maximum_suppression(ellipses, _is_same_ellipse, MAX_KEPT)


def edge_field(grey: NDArray[np.float32]) -> FieldImage:
    """Return (height, width): lengths are clearness, angles twice the gradient's."""
    smooth = cv2.GaussianBlur(np.asarray(grey, np.float32), (0, 0), 1.0)
    dx, dy = (cv2.Sobel(smooth, cv2.CV_32F, *order) for order in ((1, 0), (0, 1)))
    gradient = dx + 1j * dy
    power = np.abs(gradient) ** 2
    clear = np.quantile(power, CLEAR_EDGES) + 1e-9
    return np.asarray(gradient**2 / (power + clear), np.complex64)


def _resize(grey: NDArray[np.float32], factor: float) -> NDArray[np.float32]:
    mode = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(grey, None, fx=factor, fy=factor, interpolation=mode), np.float32)


def _outline(
    longer: float, shorter: float, tilt: float, count: int
) -> tuple[FloatArray, NDArray[np.complex128], FloatArray]:
    """Return points (n, 2) about 0, normals at twice the angle (n,), and shares of the length."""
    t = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    rotation = np.exp(1j * tilt)
    points = (shorter * np.cos(t) + 1j * longer * np.sin(t)) * rotation
    normals = (np.cos(t) / shorter + 1j * np.sin(t) / longer) * rotation
    lengths = np.hypot(shorter * np.sin(t), longer * np.cos(t))
    xy = np.column_stack([points.real, points.imag])
    return xy, (normals / np.abs(normals)) ** 2, lengths / lengths.sum()


def _shapes(width: int) -> Iterator[tuple[float, float, float]]:
    """Yield half axes, px, and tilts of all shapes."""
    for longer in SIZES * width:
        for aspect in ASPECTS:
            for tilt in TILTS if aspect < ROUND_ASPECT else (0.0,):
                yield float(longer), float(aspect * longer), float(tilt)


def _try_everywhere(field: FieldImage) -> list[FloatArray]:
    """Return the best of near ellipses, (5,) each: centre px, log half axes, tilt."""
    height, width = field.shape
    margin = int(SIZES[-1] * width) + 2
    rows, columns = (cv2.getOptimalDFTSize(side + 2 * margin) for side in field.shape)
    pattern = np.zeros((rows, columns), np.complex64)
    pattern[:height, :width] = field
    spectrum = np.asarray(fft.fft2(pattern))
    shapes = list(_shapes(width))
    best = np.full(field.shape, -1.0, np.float32)
    best_shape = np.zeros(field.shape, np.intp)
    for shape_index, (longer, shorter, tilt) in enumerate(shapes):
        count = max(int(2.0 * np.pi * longer), MIN_OUTLINE_POINTS)
        points, doubled, shares = _outline(longer, shorter, tilt, count)
        pattern[:] = 0.0
        x, y = np.rint(points.T).astype(int)  # those below 0 count from the far ends
        np.add.at(pattern, (y, x), shares * doubled)
        product = spectrum * np.conj(np.asarray(fft.fft2(pattern)))
        matched = np.real(np.asarray(fft.ifft2(product))[:height, :width])
        is_better = matched > best
        best[is_better], best_shape[is_better] = matched[is_better], shape_index

    def candidates() -> Iterator[FloatArray]:
        for pixel in np.argsort(-best, axis=None):
            y, x = divmod(int(pixel), width)
            longer, shorter, tilt = shapes[best_shape[y, x]]
            yield np.array([x + 0.5, y + 0.5, np.log(longer), np.log(shorter), tilt])

    def is_near(new: FloatArray, kept: FloatArray) -> bool:
        distance = np.hypot(*(new[:2] - kept[:2]))
        return bool(distance <= 0.25 * np.exp(kept[2]) and abs(new[2] - kept[2]) <= 0.2)

    return non_maximum_suppression(candidates(), is_near, MAX_TRIED)


def _improve(field: FieldImage, start: FloatArray) -> FloatArray:
    """Return the parameters (5,) of most support near ``start``."""
    simplex = np.vstack([start, start + np.diag([3.0, 3.0, 0.08, 0.1, 0.1])])
    options = {"initial_simplex": simplex, "maxfev": STEPS, "xatol": 0.02, "fatol": 1e-4}
    end = optimize.minimize(
        lambda parameters: -_support(field, parameters),
        start,
        method="Nelder-Mead",
        options=options,
    )
    return np.asarray(end.x)


def _support(field: FieldImage, parameters: FloatArray) -> float:
    longer, shorter = np.exp(parameters[2:4])
    points, doubled, shares = _outline(longer, shorter, parameters[4], OUTLINE_POINTS)
    columns, rows = (points + parameters[:2] - 0.5).T
    parts = field.real, field.imag
    real, imaginary = (ndimage.map_coordinates(part, (rows, columns), order=1) for part in parts)
    return float(np.sum(shares * (real * doubled.real + imaginary * doubled.imag)))


def _rescale(parameters: FloatArray, factor: float) -> FloatArray:
    """Return the ellipse's parameters in an image ``factor`` times as large."""
    return np.concatenate(
        [parameters[:2] * factor, parameters[2:4] + np.log(factor), parameters[4:]]
    )


def _is_wheel_like(parameters: FloatArray, width: int) -> bool:
    """Tell whether size and shape are still about those of wheels."""
    longer, aspect = np.exp(parameters[2]) / width, np.exp(parameters[3] - parameters[2])
    return bool(SIZES[0] / 1.2 <= longer <= 1.2 * SIZES[-1] and ASPECTS[0] / 1.2 <= aspect <= 1.25)


def _is_same_ellipse(new: Supported, kept: Supported) -> bool:
    a, b = new.ellipse, kept.ellipse
    distance = np.hypot(a.cx - b.cx, a.cy - b.cy)
    return bool(distance <= 0.12 * a.a and abs(np.log(a.a / b.a)) <= 0.08)


def find_wheel_pairs(
    grey: NDArray[np.float32], rectangle: Rectangle
) -> list[tuple[Ellipse, Ellipse]]:
    """Find the likeliest wheels of one side in a rectangle of a photo in [0, 1], left and right.

    Raises:
        QuickStartError: the rectangle is not in the photo, or shows no two such ellipses.
    """
    left, top, width, height = (int(value) for value in rectangle)
    x, y = max(left, 0), max(top, 0)
    inside = grey[y : max(top + height, 0), x : max(left + width, 0)]
    if min(inside.shape) < MIN_CAR_SIDE_PX:
        raise QuickStartError(
            f"The rectangle {left},{top},{width},{height} has no {MIN_CAR_SIDE_PX}x"
            f"{MIN_CAR_SIDE_PX} px in the photo of {grey.shape[1]}x{grey.shape[0]} px; give "
            "left,top,width,height around the car."
        )
    scored: list[tuple[float, tuple[Ellipse, Ellipse]]] = []
    for pair in combinations(find_ellipses(inside), 2):
        (a, support_a), (b, support_b) = sorted(pair, key=lambda wheel: wheel.ellipse.cx)
        across, down = b.cx - a.cx, abs(b.cy - a.cy)
        taller = abs(float(np.log((a.a * a.b) / (b.a * b.b)))) / 2.0
        flatter = abs(a.b / a.a - b.b / b.a)
        base = float(np.hypot(across, down)) / (0.5 * (a.a + b.a))
        if 2.5 <= base <= 14.0 and down <= 0.6 * across and taller <= 0.6 and flatter <= 0.35:
            score = 0.5 * (support_a + support_b) - 0.3 * taller - 0.3 * flatter
            a, b = (replace(wheel, cx=wheel.cx + x, cy=wheel.cy + y) for wheel in (a, b))
            scored.append((score, (a, b)))
    if not scored:
        raise QuickStartError(
            f"No two wheels were found in {left},{top},{width},{height}; lay the rectangle closer "
            "about the car, or outline the wheels yourself."
        )
    return [pair for _, pair in sorted(scored, key=lambda pair: -pair[0])[:MAX_PAIRS]]


def start_from_wheels(inputs: StartInputs, wheels: Wheels, known: StartCamera) -> Start:
    """Return the start by the wheels' ellipses, of equal ones the one of least loss."""
    fits = poses_from_wheels(wheels, _require_keypoints(inputs), known.of(inputs.photo))
    losses = [0.0]
    if len(fits) > 1:  # scored over the whole photo, by what some lighting explains
        losses = list(map(lighting_loss, _moments(inputs, fits, FitSettings(pixels="whole"))))
    return _start_of(fits[int(np.argmin(losses))], "two wheels")


def _require_keypoints(inputs: StartInputs) -> VehicleKeypoints:
    if inputs.keypoints is None:
        raise QuickStartError(
            "The model has no wheels that poseviewer knows of; a start from wheels needs "
            "MODEL.keypoints.json beside the model, or parts named like wheels: use point pairs."
        )
    return inputs.keypoints


def _start_of(fit: WheelFit, what: str) -> Start:
    note = f"start from {what} of radius {fit.radius:.3g}, off by {fit.error_px:.1f} px."
    return Start(fit.pose, (note,))


class FoundWheels(NamedTuple):
    """A pair of wheels that was found, and the pose by it."""

    wheels: Wheels
    fit: WheelFit


def start_from_found_wheels(inputs: StartInputs, rectangle: Rectangle, known: StartCamera) -> Start:
    """Return the start by the wheels that are found in a rectangle."""
    camera, is_guess = known.of(inputs.photo), not known.knows_focal(inputs.photo)
    likeliest = likely_wheels(inputs, rectangle, camera, is_guess)[0]
    return _start_of(likeliest.fit, "two wheels that were found")


def likely_wheels(
    inputs: StartInputs,
    rectangle: Rectangle,
    camera: Camera,
    is_guess: bool = False,
    watch: Callable[[], object] = lambda: None,
) -> list[FoundWheels]:
    """Find likely pairs of wheels, seen from above if any are, the least loss first.

    Args:
        inputs: photo and model.
        rectangle: rectangle of the photo, px.
        camera: camera of the photo.
        is_guess: whether longer focal lengths are tried, too.
        watch: called for each pair; it may raise to stop the search.

    Raises:
        QuickStartError: there is no pair of this car's wheels.
    """
    keypoints = _require_keypoints(inputs)
    cameras = [camera]
    if is_guess and isinstance(camera, Perspective):
        cameras += [replace(camera, fx=k * camera.fx, fy=k * camera.fy) for k in LONGER_FOCALS]
    pairs: list[FoundWheels] = []
    for left, right in find_wheel_pairs(inputs.photo.grey(), rectangle):
        watch()
        for wheels in (Wheels(left, right), Wheels(right, left)):
            for tried in cameras:
                with suppress(QuickStartError):  # not a pair of this car
                    fits = poses_from_wheels(wheels, keypoints, tried)
                    pairs += [FoundWheels(wheels, fit) for fit in fits]
    if not pairs:
        raise QuickStartError(
            "The ellipses found in the rectangle are no two wheels of this model; lay it closer "
            "about the car, or outline the wheels yourself."
        )
    pairs = [pair for pair in pairs if pair.fit.from_above] or pairs
    left, top, width, height = rectangle
    across, down = round(REGION_MARGIN * width), round(REGION_MARGIN * height)
    region = Rectangle(left - across, top - down, width + 2 * across, height + 2 * down)
    settings = FitSettings(pixels="whole", region=region)
    losses = map(DEFAULT.of_moments, _moments(inputs, [pair.fit for pair in pairs], settings))
    return [pairs[index] for index in np.argsort(list(losses), kind="stable")]


def _moments(
    inputs: StartInputs, fits: Sequence[WheelFit], settings: FitSettings
) -> Iterator[Moments]:
    photo = make_problem(inputs.scene(fits[0].pose, settings))[0].photo
    renderer = make_renderer(inputs.mesh)
    return (renderer.moments(fit.pose, photo) for fit in fits)
