"""The poses of several models in one photo, one after the other, until none changes what is seen of
another.

What one model hides of another depends on both poses, so the searches alternate: the model that is
seen most goes first, and each is compared where the others, at their poses by then, leave it to be
seen. A model is searched for again where this has changed since. Estimates that no search was sure
of yet hide nothing: they may be of another place altogether.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from poseviewer.fit.problem import FitProblem, Strategy, make_problem
from poseviewer.fit.progress import FitProgress, Status, merge
from poseviewer.fit.registration import PlacedModel, Registration
from poseviewer.fit.search import (
    Judge,
    finish,
    is_start_kept,
    rest_of,
    start_kept,
    until_focal_settles,
)
from poseviewer.fit.settings import FitSettings
from poseviewer.fit.visibility import Hiding, hiding, visibility
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mask import Mask
from poseviewer.render.types import Renderer

CHANGED = 0.05
"""Share of a model's pixels that others must hide or give free for another search: less moves its
minimum by less than such a search can tell."""
LEAST_LEFT = 0.5
"""Share of what is seen of a model at its start that must lie beside all others, to be searched for
first as if they all stood in front: with less there is little to go by."""
LOOKS = 3
"""How often a search looks again at what others hide of its model, before its verdict: after two
most have settled."""
MOST_ROUNDS = 4
"""Searches of one model at most: two that slide along each other would take turns for ever."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelToPlace:
    """A model that is searched for with others."""

    registration: Registration
    """Its ``others`` are those that stay where they are, the same for all."""
    settings: FitSettings
    renderer: Renderer


@dataclass(frozen=True, slots=True, eq=False)
class Placing:
    """The last search for a model."""

    registration: Registration
    """With the others where they were."""
    problem: FitProblem
    progress: FitProgress


@dataclass(frozen=True, slots=True, eq=False)
class TogetherProgress:
    """Several searches after one more evaluation of one of them."""

    index: int
    """Of the model that is searched for."""
    placings: tuple[Placing | None, ...]
    """The last search for each model; None where there was none: it is not its turn yet, or it
    stands wholly behind others."""
    poses: tuple[Pose, ...]
    """Where all are by now."""

    @property
    def progress(self) -> FitProgress:
        """The search under way."""
        placing = self.placings[self.index]
        assert placing is not None  # it has begun
        return placing.progress


def search_together(
    models: Sequence[ModelToPlace], judge: Judge, threads: int = 1
) -> Iterator[TogetherProgress]:
    """Search for all ``models`` of one photo in turn; yields after every evaluation.

    To stop it, stop asking: all poses are the best so far. Nothing is yielded where each of them
    stands wholly behind others. The limits of the settings are those of each search.

    Raises:
        SettingsError: the settings do not go with the photo, a model or its start.
        SingularChartError: the wanted chart has no parameters at a start.
    """
    poses = [model.registration.start for model in models]
    placings: list[Placing | None] = [None] * len(models)
    compared: list[Hiding | None] = [None] * len(models)
    for _ in range(MOST_ROUNDS):
        due, was_searched = set(range(len(models))), False
        while due:
            index = _most_seen(models, poses, due)
            due.remove(index)
            model = models[index]
            rest = [i for i, one in enumerate(models) if i != index and _hides(one, placings[i])]
            others = tuple(PlacedModel(models[i].registration.mesh, poses[i]) for i in rest)
            others = (*model.registration.others, *others)
            now = hiding(PlacedModel(model.registration.mesh, poses[index]), others)
            before = compared[index]
            if now.is_whole or (before is not None and not _differ(before, now)):
                continue
            there = replace(model, registration=replace(model.registration, others=others))
            first = _all_in_front(now) if before is None and len(models) == 1 else now
            for seen, placing in _search(there, poses[index], first, judge, threads):
                compared[index], placings[index] = seen, placing
                poses[index] = placing.progress.pose
                yield TogetherProgress(index, tuple(placings), tuple(poses))
            was_searched = True
        if not was_searched:
            return


def _search(
    model: ModelToPlace, pose: Pose, seen: Hiding, judge: Judge, threads: int
) -> Iterator[tuple[Hiding, Placing]]:
    """Search for a model among its others from a ``pose`` at which it is known what they hide; with
    what they hide where it is compared by then.

    This is looked at again where the coarsest level leads, and where the search ends; only then the
    verdict and restarts follow, as with wrong pixels they would be in vain.
    """
    registration, renderer = model.registration, model.renderer
    mesh, others = registration.mesh, registration.others
    problem = _problem(model, seen)
    strategy = Strategy.FIRST if problem.photo.structure is None else Strategy.COARSE
    done: FitProgress | None = None
    gain = math.inf  # of the last search, where it continued another on the same pixels
    for look in range(LOOKS + 1):
        rest = problem.limits if done is None else rest_of(problem.limits, done, done.seconds)
        if rest is None:
            break
        start = problem.chart.from_pose(pose)
        part, before = replace(problem, strategy=strategy, start=start, limits=rest), done
        for now in until_focal_settles(part, renderer, threads):
            done = now if before is None else merge(before, now, now)
            if strategy is Strategy.CONTINUE:
                gain = now.start_loss - now.loss
            yield seen, Placing(registration, problem, replace(done, status=Status.RUNNING))
        assert done is not None  # a search yields at least once
        pose, found = done.pose, hiding(PlacedModel(mesh, done.pose), others)
        is_same = found.is_whole or not _differ(seen, found)
        if strategy is not Strategy.COARSE and (is_same or look == LOOKS):
            break
        if not is_same:
            seen, problem = found, _problem(model, found)
        strategy = Strategy.CONTINUE
    assert done is not None
    for end in finish(problem, done, mesh, renderer, judge, threads, bool(others), gain):
        if is_start_kept(problem, end):
            found = hiding(PlacedModel(mesh, registration.start), others)
            if not found.is_whole:
                seen, problem = found, _problem(model, found)
            end = start_kept(problem, end, mesh, renderer, judge, threads)
        yield seen, Placing(registration, problem, end)


def _all_in_front(seen: Hiding) -> Hiding:
    """What others may hide of a model: at a start its depth may be too wrong to tell. The same as
    given where that leaves too little of it, as of what stands before a wall.
    """
    left, shown = (np.count_nonzero(seen.drawn & ~hidden) for hidden in (seen.others, seen.hidden))
    return replace(seen, hidden=seen.others) if left >= LEAST_LEFT * shown else seen


def _problem(model: ModelToPlace, seen: Hiding) -> FitProblem:
    """As of ``make_problem``, where a model's others hide what they do at another pose of it."""
    registration = model.registration
    weights = 1.0 if registration.mask is None else registration.mask.weights
    mask = Mask.of(weights * ~seen.with_margin)
    return make_problem(replace(registration, mask=mask, others=()), model.settings)[0]


def _hides(model: ModelToPlace, placing: Placing | None) -> bool:
    """Whether a model is where it is thought to be, so that it hides what is behind it."""
    if not model.settings.keep_start:
        return True
    return placing is not None and placing.progress.status is not Status.KEPT


def _most_seen(models: Sequence[ModelToPlace], poses: Sequence[Pose], due: set[int]) -> int:
    """Which of the models that are ``due`` all others hide least."""
    placed = [
        PlacedModel(model.registration.mesh, pose)
        for model, pose in zip(models, poses, strict=True)
    ]
    shares = visibility([*placed, *models[0].registration.others]).shares
    return max(sorted(due), key=lambda index: shares[index])


def _differ(before: Hiding, now: Hiding) -> bool:
    """Whether other pixels of the model are hidden now than were when it was searched for."""
    changed = np.count_nonzero((before.hidden ^ now.hidden) & now.drawn)
    return bool(changed > CHANGED * np.count_nonzero(now.drawn))
