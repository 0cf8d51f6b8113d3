"""Starts without a person: poses proposed by a search over views, and the best of them taken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import QuickStartError, SettingsError
from poseviewer.files.photo.load import load_mask
from poseviewer.fit.loss import registration_loss
from poseviewer.fit.problem import FitProblem, fit_pose, make_photo_attributes, make_problem
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Pose
from poseviewer.geometry.hull import hull_points
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.photo import Photo
from poseviewer.render.renderers import make_renderer
from poseviewer.render.types import PhotoAttributes, Renderer
from poseviewer.starts.box_fit import Box, BoxFits, fit_box
from poseviewer.starts.boxes import find_boxes
from poseviewer.starts.marks import Material, Rectangle, Start, StartCamera, likely_wheels
from poseviewer.starts.view_search import Proposal, ViewProblem, ViewRules, find_views, ranked
from poseviewer.starts.views import even_rotations, ground_views
from poseviewer.vehicle.chart import visible_side
from poseviewer.vehicle.keypoints import VehicleKeypoints
from poseviewer.vehicle.wheel_pose import Wheels

MOST_BY_WHEELS = 4
"""Poses that a vehicle's wheels give."""
WHEEL_APART = 0.7
"""Of a wheel's half axis: so near to where it was found a pose must put a wheel's centre."""

AUTOMATIC = "auto"
"""In the place of a pose file: find a start."""
MARGIN = 0.35
"""How far the compared pixels reach beyond the rectangle, as a share of its sides."""
SMALLEST_BOX = 8
"""px: sides of a rectangle."""
CORNERS = 120
"""Corners of the model that say where its outline is, to a per cent."""
TRIAL = Limits(400)
"""Of the fit from each proposal that decides which is taken."""


@dataclass(frozen=True, slots=True, eq=False)
class Wanted:
    """What a start is looked for."""

    photo: Photo
    mesh: Mesh
    keypoints: VehicleKeypoints | None
    camera: Camera
    box: Rectangle | None = None
    """Rectangle (left, top, width, height) about the object, px; None: anywhere in the photo."""
    settings: FitSettings = field(default_factory=FitSettings)
    mask: NDArray[np.float32] | None = None
    rules: ViewRules = field(default_factory=ViewRules)

    @property
    def corners(self) -> FloatArray:
        """(k, 3): those of the model that say where its outline is."""
        return few_corners(self.mesh)


@dataclass(frozen=True, slots=True, eq=False)
class Proposals:
    """Poses to start from, the best first; there is one at least."""

    found: tuple[Proposal, ...]
    photo: PhotoAttributes
    """What they were compared on: the region about the rectangle."""


def propose(
    wanted: Wanted, renderer: Renderer | None = None, begin: Callable[[], None] | None = None
) -> Proposals:
    """Up to five start poses, by a search over views on all cores; some 3,000 evaluations of small
    pictures. The same arguments give the same proposals.

    ``begin`` is called by each thread first (to lower its priority, say).

    Raises:
        QuickStartError: the rectangle is too small, or not in the photo.
        SettingsError: the region leaves too few pixels.
    """
    renderer = make_renderer(wanted.mesh) if renderer is None else renderer
    if wanted.box is not None:
        box = _checked(wanted.box, wanted.photo)
        fits, photo = _fits(wanted, box), _photo_about(wanted, box)
        problem = _problem(wanted, box, photo)
        views = find_views(problem, fits, renderer, begin)
        return _some(_by_wheels(wanted, problem, views, renderer, begin), photo)
    return _propose_anywhere(wanted, renderer, begin)


def _by_wheels(
    wanted: Wanted,
    problem: ViewProblem,
    views: tuple[Proposal, ...],
    renderer: Renderer,
    begin: Callable[[], None] | None,
) -> tuple[Proposal, ...]:
    """The proposals of ``views``; where the photo shows a vehicle's two wheels, the poses by them,
    and of the views those alone that put the wheels there: a pose that does not can have less loss
    on a car whose paint is not the model's.
    """
    if wanted.keypoints is None or wanted.box is None:
        return views
    material = Material(wanted.photo, wanted.mesh, wanted.keypoints)
    try:
        found = likely_wheels(material, wanted.box, wanted.camera)
    except QuickStartError:  # no two are seen, as from in front
        return views
    agreeing = [one for one in views if _shows(one.pose, wanted.keypoints, found[0].wheels)]
    poses = [one.fit.pose for one in found[:MOST_BY_WHEELS]]
    return ranked(problem, [*agreeing, *(Proposal(p, np.inf) for p in poses)], renderer, begin)


def _shows(pose: Pose, keypoints: VehicleKeypoints, wheels: Wheels) -> bool:
    """Whether a pose has the wheels about where they were found."""
    side = visible_side(keypoints, pose)
    pairs = (wheels.rear, side.rear_wheel), (wheels.front, side.front_wheel)
    away = [
        np.hypot(*(pose.project(centre) - [wheel.cx, wheel.cy])) / wheel.a
        for wheel, centre in pairs
    ]
    return bool(max(away) < WHEEL_APART)


def _propose_anywhere(
    wanted: Wanted, renderer: Renderer, begin: Callable[[], None] | None
) -> Proposals:
    everywhere = Box(0.0, 0.0, float(wanted.photo.width), float(wanted.photo.height))
    photo = _photo_about(wanted, everywhere)
    boxes = find_boxes(photo, lambda box, count: _few_fits(wanted, box, count), renderer, begin)
    # The squares say where, not which shape; each has its share of the views.
    wanted = replace(wanted, rules=replace(wanted.rules, misshapen=np.inf, box_weight=0.0))
    found: list[Proposal] = []
    for box in boxes:
        near = _problem(wanted, box, _photo_about(wanted, box))
        found += find_views(near, _fits(wanted, box, 2 * len(boxes)), renderer, begin)
    # Regions about other places are other pixels: all are compared again, over the whole photo.
    largest = max(boxes, key=lambda box: box.width)
    return _some(ranked(_problem(wanted, largest, photo), found, renderer, begin), photo)


def best_start(
    wanted: Wanted, proposals: Proposals, renderer: Renderer, watch: Callable[[], object]
) -> Start:
    """The pose to go on from: a short fit from each proposal, and the end of least loss.

    ``watch`` is called after every evaluation; whatever it raises ends the search.
    """
    poses = [fitted(wanted, one.pose, renderer, watch) for one in proposals.found]
    losses = [registration_loss(renderer.moments(pose, proposals.photo)) for pose in poses]
    best = int(np.argmin(losses))
    return Start(poses[best], (_note(best, losses),))


def fitted(wanted: Wanted, start: Pose, renderer: Renderer, watch: Callable[[], object]) -> Pose:
    """Where a short fit from ``start`` ends; ``start`` where none can be made from it."""
    settings = replace(wanted.settings, method="default", lock=(), limits=TRIAL)
    registration = Registration(wanted.photo, wanted.mesh, "", "", wanted.keypoints, start, ())
    try:
        problem: FitProblem = make_problem(registration, settings, wanted.mask)[0]
    except SettingsError:
        return start
    pose = start
    for progress in fit_pose(problem, renderer):
        pose = progress.pose
        watch()
    return pose


def _note(best: int, losses: list[float]) -> str:
    text = f"start found: the {_ordinal(best + 1)} of {len(losses)} proposals, loss "
    others = sorted(loss for index, loss in enumerate(losses) if index != best)
    if not others:
        return f"start found: one proposal, loss {losses[best]:.2f}; look whether it is right."
    return f"{text}{losses[best]:.2f}, the next best {others[0]:.2f}; look whether it is right."


def _ordinal(number: int) -> str:
    return {1: "first", 2: "second", 3: "third", 4: "fourth"}.get(number, f"{number}th")


@dataclass(frozen=True, slots=True, eq=False)
class AutoStart:
    """``find`` is a start for ``quick_start.load_unplaced``."""

    box: Rectangle | None = None
    """About the object; None: the settings' region, or anywhere."""
    camera: StartCamera = field(default_factory=StartCamera)
    settings: FitSettings = field(default_factory=FitSettings)
    mask: Path | None = None
    watch: Callable[[], object] = lambda: None

    def find(self, material: Material) -> Start:
        """The best of the proposals.

        Raises:
            PoseViewerError: the rectangle, the region or the mask cannot be used.
        """
        photo, box = material.photo, self.box or self.settings.region
        mask = load_mask(self.mask, photo.width, photo.height) if self.mask else None
        camera = self.camera.of(photo)
        wanted = Wanted(photo, material.mesh, material.keypoints, camera, box, self.settings, mask)
        renderer = make_renderer(material.mesh)
        return best_start(wanted, propose(wanted, renderer), renderer, self.watch)


@lru_cache(maxsize=4)
def few_corners(mesh: Mesh) -> FloatArray:
    """(k, 3): the outermost vertices in some hundred directions, in the model's frame."""
    corners = hull_points(mesh)
    outermost = np.argmax(corners @ even_rotations(CORNERS)[:, 2].T, axis=0)
    return corners[np.unique(outermost)]


def _checked(box: Rectangle, photo: Photo) -> Box:
    left, top, width, height = box
    inside = (
        min(left + width, photo.width) - max(left, 0),
        min(top + height, photo.height) - max(top, 0),
    )
    if min(inside) < SMALLEST_BOX:
        raise QuickStartError(
            f"--box {left},{top},{width},{height}: has no {SMALLEST_BOX}x{SMALLEST_BOX} px in the "
            f"photo of {photo.width}x{photo.height} px; give the object's left,top,width,height."
        )
    return Box(float(left), float(top), float(width), float(height))


def _some(found: tuple[Proposal, ...], photo: PhotoAttributes) -> Proposals:
    if not found:
        raise QuickStartError(
            "No view of the model fits there; lay the rectangle closer about the object."
        )
    return Proposals(found, photo)


def _fits(wanted: Wanted, box: Box, share: int = 1) -> BoxFits:
    """The views to be tried, a ``share``-th of them. A vehicle's are those on level ground."""
    if wanted.keypoints is None:
        return _filling(wanted, box, even_rotations(wanted.rules.views // share))
    return _filling(wanted, box, ground_views(wanted.keypoints)[::share])


def _few_fits(wanted: Wanted, box: Box, count: int) -> BoxFits:
    """About ``count`` of these views."""
    if wanted.keypoints is None:
        return _filling(wanted, box, even_rotations(count))
    views = ground_views(wanted.keypoints)
    return _filling(wanted, box, views[:: -(-len(views) // count)])


def _filling(wanted: Wanted, box: Box, rotations: FloatArray) -> BoxFits:
    return fit_box(box, rotations, wanted.corners, wanted.mesh.centre, wanted.camera)


def _problem(wanted: Wanted, box: Box, photo: PhotoAttributes) -> ViewProblem:
    mesh = wanted.mesh
    return ViewProblem(photo, box, wanted.corners, mesh.centre, mesh.diameter / 2.0, wanted.rules)


def _photo_about(wanted: Wanted, box: Box) -> PhotoAttributes:
    """The photo with the surroundings of a rectangle as its region."""
    wide = box.grown(2.0 * MARGIN)
    left, top = max(int(wide.left), 0), max(int(wide.top), 0)
    right, bottom = int(wide.left + wide.width) + 1, int(wide.top + wide.height) + 1
    return _attributes(wanted, box, (left, top, right - left, bottom - top))


def _attributes(wanted: Wanted, box: Box, region: Rectangle) -> PhotoAttributes:
    """Over a region within the settings' own, by the default method's way to compare."""
    own = wanted.settings.region
    settings = replace(wanted.settings, method="default", pixels="whole", region=_both(region, own))
    some = _few_fits(wanted, box, 1).poses[0]
    return make_photo_attributes(wanted.photo, wanted.mesh, some, settings, wanted.mask)


def _both(one: Rectangle, other: Rectangle | None) -> Rectangle:
    """What two rectangles share; of a box far from the region, the box."""
    if other is None:
        return one
    left, top = max(one[0], other[0]), max(one[1], other[1])
    right = min(one[0] + one[2], other[0] + other[2])
    bottom = min(one[1] + one[3], other[1] + other[3])
    return (left, top, right - left, bottom - top) if right > left and bottom > top else one
