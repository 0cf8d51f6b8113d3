"""A search for all objects of a photo, as the search's worker runs it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from poseviewer.api import Case, make_case
from poseviewer.app.state.document import Document, SceneObject, SearchEnd
from poseviewer.app.state.session import Search, SearchUpdate, Together
from poseviewer.app.workers.jobs import renderer_of, run_search
from poseviewer.confidence.model import judge_end
from poseviewer.errors import SettingsError
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.registration import PlacedModel
from poseviewer.fit.together import ModelToPlace, search_together
from poseviewer.render.pool import processors


def run(asked: Search) -> Iterator[SearchUpdate]:
    """What the session asks for: a search for an object alone, or for some among others."""
    return search_all(asked.before, asked.objects) if asked.objects else run_search(asked)


def search_all(document: Document, objects: Sequence[SceneObject]) -> Iterator[SearchUpdate]:
    """A search for some of a document's objects in turn, until none improves, the others where they
    are; raises as ``search``, and where nothing of any of them is to be seen.
    """
    numbers = [one.number for one in objects]
    left = [one for one in document.objects if one.stands and one.number not in numbers]
    stay = tuple(PlacedModel(one.registration.mesh, one.pose) for one in left)
    models = [
        ModelToPlace(
            replace(one.registration, start=one.pose, others=stay),
            one.settings,
            renderer_of(one.registration.mesh).clone(),
        )
        for one in objects
    ]
    case: Case | None = None
    update: SearchUpdate | None = None
    improvements: tuple[FitProgress, ...] = ()
    restarts: tuple[FitProgress, ...] = ()
    ends: dict[int, SearchEnd] = {}
    for now in search_together(models, judge_end, processors()):
        model, placing, number = models[now.index], now.placings[now.index], numbers[now.index]
        assert placing is not None  # it is the one under way
        progress = placing.progress
        if case is None or case.problem is not placing.problem:
            case = Case(placing.registration, model.settings, placing.problem, model.renderer)
            improvements = restarts = ()
        if not improvements or progress.loss < improvements[-1].loss:
            improvements = (*improvements, progress)
        if progress.restart > len(restarts):
            restarts = (*restarts, progress)
        if progress.status is not Status.RUNNING:
            ends = {**ends, number: SearchEnd.of(case, progress)}
        together = Together(number, dict(zip(numbers, now.poses, strict=True)), ends)
        update = SearchUpdate(case, progress, improvements, restarts, together=together)
        yield update
    if update is None or update.together is None:
        for model in models:  # says why it cannot be compared, and what to do
            make_case(model.registration, model.settings, model.renderer)
        raise SettingsError("the objects stand wholly behind others: bring one to the front")
    yield replace(update, together=replace(update.together, is_over=True))
