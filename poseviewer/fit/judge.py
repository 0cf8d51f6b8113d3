"""Judge a pose by the losses about it, and find a better one turned about an axis."""

import math
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial

import numpy as np
from msgspec import structs

from poseviewer.confidence.pose_covariance import PoseCovariance, joint_covariance
from poseviewer.confidence.verdict import Features, Verdict, judge, judge_together
from poseviewer.errors import PoseViewerError
from poseviewer.fit.covariance import find_covariance
from poseviewer.fit.outline import outline_support
from poseviewer.fit.probing import Probe
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose, level_pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.optimise.nelder_mead import Descent
from poseviewer.render.attributes import AttributeImage, Renderer
from poseviewer.render.pyramid.levels import model_mask, visible_fraction

ALIKE_DISTANCE = 0.1
"""Distance of attributes, normal (unit) and reflectance in [0, 1], up to which they are alike."""
MIN_VISIBLE_PIXELS = 50
"""Pixels of the model below which it counts as invisible."""
WRONG_POSES = 48
"""Number of wrong poses that the pose is compared with."""
WRONG_DEG = (15.0, 45.0)
"""Smallest and largest rotation of a wrong pose."""
WRONG_SHIFT = 0.2
"""Standard deviation of a wrong pose's translation, in radii."""
WRONG_SIZE = 0.1
"""Standard deviation of the logarithm of a wrong pose's size."""
RETURNS = 4
"""Number of descents from poses near by, which should return to the pose."""
RETURN_DISTANCE = 0.15
"""Distance of the returns' starts: radians, or fraction of the radius."""
RETURN = Descent(edge=0.08, evaluations=60)
"""A return, or a descent from a turned pose: long enough to come back to a clear minimum."""
FROM_POSE = Descent(edge=0.03, evaluations=50)
"""Descent from the pose itself: the coarse minimum is a little beside the photo's."""
TURN_GAIN = 0.02
"""Loss that a turned pose must gain on the coarse level, as in a search's last stage."""
OUTLINE_OVERLAP = 0.75
"""Intersection over union of two silhouettes from which they count as the same."""


def judge_end(
    progress: FitProgress,
    renderer: Renderer,
    threads: int = 1,
    probed: Features | None = None,
    covariance: PoseCovariance | None = None,
) -> FitProgress:
    """Add the verdict on a search's final pose, and its covariance.

    The verdict is ``lost`` where the model is not visible.

    Args:
        progress: end of the search.
        renderer: renderer of the model.
        threads: number of threads.
        probed: features of a pose near by, for the losses about this one; None: evaluate these.
        covariance: covariance of the pose; None: find it.
    """
    problem = progress.problem
    parameters = progress.parameters
    features = None
    if len(problem.views) > 1:
        pairs = zip(problem.by_view, problem.poses(parameters), strict=True)
        in_views = [replace(progress, problem=problem, pose=pose) for problem, pose in pairs]
        each = [judge_end(own, renderer, threads) for own in in_views]
        verdict = judge_together([one.verdict for one in each if one.verdict is not None])
        if verdict.label != "lost":
            charts, known = [view.chart for view in problem.views], [one.covariance for one in each]
            covariance = joint_covariance(charts, known, parameters, problem.mesh)
        return replace(progress, verdict=_add_reservations(verdict, problem), covariance=covariance)
    probing = partial(Probe, problem, renderer, progress.pose, threads)
    if progress.status is not Status.NOTHING_SEEN:
        # Raises for a pose in part behind the camera, or on the border of its chart.
        with suppress(PoseViewerError), closing(probing()) as probe:
            features = gather_features(probe, probed)
    verdict = _add_reservations(judge(features), problem)
    if features is None or verdict.label == "lost":
        covariance = None
    elif covariance is None:
        # Raises where poses beside it leave the photo.
        unknown = PoseViewerError, OutsideChartError, np.linalg.LinAlgError
        with suppress(*unknown), closing(probing(is_fine=True)) as probe:
            covariance = find_covariance(probe, features.seen)
    return replace(progress, verdict=verdict, covariance=covariance)


def _add_reservations(verdict: Verdict, problem: FitProblem) -> Verdict:
    """Add reasons that the photo does not tell: the model's symmetry, and a doubtful start."""
    if verdict.label == "lost":
        return verdict
    turns, reasons = problem.symmetry.words, verdict.reasons
    if turns:
        reason = f"The model looks the same after {turns}: no photo tells these poses apart."
        reasons = (*reasons, reason)
    if problem.doubt:
        verdict, reasons = structs.replace(verdict, label="doubtful"), (*reasons, problem.doubt)
    return structs.replace(verdict, reasons=reasons)


def gather_features(probe: Probe, probed: Features | None = None) -> Features | None:
    """Gather the features of a pose; they do not depend on the number of threads.

    Args:
        probe: probe of the pose.
        probed: features of a pose near by, for the losses about this one; None: evaluate these.

    Returns:
        The features; None if the model is invisible, or in part behind the camera.
    """
    photo = probe.photo
    renderer = probe.renderer
    pose = probe.chart.start
    drawn = model_mask(photo, renderer, pose)
    seen = np.count_nonzero(drawn & (photo.weights > 0.0))
    if seen < MIN_VISIBLE_PIXELS:
        return None
    if probed is None:
        here = float(probe.losses(np.zeros((1, len(probe.motions))))[0])
        if not math.isfinite(here):
            return None
        margin = _turn_margin(probe, here)
        spread = 100.0 * float(np.median(_distances_of_returns(probe)))
    else:
        margin, spread = probed.turn_margin, probed.spread_percent
    return Features(
        turn_margin=margin,
        spread_percent=spread,
        outline=outline_support(photo.channels, photo.weights, drawn),
        seen=visible_fraction(photo, renderer, pose),
        alike=_alike_fraction(renderer.render(level_pose(pose, photo.factor))),
    )


def _turn_margin(probe: Probe, here: float) -> float:
    """Loss that the best turn adds to that of the pose, in deviations of wrong poses' losses."""
    losses, turned = (
        all_losses[np.isfinite(all_losses)]
        for all_losses in (probe.losses(_wrong_steps(probe)), probe.losses(probe.turns()))
    )
    typical = float(np.median(losses))
    scale = max(1.4826 * float(np.median(np.abs(losses - typical))), 1e-6)
    # If no rotation is free, a typical wrong pose stands for the best turned one.
    gain = float((turned - here).min()) if len(turned) else max(typical - here, 0.0)
    return gain / scale


def _alike_fraction(image: AttributeImage) -> float:
    """Fraction of the model's pixels whose attributes are about their median."""
    attributes = np.hstack([image.normals[image.mask], image.reflectance[image.mask]])
    apart = np.linalg.norm(attributes - np.median(attributes, axis=0), axis=1)
    return float(np.mean(apart < ALIKE_DISTANCE))


def _wrong_steps(probe: Probe) -> FloatArray:
    """(w, k): steps to wrong poses."""
    random = np.random.default_rng(0)
    axes = random.normal(size=(WRONG_POSES, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = np.radians(random.uniform(*WRONG_DEG, (WRONG_POSES, 1)))
    rest = random.normal(size=(WRONG_POSES, 3)) * [WRONG_SHIFT, WRONG_SHIFT, WRONG_SIZE]
    focal = np.zeros((WRONG_POSES, probe.motions.shape[1] - 6))
    return np.hstack([axes * angles, rest, focal]) @ probe.motions.T


def _distances_of_returns(probe: Probe) -> list[float]:
    """Distances of the returns' ends to the coarse minimum, as fractions of the model's size."""
    size = len(probe.motions)
    near = np.random.default_rng(1).normal(size=(RETURNS, size))
    near *= RETURN_DISTANCE / np.linalg.norm(near, axis=1, keepdims=True) * math.sqrt(size / 3.0)
    returns = [(step, RETURN) for step in near]
    minimum, *ends = probe.descend([(np.zeros(size), FROM_POSE), *returns])
    return [probe.distance(minimum.best, end.best) for end in ends]


def better_turn(
    problem: FitProblem, renderer: Renderer, pose: Pose, threads: int = 1
) -> FloatArray | None:
    """Find a better pose of the same silhouette by descents from turned poses, on a coarse level.

    A can turned about its axis keeps its silhouette, and its label tells only small rotations.

    Args:
        problem: problem of the search.
        renderer: renderer of the model.
        pose: pose to improve on.
        threads: number of threads.

    Returns:
        (d,): parameters; None if a descent from the pose itself ends no worse.
    """
    with suppress(PoseViewerError), closing(Probe(problem, renderer, pose, threads)) as probe:
        photo, level = probe.level.photo, probe.level.renderer
        starts = [np.zeros(len(probe.motions)), *probe.turns()]
        own, *ends = probe.descend([(at, RETURN) for at in starts])
        for end in sorted(ends, key=lambda end: end.value):
            if end.value > own.value - TURN_GAIN:
                break
            here, there = (model_mask(photo, level, probe.pose(at)) for at in (starts[0], end.best))
            if np.count_nonzero(here & there) >= OUTLINE_OVERLAP * np.count_nonzero(here | there):
                parameters = problem.chart.from_pose(probe.pose(end.best))
                return problem.complete(parameters[problem.free_indices])
    return None
