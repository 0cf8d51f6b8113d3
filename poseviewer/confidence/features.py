"""Features of a pose that tell right from wrong: a few hundred evaluations on a coarse level."""

from __future__ import annotations

import math
from contextlib import closing
from itertools import combinations

import numpy as np

from poseviewer.fit.lighting import recover_lighting
from poseviewer.fit.outline import outline_support
from poseviewer.fit.probing import Descent, Probe, compared_photo
from poseviewer.fit.problem import FitProblem, shown_attributes
from poseviewer.fit.verdict import Features, WeakDirection
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Pose, level_pose
from poseviewer.geometry.linear_algebra import whiten
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.moments import model_attributes, moments_of_images
from poseviewer.render.types import PhotoAttributes, Renderer

FEWEST_PIXELS = 50
"""Of the model, below which it counts as unseen."""
WRONG_POSES = 48
WRONG_DEG, WRONG_SHIFT, WRONG_SIZE = (15.0, 45.0), 0.2, 0.1
"""Wrong poses are turned by so much; standard deviations of their shift, in radii, and of the
logarithm of their size."""
RIVALS, RIVAL_EDGE, RIVAL_EVALUATIONS = 2, 0.12, 60
"""Descents from the best wrong poses."""
RETURNS, RETURN_DISTANCE, RETURN_EDGE, RETURN_EVALUATIONS = 4, 0.15, 0.08, 60
"""Descents from near by: 8 degrees away, or that share of the radius."""
MINIMUM_EDGE, MINIMUM_EVALUATIONS = 0.03, 50
"""Descent from the pose itself: a coarse level's minimum is a little beside the photo's."""
SAME_PLACE, OTHER_PLACE = 0.03, 0.05
"""Shares of the size: descents that end nearer have come back, farther ones found a rival."""
EXPLAINED = 0.5
"""Standard deviations of the photo that light may leave of a pixel that it explains."""
CURVATURE_STEP = 0.06
"""Of the differences that curvature is taken from: 3 % of the model's size at its rim."""
WEAK_REACHES = (0.1, 0.2, 0.4)
"""How far along a direction the loss is looked at."""
WEAK_SHARE = 0.15
"""A direction is weak where the loss rises by less than this share of a wrong pose's rise."""
NAMED_SHARE = 0.35
"""A part of a motion is named from this share of the greatest part."""


def gather_features(
    problem: FitProblem, mesh: Mesh, renderer: Renderer, pose: Pose, threads: int = 1
) -> Features | None:
    """The features of a pose of the problem; the same each time, on any number of threads.

    None where there are none: the model is not in sight, or in part behind the camera.

    Raises:
        PoseViewerError: the pose has no parameters in the problem's chart.
    """
    photo = compared_photo(problem, mesh, pose)
    covered = renderer.covers(level_pose(pose, photo.factor))
    if np.count_nonzero(covered & (photo.weights > 0.0)) < FEWEST_PIXELS:
        return None
    with closing(Probe(problem, photo, mesh, renderer, pose, threads)) as probe:
        here = float(probe.losses([np.zeros(len(probe.motions))])[0])
        if not math.isfinite(here):
            return None
        wrong = _wrong_steps(probe)
        losses = probe.losses(wrong)
        wrong, losses = wrong[np.isfinite(losses)], losses[np.isfinite(losses)]
        typical = float(np.median(losses))
        scale = max(1.4826 * float(np.median(np.abs(losses - typical))), 1e-6)
        contrast = max(typical - here, 0.0)
        (minimum, least), ends = _descend(probe, wrong[np.argsort(losses)[:RIVALS]])
        away = [probe.distance(minimum, end) for end, _ in ends]
        others = [(e[1], d) for e, d in zip(ends, away, strict=True) if d > OTHER_PLACE]
        # Where all descents come back, the nearest rival is as bad as nothing is known to be.
        rival, rival_away = min(others, default=(math.inf, 0.0))
        turned = probe.losses(probe.turns()) - here
        turn = float(np.min(turned[np.isfinite(turned)], initial=np.inf))
        return Features(
            loss_margin=(typical - here) / scale,
            turn_margin=(turn if math.isfinite(turn) else contrast) / scale,
            rival_margin=min(rival - least, contrast) / scale,
            rival_percent=100.0 * rival_away,
            agreement=float(np.mean(np.array(away[:RETURNS]) < SAME_PLACE)),
            spread_percent=100.0 * float(np.median(away[:RETURNS])),
            explained=_explained(photo, renderer, pose),
            outline=outline_support(photo.channels, photo.weights, covered),
            seen=float(np.mean(photo.weights[covered] > 0.0)),
            pixels=math.log10(np.count_nonzero(covered)),
            weak=_weak_directions(probe, minimum, least, contrast),
        )


def _wrong_steps(probe: Probe) -> FloatArray:
    """(w, k): steps to wrong poses."""
    random = np.random.default_rng(0)
    size = probe.motions.shape[1]
    axes = random.normal(size=(WRONG_POSES, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = np.radians(random.uniform(*WRONG_DEG, (WRONG_POSES, 1)))
    rest = random.normal(size=(WRONG_POSES, 3)) * [WRONG_SHIFT, WRONG_SHIFT, WRONG_SIZE]
    motions = np.hstack([axes * angles, rest, np.zeros((WRONG_POSES, size - 6))])
    return motions @ probe.motions.T


End = tuple[FloatArray, float]


def _descend(probe: Probe, best_wrong: FloatArray) -> tuple[End, list[End]]:
    """Step and loss of the coarse minimum at the pose; and of where descents from near by and from
    the best wrong poses end.
    """
    size = len(probe.motions)
    random = np.random.default_rng(1)
    near = random.normal(size=(RETURNS, size))
    near *= RETURN_DISTANCE / np.linalg.norm(near, axis=1, keepdims=True) * math.sqrt(size / 3.0)
    minimum, *ends = probe.descend(
        [
            Descent(np.zeros(size), MINIMUM_EDGE, MINIMUM_EVALUATIONS),
            *(Descent(step, RETURN_EDGE, RETURN_EVALUATIONS) for step in near),
            *(Descent(step, RIVAL_EDGE, RIVAL_EVALUATIONS) for step in best_wrong),
        ]
    )
    return minimum, ends


def _explained(photo: PhotoAttributes, renderer: Renderer, pose: Pose) -> float:
    """The share of the model's pixels that light explains."""
    clipped = shown_attributes(photo)
    image = renderer.render(level_pose(pose, photo.factor))
    seen = image.mask & (photo.weights > 0.0)
    lighting = recover_lighting(moments_of_images(image, clipped))
    colours = photo.channels[seen].astype(float)
    left = colours - lighting.apply(model_attributes(image, clipped)[seen])
    counted = photo.channels[photo.weights > 0.0].astype(float)
    white = whiten(np.cov(counted.T).reshape(colours.shape[1], -1), counted.mean(axis=0))
    return float(np.mean(np.sqrt(np.mean((left @ white.T) ** 2, axis=1)) < EXPLAINED))


def _weak_directions(
    probe: Probe, place: FloatArray, least: float, contrast: float
) -> tuple[WeakDirection, ...]:
    """The directions of least curvature at a ``place`` (k,), of loss ``least``, along which the
    loss hardly rises; ``contrast`` is what a typical wrong pose costs more.
    """
    found = []
    limit = float(probe.losses([place])[0]) + WEAK_SHARE * contrast
    for direction in _principal_directions(probe, place, least):
        reach = 0.0
        for wanted in WEAK_REACHES:
            step = wanted * direction
            if np.any(probe.losses([place + step, place - step]) > limit):
                break
            reach = wanted
        if reach > 0.0:
            found.append(_described(probe, direction @ probe.motions, reach))
    return tuple(found)


def _principal_directions(probe: Probe, place: FloatArray, centre: float) -> FloatArray:
    """(k, k): a row each, the least curved first, by the second derivatives of the loss at a
    ``place`` (k,), where it is ``centre``.
    """
    size = len(place)
    axes = CURVATURE_STEP * np.eye(size)
    pairs = list(combinations(range(size), 2))
    ways = np.array([*axes, *(axes[i] + axes[j] for i, j in pairs)])
    # (w,): the losses on both sides together.
    both = probe.losses([*(place + ways), *(place - ways)]).reshape(2, -1).sum(axis=0)
    hessian = np.diag((both[:size] - 2.0 * centre) / CURVATURE_STEP**2)
    for (i, j), mixed in zip(pairs, both[size:], strict=True):
        bend = mixed - both[i] - both[j] + 2.0 * centre
        hessian[i, j] = hessian[j, i] = bend / (2.0 * CURVATURE_STEP**2)
    if not np.all(np.isfinite(hessian)):
        return np.eye(size)
    return np.linalg.eigh(hessian)[1].T


def _described(probe: Probe, motion: FloatArray, reach: float) -> WeakDirection:
    """The parts of a unit motion (d,) that matter, each with how far it can go."""
    is_parallel = isinstance(probe.chart.start.camera, Parallel)
    depth = "changing the scale" if is_parallel else "changing the distance"
    sizes = {
        "changing the focal length": abs(float(motion[6])) if len(motion) > 6 else 0.0,
        "turning": float(np.linalg.norm(motion[:3])),
        "shifting in the picture": float(np.linalg.norm(motion[3:5])),
        depth: abs(float(motion[5])),
    }
    degrees, percents, words = 0.0, [0.0], []
    for name, size in sizes.items():
        if size < NAMED_SHARE * max(sizes.values()):
            continue
        away = reach * size
        if name == "turning":
            degrees = math.degrees(away)
            words.append(f"turning {_axis(motion[:3])} by {degrees:.0f}°")
            continue
        if name == "shifting in the picture":  # of two radii
            percent = 50.0 * away
        else:
            gain = probe.chart.focal_gain if name == "changing the focal length" else 1.0
            percent = 100.0 * (math.exp(min(away * gain, 5.0)) - 1.0)
        percents.append(percent)
        words.append(f"{name} by {percent:.0f} %")
    return WeakDirection(
        " with ".join(words), degrees, max(percents), tuple(float(x) for x in motion)
    )


def _axis(turn: FloatArray) -> str:
    """An axis (3,) of the camera frame in words."""
    share = np.abs(turn) / np.linalg.norm(turn)
    names = ("the picture's horizontal", "the picture's vertical", "the line of sight")
    nearest = int(np.argmax(share))
    if share[nearest] > 0.9:
        return f"about {names[nearest]}"
    if nearest == 2 or share[2] > 0.5:
        return f"about a slanted axis near {names[nearest]}"
    return "about an axis in the picture's plane"
