"""Evidence on a pose, from the losses about it: for its verdict, and for a better turn."""

import math
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial

import numpy as np
from msgspec import structs

from poseviewer.confidence.pose_covariance import joint_covariance
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
from poseviewer.render.pyramid.levels import model_mask, visible_fraction
from poseviewer.render.types import AttributeImage, Renderer

ALIKE = 0.1
"""Distance of two looks, normal (unit) and reflectance (of 1), that counts as none."""
MIN_PIXELS = 50
"""Pixels of the model below which it counts as unseen."""
WRONG_POSES = 48
"""Wrong poses that the right one is compared with."""
WRONG_DEG = (15.0, 45.0)
"""Smallest and largest rotation of a wrong pose."""
WRONG_SHIFT = 0.2
"""Standard deviation of a wrong pose's translation, in radii."""
WRONG_SIZE = 0.1
"""Standard deviation of the logarithm of a wrong pose's size."""
RETURNS = 4
"""Descents from poses near the end."""
RETURN_DISTANCE = 0.15
"""Distance of their starts: radians, or fraction of the radius."""
RETURN_EDGE = 0.08
"""Edge of their first simplex."""
RETURN_EVALUATIONS = 60
MINIMUM_EDGE, MINIMUM_EVALUATIONS = 0.03, 50
"""Descent from the pose itself: a coarse level's minimum is a little beside the photo's."""
TURN_EDGE, TURN_EVALUATIONS = 0.08, 60
"""Edge and length of descents from turned poses."""
TURN_GAIN = 0.02
"""Loss that a turned pose must gain on the coarse level, as in a search's last stage."""
OUTLINE_OVERLAP = 0.75
"""Intersection over union of two poses' pictures from which their outlines count as the same."""


def judge_end(progress: FitProgress, renderer: Renderer, threads: int = 1) -> FitProgress:
    """The progress with the verdict on the pose that a search ended in, ``lost`` where no model is
    to be seen, and the pose's covariance.
    """
    problem = progress.problem
    parameters = progress.parameters
    features = None
    covariance = None
    if len(problem.views) > 1:
        pairs = zip(problem.alone, problem.poses(parameters), strict=True)
        owns = [replace(progress, problem=alone, pose=pose) for alone, pose in pairs]
        each = [judge_end(own, renderer, threads) for own in owns]
        verdict = judge_together([one.verdict for one in each if one.verdict is not None])
        if verdict.label != "lost":
            charts, known = [view.chart for view in problem.views], [one.covariance for one in each]
            covariance = joint_covariance(charts, known, parameters, problem.mesh)
        return replace(progress, verdict=_with_symmetry(verdict, problem), covariance=covariance)
    probing = partial(Probe, problem, renderer, progress.pose, threads)
    if progress.status is not Status.NOTHING_SEEN:
        # Raises where it is in part behind the camera, or on the edge of its chart.
        with suppress(PoseViewerError), closing(probing()) as probe:
            features = gather_features(probe)
    verdict = _with_symmetry(judge(features), problem)
    if features is not None and verdict.label != "lost":
        # Raises where poses beside it are in no photo.
        unknown = PoseViewerError, OutsideChartError, np.linalg.LinAlgError
        with suppress(*unknown), closing(probing(is_fine=True)) as probe:
            covariance = find_covariance(probe, features.seen)
    return replace(progress, verdict=verdict, covariance=covariance)


def _with_symmetry(verdict: Verdict, problem: FitProblem) -> Verdict:
    """The verdict with a reason that names the turns that the model's symmetry leaves open."""
    turns = problem.symmetry.words
    if not turns or verdict.label == "lost":
        return verdict
    reason = f"The model looks the same after {turns}: no photo tells these poses apart."
    return structs.replace(verdict, reasons=(*verdict.reasons, reason))


def gather_features(probe: Probe) -> Features | None:
    """Features of a pose, on any number of threads the same; None where the model is not in sight,
    or in part behind the camera.
    """
    photo = probe.photo
    renderer = probe.renderer
    pose = probe.chart.start
    drawn = model_mask(photo, renderer, pose)
    here = float(probe.losses(np.zeros((1, len(probe.motions))))[0])
    if np.count_nonzero(drawn & (photo.weights > 0.0)) < MIN_PIXELS or not math.isfinite(here):
        return None
    losses, turned = (
        all_losses[np.isfinite(all_losses)]
        for all_losses in (probe.losses(_wrong_steps(probe)), probe.losses(probe.turns()))
    )
    typical = float(np.median(losses))
    scale = max(1.4826 * float(np.median(np.abs(losses - typical))), 1e-6)
    # Without turns, a turned pose is taken for as bad as a typical wrong one.
    gain = float((turned - here).min()) if len(turned) else max(typical - here, 0.0)
    return Features(
        turn_margin=gain / scale,
        spread_percent=100.0 * float(np.median(_distances_of_returns(probe))),
        outline=outline_support(photo.channels, photo.weights, drawn),
        seen=visible_fraction(photo, renderer, pose),
        alike=_share_alike(renderer.render(level_pose(pose, photo.factor))),
    )


def _share_alike(image: AttributeImage) -> float:
    """The share of the model's pixels that look as their median does."""
    looks = np.hstack([image.normals[image.mask], image.reflectance[image.mask]])
    apart = np.linalg.norm(looks - np.median(looks, axis=0), axis=1)
    return float(np.mean(apart < ALIKE))


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
    """Distances of the ends of descents from near by to the coarse minimum, shares of the size."""
    size = len(probe.motions)
    near = np.random.default_rng(1).normal(size=(RETURNS, size))
    near *= RETURN_DISTANCE / np.linalg.norm(near, axis=1, keepdims=True) * math.sqrt(size / 3.0)
    descents = [(step, RETURN_EDGE, RETURN_EVALUATIONS) for step in near]
    own = (np.zeros(size), MINIMUM_EDGE, MINIMUM_EVALUATIONS)
    (minimum, _), *ends = probe.descend([own, *descents])
    return [probe.distance(minimum, end) for end, _ in ends]


def better_turn(
    problem: FitProblem, renderer: Renderer, pose: Pose, threads: int = 1
) -> FloatArray | None:
    """Parameters (d,) of the best pose of the same outline that descents from turned poses reach on
    a coarse level; None where a descent from the pose itself reaches no worse one.

    A can turned about its axis keeps its outline, and its print tells the turn a few degrees far.
    """
    with suppress(PoseViewerError), closing(Probe(problem, renderer, pose, threads)) as probe:
        photo, level = probe.level.photo, probe.level.renderer
        starts = [np.zeros(len(probe.motions)), *probe.turns()]
        (_, own), *ends = probe.descend([(at, TURN_EDGE, TURN_EVALUATIONS) for at in starts])
        for step, loss in sorted(ends, key=lambda end: end[1]):
            if loss > own - TURN_GAIN:
                break
            here, there = (model_mask(photo, level, probe.pose(at)) for at in (starts[0], step))
            if np.count_nonzero(here & there) >= OUTLINE_OVERLAP * np.count_nonzero(here | there):
                parameters = problem.chart.from_pose(probe.pose(step))
                return problem.complete(parameters[problem.free_indices])
    return None
