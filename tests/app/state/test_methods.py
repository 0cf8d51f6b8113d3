"""Both methods in the session: chosen, mapped, compared; each end can be taken, and undone."""

from dataclasses import replace

import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.session import SearchUpdate, Session
from poseviewer.app.workers.jobs import run_search
from poseviewer.app.workers.opening import open_files
from poseviewer.scene.settings import FitSettings, Limits
from tests.app.state.documents import after, asked_of, assert_same_pose, make_document

SETTINGS = FitSettings(grey=True, seed=3, limits=Limits(evaluations=40))


@pytest.fixture(scope="module")
def session(scene) -> Session:
    """The small scene, moved a little from its start."""
    document = open_files(scene.photo, scene.model, scene.start)
    opened = Session(document.with_object(settings=SETTINGS))
    return after(opened, c.nudge("move", 2.0))


@pytest.fixture(scope="module")
def updates(session) -> list[SearchUpdate]:
    """All updates of a comparison of the methods."""
    return list(run_search(asked_of(after(session, c.compare_losses()))))


def compared(session: Session, updates: list[SearchUpdate]) -> Session:
    """After the whole of a comparison."""
    session = after(session, c.compare_losses())
    asked = asked_of(session)
    return after(session, *(c.search_advanced(asked, update) for update in updates))


def test_each_method_keeps_what_it_compares(session):
    paper = after(session, c.set_loss("paper"))
    settings = paper.document.settings
    assert (settings.loss, settings.pixels, settings.grey) == ("paper", "clip", True)
    assert (settings.seed, settings.limits) == (SETTINGS.seed, SETTINGS.limits)
    whole = after(paper, c.alter_settings(lambda s: replace(s, pixels="whole")))
    ours = after(whole, c.set_loss("default"))
    assert ours.document.settings == SETTINGS
    assert after(ours, c.set_loss("paper")).document.settings == whole.document.settings
    assert after(ours, c.set_loss("default")) is ours
    assert after(ours, c.undo(), c.undo(), c.undo()).document is session.document


def test_the_maps_are_of_the_loss_that_is_asked_for(session):
    paper = after(session, c.set_loss("paper"))
    for at_hand in (session, paper):
        own = at_hand.document.settings
        assert at_hand.mapped == (own,)
        both = after(at_hand, c.change(whose="both")).mapped
        assert [settings.loss for settings in both] == ["default", "paper"]
        assert own in both
        assert after(at_hand, c.change(whose="default")).mapped == (SETTINGS,)


def test_a_comparison_searches_from_the_start_by_both_methods(session, updates):
    centre, methods = session.document.mesh.centre, [update.settings.loss for update in updates]
    assert sorted(set(methods)) == ["default", "paper"]
    assert methods == sorted(methods, reverse=True)  # the chosen one last
    for update in updates:
        first = update.problem.chart.to_pose(update.problem.start)
        assert first.project(centre) == pytest.approx(session.document.start.project(centre))
    done = compared(session, updates)
    assert not done.searching
    assert done.history.past == (*session.history.past, session.document)
    assert [end.settings.loss for end in done.ends] == ["default", "paper"]
    assert_same_pose(done.document.pose, done.ends[0].progress.pose)
    for index, end in enumerate(done.ends):
        assert end.losses[index] == pytest.approx(end.progress.loss, rel=1e-9)
        assert len({other.losses[index] for other in done.ends}) == 2  # each judged by each loss
    stopped = after(done, c.compare_losses())
    stopped = after(stopped, c.search_advanced(asked_of(stopped), updates[5]), c.stop_search())
    assert stopped.ends is done.ends
    assert after(done, c.open_document(make_document())).ends == ()


@pytest.mark.parametrize("index", [0, 1])
def test_each_end_can_be_taken_with_its_method_and_undone(session, updates, index):
    done = compared(session, updates)
    end = done.ends[index]
    taken = after(done, c.take_end(index))
    assert_same_pose(taken.document.pose, end.progress.pose)
    assert taken.document.settings == end.settings
    assert taken.search is not None
    assert taken.search.latest is end
    assert not taken.searching
    assert taken.ends is done.ends
    assert after(taken, c.undo()).document is done.document
    other = after(taken, c.take_end(1 - index))
    assert_same_pose(other.document.pose, done.ends[1 - index].progress.pose)
    assert after(other, c.set_loss("default")).document.settings == SETTINGS
    assert after(done, c.take_end(2)) is done
