"""Judge a pose by the losses about it, and by the minima that turned poses lead to."""

import math
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial

import numpy as np
from msgspec import structs

from poseviewer.confidence.pose_covariance import PoseCovariance, joint_covariance, short
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
from poseviewer.geometry.mesh import Mesh, hull_points
from poseviewer.optimise.nelder_mead import Descent
from poseviewer.optimise.protocol import State
from poseviewer.render.attributes import AttributeImage, Renderer
from poseviewer.render.pyramid.levels import model_mask
from poseviewer.render.renderers import make_renderer

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
MAX_PROBED = 3
"""Number of views in each of which rivals are looked for. Of more as many are looked at together: a
pose that all views share has a rival only where they share that, too."""
RETURNS = 4
"""Number of descents from poses near by, which should return to the pose."""
RETURN_DISTANCE = 0.15
"""Distance of the returns' starts: radians, or fraction of the radius."""
RETURN = Descent(edge=0.08, evaluations=60)
"""A return: long enough to come back to a clear minimum."""
FROM_POSE = Descent(edge=0.03, evaluations=50)
"""Descent from the pose itself: the coarse minimum is a little beside the photo's."""
TURNS_DEG = (30.0, -30.0)
"""Rotations from which descents come back to a right pose; wrong ones mostly have a rival there."""
NEAR_TURNS_DEG = (15.0, 30.0, 45.0, -15.0, -30.0, -45.0)
"""Rotations that are compared as they stand where a pose is followed."""
FROM_TURN = (Descent(edge=0.08, evaluations=50), Descent(edge=0.08, evaluations=100))
"""Descent from a turned pose, restarted where it has not come back by then."""
RIVAL_DISTANCE = 0.04
"""Distance, by the model's size, from which another minimum is another pose."""
MAX_DEVIATION = 0.1
"""Standard deviation of a ``found`` pose in the photo, by the model's size there, at most."""
RIVAL_GAIN = 0.02
"""Loss by which a rival must be better on the coarse level, as in a search's last stage."""


def judge_end(
    progress: FitProgress,
    renderer: Renderer,
    threads: int = 1,
    probed: Features | None = None,
    covariance: PoseCovariance | None = None,
    is_followed: bool = False,
    known_outline: float = 1.0,
) -> FitProgress:
    """Add the verdict on a search's final pose, and its covariance.

    The verdict is ``lost`` where the model is not visible.

    Args:
        progress: end of the search.
        renderer: renderer of the model.
        threads: number of threads.
        probed: features of a pose near by, for the losses about this one; None: evaluate these.
        covariance: covariance of the pose; None: find it.
        is_followed: whether the pose is known to be near the last one: no rival can be far.
        known_outline: edge support of the model at a pose that is known to be right.
    """
    problem = progress.problem
    parameters = progress.parameters
    features = rival = None
    if len(problem.views) > 1:
        poses = problem.poses(parameters)
        if len(poses) > MAX_PROBED and probed is None:
            probed = _probe_together(problem, renderer, poses, threads)
        pairs = zip(problem.by_view, poses, strict=True)
        in_views = [replace(progress, problem=problem, pose=pose) for problem, pose in pairs]
        each = [judge_end(own, renderer, threads, probed) for own in in_views]
        verdict = judge_together([one.verdict for one in each if one.verdict is not None])
        if verdict.label != "lost":
            charts, known = [view.chart for view in problem.views], [one.covariance for one in each]
            covariance = joint_covariance(charts, known, parameters, problem.mesh)
        verdict = _add_reservations(verdict, problem, covariance)
        return replace(progress, verdict=verdict, covariance=covariance, rival=each[0].rival)
    probing = partial(Probe, problem, renderer, progress.pose, threads)
    if progress.status is not Status.NOTHING_SEEN:
        # Raises for a pose in part behind the camera, or on the border of its chart.
        with suppress(PoseViewerError), closing(probing()) as probe:
            features, rival = gather_features(probe, probed, is_followed)
    verdict = judge(features, known_outline)
    if features is None or verdict.label == "lost":
        covariance = None
    elif covariance is None:
        # Raises where poses beside it leave the photo.
        unknown = PoseViewerError, OutsideChartError, np.linalg.LinAlgError
        with suppress(*unknown), closing(probing(is_fine=True)) as probe:
            covariance = find_covariance(probe, features.seen)
    verdict = _add_reservations(verdict, problem, covariance)
    return replace(progress, verdict=verdict, covariance=covariance, rival=rival)


def _probe_together(
    problem: FitProblem, renderer: Renderer, poses: Sequence[Pose], threads: int
) -> Features | None:
    """Features by the mean loss of some views; None: the model is invisible in the first."""
    chosen = range(0, len(poses), math.ceil(len(poses) / MAX_PROBED))
    some = replace(problem, views=tuple(problem.views[index] for index in chosen))
    first, *others = (poses[index] for index in chosen)
    with (
        suppress(PoseViewerError),
        closing(Probe(some, renderer, first, threads, False, others)) as probe,
    ):
        return gather_features(probe)[0]
    return None


def bare_renderer(mesh: Mesh, renderer: Renderer) -> Renderer:
    """Return the renderer of the model without paint, by which poses are judged: paint would
    confirm the poses that it comes from, right or wrong.

    Args:
        mesh: the model as it is in its file.
        renderer: renderer of this mesh, which is returned then, or of the painted model.
    """
    return renderer if renderer.mesh is mesh else make_renderer(mesh)


def _add_reservations(
    verdict: Verdict, problem: FitProblem, covariance: PoseCovariance | None
) -> Verdict:
    """Add what the features do not tell: a wide spread, the symmetry, and a doubtful start."""
    if verdict.label == "lost":
        return verdict
    turns, doubts = problem.symmetry.words, []
    if covariance is not None:
        size = np.linalg.norm(np.ptp(covariance.pose.project(hull_points(problem.mesh)), axis=0))
        if covariance.px > MAX_DEVIATION * size:
            doubts = [f"Where it is in the photo is known to ±{short(covariance.px)} px alone."]
    if problem.doubt:
        doubts.append(problem.doubt)
    if turns:
        reason = f"The model looks the same after {turns}: no photo tells these poses apart."
        verdict = structs.replace(verdict, reasons=(*verdict.reasons, reason))
    if not doubts:
        return verdict
    return structs.replace(verdict, label="doubtful", reasons=(*verdict.reasons, *doubts))


def gather_features(
    probe: Probe, probed: Features | None = None, is_followed: bool = False
) -> tuple[Features | None, Pose | None]:
    """Gather the features of a pose; they do not depend on the number of threads.

    Args:
        probe: probe of the pose.
        probed: features of a pose near by, for the losses about this one; None: evaluate these.
        is_followed: whether rivals are turned poses themselves, without descents from them.

    Returns:
        The features, None if the model is invisible, or in part behind the camera; and a better
        pose that a descent from a turned one has found.
    """
    photo = probe.photo
    renderer = probe.renderer
    pose = probe.chart.start
    drawn = model_mask(photo, renderer, pose)
    seen = photo.weights[drawn] > 0.0
    if np.count_nonzero(seen) < MIN_VISIBLE_PIXELS:
        return None, None
    better = None
    if probed is None:
        here = float(probe.losses(np.zeros((1, len(probe.motions))))[0])
        if not math.isfinite(here):
            return None, None
        own, spread = _return_from_near(probe)
        margin, better = _rival_margin(probe, own, () if is_followed else FROM_TURN)
        alike = _alike_fraction(renderer.render(level_pose(pose, photo.factor)))
    else:
        margin, spread, alike = probed.rival_margin, probed.spread_percent, probed.alike
    features = Features(
        rival_margin=margin,
        spread_percent=spread,
        outline=outline_support(photo.channels, photo.weights, drawn),
        seen=float(np.mean(seen)),
        alike=alike,
    )
    return features, better


def _rival_margin(
    probe: Probe, own: State, descents: Sequence[Descent]
) -> tuple[float, Pose | None]:
    """Loss that the best other minimum adds to the ``own``, in deviations of wrong poses' losses;
    and its pose where it is the better one.

    Descents from turned poses lead to the other minima: a wrong pose mostly has one as good.
    """
    losses = probe.losses(_wrong_steps(probe))
    losses = losses[np.isfinite(losses)]
    typical = float(np.median(losses))
    scale = max(1.4826 * float(np.median(np.abs(losses - typical))), 1e-6)
    if not descents:
        turned = probe.losses(probe.turns(*NEAR_TURNS_DEG))
        return float(turned.min(initial=max(typical, own.value)) - own.value) / scale, None

    def others(turns: FloatArray) -> list[State]:
        """Minima elsewhere to which descents from turned poses lead."""
        steps, away = list(turns), list[State]()
        for descent in descents:
            ends = probe.descend([(step, descent) for step in steps])
            away = [e for e in ends if probe.distance(own.best, e.best) > RIVAL_DISTANCE]
            steps = [end.best for end in away]
        return away

    (own,) = probe.descend([(own.best, descents[-1])])  # as long as theirs
    # From behind, many things look alike: the reverse side counts only where it is the better one.
    behind = [end for end in others(probe.turns(180.0)) if end.value < own.value]
    rivals = sorted([*others(probe.turns(*TURNS_DEG)), *behind], key=lambda end: end.value)
    if not rivals:  # a typical wrong pose stands for them
        return max(typical - own.value, 0.0) / scale, None
    gain = rivals[0].value - own.value
    return gain / scale, probe.pose(rivals[0].best) if gain < -RIVAL_GAIN else None


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


def _return_from_near(probe: Probe) -> tuple[State, float]:
    """The coarse minimum at the pose, and the median distance to it of the ends of descents from
    near by, in % of the model's size.
    """
    size = len(probe.motions)
    near = np.random.default_rng(1).normal(size=(RETURNS, size))
    near *= RETURN_DISTANCE / np.linalg.norm(near, axis=1, keepdims=True) * math.sqrt(size / 3.0)
    returns = [(step, RETURN) for step in near]
    minimum, *ends = probe.descend([(np.zeros(size), FROM_POSE), *returns])
    distances = [probe.distance(minimum.best, end.best) for end in ends]
    return minimum, 100.0 * float(np.median(distances))
