"""Both methods in the session: chosen, mapped, compared; each end can be taken, and undone."""

from __future__ import annotations

from dataclasses import replace

import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.session import SearchUpdate, Session, Whose
from poseviewer.app.workers.jobs import run_search
from poseviewer.app.workers.opening import open_files
from poseviewer.fit.settings import FitSettings, Limits, Method
from tests.app.state.documents import after, assert_same_pose, make_document

SETTINGS = FitSettings(grey=True, seed=3, limits=Limits(evaluations=40))


@pytest.fixture(scope="module")
def session(scene) -> Session:
    """The small scene, moved a little from its start."""
    document = open_files(scene.photo, scene.model, scene.start).document
    opened = Session(document.with_object(settings=SETTINGS))
    return after(opened, c.Nudge("move", 2.0))


@pytest.fixture(scope="module")
def updates(session) -> list[SearchUpdate]:
    """All updates of a comparison of the methods."""
    asked = after(session, c.CompareMethods()).search
    assert asked is not None
    return list(run_search(asked))


def compared(session: Session, updates: list[SearchUpdate]) -> Session:
    """After the whole of a comparison."""
    session = after(session, c.CompareMethods())
    number = session.searches
    return after(session, *(c.SearchAdvanced(number, update) for update in updates))


def test_each_method_keeps_what_it_compares(session):
    paper = after(session, c.SetMethod("paper"))
    settings = paper.document.settings
    assert (settings.method, settings.pixels, settings.grey) == ("paper", "clip", True)
    assert (settings.seed, settings.limits) == (SETTINGS.seed, SETTINGS.limits)
    whole = after(paper, c.AlterSettings(lambda s: replace(s, pixels="whole")))
    ours = after(whole, c.SetMethod("default"))
    assert ours.document.settings == SETTINGS
    assert after(ours, c.SetMethod("paper")).document.settings == whole.document.settings
    assert after(ours, c.SetMethod("default")) is ours
    assert after(ours, c.Undo(), c.Undo(), c.Undo()).document is session.document


def test_the_maps_are_of_the_loss_that_is_asked_for(session):
    paper = after(session, c.SetMethod("paper"))
    for at_hand in (session, paper):
        own = at_hand.document.settings
        assert at_hand.mapped == (own,)
        wanted: list[tuple[Whose, list[Method]]] = [
            ("paper", ["paper"]),
            ("both", ["default", "paper"]),
        ]
        for whose, methods in wanted:
            mapped = after(at_hand, c.ChangeLandscape(whose=whose)).mapped
            assert [settings.method for settings in mapped] == methods
            assert all(s == own for s in mapped if s.method == own.method)
            assert after(at_hand, c.ChangeLandscape(whose="default")).mapped == (SETTINGS,)


def test_a_comparison_searches_from_the_start_by_both_methods(session, updates):
    for update in updates:
        first = update.problem.chart.to_pose(update.problem.start)
        assert first.project(session.document.mesh.centre) == pytest.approx(
            session.document.start.project(session.document.mesh.centre)
        )
    methods = [update.settings.method for update in updates]
    assert methods == sorted(methods, reverse=True)  # the chosen one last
    first = {update.settings.method: update for update in reversed(updates)}
    assert set(first) == {"default", "paper"}
    running = after(session, c.CompareMethods())
    for update in updates[:-1]:
        running = after(running, c.SearchAdvanced(running.searches, update))
        assert running.searching
    done = compared(session, updates)
    assert not done.searching
    assert done.history.past == (*session.history.past, session.document)
    assert [end.settings.method for end in done.ends] == ["default", "paper"]
    assert_same_pose(done.document.pose, done.ends[0].update.progress.pose)
    for index, end in enumerate(done.ends):
        assert end.losses[index] == pytest.approx(end.update.progress.loss, rel=1e-9)
        others = [other.losses[index] for other in done.ends]
        assert len(set(others)) == 2  # each end is judged by each loss


def test_a_stopped_comparison_leaves_the_ends_of_the_one_before(session, updates):
    done = compared(session, updates)
    stopped = after(done, c.CompareMethods())
    stopped = after(stopped, c.SearchAdvanced(stopped.searches, updates[5]), c.StopSearch())
    assert stopped.ends is done.ends


@pytest.mark.parametrize("index", [0, 1])
def test_each_end_can_be_taken_with_its_method_and_undone(session, updates, index):
    done = compared(session, updates)
    end = done.ends[index]
    taken = after(done, c.TakeEnd(index))
    assert_same_pose(taken.document.pose, end.update.progress.pose)
    assert taken.document.settings == end.settings
    assert taken.search is not None
    assert taken.search.latest is end.update
    assert not taken.searching
    assert taken.ends is done.ends
    assert after(taken, c.Undo()).document is done.document
    other = after(taken, c.TakeEnd(1 - index))
    assert_same_pose(other.document.pose, done.ends[1 - index].update.progress.pose)
    assert after(other, c.SetMethod("default")).document.settings == SETTINGS
    assert after(done, c.TakeEnd(2)) is done


def test_ends_on_another_photo_or_model_are_gone(session, updates):
    done = compared(session, updates)
    assert after(done, c.Open(make_document())).ends == ()
