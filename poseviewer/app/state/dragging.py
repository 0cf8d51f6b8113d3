"""Drags become poses: what the pointer takes hold of, and how the pose follows it, in photo px."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from poseviewer.app.state.document import Document
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.overlay.contour import is_within_outline
from poseviewer.scene.types import PlacedModel
from poseviewer.starts.placing import surface_point, with_point_at
from poseviewer.vehicle.chart import MIN_AXLE_COMPONENT, VehicleChart

REACH = 14.0
"""A pin or a mark is taken within this distance (px of the screen)."""
MODEL_REACH = 12.0
"""The model is taken also this far (px of the screen) beside its convex outline."""
MIN_LEVER = 8.0
"""Rolls and scales are taken as if grabbed at least this far (px) from the centre."""
MAX_ZOOM = 20.0
"""Largest factor by which one drag scales the model, up or down."""
STIFFNESS = 1e-2
"""px per unit of the free-body chart: what pins do not determine is kept."""
MIN_SIDE = 2
"""px: a smaller rectangle is none."""


@dataclass(frozen=True, slots=True, eq=False)
class Drag:
    """Something that the pointer holds."""

    follow: Callable[[Document, FloatArray], Document]
    """Makes the document with the pointer at a point (2,), px of the photo."""
    model_from: FloatArray | None = None
    """(2,): where the pointer took hold of the model itself."""
    before: Document | None = None
    """Document when it was taken; None until the pointer moves."""


def hold_model(held: Document, start: FloatArray, kind: str) -> Drag:
    """Take hold of the model at a point (2,) to "move", "turn" or "roll" and scale it."""
    pose, mesh = held.pose, held.mesh

    def follow(document: Document, point: FloatArray) -> Document:
        if kind == "turn":
            radius = max(radius_in_photo(pose, mesh), 1.0)
            return document.at_pose(trackball(pose, mesh.centre, radius, start, point))
        if kind == "roll":
            return document.at_pose(roll_and_scale(pose, mesh.centre, start, point))
        return document.at_pose(translate(pose, mesh.centre, point - start))

    return Drag(follow, start)


def hold_pin(held: Document, pin: int, offset: FloatArray) -> Drag:
    """Take hold of a pin, of the vehicle chart or on the surface; ``offset`` (2,) from pointer."""
    pose, pins = held.pose, np.array(held.state.pins)

    def follow(document: Document, point: FloatArray) -> Document:
        if not len(pins) and isinstance(chart := held.chart, VehicleChart):
            parameters = with_vehicle_pin(chart, chart.from_pose(pose), pin, point + offset)
            return document.at_pose(chart.to_pose(parameters))
        pixels = pose.project(pins)
        pixels[pin] = point + offset
        return document.at_pose(fit_pins(held.mesh, pose, pins, pixels))

    return Drag(follow)


def draw_rectangle(tool: str, start: FloatArray) -> Drag:
    """Draw the region, or the box about the object, from a corner (2,), cut to the photo."""

    def follow(document: Document, point: FloatArray) -> Document:
        size = [document.photo.width, document.photo.height]
        low, high = np.sort(np.clip([start, point], 0, size), axis=0)
        corners = [*map(int, np.floor(low))], [*map(int, np.ceil(high))]
        rectangle = Rectangle.from_corners(*corners)
        shown = None if min(rectangle.width, rectangle.height) < MIN_SIDE else rectangle
        if tool == "region":
            return document.with_own(region=shown)
        return document.with_marks(box=shown)

    return Drag(follow)


def nearest_place(places: FloatArray, point: FloatArray, zoom: float) -> int | None:
    """Index of the nearest of places (k, 2), px, in reach; ``zoom``: screen px per photo px."""
    away = np.nan_to_num(np.linalg.norm(places - point, axis=1) * zoom, nan=np.inf)
    return int(np.argmin(away)) if len(away) and away.min() <= REACH else None


def take_hold(document: Document, point: FloatArray, zoom: float, kind: str) -> Drag | None:
    """Take hold of a pin or the model (to do ``kind``) under ``point``; None: nothing to hold."""
    if document.object.hidden or document.object.locked:
        return None
    pins = pins_in_photo(document)
    pin = nearest_place(pins, point, zoom)
    if pin is not None:
        return hold_pin(document, pin, pins[pin] - point)
    if is_within_outline(point, document.pose, document.mesh, MODEL_REACH / zoom):
        return hold_model(document, point, kind)
    return None


def nearest_object(document: Document, point: FloatArray) -> int:
    """Index of the nearest object at ``point`` that a press may take; else the active one's."""
    objects = document.scene.objects
    indices = (document.active, *document.others)
    free = [i for i in indices if not (objects[i].hidden or objects[i].locked)]
    depths = [_depth_at(document.scene.model_at(i, document.view_index), point) for i in free]
    nearest = min(depths, default=math.inf)
    return free[depths.index(nearest)] if nearest < math.inf else document.active


def _depth_at(one: PlacedModel, point: FloatArray) -> float:
    """The depth of a surface as seen at ``point``; infinite beside it."""
    if not is_within_outline(point, one.pose, one.mesh, 0.0):
        return math.inf
    place = surface_point(one.mesh, one.pose, point)
    return math.inf if place is None else float(one.pose.camera_from_model.apply(place)[2])


def pins_in_photo(document: Document) -> FloatArray:
    """(k, 2): where the pins are, in px: a vehicle's three, or those on the surface."""
    if document.state.pins:
        return document.pose.project(np.array(document.state.pins))
    chart = document.chart
    if isinstance(chart, VehicleChart):
        return vehicle_pins(chart, chart.from_pose(document.pose))
    return np.zeros((0, 2))


def translate(pose: Pose, centre: ArrayLike, delta: ArrayLike) -> Pose:
    """The pose whose model ``centre`` (3,) lies ``delta`` (2,) px further, at the same depth."""
    return with_point_at(pose, centre, pose.project(centre) + np.asarray(delta, dtype=float))


def rotate(pose: Pose, centre: ArrayLike, rotation_vector: ArrayLike) -> Pose:
    """The pose rotated about ``centre`` (3,) by an axis times an angle (3,), in camera axes."""
    turn = Rotation.from_rotvec(np.array(rotation_vector, dtype=float)).as_matrix()
    rotation = turn @ pose.camera_from_model.rotation
    fixed = pose.camera_from_model.apply(centre)
    translation = fixed - rotation @ np.asarray(centre, dtype=float)
    return replace(pose, camera_from_model=RigidTransform(rotation, translation))


def trackball(
    pose: Pose, centre: ArrayLike, radius: float, start: ArrayLike, end: ArrayLike
) -> Pose:
    """The pose rotated as a ball of ``radius`` px about ``centre`` that is dragged (G. Bell)."""
    middle = pose.project(centre)
    first, second = (_on_trackball((np.asarray(p) - middle) / radius) for p in (start, end))
    axis = np.cross(first, second)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return pose
    return rotate(pose, centre, axis / sine * math.atan2(sine, float(first @ second)))


def _on_trackball(point: FloatArray) -> FloatArray:
    """The unit vector towards a point of the trackball, in camera axes, in radii."""
    square = float(point @ point)
    depth = math.sqrt(1.0 - square) if square <= 0.5 else 0.5 / math.sqrt(square)
    vector = np.array([point[0], point[1], -depth])
    return vector / np.linalg.norm(vector)


def roll_and_scale(pose: Pose, centre: ArrayLike, start: ArrayLike, end: ArrayLike) -> Pose:
    """Rolled about the line of sight, and scaled, so that ``start`` is seen at ``end``."""
    middle = pose.project(centre)
    before, after = np.asarray(start) - middle, np.asarray(end) - middle
    lever, reach = (max(float(np.linalg.norm(v)), MIN_LEVER) for v in (before, after))
    angle = math.atan2(after[1], after[0]) - math.atan2(before[1], before[0])
    if float(np.linalg.norm(before)) < MIN_LEVER:
        angle = 0.0  # no direction to speak of
    zoom = min(max(reach / lever, 1.0 / MAX_ZOOM), MAX_ZOOM)
    return scale_about(roll(pose, centre, angle), centre, zoom)


def roll(pose: Pose, centre: ArrayLike, angle: float) -> Pose:
    """Rolled by ``angle`` (rad), clockwise in the photo, about the line of sight of ``centre``."""
    sight = np.array([0.0, 0.0, 1.0])
    if not isinstance(pose.camera, Parallel):
        sight = pose.camera_from_model.apply(centre)
    return rotate(pose, centre, angle * sight / np.linalg.norm(sight))


def scale_about(pose: Pose, centre: ArrayLike, zoom: float) -> Pose:
    """``zoom`` times as large in the photo, about the image of ``centre``: by scale, or depth."""
    camera, pixel = pose.camera, pose.project(centre)
    if isinstance(camera, Parallel):
        larger = replace(pose, camera=replace(camera, scale=camera.scale * zoom))
        return with_point_at(larger, centre, pixel)
    return with_point_at(pose, centre, pixel, pose.camera_from_model.apply(centre)[2] / zoom)


def radius_in_photo(pose: Pose, mesh: Mesh) -> float:
    """The model's radius about its centre, in px of the photo; nan behind the camera."""
    at = pose.camera_from_model.apply(mesh.centre)
    rim = at + np.array([mesh.diameter / 2.0, 0.0, 0.0])
    return float(np.linalg.norm(pose.camera.project(rim) - pose.camera.project(at)))


def fit_pins(mesh: Mesh, pose: Pose, points: ArrayLike, pixels: ArrayLike) -> Pose:
    """The pose nearest to ``pose`` that shows model ``points`` (k, 3) at ``pixels`` (k, 2)."""
    points, pixels = np.atleast_2d(points), np.atleast_2d(pixels)
    if len(points) == 1:
        return with_point_at(pose, points[0], pixels[0])
    chart = FreeBodyChart.near(mesh, pose)

    def residuals(parameters: FloatArray) -> FloatArray:
        try:
            shown = chart.to_pose(parameters).project(points)
        except OutsideChartError:
            shown = np.full(pixels.shape, 1e6)
        away = np.nan_to_num(shown - pixels, nan=1e6)
        return np.append(away.ravel(), STIFFNESS * parameters)

    nearest = least_squares(residuals, np.zeros(len(chart.names)), method="lm", max_nfev=200)
    return chart.to_pose(nearest.x)


def vehicle_pins(chart: VehicleChart, parameters: FloatArray) -> FloatArray:
    """(3, 2): rear wheel, front wheel, and axle tip, ``_axle_length`` times psi from it, in px."""
    size = np.array([chart.camera.width, chart.camera.height])
    rear = parameters[0:2] * size
    return np.array(
        [rear, rear + parameters[2:4] * size, rear + parameters[4:6] * _axle_length(chart)]
    )


def with_vehicle_pin(
    chart: VehicleChart, parameters: FloatArray, pin: int, pixel: ArrayLike
) -> FloatArray:
    """The parameters with one pin (0 rear, 1 front, 2 tip) at ``pixel``, the others held."""
    pins = vehicle_pins(chart, parameters)
    pins[pin] = pixel
    size = np.array([chart.camera.width, chart.camera.height])
    psi = (pins[2] - pins[0]) / _axle_length(chart)
    rim = math.sqrt(1.0 - MIN_AXLE_COMPONENT**2) - 1e-6
    psi *= min(1.0, rim / max(float(np.linalg.norm(psi)), 1e-12))
    return np.concatenate([pins[0] / size, (pins[1] - pins[0]) / size, psi])


def _axle_length(chart: VehicleChart) -> float:
    """Px at which a whole unit of psi is drawn; fixed, as each pin is two numbers of its own."""
    return 0.25 * min(chart.camera.width, chart.camera.height)
