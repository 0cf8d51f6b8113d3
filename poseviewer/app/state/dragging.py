"""Drags: what a press takes hold of, and how the pose follows the pointer, in photo px."""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from poseviewer.app.state.document import Document
from poseviewer.errors import SettingsError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.placing import fit_into_rectangle, surface_point, with_point_at
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.opening.scenes import scale_by_rays
from poseviewer.render.overlay.contour import is_within_outline
from poseviewer.vehicle.chart import MIN_AXLE_COMPONENT, VehicleChart

POINT_REACH_PX = 14.0
"""Distance within which a press takes a pin or a mark, px of the screen."""
MIN_LEVER_PX = 8.0
"""Least distance from the centre at which rolls and scales count as grabbed."""
MAX_ZOOM = 20.0
"""Largest factor by which one drag scales the model, up or down."""
STIFFNESS = 1e-2
"""Weight of the old pose, px per unit of the free-body chart: keeps what pins leave open."""
MIN_SIDE_PX = 2
"""Least side of a rectangle; a smaller one clears it."""


@dataclass(frozen=True, slots=True, eq=False)
class Drag:
    """A drag under way."""

    follow: Callable[[Document, FloatArray], Document]
    """Gives the document with the pointer at a point (2,)."""
    holds_model: bool = False
    """Whether the model itself is held, instead of a pin, mark or rectangle."""
    end: Callable[[Document], Document] = lambda document: document
    """Gives the document after the drag, of the last one during it."""
    before: Document | None = None
    """Document before the drag; None until the pointer moves."""


def _hold_model(held: Document, start: FloatArray, kind: str) -> Drag:
    pose, mesh = held.pose, held.mesh

    def follow(document: Document, point: FloatArray) -> Document:
        if kind == "turn":
            radius = max(radius_in_photo(pose, mesh), 1.0)
            return document.at_pose(trackball(pose, mesh.centre, radius, start, point))
        if kind == "roll":
            return document.at_pose(roll_and_scale(pose, mesh.centre, start, point))
        return document.at_pose(translate(pose, mesh.centre, point - start))

    return Drag(follow, holds_model=True)


def _hold_pin(held: Document, pin: int, offset: FloatArray) -> Drag:
    """Take hold of a pin that is ``offset`` (2,) from the pointer."""
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
    """Draw the region or the box about the object from a corner (2,), cut to the photo."""

    def follow(document: Document, point: FloatArray) -> Document:
        size = [document.photo.width, document.photo.height]
        low, high = np.sort(np.clip([start, point], 0, size), axis=0)
        corners = [*map(int, np.floor(low))], [*map(int, np.ceil(high))]
        rectangle = Rectangle.from_corners(*corners)
        drawn = None if min(rectangle.width, rectangle.height) < MIN_SIDE_PX else rectangle
        if tool == "region":
            return document.with_in_view(region=drawn)
        return document.with_marks(box=drawn)

    return Drag(follow, end=_fit_into_box if tool == "box" else lambda document: document)


def _fit_into_box(document: Document) -> Document:
    """Document whose model fits into the box about the object, if there is one."""
    box = document.marks.box
    if box is None:
        return document
    return move_to(document, fit_into_rectangle(document.pose, document.mesh, box))


def nearest_point(points: FloatArray, pointer: FloatArray, zoom: float) -> int | None:
    """Index of the nearest of points (k, 2) in reach; ``zoom`` is in screen px per photo px."""
    distances = np.nan_to_num(np.linalg.norm(points - pointer, axis=1) * zoom, nan=np.inf)
    is_in_reach = len(distances) and distances.min() <= POINT_REACH_PX
    return int(np.argmin(distances)) if is_in_reach else None


def take_hold(document: Document, point: FloatArray, zoom: float, kind: str) -> Drag | None:
    """Take hold of a pin that is there, else of the model; None: the object cannot be moved.

    Args:
        document: at the press.
        point: (2,), of the pointer.
        zoom: screen px per photo px.
        kind: motion of the model: "move", "turn", or "roll" (and scale).
    """
    if document.object.hidden or document.object.locked:
        return None
    pins = pins_in_photo(document)
    pin = nearest_point(pins, point, zoom)
    if pin is not None:
        return _hold_pin(document, pin, pins[pin] - point)
    return _hold_model(document, point, kind)


def nearest_object(document: Document, point: FloatArray) -> int:
    """Index of the nearest movable object at ``point``; the active one's if there is none."""
    depths = {document.active: math.inf}
    for index in (document.active, *document.others):
        item = document.scene.objects[index]
        mesh, pose = item.mesh, document.scene.pose(index, document.view_index)
        if item.hidden or item.locked or not is_within_outline(point, pose, mesh, 0.0):
            continue
        surface = surface_point(mesh, pose, point)
        if surface is not None:
            depths[index] = float(pose.camera_from_model.apply(surface)[2])
    return min(depths, key=depths.__getitem__)


def pins_in_photo(document: Document) -> FloatArray:
    """(k, 2): pixels of the pins: a vehicle's three, or those on the surface."""
    if document.state.pins:
        return document.pose.project(np.array(document.state.pins))
    chart = document.chart
    if isinstance(chart, VehicleChart):
        return vehicle_pins(chart, chart.from_pose(document.pose))
    return np.zeros((0, 2))


def move_to(document: Document, pose: Pose) -> Document:
    """The document at a pose; if the scale of its views is free, at the triangulated scale."""
    scale = None
    if document.scene.free_scale:
        with suppress(SettingsError):
            views, name = document.scene.views, document.scene.name
            scale = 1.0 / scale_by_rays(views, document.view_index, document.mesh, pose, name)
    return document.at_pose(pose, scale=scale)


def translate(pose: Pose, centre: ArrayLike, delta: ArrayLike) -> Pose:
    """The pose with the model's ``centre`` (3,) moved by ``delta`` (2,) px, at the same depth."""
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
    """The pose rotated as a trackball (G. Bell).

    Args:
        pose: before the drag.
        centre: (3,), of the ball, in the model's frame.
        radius: of the ball, px.
        start: (2,), pixel at which the ball is taken.
        end: (2,), pixel to which it is dragged.
    """
    middle = pose.project(centre)
    first, second = (_on_trackball((np.asarray(p) - middle) / radius) for p in (start, end))
    axis = np.cross(first, second)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return pose
    return rotate(pose, centre, axis / sine * math.atan2(sine, float(first @ second)))


def _on_trackball(point: FloatArray) -> FloatArray:
    """Unit vector, in camera axes, to the trackball's surface at a point given in radii."""
    square = float(point @ point)
    depth = math.sqrt(1.0 - square) if square <= 0.5 else 0.5 / math.sqrt(square)
    vector = np.array([point[0], point[1], -depth])
    return vector / np.linalg.norm(vector)


def roll_and_scale(pose: Pose, centre: ArrayLike, start: ArrayLike, end: ArrayLike) -> Pose:
    """The pose rolled about the viewing ray of ``centre`` and scaled, so that a point follows.

    Args:
        pose: before the drag.
        centre: (3,), in the model's frame; keeps its pixel.
        start: (2,), pixel of the point.
        end: (2,), pixel to which the point goes.
    """
    middle = pose.project(centre)
    before, after = np.asarray(start) - middle, np.asarray(end) - middle
    old_lever, new_lever = (max(float(np.linalg.norm(v)), MIN_LEVER_PX) for v in (before, after))
    angle = math.atan2(after[1], after[0]) - math.atan2(before[1], before[0])
    if float(np.linalg.norm(before)) < MIN_LEVER_PX:
        angle = 0.0  # the direction is undefined
    zoom = min(max(new_lever / old_lever, 1.0 / MAX_ZOOM), MAX_ZOOM)
    return scale_about(roll(pose, centre, angle), centre, zoom)


def roll(pose: Pose, centre: ArrayLike, angle: float) -> Pose:
    """The pose rolled about the viewing ray of ``centre`` by ``angle`` (rad), clockwise."""
    ray = np.array([0.0, 0.0, 1.0])
    if not isinstance(pose.camera, Parallel):
        ray = pose.camera_from_model.apply(centre)
    return rotate(pose, centre, angle * ray / np.linalg.norm(ray))


def scale_about(pose: Pose, centre: ArrayLike, zoom: float) -> Pose:
    """The pose with the model ``zoom`` times as large about ``centre``: by scale, or by depth."""
    camera, pixel = pose.camera, pose.project(centre)
    if isinstance(camera, Parallel):
        larger = replace(pose, camera=replace(camera, scale=camera.scale * zoom))
        return with_point_at(larger, centre, pixel)
    return with_point_at(pose, centre, pixel, pose.camera_from_model.apply(centre)[2] / zoom)


def radius_in_photo(pose: Pose, mesh: Mesh) -> float:
    """The model's radius about its centre, in px of the photo; nan behind the camera."""
    centre = pose.camera_from_model.apply(mesh.centre)
    rim = centre + np.array([mesh.diameter / 2.0, 0.0, 0.0])
    return float(np.linalg.norm(pose.camera.project(rim) - pose.camera.project(centre)))


def fit_pins(mesh: Mesh, pose: Pose, points: ArrayLike, pixels: ArrayLike) -> Pose:
    """The pose nearest to a given one by which pins have their pixels.

    Args:
        mesh: the model.
        pose: before the drag.
        points: (k, 3), the pins in the model's frame.
        pixels: (k, 2), their pixels.
    """
    points, pixels = np.atleast_2d(points), np.atleast_2d(pixels)
    if len(points) == 1:
        return with_point_at(pose, points[0], pixels[0])
    chart = FreeBodyChart.near(mesh, pose)

    def residuals(parameters: FloatArray) -> FloatArray:
        try:
            projections = chart.to_pose(parameters).project(points)
        except OutsideChartError:
            projections = np.full(pixels.shape, 1e6)
        errors = np.nan_to_num(projections - pixels, nan=1e6)
        return np.append(errors.ravel(), STIFFNESS * parameters)

    solution = least_squares(residuals, np.zeros(len(chart.names)), method="lm", max_nfev=200)
    return chart.to_pose(solution.x)


def vehicle_pins(chart: VehicleChart, parameters: FloatArray) -> FloatArray:
    """(3, 2): pixels of rear wheel, front wheel, and the tip of the rear axle."""
    size = np.array([chart.camera.width, chart.camera.height])
    rear = parameters[0:2] * size
    tip = rear + parameters[4:6] * _axle_length(chart)
    return np.array([rear, rear + parameters[2:4] * size, tip])


def with_vehicle_pin(
    chart: VehicleChart, parameters: FloatArray, pin: int, pixel: ArrayLike
) -> FloatArray:
    """The parameters (6,) of a chart with one pin moved and the others in place.

    Args:
        chart: the vehicle's.
        parameters: (6,), before.
        pin: index among ``vehicle_pins``.
        pixel: (2,), to which it goes.
    """
    pins = vehicle_pins(chart, parameters)
    pins[pin] = pixel
    size = np.array([chart.camera.width, chart.camera.height])
    psi = (pins[2] - pins[0]) / _axle_length(chart)
    rim = math.sqrt(1.0 - MIN_AXLE_COMPONENT**2) - 1e-6
    psi *= min(1.0, rim / max(float(np.linalg.norm(psi)), 1e-12))
    return np.concatenate([pins[0] / size, (pins[1] - pins[0]) / size, psi])


def _axle_length(chart: VehicleChart) -> float:
    """Px per unit of psi, as drawn."""
    return 0.25 * min(chart.camera.width, chart.camera.height)
