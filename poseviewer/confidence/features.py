"""Gathers the evidence about a pose: a few hundred evaluations on a coarse level."""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from poseviewer.confidence.outline_support import outline_support
from poseviewer.confidence.weak_directions import curvature, weak_directions
from poseviewer.fit.lighting import recover_lighting
from poseviewer.fit.loss import EDGE_WEIGHT
from poseviewer.fit.probing import Cost, Descent, Probe, compared_photo, probe_about
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.turns import turning_steps
from poseviewer.fit.verdict import Features
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.linear_algebra import whiten
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.moments import model_attributes, moments_of_images
from poseviewer.render.pyramid.level_pose import level_pose
from poseviewer.render.types import PhotoAttributes, Renderer

WRONG = 48
"""So many wrong poses are tried, ..."""
WRONG_DEG, WRONG_SHIFT, WRONG_SIZE = (15.0, 45.0), 0.2, 0.1
"""... turned by so much, and off by so much: standard deviations, in radii, and of a logarithm."""
RIVALS, RIVAL_STEP, RIVAL_EVALUATIONS = 2, 0.12, 60
"""From so many of the best of them descents are sent."""
RETURNS, RETURN_WAY, RETURN_STEP, RETURN_EVALUATIONS = 4, 0.15, 0.08, 60
"""So many descents start near by: so far off, 8 degrees or that share of the radius."""
MINIMUM_STEP, MINIMUM_EVALUATIONS = 0.03, 50
"""Of the descent from the pose itself: a coarse level's minimum is a little beside the photo's."""
BACK = 0.03
"""A descent has come back, or two are one place, within this share of the size."""
ELSEWHERE = 0.05
EXPLAINED = 0.5
"""A pixel is explained where light leaves less than so many standard deviations of the photo."""


@dataclass(frozen=True, slots=True)
class _Around:
    """What descents found around a pose."""

    minimum: FloatArray
    """(k,): the step to the coarse level's minimum near the pose; the rest is seen from there."""
    least: float
    rival: float
    """Loss of the best other place, less that of the minimum."""
    rival_way: float
    agreement: float
    spread: float
    drift: float


def gather_features(
    problem: FitProblem, mesh: Mesh, renderer: Renderer, pose: Pose, threads: int = 1
) -> Features | None:
    """The evidence about a pose of the problem; the same each time, on any number of threads.

    None where there is none to be had: the model is not in sight, or in part behind the camera.

    Raises:
        PoseViewerError: the pose has no numbers in the problem's chart.
    """
    photo = compared_photo(problem, mesh, pose)
    covered = renderer.covers(level_pose(pose, photo.factor))
    if np.count_nonzero(covered & (photo.weights > 0.0)) < FEWEST:
        return None
    with closing(probe_about(problem, photo, mesh, renderer, pose, threads)) as probe:
        return _evidence(probe, mesh, photo, renderer, pose, covered)


def _evidence(
    probe: Probe,
    mesh: Mesh,
    photo: PhotoAttributes,
    renderer: Renderer,
    pose: Pose,
    covered: NDArray[np.bool_],
) -> Features | None:
    (here,) = probe.costs([np.zeros(len(probe.motions))])
    if here is None:
        return None
    wrong, costs = _wrong_poses(probe)
    losses = np.array([cost.loss for cost in costs])
    cosines = np.array([cost.edge_cosine for cost in costs])
    light = losses - EDGE_WEIGHT * (1.0 - cosines)
    scale = _spread(losses)
    around = _look_around(probe, wrong[np.argsort(losses)[:RIVALS]])
    directions = curvature(probe, around.minimum, around.least)
    contrast = max(float(np.median(losses)) - here.loss, 0.0)
    turned = probe.losses(list(turning_steps(probe, mesh))) - here.loss
    turn = float(np.min(turned[np.isfinite(turned)], initial=np.inf))
    outline = outline_support(photo.channels, photo.weights, covered)
    size = math.sqrt(np.count_nonzero(covered))
    explained, share = _explained(photo, renderer, pose)
    return Features(
        loss_margin=(float(np.median(losses)) - here.loss) / scale,
        edge_margin=(here.edge_cosine - float(np.median(cosines))) / _spread(cosines),
        light_margin=(float(np.median(light)) - _light(here)) / _spread(light),
        turn_margin=(turn if math.isfinite(turn) else contrast) / scale,
        rival_margin=min(around.rival, contrast) / scale,
        rival_percent=100.0 * around.rival_way,
        agreement=around.agreement,
        spread_percent=100.0 * around.spread,
        drift_percent=100.0 * around.drift,
        edges=here.edge_cosine,
        explained=explained,
        light=share,
        outline=outline.share,
        outline_excess=outline.excess,
        outline_shift_percent=100.0 * outline.shift_px / size,
        seen=float(np.mean(photo.weights[covered] > 0.0)),
        pixels=math.log10(np.count_nonzero(covered)),
        weak=weak_directions(probe, around.minimum, directions, contrast),
    )


FEWEST = 50
"""Pixels of the model, below which nothing is said."""


def _wrong_poses(probe: Probe) -> tuple[FloatArray, list[Cost]]:
    """Steps (w, k) to wrong poses about the pose, and what they cost."""
    random = np.random.default_rng(0)
    size = probe.motions.shape[1]
    axes = random.normal(size=(WRONG, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = np.radians(random.uniform(*WRONG_DEG, (WRONG, 1)))
    rest = random.normal(size=(WRONG, 3)) * [WRONG_SHIFT, WRONG_SHIFT, WRONG_SIZE]
    motions = np.hstack([axes * angles, rest, np.zeros((WRONG, size - 6))])
    steps = motions @ probe.motions.T
    costs = probe.costs(list(steps))
    kept = [index for index, cost in enumerate(costs) if cost is not None]
    return steps[kept], [cost for cost in costs if cost is not None]


def _look_around(probe: Probe, best_wrong: FloatArray) -> _Around:
    """Descents from the pose itself, from near by and from the best wrong poses."""
    size = len(probe.motions)
    origin = np.zeros(size)
    random = np.random.default_rng(1)
    ways = random.normal(size=(RETURNS, size))
    ways *= RETURN_WAY / np.linalg.norm(ways, axis=1, keepdims=True) * math.sqrt(size / 3.0)
    (minimum, least), *ends = probe.descend(
        [
            Descent(origin, MINIMUM_STEP, MINIMUM_EVALUATIONS),
            *(Descent(way, RETURN_STEP, RETURN_EVALUATIONS) for way in ways),
            *(Descent(step, RIVAL_STEP, RIVAL_EVALUATIONS) for step in best_wrong),
        ]
    )
    apart = np.array([probe.distance(minimum, end) for end, _ in ends[:RETURNS]])
    others = [
        (loss, probe.distance(minimum, end))
        for end, loss in ends
        if probe.distance(minimum, end) > ELSEWHERE
    ]
    # Where all descents come back, the nearest rival is as bad as nothing is known to be.
    rival, way = min(others, default=(math.inf, 0.0))
    return _Around(
        minimum,
        least,
        rival - least if others else math.inf,
        way,
        float(np.mean(apart < BACK)),
        float(np.median(apart)),
        probe.distance(origin, minimum),
    )


def _light(cost: Cost) -> float:
    return cost.loss - EDGE_WEIGHT * (1.0 - cost.edge_cosine)


def _spread(values: FloatArray) -> float:
    """Robust standard deviation: of the median absolute deviation."""
    return max(1.4826 * float(np.median(np.abs(values - np.median(values)))), 1e-6)


def _explained(photo: PhotoAttributes, renderer: Renderer, pose: Pose) -> tuple[float, float]:
    """Shares of the model's pixels, and of the photo's variance on it, that light explains."""
    coloured = photo.channels.shape[2] == 3
    clipped = replace(photo, clipped=True, colour_reflectance=coloured, structure=None)
    image = renderer.render(level_pose(pose, photo.factor))
    seen = image.mask & (photo.weights > 0.0)
    lighting = recover_lighting(moments_of_images(image, clipped))
    colours = photo.channels[seen].astype(float)
    left = colours - lighting.apply(model_attributes(image, clipped)[seen])
    counted = photo.channels[photo.weights > 0.0].astype(float)
    white = whiten(np.cov(counted.T).reshape(colours.shape[1], -1), counted.mean(axis=0))
    lengths = np.sqrt(np.mean((left @ white.T) ** 2, axis=1))
    before = np.mean(((colours - colours.mean(axis=0)) @ white.T) ** 2)
    share = 1.0 - float(np.mean(lengths**2)) / max(float(before), 1e-12)
    return float(np.mean(lengths < EXPLAINED)), min(max(share, 0.0), 1.0)
