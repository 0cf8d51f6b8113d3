"""Starts without user input: by texture features, by wheels, and by views that fill a rectangle.

A model with texture is found anywhere in a photo (``texture_features``), and so is a vehicle of
which two wheels are seen. In a rectangle about the object, views of its shape are scored by the
loss on the coarsest pyramid level; the best that differ are improved by short descents, the best of
these by longer ones, and a few pose hypotheses are left.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache, reduce
from pathlib import Path
from typing import NamedTuple

import numpy as np

from poseviewer.errors import QuickStartError, SettingsError, percent
from poseviewer.fit.problem import make_problem
from poseviewer.fit.stages import fit_pose
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh, hull_points
from poseviewer.geometry.rectangle import Rectangle, non_maximum_suppression
from poseviewer.losses.default_loss import DEFAULT
from poseviewer.optimise.nelder_mead import Descent, NelderMeadOptions
from poseviewer.render.attributes import PhotoAttributes, Renderer
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import Level, make_level
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.settings import FitSettings, Limits
from poseviewer.scene.types import Scene
from poseviewer.starts.dino_features import PatchEncoder
from poseviewer.starts.learned import compare_with_photo, propose_rectangles
from poseviewer.starts.start import Start, StartInputs
from poseviewer.starts.texture_features import SURE_INLIERS, poses_from_features
from poseviewer.starts.views import ViewPoses, ground_views, poses_filling, sample_rotations
from poseviewer.starts.wheels import likely_wheels
from poseviewer.vehicle.chart import visible_side
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints
from poseviewer.vehicle.wheel_pose import Wheels

AUTOMATIC = "auto"
"""Word in place of a pose file: find a start."""
MARGIN = 0.35
"""Reach of the compared pixels beyond the rectangle, as a share of its sides."""
TEXTURE_REACH = 0.5
"""Reach beyond the rectangle where a search has ended, as a share of its sides, in which texture is
looked for."""
MIN_OVERLAP = 0.2
"""Intersection over union of that rectangle and a proposal's: with less, another thing like it may
be meant."""
MIN_SIDE_PX = 8
"""Smallest side of a rectangle about the object."""
HULL_POINTS = 120
"""Directions whose outermost vertices stand for the model's outline, to a per cent."""
COVERED = 0.6
"""Typical fraction of its rectangle that a model covers."""
BEHIND_CAMERA = 4.0
"""Rectangle error of a pose partly behind the camera: each side is off by the side's length."""
WHEEL_POSES = 4
"""Hypotheses that a vehicle's wheels add."""
WHEEL_DISTANCE = 0.7
"""Distance, in half axes of a wheel that was found, within which a pose shows the wheel there."""
TOLERANCES = NelderMeadOptions(x_tolerance=1e-3, f_tolerance=1e-4)
"""Tolerances of descents."""
TRIAL = Limits(400)
"""Limits of the fit from each hypothesis that decides which is taken."""
ROTATIONS = 2400
"""Views spread over all rotations: 19 degrees apart. About half have the rectangle's shape."""
ASPECT_THRESHOLD = 0.35
"""Logarithm of the factor by which the aspect ratio of a view that is tried may be off."""
RECTANGLE_WEIGHT = 4.0
"""Weight of the squared distances of the outline's sides from the rectangle's, as shares."""
SIDE_PX = 40.0
"""Side of the rectangle, made square, on the coarsest level."""
PHOTO_SIDE_PX = 200.0
"""Side of the photo, made square, where poses by wheels anywhere in it are compared."""
MAX_HYPOTHESES = 5
"""Hypotheses for a user to choose from."""
GROWTH = 0.15
"""Growth of a rectangle that a network proposes, as a share of its sides."""
ROTATIONS_PER_RECTANGLE = 1200
"""Views that are tried in each rectangle that a network proposes."""
POSES_PER_RECTANGLE = 2
"""Best poses of each such rectangle, which are compared with those of the others."""
EVEN_COSINE = 0.54
"""Cosine of features of a pose that is as likely right as wrong, from photos with known poses."""
COSINE_SCALE = 0.04
"""Rise of the cosine that makes it e times as likely right."""
MIN_ODDS_SHARE = 1.0 / 3.0
"""Smallest odds of a pose by features that is proposed, as a share of the likeliest one's."""
SURE_PROBABILITY = 0.7
"""Probability by features from which a pose may be ``found``: of likelier ones most are right."""
INLIER_POWER = 4
"""Exponent of the number of inliers in the odds of a pose by texture features."""
EVEN_INLIERS = 7**4
"""``inliers ** INLIER_POWER`` of a pose that is as likely right as wrong."""
LEAD_POWER = 0.95
"""Exponent of the first hypothesis's lead in its odds, fitted to photos with known poses."""
EVEN_LEAD = 0.09
"""``lead ** LEAD_POWER`` of a hypothesis that is as likely right as wrong."""
OTHERS_SHARE = 0.07
"""Share of each other hypothesis in the probability that the first is wrong."""
MIN_HYPOTHESIS_DISTANCE = 0.1
"""Smallest mean distance of hypotheses in the photo, as a share of the rectangle's diagonal."""


class Round(NamedTuple):
    """A round of descents from the best poses so far."""

    count: int
    """Number of descents."""
    descent: Descent
    """Each of them; edges are radians and shares of the model's radius."""
    side_px: float
    """Side of the rectangle, made square, on the level."""


ROUNDS = (
    Round(32, Descent(0.12, 23, TOLERANCES), SIDE_PX),
    Round(10, Descent(0.08, 79, TOLERANCES), 60.0),
)
"""Rounds in a rectangle: many short descents in a small picture, few longer ones in a larger."""
SHORT_ROUND = ROUNDS[0]._replace(count=8)
"""Round of fewer descents, for each of several rectangles."""

BeginThread = Callable[[], None]
"""Called first by each thread of a search."""


@dataclass(frozen=True, slots=True, eq=False)
class StartQuery:
    """Inputs of a search for a start."""

    inputs: StartInputs
    camera: Camera
    rectangle: Rectangle | None = None
    """Rectangle about the object; None: it may be anywhere in the photo."""
    settings: FitSettings = field(default_factory=FitSettings)
    features: Path | None = None
    """Weights of a DINOv2 backbone that proposes rectangles where none is given."""

    @property
    def points(self) -> FloatArray:
        """(k, 3): the model's outermost vertices, in its frame."""
        return outermost_points(self.inputs.mesh)

    @property
    def box(self) -> Rectangle:
        """Rectangle to search.

        Raises:
            QuickStartError: hardly any of it is in the photo.
        """
        photo = self.inputs.photo
        if self.rectangle is None:
            return Rectangle(0.0, 0.0, photo.width, photo.height)
        left, top, width, height = self.rectangle
        inside = self.rectangle.intersection(Rectangle(0, 0, photo.width, photo.height))
        if min(inside.width, inside.height) < MIN_SIDE_PX:
            raise QuickStartError(
                f"box {left},{top},{width},{height}: has no {MIN_SIDE_PX}x{MIN_SIDE_PX} px in the "
                f"photo of {photo.width}x{photo.height} px; give the object's "
                "left,top,width,height."
            )
        return Rectangle(*map(float, self.rectangle))

    def views(self, count: int | None = None) -> ViewPoses:
        """Return ``count`` or all poses that fill the box, a vehicle's on level ground."""
        keypoints, centre = self.inputs.keypoints, self.inputs.mesh.centre
        if keypoints is None:
            rotations = sample_rotations(count or ROTATIONS)
        else:
            rotations = ground_views(keypoints)[:count]
        return poses_filling(self.box, rotations, self.points, centre, self.camera)

    @property
    def photo(self) -> PhotoAttributes:
        """Photo as the default method compares it, about the box in its region."""
        wide = self.box.expand(2.0 * MARGIN)
        low = max(int(wide.left), 0), max(int(wide.top), 0)
        region = Rectangle.from_corners(low, (int(wide.right) + 1, int(wide.bottom) + 1))
        if self.settings.region is not None:
            common = region.intersection(Rectangle(*self.settings.region))
            region = common if common.area > 0.0 else region
        settings = FitSettings(
            chart="free-body",
            pixels="whole",
            region=region,
            grey=self.settings.grey,
            colour_reflectance=self.settings.colour_reflectance,
        )
        pose = self.views(1).poses[0]
        return make_problem(self.inputs.scene(pose, settings))[0].photo


@dataclass(frozen=True, slots=True, eq=False)
class PoseHypothesis:
    """A start pose that may be right."""

    pose: Pose
    loss: float
    """Loss on the last level: to be compared with others of the same search."""
    probability: float = 0.0
    """Probability that it is right."""
    doubt: str = ""
    """Sentence why it may be far off, so that no verdict on a fit from it is ``found``."""

    @property
    def percent(self) -> str:
        """Probability in whole per cent, below 100: none is certain."""
        return percent(min(self.probability, 0.99))


def propose(
    query: StartQuery,
    renderer: Renderer | None = None,
    begin: BeginThread | None = None,
    watch: Callable[[], object] = lambda: None,
) -> list[PoseHypothesis]:
    """Find up to ``MAX_HYPOTHESES`` start poses, the likeliest first, the same each time.

    They come from texture features, from a vehicle's wheels, and in a rectangle from some 3,000
    evaluations of small pictures on all cores.

    Args:
        query: the photo, the model and where to search.
        renderer: renderer of the model; by default a new one.
        begin: called by each thread first.
        watch: called in each step; it may raise to stop the search.

    Raises:
        QuickStartError: hardly any of the rectangle is in the photo, no view fits there, or the
            photo shows neither texture features of the model nor its wheels.
    """
    if hypotheses := _from_features(query, watch):
        return hypotheses
    watch()
    renderer = make_renderer(query.inputs.mesh) if renderer is None else renderer
    search = _ViewSearch(query, query.box, query.photo, renderer, begin, watch)
    if query.rectangle is None:
        by_wheels = with_probabilities(_with_wheels(search, [], PHOTO_SIDE_PX))
        hypotheses = by_wheels or _in_proposed_rectangles(search)
        sentence = (
            "The model was not found in the photo by its texture or by a car's wheels; draw a "
            "rectangle about it (Fit to box), or give the box left,top,width,height."
        )
    else:
        views = search.best_views(query.views())
        hypotheses = with_probabilities(_with_wheels(search, views, SIDE_PX))
        sentence = "No view of the model fits there; lay the rectangle closer about the object."
    if not hypotheses:
        raise QuickStartError(sentence)
    return hypotheses


def _from_features(query: StartQuery, watch: Callable[[], object]) -> list[PoseHypothesis]:
    """Return hypotheses by the model's texture features, of those with enough inliers."""
    found = poses_from_features(query.inputs, query.camera, query.box, watch)
    powers = [(pose, n, n**INLIER_POWER) for pose, n in found if n >= SURE_INLIERS]
    return [PoseHypothesis(pose, -n, power / (power + EVEN_INLIERS)) for pose, n, power in powers]


def with_probabilities(hypotheses: Sequence[PoseHypothesis]) -> list[PoseHypothesis]:
    """Give hypotheses, the best first, probabilities by the first one's lead over the second."""
    if not hypotheses:
        return []
    lead = hypotheses[1].loss - hypotheses[0].loss if len(hypotheses) > 1 else 1.0
    first = lead**LEAD_POWER / (lead**LEAD_POWER + EVEN_LEAD)
    each = [first] + [OTHERS_SHARE * (1.0 - first)] * (len(hypotheses) - 1)
    return [replace(h, probability=p) for h, p in zip(hypotheses, each, strict=True)]


@dataclass(frozen=True, slots=True, eq=False)
class _ViewSearch:
    """A search over the views that fill a rectangle."""

    query: StartQuery
    rectangle: Rectangle
    photo: PhotoAttributes
    renderer: Renderer
    begin: BeginThread | None
    watch: Callable[[], object]

    def best_views(
        self, views: ViewPoses, rounds: Sequence[Round] = ROUNDS
    ) -> list[PoseHypothesis]:
        """Return the best views that differ, improved round by round."""
        hypotheses = self._try_all(views)
        for stage in rounds:
            hypotheses = self.descend(self.distinct(hypotheses, stage.count), stage)
        return self.distinct(hypotheses, MAX_HYPOTHESES)

    def within(self, rectangle: Rectangle) -> "_ViewSearch":
        """Return the search over the views that fill another rectangle."""
        query = replace(self.query, rectangle=rectangle)
        return replace(self, query=query, rectangle=query.box, photo=query.photo)

    def rank(self, poses: Sequence[Pose], side_px: float) -> list[PoseHypothesis]:
        """Score poses of any searches over this one's region; returns those that differ."""
        return self.distinct(self._score(poses, self._level(side_px), 1), MAX_HYPOTHESES)

    def _level(self, side_px: float) -> Level:
        """Make the level on which the rectangle, made square, has sides of about ``side_px``."""
        area = self.rectangle.area / self.photo.factor**2
        factor = max(1, round(area**0.5 / side_px))
        return make_level(self.photo, self.renderer, factor, COVERED * area)

    def _score(self, poses: Sequence[Pose], level: Level, *chunk: int) -> list[PoseHypothesis]:
        def score(renderer: Renderer, pose: Pose) -> PoseHypothesis:
            self.watch()
            return PoseHypothesis(pose, DEFAULT.of_moments(renderer.moments(pose, level.photo)))

        with RendererPool(level.renderer, begin=self.begin) as pool:
            return list(pool.map(score, poses, *chunk))

    def _try_all(self, views: ViewPoses) -> list[PoseHypothesis]:
        shaped = np.flatnonzero(views.aspect_errors <= ASPECT_THRESHOLD)
        if not len(shaped):
            shaped = np.argsort(views.aspect_errors)[: len(views.poses) // 10 + 1]
        scored = self._score([views.poses[i] for i in shaped], self._level(SIDE_PX))
        # Half of the logarithm goes to each of width and height, half of that to each side.
        costs = RECTANGLE_WEIGHT * 4.0 * (views.aspect_errors[shaped] / 4.0) ** 2
        return [
            PoseHypothesis(p.pose, p.loss + float(c)) for p, c in zip(scored, costs, strict=True)
        ]

    def descend(self, starts: Sequence[PoseHypothesis], stage: Round) -> list[PoseHypothesis]:
        """Return the ends of a round's descents from poses."""
        level, mesh = self._level(stage.side_px), self.query.inputs.mesh
        worst = DEFAULT.scale(level.photo).worst

        def descend(renderer: Renderer, start: PoseHypothesis) -> PoseHypothesis:
            chart = FreeBodyChart(start.pose, mesh.centre, mesh.diameter / 2.0)

            def loss_at(parameters: FloatArray) -> float:
                self.watch()
                try:
                    pose = chart.to_pose(parameters)
                except OutsideChartError:
                    return worst
                loss = DEFAULT.of_moments(renderer.moments(pose, level.photo))
                return loss + RECTANGLE_WEIGHT * self._rectangle_error(pose)

            end = stage.descent.run(loss_at, np.zeros(6))
            return PoseHypothesis(chart.to_pose(end.best), end.value)

        with RendererPool(level.renderer, begin=self.begin) as pool:
            return list(pool.map(descend, starts, at_a_time=1))

    def _rectangle_error(self, pose: Pose) -> float:
        """Sum the squared distances of the outline's sides from the rectangle's, as a share."""
        outline, target = pose.project(self.query.points), self.rectangle
        off = np.concatenate(
            [outline.min(axis=0) - target[:2], outline.max(axis=0) - [target.right, target.bottom]]
        )
        share = float(off @ off) / target.area
        return share if np.isfinite(share) else BEHIND_CAMERA

    def distinct(self, hypotheses: Sequence[PoseHypothesis], most: int) -> list[PoseHypothesis]:
        """Return the best whose pictures of the model differ."""
        reach = MIN_HYPOTHESIS_DISTANCE * float(np.hypot(*self.rectangle[2:]))
        ordered = sorted(hypotheses, key=lambda hypothesis: hypothesis.loss)
        pictures = ((h, h.pose.project(self.query.points)) for h in ordered)
        kept = non_maximum_suppression(
            (pair for pair in pictures if np.isfinite(pair[1]).all()),
            lambda a, b: bool(np.linalg.norm(a[1] - b[1], axis=1).mean() < reach),
            most,
        )
        return [hypothesis for hypothesis, _ in kept]


def _in_proposed_rectangles(search: _ViewSearch) -> list[PoseHypothesis]:
    """Return the best hypotheses in the rectangles that a network proposes, if there is one."""
    query, poses = search.query, list[Pose]()
    if query.features is None:
        return []
    encoder = PatchEncoder.load(query.features)

    def rank(poses: Sequence[Pose], count: int) -> list[PoseHypothesis]:
        cosines = compare_with_photo(query.inputs, encoder, poses, search.watch)
        odds = [math.exp((cosine - EVEN_COSINE) / COSINE_SCALE) for cosine in cosines]
        pairs = zip(poses, odds, strict=True)
        ranked = [_by_network(pose, odd) for pose, odd in pairs]
        size = outline_box(max(ranked, key=lambda h: h.probability).pose, query.points)
        return replace(search, rectangle=size).distinct(ranked, count)

    for rectangle in propose_rectangles(query.inputs, encoder, search.watch):
        with suppress(QuickStartError):  # hardly any of it is in the photo
            own = search.within(rectangle.expand(GROWTH))
            views = own.best_views(own.query.views(ROTATIONS_PER_RECTANGLE), (SHORT_ROUND,))
            poses += [view.pose for view in views[:POSES_PER_RECTANGLE]]
    if not poses:
        return []
    ends = list[Pose]()
    for best in rank(poses, MAX_HYPOTHESES):
        own = search.within(outline_box(best.pose, query.points))
        ends += [end.pose for end in own.descend([best], ROUNDS[-1])]
    hypotheses = rank(ends, MAX_HYPOTHESES)
    return [h for h in hypotheses if h.loss <= MIN_ODDS_SHARE * hypotheses[0].loss]


def _by_network(pose: Pose, odds: float) -> PoseHypothesis:
    """Make a hypothesis of the odds that the network gives it."""
    own = PoseHypothesis(pose, -odds, odds / (1.0 + odds))
    if own.probability >= SURE_PROBABILITY:
        return own
    least = f"of starts below {percent(SURE_PROBABILITY)} most are wrong"
    doubt = f"The network gives the start a probability of {own.percent}, and {least}."
    return replace(own, doubt=doubt)


def _with_wheels(
    search: _ViewSearch, views: list[PoseHypothesis], side_px: float
) -> list[PoseHypothesis]:
    """Return hypotheses by a vehicle's wheels, and ``views`` that show these; else the views."""
    query, keypoints = search.query, search.query.inputs.keypoints
    if keypoints is None:
        return views
    is_guess = bool(query.inputs.photo.focal_note(query.camera))
    try:
        pairs = likely_wheels(query.inputs, search.rectangle, query.camera, is_guess, search.watch)
    except QuickStartError:  # no two are seen, as from in front
        return views
    agreeing = [v.pose for v in views if _shows(v.pose, keypoints, pairs[0].wheels)]
    return search.rank([*agreeing, *(pair.fit.pose for pair in pairs[:WHEEL_POSES])], side_px)


def _shows(pose: Pose, keypoints: VehicleKeypoints, wheels: Wheels) -> bool:
    """Tell whether a pose shows the wheels about where they were found."""
    side = visible_side(keypoints, pose)
    pairs = (wheels.rear, side.rear_wheel), (wheels.front, side.front_wheel)
    off = [
        np.hypot(*(pose.project(centre) - [wheel.cx, wheel.cy])) / wheel.a
        for wheel, centre in pairs
    ]
    return bool(max(off) < WHEEL_DISTANCE)


def best_start(
    query: StartQuery,
    hypotheses: Sequence[PoseHypothesis],
    renderer: Renderer,
    watch: Callable[[], object] = lambda: None,
) -> Start:
    """Return the end of least loss of short fits from the hypotheses.

    Args:
        query: the photo, the model and where it was searched for.
        hypotheses: poses to choose from, at least one.
        renderer: renderer of the model.
        watch: called in each evaluation; it may raise to stop.
    """
    settings = replace(query.settings, loss=DEFAULT.name, search="auto", lock=(), limits=TRIAL)
    if query.rectangle is None:  # losses compare over the same pixels
        boxes = [outline_box(hypothesis.pose, query.points) for hypothesis in hypotheses]
        query = replace(query, rectangle=reduce(Rectangle.union, boxes))
    poses, photo = [], query.photo
    for pose in (hypothesis.pose for hypothesis in hypotheses):
        with suppress(SettingsError):
            for progress in fit_pose(make_problem(query.inputs.scene(pose, settings))[0], renderer):
                pose = progress.pose
                watch()
        poses.append(pose)
    losses = [DEFAULT.of_moments(renderer.moments(pose, photo)) for pose in poses]
    best = int(np.argmin(losses))
    rating = f"probability {hypotheses[best].percent}, loss {losses[best]:.2f}"
    note = f"start found: proposal {best + 1} of {len(losses)}, {rating}"
    note += f", the next best {sorted(losses)[1]:.2f}" if len(losses) > 1 else ""
    note = f"{note}; look whether it is right."
    return Start(poses[best], (note,), doubt=hypotheses[best].doubt)


def propose_about(scene: Scene, object_index: int, view_index: int) -> list[Pose]:
    """Propose starts for an object that may stand far off: by texture about where it stands, else
    those that fill the rectangle where it stands.

    Args:
        scene: the scene.
        object_index: index of the object.
        view_index: index of the view.
    """
    item, view = scene.objects[object_index], scene.views[view_index]
    pose = scene.pose(object_index, view_index)
    inputs = StartInputs(view.photo, item.mesh, item.model.keypoints, view.mask, item.settings)
    box = outline_box(pose, outermost_points(item.mesh))
    near, wide = (
        StartQuery(inputs, pose.camera, rectangle, item.settings)
        for rectangle in (box, box.expand(TEXTURE_REACH))
    )
    with suppress(QuickStartError):
        hypotheses = _from_features(wide, lambda: None) or propose(near)
        boxes = (outline_box(hypothesis.pose, near.points) for hypothesis in hypotheses)
        pairs = zip(hypotheses, boxes, strict=True)
        return [own.pose for own, there in pairs if there.overlap(box) > MIN_OVERLAP]
    return []


def outline_box(pose: Pose, points: FloatArray) -> Rectangle:
    """Return the rectangle about points (k, 3) of a model in the photo, px."""
    outline = pose.project(points)
    return Rectangle.from_corners(outline.min(axis=0), outline.max(axis=0))


@lru_cache(maxsize=4)
def outermost_points(mesh: Mesh) -> FloatArray:
    """Return (k, 3): the outermost vertices in ``HULL_POINTS`` directions."""
    corners = hull_points(mesh)
    outermost = np.argmax(corners @ sample_rotations(HULL_POINTS)[:, 2].T, axis=0)
    return corners[np.unique(outermost)]
