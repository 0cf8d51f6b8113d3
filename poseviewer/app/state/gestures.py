"""What a drag does: which thing the pointer takes hold of, and where that takes the pose."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from poseviewer.app.state.document import Document
from poseviewer.app.state.motions import (
    moved,
    pinned,
    radius_in_photo,
    rolled_and_scaled,
    trackball,
    turned,
    vehicle_pins,
    with_vehicle_pin,
)
from poseviewer.fit.landscape import Slice
from poseviewer.geometry.arrays import FloatArray
from poseviewer.render.overlay.contour import within
from poseviewer.vehicle.chart import VehicleChart

PIN_REACH = 14.0
"""A pin is taken within so many px of the screen."""
RING_REACH = 8.0
"""A rotation ring is taken within so many px of the screen."""
MODEL_REACH = 12.0
"""The model is taken so many px of the screen beside its convex outline, too."""
RING_STEPS = 72
LEAST_RING_SPEED = 0.3
"""Where a ring runs towards the eye, it turns no faster than by this share of its radius."""


class Drag(Protocol):
    """Something that the pointer holds."""

    def apply(self, document: Document, point: FloatArray) -> Document:
        """The document with the pointer at ``point`` (2,), px of the photo."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ModelDrag:
    """The model itself: moved, turned (shift), or rolled and scaled (ctrl)."""

    held: Document
    start: FloatArray
    way: str

    def apply(self, document: Document, point: FloatArray) -> Document:
        """See ``geometry.motions``."""
        pose, mesh = self.held.pose, self.held.registration.mesh
        if self.way == "turn":
            radius = max(radius_in_photo(pose, mesh), 1.0)
            pose = trackball(pose, mesh.centre, radius, self.start, point)
        elif self.way == "roll":
            pose = rolled_and_scaled(pose, mesh.centre, self.start, point)
        else:
            pose = moved(pose, mesh.centre, point - self.start)
        return replace(document, pose=pose)


@dataclass(frozen=True, slots=True, eq=False)
class VehiclePinDrag:
    """One of the three pins that are the vehicle chart's numbers."""

    held: Document
    chart: VehicleChart
    pin: int
    offset: FloatArray
    """(2,): from the pointer to the pin, when it was taken."""

    def apply(self, document: Document, point: FloatArray) -> Document:
        """The numbers of the pin follow the pointer."""
        parameters = self.chart.from_pose(self.held.pose)
        changed = with_vehicle_pin(self.chart, parameters, self.pin, point + self.offset)
        return replace(document, pose=self.chart.to_pose(changed))


@dataclass(frozen=True, slots=True, eq=False)
class SurfacePinDrag:
    """One of the pins on the surface; the others hold."""

    held: Document
    pin: int
    offset: FloatArray

    def apply(self, document: Document, point: FloatArray) -> Document:
        """The least motion that shows every pinned point under its pin."""
        pose, points = self.held.pose, np.array(self.held.pins)
        pixels = pose.project(points)
        pixels[self.pin] = point + self.offset
        return replace(document, pose=pinned(self.held.registration.mesh, pose, points, pixels))


@dataclass(frozen=True, slots=True, eq=False)
class RingDrag:
    """One of the rings about the model's axes."""

    held: Document
    axis: int
    start: FloatArray
    tangent: FloatArray
    """(2,): px that the ring runs for each radian, where it was taken."""

    def apply(self, document: Document, point: FloatArray) -> Document:
        """The turn that the pointer's way along the ring amounts to."""
        angle = float((point - self.start) @ self.tangent) / float(self.tangent @ self.tangent)
        axis = self.held.pose.camera_from_model.rotation[:, self.axis]
        centre = self.held.registration.mesh.centre
        return replace(document, pose=turned(self.held.pose, centre, angle * axis))


@dataclass(frozen=True, slots=True, eq=False)
class RegionDrag:
    """A rectangle that is being drawn on the photo."""

    start: FloatArray

    def apply(self, document: Document, point: FloatArray) -> Document:
        """The region between two corners, cut to the photo; smaller than 2 px: none."""
        photo = document.registration.photo
        size = np.array([photo.width, photo.height])
        low, high = np.sort(np.clip([self.start, point], 0, size), axis=0)
        left, top = (int(v) for v in np.floor(low))
        right, bottom = (int(v) for v in np.ceil(high))
        region = (left, top, right - left, bottom - top)
        if min(region[2:]) < 2:
            return replace(document, settings=replace(document.settings, region=None))
        return replace(document, settings=replace(document.settings, region=region))


def take_hold(
    document: Document, point: FloatArray, zoom: float, way: str, rings: bool
) -> Drag | None:
    """What lies under ``point``: a pin, a ring, or the model; None for nothing.

    ``zoom``: screen px per photo px; ``way``: what holding the model does.
    """
    pins = pins_in_photo(document)
    if len(pins):
        away = np.nan_to_num(np.linalg.norm(pins - point, axis=1) * zoom, nan=np.inf)
        pin = int(np.argmin(away))
        if away[pin] <= PIN_REACH:
            offset, chart = pins[pin] - point, document.chart
            if isinstance(chart, VehicleChart) and not document.pins:
                return VehiclePinDrag(document, chart, pin, offset)
            return SurfacePinDrag(document, pin, offset)
    if rings:
        ring = _ring_at(document, point, zoom)
        if ring is not None:
            return ring
    mesh = document.registration.mesh
    if within(point, document.pose, mesh, MODEL_REACH / zoom):
        return ModelDrag(document, point, way)
    return None


def pins_in_photo(document: Document) -> FloatArray:
    """(k, 2): where the pins are, in px: a vehicle's three, or those on the surface."""
    if document.pins:
        return document.pose.project(np.array(document.pins))
    chart = document.chart
    if isinstance(chart, VehicleChart):
        return vehicle_pins(chart, chart.from_pose(document.pose))
    return np.zeros((0, 2))


def rings_in_photo(document: Document) -> FloatArray:
    """(3, RING_STEPS + 1, 3): circles about the model's axes, as seen from afar; the last
    coordinate is below 0 on the near side.
    """
    rotation = document.pose.camera_from_model.rotation
    angles = np.linspace(0.0, 2.0 * math.pi, RING_STEPS + 1)
    rings = []
    for axis in range(3):
        one, other = rotation[:, (axis + 1) % 3], rotation[:, (axis + 2) % 3]
        rings.append(np.cos(angles)[:, None] * one + np.sin(angles)[:, None] * other)
    found = np.array(rings) * ring_radius(document)
    found[..., :2] += document.pose.project(document.registration.mesh.centre)
    return found


def ring_radius(document: Document) -> float:
    """In px of the photo: beyond most of the model, within most photos."""
    photo = document.registration.photo
    radius = radius_in_photo(document.pose, document.registration.mesh)
    return float(np.clip(0.8 * radius, 30.0, 0.45 * min(photo.width, photo.height)))


def _ring_at(document: Document, point: FloatArray, zoom: float) -> RingDrag | None:
    rings = rings_in_photo(document)
    away = np.linalg.norm(rings[..., :2] - point, axis=2) * zoom
    away = np.where(rings[..., 2] <= 1e-9, away, np.inf)  # the far half is behind the model
    axis, step = np.unravel_index(int(np.argmin(away)), away.shape)
    if not away[axis, step] <= RING_REACH:
        return None
    ring = rings[axis, :-1, :2]
    step = int(step) % RING_STEPS
    ahead, behind = ring[(step + 1) % RING_STEPS], ring[step - 1]
    tangent = (ahead - behind) * (RING_STEPS / (4.0 * math.pi))
    least = LEAST_RING_SPEED * ring_radius(document)
    speed = float(np.linalg.norm(tangent))
    if speed < least:
        tangent = tangent / max(speed, 1e-9) * least
    return RingDrag(document, int(axis), point, tangent)


def picked_numbers(piece: Slice, centre: FloatArray, u: float, v: float) -> FloatArray:
    """(d,): the numbers at a press on a map through ``centre`` (d,).

    ``u`` and ``v`` are the place from the map's left and lower border as a share of its side;
    beyond 0 and 1 the border is meant. Nothing snaps to the grid.
    """
    parameters = np.array(centre, dtype=float)
    u, v = (min(max(float(share), 0.0), 1.0) for share in (u, v))
    x, y = piece.first_values, piece.second_values
    parameters[piece.first] = x[0] + u * (x[-1] - x[0])
    parameters[piece.second] = y[0] + v * (y[-1] - y[0])
    return parameters
