"""Start poses without a person: views from everywhere, tried on a small picture.

Only the place is given, by a rectangle about the model: it fixes where and how large the model is
in each view. Views whose outline has another shape than the rectangle need no try. The others are
judged by the loss of a fit on the coarsest level; the best that differ are improved by short
descents, the best of these by longer ones, and a few are proposed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from poseviewer.fit.loss import registration_loss, worst_registration_loss
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.optimise.nelder_mead import axis_simplex, downhill_simplex
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import Level, sketch_level
from poseviewer.render.types import PhotoAttributes, Renderer
from poseviewer.starts.box_fit import Box, BoxFits

COVERED = 0.6
"""Share of its rectangle that a model covers, about."""


@dataclass(frozen=True, slots=True)
class Round:
    """Descents from the best places so far."""

    places: int
    evaluations: int
    """Of each descent."""
    step: float
    """Edge of its simplex: radians, shares of the radius."""
    side_px: float
    """Side of the rectangle, made square, on the level that it is made on."""


@dataclass(frozen=True, slots=True)
class ViewRules:
    """How many views are tried, how the best are improved, and how many are proposed."""

    views: int = 2400
    """Spread over all rotations: 19 degrees apart. About half have the rectangle's shape."""
    misshapen: float = 0.35
    """Views are tried whose aspect ratio is off by no more than this factor (as a logarithm)."""
    box_weight: float = 4.0
    """What it costs, beside the loss, that the outline leaves the rectangle: times the squares of
    its four sides' distances, as shares of the rectangle's size."""
    side_px: float = 40.0
    """Side of the rectangle, made square, on the coarsest level."""
    rounds: tuple[Round, ...] = (Round(32, 24, 0.12, 40.0), Round(10, 80, 0.08, 60.0))
    proposals: int = 5
    apart: float = 0.1
    """Proposals are no nearer to one another: mean distance of the model's corners in the photo, as
    a share of the rectangle's diagonal."""


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """A start pose that was found."""

    pose: Pose
    loss: float
    """On the last level: to be compared with other proposals of the same search."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewProblem:
    """What views are searched for."""

    photo: PhotoAttributes
    """Whose region is the rectangle, with some of what is around it."""
    box: Box
    points: FloatArray
    """(k, 3): corners of the model, in its frame."""
    centre: FloatArray
    """(3,): the model's, in its frame."""
    radius: float
    rules: ViewRules = ViewRules()


def find_views(
    problem: ViewProblem,
    fits: BoxFits,
    renderer: Renderer,
    begin: Callable[[], None] | None = None,
) -> tuple[Proposal, ...]:
    """Up to ``rules.proposals`` poses that differ, the best first, from views that fill the
    rectangle (``fit_box``); on all cores, whose threads call ``begin`` first.

    The same arguments give the same proposals.
    """
    rules = problem.rules
    found = _try_all(problem, fits, renderer, begin)
    for this in rules.rounds:
        chosen = _different(problem, found, this.places)
        found = _descend(problem, this, chosen, renderer, begin)
    return tuple(_different(problem, found, rules.proposals))


def ranked(
    problem: ViewProblem,
    found: Sequence[Proposal],
    renderer: Renderer,
    begin: Callable[[], None] | None = None,
) -> tuple[Proposal, ...]:
    """Proposals of several searches judged anew, over the region of one ``problem``; those that
    differ, the best first.
    """
    level = view_level(problem, renderer, problem.rules.side_px)

    def judge(own: Renderer, one: Proposal) -> Proposal:
        return Proposal(one.pose, registration_loss(own.moments(one.pose, level.photo)))

    with RendererPool(level.renderer, begin=begin) as pool:
        again = list(pool.map(judge, found, at_a_time=1))
    return tuple(_different(problem, again, problem.rules.proposals))


def view_level(problem: ViewProblem, renderer: Renderer, side_px: float) -> Level:
    """The level on which the rectangle, made square, has about ``side_px`` along each side."""
    area = problem.box.width * problem.box.height / problem.photo.factor**2
    factor = max(1, round((area**0.5) / side_px))
    return sketch_level(problem.photo, renderer, factor, COVERED * area)


def _try_all(
    problem: ViewProblem, fits: BoxFits, renderer: Renderer, begin: Callable[[], None] | None
) -> list[Proposal]:
    rules = problem.rules
    shaped = np.flatnonzero(fits.misshapen <= rules.misshapen)
    if not len(shaped):
        shaped = np.argsort(fits.misshapen)[: len(fits.poses) // 10 + 1]
    level = view_level(problem, renderer, rules.side_px)
    # Half of the logarithm goes to each of width and height, half of that to each side.
    costs = rules.box_weight * 4.0 * (fits.misshapen / 4.0) ** 2

    def judge(own: Renderer, index: int) -> float:
        return registration_loss(own.moments(fits.poses[index], level.photo))

    with RendererPool(level.renderer, begin=begin) as pool:
        losses = list(pool.map(judge, shaped.tolist()))
    return [
        Proposal(fits.poses[i], loss + float(costs[i]))
        for i, loss in zip(shaped.tolist(), losses, strict=True)
    ]


def _descend(
    problem: ViewProblem,
    this: Round,
    chosen: Sequence[Proposal],
    renderer: Renderer,
    begin: Callable[[], None] | None,
) -> list[Proposal]:
    level = view_level(problem, renderer, this.side_px)

    def descend(own: Renderer, proposal: Proposal) -> Proposal:
        return descended(problem, this, level.photo, own, proposal.pose)

    with RendererPool(level.renderer, begin=begin) as pool:
        return list(pool.map(descend, chosen, at_a_time=1))


def descended(
    problem: ViewProblem, this: Round, photo: PhotoAttributes, renderer: Renderer, start: Pose
) -> Proposal:
    """The best pose of a short descent from ``start``."""
    chart = FreeBodyChart(start, problem.centre, problem.radius)
    worst = worst_registration_loss(photo)

    def objective(parameters: FloatArray) -> float:
        try:
            pose = chart.to_pose(parameters)
        except OutsideChartError:
            return worst
        loss = registration_loss(renderer.moments(pose, photo))
        return loss + problem.rules.box_weight * beside_box(problem, pose)

    corners = axis_simplex(np.zeros(6), np.full(6, this.step))
    states = downhill_simplex(objective, corners, x_tolerance=1e-3, f_tolerance=1e-4)
    *_, last = islice(states, this.evaluations)
    return Proposal(chart.to_pose(last.vertices[0]), float(last.values[0]))


def beside_box(problem: ViewProblem, pose: Pose) -> float:
    """The squares of the distances between the sides of the outline's box and the rectangle's, as
    shares of its size, summed; 4 for a pose that is partly behind the camera.
    """
    box = problem.box
    seen = pose.project(problem.points)
    low, high = seen.min(axis=0), seen.max(axis=0)
    off = np.concatenate([low - [box.left, box.top], high - [box.right, box.bottom]])
    share = float(off @ off) / (box.width * box.height)
    return share if np.isfinite(share) else 4.0


def _different(problem: ViewProblem, found: Sequence[Proposal], most: int) -> list[Proposal]:
    """The best that lie apart from all better ones."""
    reach = problem.rules.apart * float(np.hypot(problem.box.width, problem.box.height))
    kept: list[Proposal] = []
    seen: list[FloatArray] = []
    for one in sorted(found, key=lambda proposal: proposal.loss):
        places = one.pose.project(problem.points)
        away = [np.linalg.norm(places - other, axis=1).mean() for other in seen]
        if not np.isfinite(places).all() or (away and min(away) < reach):
            continue
        kept.append(one)
        seen.append(places)
        if len(kept) == most:
            break
    return kept
