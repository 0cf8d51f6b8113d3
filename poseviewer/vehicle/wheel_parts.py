"""Find a vehicle's wheels among the named parts of a model, by words in English and German."""

import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import face_normals_and_areas
from poseviewer.vehicle.vehicle_keypoints import SideKeypoints, VehicleKeypoints

WHEEL_WORDS = (
    r"wheels?|tires?|tyres?|rims?|hubcaps?|rad|raeder|rader|reifen|felgen?|vorderrad|hinterrad"
    r"|(front|rear|back|left|right|[lrfb]{1,2})wheel|wheel(front|rear|back|left|right|[lrfb]{1,2})"
)
NOT_A_WHEEL_WORDS = (
    r"steer\w*|spare|arch\w*|hous\w*|well\w*|wheelarch\w*|wheelhous\w*|wheelwell\w*|fender"
    r"|lenkrad|ersatz|reserverad|kasten|radkasten"
)
"""Words of parts that no car drives on, beside those of wheels."""
FRONT_WORDS = r"f[lr]|[lr]f|v[lr]|front\w*|vorn\w*|vorder\w*"
REAR_WORDS = r"[rb]l|[lrb]r|h[lr]|rear\w*|back\w*|hint\w*"
"""Words of wheels, FL to VR and BL to HR among them."""
FRONT_BODY_WORDS = (
    r"head(light|lamp)s?|bonnet|hood|gr[iy]lle?|radiator|windscreen|windshield|engine|front\w*"
    r"|scheinwerfer|motorhaube|kuhlergrill"
)
REAR_BODY_WORDS = (
    r"tail(light|lamp|gate)s?|trunk|boot|exhaust|muffler|tailpipe|rear\w*|heck\w*|rucklicht\w*"
    r"|auspuff|kofferraum"
)
"""Words of parts at one end of a car."""
MISLEADING_BODY_WORDS = r"mirrors?|view|spiegel\w*|seats?|doors?"
"""Words of parts that do not vote: a rear-view mirror is in front, doors lie in the middle."""
ROOF_SHARE = 0.25
"""Share of the height in which the roof is."""
MIN_POINTS = 16
"""Points of wheels, four for each: fewer are no circles."""


@dataclass(frozen=True, slots=True, eq=False)
class _Layout:
    """Four wheels in the vehicle's axes, whose signs along and up are still open."""

    axes: FloatArray
    """(3, 3) rows: unit directions along, across, up."""
    centres: FloatArray
    """(4, 3) middle of each wheel's box along these directions."""
    half_widths: FloatArray
    """(4,) half the extent across."""
    label: NDArray[np.int32]
    """(W,) index of each wheel vertex's wheel."""


def find_wheels(mesh: Mesh) -> VehicleKeypoints | None:
    """Find the key points of a vehicle whose wheels are named parts, else None.

    The parts must fall into four clusters on a rectangle. The front is told by lamps, bonnet and
    boot beyond the axles, else by the wheels' names, else by the roof, which stands behind the
    middle of the wheelbase. A key point is the centre of the wheel's outer face.
    """
    wheel_parts = [i for i, name in enumerate(mesh.part_names) if is_wheel_name(name)]
    vertex_part = np.full(len(mesh.vertices), -1)
    vertex_part[mesh.faces] = mesh.face_part[:, None]
    chosen = np.isin(vertex_part, wheel_parts)
    if np.unique(mesh.vertices[chosen], axis=0).shape[0] < MIN_POINTS:
        return None
    layout = _four_wheels(mesh.vertices[chosen])
    if layout is None:
        return None
    # Most of a vehicle stands above its wheels' centres.
    heights, middle = mesh.vertices @ layout.axes[2], layout.centres[:, 2].mean()
    is_up = heights.max() - middle > middle - heights.min()
    up = layout.axes[2] if is_up else -layout.axes[2]
    vote = (
        _vote_of_body(mesh, layout)
        or _vote_of_wheel_names(mesh, layout, vertex_part[chosen])
        or _vote_of_roof(mesh, layout, up)
    )
    try:
        return _key_points(layout, -layout.axes[0] if vote < 0.0 else layout.axes[0], up)
    except ValueError:
        return None


def is_wheel_name(name: str) -> bool:
    """Tell whether a part of this name belongs to a road wheel."""
    words = _words(name)
    return _any(WHEEL_WORDS, words) and not _any(NOT_A_WHEEL_WORDS, words)


def _words(name: str) -> list[str]:
    """Split into lower-case words without accents; wheelFL, Wheel1 and wheel_fl hold "wheel"."""
    plain = unicodedata.normalize("NFKD", name)
    plain = "".join(c for c in plain if not unicodedata.combining(c)).replace("ß", "ss")
    return [w.lower() for w in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", plain)]


def _any(pattern: str, words: Iterable[str]) -> bool:
    return any(re.fullmatch(pattern, word) for word in words)


def _four_wheels(points: FloatArray) -> _Layout | None:
    """Find four clusters of the points (W, 3) at the corners of a rectangle, or None."""
    seeds = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    distance = np.full(len(points), np.inf)
    for _ in range(3):
        distance = np.minimum(distance, np.linalg.norm(points - points[seeds[-1]], axis=1))
        seeds.append(int(np.argmax(distance)))
    _, label = kmeans2(points, points[seeds], minit="matrix", iter=20)
    if len(np.unique(label)) < 4:
        return None
    axes = _rectangle_axes(_boxes(points, label)[0])
    if axes is None:
        return None
    centres, size = _boxes(points @ axes.T, label)
    spacing = np.ptp(centres, axis=0)[:2]
    wheels_alike = np.ptp(size[:, 2]) < 0.3 * size[:, 2].max()
    if np.any(size[:, :2] > 0.6 * spacing) or not wheels_alike:
        return None
    return _Layout(axes, centres, size[:, 1] / 2.0, label)


def _boxes(points: FloatArray, label: NDArray) -> tuple[FloatArray, FloatArray]:
    """Return centres and sizes (4, 3) of the boxes of four clusters of points."""
    clusters = [points[label == i] for i in range(4)]
    low, high = (np.stack([end(c, axis=0) for c in clusters]) for end in (np.min, np.max))
    return (low + high) / 2.0, high - low


def _rectangle_axes(corners: FloatArray) -> FloatArray | None:
    """Return directions (3, 3) along the longer sides, the shorter sides, and across both."""
    sides = corners[1:] - corners[0]
    short, long, diagonal = sides[np.argsort(np.linalg.norm(sides, axis=1))]
    length = np.linalg.norm(long)
    if np.linalg.norm(short + long - diagonal) > 0.15 * length:
        return None
    along = (long + diagonal - short) / np.linalg.norm(long + diagonal - short)
    across = short - along * (along @ short)
    if np.linalg.norm(across) < 0.2 * length or np.linalg.norm(short) > 0.95 * length:
        return None
    across = across / np.linalg.norm(across)
    return np.stack([along, across, np.cross(along, across)])


def _vote_of_body(mesh: Mesh, layout: _Layout) -> float:
    """Count parts of one end that lie beyond a quarter of the wheelbase from the middle."""
    middle = layout.centres[:, 0].mean()
    reach = 0.25 * np.ptp(layout.centres[:, 0])
    vote = 0.0
    for name in mesh.part_names:
        words = _words(name)
        if is_wheel_name(name) or _any(MISLEADING_BODY_WORDS, words):
            continue
        sign = _any(FRONT_BODY_WORDS, words) - _any(REAR_BODY_WORDS, words)
        if sign:
            part = mesh.part_vertices(name)
            ahead = (part.min(axis=0) + part.max(axis=0)) / 2.0 @ layout.axes[0] - middle
            vote += sign * np.sign(ahead) * (abs(ahead) > reach)
    return vote


def _vote_of_wheel_names(mesh: Mesh, layout: _Layout, part_of_point: NDArray) -> float:
    vote = 0.0
    for wheel, side in enumerate(np.sign(layout.centres[:, 0] - layout.centres[:, 0].mean())):
        for part in np.unique(part_of_point[layout.label == wheel]):
            words = _words(mesh.part_names[part])
            vote += side * (int(_any(FRONT_WORDS, words)) - int(_any(REAR_WORDS, words)))
    return vote


def _vote_of_roof(mesh: Mesh, layout: _Layout, up: FloatArray) -> float:
    """Vote away from the roof, which stands behind the wheelbase's middle (not in pick-ups)."""
    _, areas = face_normals_and_areas(mesh.vertices, mesh.faces)
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    heights = mesh.vertices @ up
    roof = centres @ up > heights.max() - ROOF_SHARE * np.ptp(heights)
    if not areas[roof].sum() > 0.0:
        return 0.0
    roof_centre = np.average(centres[roof] @ layout.axes[0], weights=areas[roof])
    return float(layout.centres[:, 0].mean() - roof_centre)


def _key_points(layout: _Layout, front: FloatArray, up: FloatArray) -> VehicleKeypoints:
    left = np.cross(up, front)
    centres = layout.centres @ layout.axes
    sides = []
    for outwards in (left, -left):
        on_side = np.flatnonzero((centres - centres.mean(axis=0)) @ outwards > 0.0)
        rear, ahead = on_side[np.argsort(centres[on_side] @ front)]
        faces = centres + layout.half_widths[:, None] * outwards
        sides.append(SideKeypoints(faces[rear], faces[ahead], outwards))
    return VehicleKeypoints(left=sides[0], right=sides[1])
