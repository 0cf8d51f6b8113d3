"""The verdict on a pose: found, doubtful or lost, and why."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from poseviewer.confidence.features import gather_features
from poseviewer.confidence.reasons import reasons_for
from poseviewer.confidence.uncertainty import find_covariance, joint_covariance
from poseviewer.confidence.weights import FEATURES, FOUND_FROM, LOST_BELOW, OFFSET
from poseviewer.errors import PoseViewerError
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.verdict import WORDS, Features, Verdict, Word
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.types import Renderer

LEAST_SEEN = 0.35
"""Share of the model that must be seen: with less, poses far off look right as well."""
HIDDEN_BELOW, FOUND_BEHIND = 0.95, 0.985
"""Share of the model below which something hides it, and the probability from which its pose is
then ``found``: what stood out is left out, and so the rest looks better than it did in the trials.
"""
LEAST_PROBABILITY = 0.01
"""Of one photo among several: none is sure enough to overrule all others."""
LARGEST_SCORE = 4.0
"""Standard deviations from the trials' mean at which a feature is cut off: it says no more then."""


def judge_end(
    progress: FitProgress, problem: FitProblem, mesh: Mesh, renderer: Renderer, threads: int = 1
) -> Verdict:
    """The verdict on the pose that a search ended in: ``lost`` where no model is to be seen."""
    if problem.others:
        each = []
        for view in problem.views:
            own = replace(progress, pose=view.chart.to_pose(progress.parameters))
            each.append(judge_end(own, view, mesh, renderer, threads))
        verdict = judge_together(each)
        known = verdict.word != "lost"
        covariance = joint_covariance(problem, mesh, progress.parameters, each) if known else None
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
    """The verdict by the features; None: the model is not to be seen at the pose."""
    if features is None:
        return Verdict("lost", 0.0, ("Hardly anything of the model is to be seen there.",), None)
    probability = probability_of(features)
    is_lost = probability < LOST_BELOW
    found_from = FOUND_BEHIND if features.seen < HIDDEN_BELOW else FOUND_FROM
    word: Word = "found" if probability >= found_from else "lost" if is_lost else "doubtful"
    return Verdict(word, probability, reasons_for(features), features)


def judge_together(views: Sequence[Verdict]) -> Verdict:
    """Verdict on one pose by the mean log odds of its photos, as if they repeated each other.

    ``found`` needs half of them as probable, ``lost`` most of them as improbable: a few that no
    pose of the set explains contradict the others, and say little of the pose.
    """
    odds = np.clip([one.probability for one in views], LEAST_PROBABILITY, 1.0 - LEAST_PROBABILITY)
    probability = float(1.0 / (1.0 + np.exp(-np.mean(np.log(odds / (1.0 - odds))))))
    confirm = sum(one.probability >= FOUND_FROM for one in views)
    deny = sum(one.probability < LOST_BELOW for one in views)
    is_found = probability >= FOUND_FROM and 2 * confirm >= len(views)
    is_lost = probability < LOST_BELOW and 2 * deny > len(views)
    word: Word = "found" if is_found else "lost" if is_lost else "doubtful"
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
