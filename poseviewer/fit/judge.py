"""The verdict on a pose: found, doubtful or lost, and why.

Features of the pose, from a few hundred evaluations on a coarse level, tell right poses from wrong
ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import replace

import numpy as np

from poseviewer.errors import PoseViewerError
from poseviewer.fit.covariance import find_covariance, joint_covariance
from poseviewer.fit.outline import outline_support
from poseviewer.fit.probing import Probe
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.verdict import WORDS, Features, Verdict, Word
from poseviewer.fit.weights import FEATURES, FOUND_FROM, LOST_BELOW, OFFSET
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.pyramid.levels import covered, seen_share
from poseviewer.render.types import Renderer

LEAST_SEEN = 0.35
"""Share of the model that must be seen: with less, poses far off look right too."""
HIDDEN_BELOW, FOUND_BEHIND = 0.95, 0.985
"""Share of the model below which something hides it, and probability from which its pose is then
``found``: without what stood out, the rest looks better than in the trials."""
LEAST_PROBABILITY = 0.01
"""Probability of one photo among several: none is sure enough to overrule all others."""
LARGEST_SCORE = 4.0
"""Standard deviations from the trials' mean at which a feature is cut off: it says no more then."""
SMALL_SPREAD_PERCENT = 3.0
"""Spread below which searches from near by have come back."""
LOW_TURN_MARGIN = 0.3
"""Turn margin that right poses seldom have."""
GOOD_OUTLINE, POOR_OUTLINE = 0.9, 0.75
"""Shares of the outline."""
LEAST_WHOLE = 0.9
"""Share of the model below which it is said to be hidden in part."""
FEWEST_PIXELS = 50
"""Pixels of the model below which it counts as unseen."""
WRONG_POSES, WRONG_DEG, WRONG_SHIFT, WRONG_SIZE = 48, (15.0, 45.0), 0.2, 0.1
"""Number and turns of wrong poses; standard deviations of their shift (radii) and log size."""
RETURNS, RETURN_DISTANCE, RETURN_EDGE, RETURN_EVALUATIONS = 4, 0.15, 0.08, 60
"""Descents from near by: 8 degrees away, or that share of the radius."""
MINIMUM_EDGE, MINIMUM_EVALUATIONS = 0.03, 50
"""Descent from the pose itself: a coarse level's minimum is a little beside the photo's."""


def judge_end(
    progress: FitProgress, problem: FitProblem, mesh: Mesh, renderer: Renderer, threads: int = 1
) -> Verdict:
    """Verdict on the pose that a search ended in: ``lost`` where no model is to be seen."""
    if len(problem.views) > 1:
        each = []
        for alone in problem.alone:
            own = replace(progress, pose=alone.chart.to_pose(progress.parameters))
            each.append(judge_end(own, alone, mesh, renderer, threads))
        verdict = judge_together(each)
        if verdict.word == "lost":
            return verdict
        covariance = joint_covariance(problem, mesh, progress.parameters, each)
        return replace(verdict, covariance=covariance)
    features: Features | None = None
    if progress.status is not Status.NOTHING_SEEN:
        with suppress(PoseViewerError):  # in part behind the camera, or on the edge of its chart
            features = gather_features(problem, mesh, renderer, progress.pose, threads)
    verdict = judge(features)
    if verdict.word == "lost" or features is None:
        return verdict
    pose, seen = progress.pose, features.seen
    covariance = find_covariance(problem, mesh, renderer, pose, seen, threads)
    return replace(verdict, covariance=covariance)


def judge(features: Features | None) -> Verdict:
    """Verdict by the features; None: the model is not to be seen at the pose."""
    if features is None:
        return Verdict("lost", 0.0, ("Hardly anything of the model is to be seen there.",), None)
    probability = probability_of(features)
    found_from = FOUND_BEHIND if features.seen < HIDDEN_BELOW else FOUND_FROM
    word = _word(probability >= found_from, probability < LOST_BELOW)
    return Verdict(word, probability, reasons_for(features), features)


def _word(is_found: bool, is_lost: bool) -> Word:
    return "found" if is_found else "lost" if is_lost else "doubtful"


def judge_together(views: Sequence[Verdict]) -> Verdict:
    """Verdict on one pose by the mean log odds of its photos, as if they repeated each other.

    ``found`` needs half of them as probable, ``lost`` most of them as improbable: a few that no
    pose of the set explains contradict the others, and say little of the pose.
    """
    odds = np.clip([one.probability for one in views], LEAST_PROBABILITY, 1.0 - LEAST_PROBABILITY)
    probability = float(1.0 / (1.0 + np.exp(-np.mean(np.log(odds / (1.0 - odds))))))
    confirm = sum(one.probability >= FOUND_FROM for one in views)
    deny = sum(one.probability < LOST_BELOW for one in views)
    word = _word(
        probability >= FOUND_FROM and 2 * confirm >= len(views),
        probability < LOST_BELOW and 2 * deny > len(views),
    )
    words = [one.word for one in views]
    said = ", ".join(f"{words.count(w)} {w}" for w in reversed(WORDS) if w in words)
    reasons = (f"By each of the {len(views)} photos alone it is: {said}.",)
    return Verdict(word, probability, reasons, None, views=tuple(views))


def probability_of(features: Features) -> float:
    """By logistic regression on the features; 0 where too little of the model is seen."""
    if features.seen < LEAST_SEEN:
        return 0.0
    score = OFFSET
    for name, (mean, deviation, weight) in FEATURES.items():
        away = (scaled(name, getattr(features, name)) - mean) / deviation
        score += weight * min(max(away, -LARGEST_SCORE), LARGEST_SCORE)
    return 1.0 / (1.0 + math.exp(-score))


def scaled(name: str, value: float) -> float:
    """Unbounded features by the inverse hyperbolic sine: a logarithm that takes 0 and less."""
    return math.asinh(value) if name.endswith(("_margin", "_percent")) else value


def reasons_for(features: Features) -> tuple[str, ...]:
    """Sentences for and against the pose."""
    spread, turn, outline = features.spread_percent, features.turn_margin, features.outline
    is_back = spread < SMALL_SPREAD_PERCENT
    end = "came back to it" if is_back else f"ended {spread:.0f} % of the model's size away"
    cost = "less on the coarse photo" if turn < 0.0 else "hardly more: it may be turned"
    how = "" if outline >= GOOD_OUTLINE else "only " if outline < POOR_OUTLINE else "some "
    sentences = {
        f"Searches from near by {end}.": True,
        f"Turned about one of its own axes the model costs {cost}.": turn < LOW_TURN_MARGIN,
        f"Along {how}{outline:.0%} of its outline the photo has an edge of that direction.": True,
        f"Only {features.seen:.0%} of the model is seen: the rest lies on pixels left out.": (
            features.seen < LEAST_WHOLE
        ),
    }
    return tuple(sentence for sentence, holds in sentences.items() if holds)


def gather_features(
    problem: FitProblem, mesh: Mesh, renderer: Renderer, pose: Pose, threads: int = 1
) -> Features | None:
    """Features of a pose, on any number of threads the same; None where the model is not in sight,
    or in part behind the camera. Raises ``PoseViewerError`` for a pose outside the chart.
    """
    with closing(Probe(problem, mesh, renderer, pose, threads)) as probe:
        photo = probe.photo
        drawn = covered(photo, renderer, pose)
        if np.count_nonzero(drawn & (photo.weights > 0.0)) < FEWEST_PIXELS:
            return None
        here = float(probe.losses([np.zeros(len(probe.motions))])[0])
        if not math.isfinite(here):
            return None
        losses = probe.losses(_wrong_steps(probe))
        losses = losses[np.isfinite(losses)]
        typical = float(np.median(losses))
        scale = max(1.4826 * float(np.median(np.abs(losses - typical))), 1e-6)
        turned = probe.losses(probe.turns()) - here
        turned = turned[np.isfinite(turned)]
        # Without turns, a turned pose is taken for as bad as a typical wrong one.
        gain = float(turned.min()) if len(turned) else max(typical - here, 0.0)
        return Features(
            turn_margin=gain / scale,
            spread_percent=100.0 * float(np.median(_distances_of_returns(probe))),
            outline=outline_support(photo.channels, photo.weights, drawn),
            seen=seen_share(photo, renderer, pose),
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


def _distances_of_returns(probe: Probe) -> list[float]:
    """Distances of the ends of descents from near by to the coarse minimum, shares of the size."""
    size = len(probe.motions)
    random = np.random.default_rng(1)
    near = random.normal(size=(RETURNS, size))
    near *= RETURN_DISTANCE / np.linalg.norm(near, axis=1, keepdims=True) * math.sqrt(size / 3.0)
    descents = [(step, RETURN_EDGE, RETURN_EVALUATIONS) for step in near]
    own = (np.zeros(size), MINIMUM_EDGE, MINIMUM_EVALUATIONS)
    (minimum, _), *ends = probe.descend([own, *descents])
    return [probe.distance(minimum, end) for end, _ in ends]
