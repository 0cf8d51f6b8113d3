"""Both methods in the session: chosen, mapped, compared; each end can be taken, and undone."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.state.display_edits import set_fields
from poseviewer.app.state.document_edits import open_document, undo
from poseviewer.app.state.pose_edits import nudge
from poseviewer.app.state.search_edits import (
    alter_settings,
    compare_losses,
    search_advanced,
    set_loss,
    stop_search,
    take_end,
)
from poseviewer.app.state.searches import LossComparison
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import search_edits
from poseviewer.app.workers.opening import open_files
from poseviewer.fit.progress import SearchProgress
from poseviewer.scene.settings import FitSettings, Limits
from tests.app.state.documents import after, asked_of, assert_same_pose, make_document

SETTINGS = FitSettings(grey=True, seed=3, limits=Limits(evaluations=40))


@pytest.fixture(scope="module")
def session(scene) -> Session:
    """The small scene, moved a little from its start."""
    document = open_files(scene.photo, scene.model, scene.start)
    opened = Session(document.with_object(settings=SETTINGS))
    return after(opened, nudge("move", 2.0))


Step = tuple[SearchProgress, LossComparison | None]


@pytest.fixture(scope="module")
def steps(session) -> list[Step]:
    """All steps of a comparison of the methods."""
    edits = search_edits(asked_of(after(session, compare_losses())))
    return [(edit.arguments[1], *edit.arguments[2:]) for edit in edits]


def compared(session: Session, steps: list[Step]) -> tuple[Session, LossComparison]:
    """After the whole of a comparison, and the comparison."""
    session = after(session, compare_losses())
    asked = asked_of(session)
    done = after(session, *(search_advanced(asked, *step) for step in steps))
    assert done.comparison is not None
    return done, done.comparison


def test_each_method_keeps_what_it_compares(session):
    paper = after(session, set_loss("paper"))
    settings = paper.document.settings
    assert (settings.loss, settings.pixels, settings.grey) == ("paper", "clip", True)
    assert (settings.seed, settings.limits) == (SETTINGS.seed, SETTINGS.limits)
    whole = after(paper, alter_settings(lambda s: replace(s, pixels="whole")))
    ours = after(whole, set_loss("default"))
    assert ours.document.settings == SETTINGS
    assert after(ours, set_loss("paper")).document.settings == whole.document.settings
    assert after(ours, set_loss("default")) is ours
    assert after(ours, undo(), undo(), undo()).document is session.document


def test_the_maps_are_of_the_loss_that_is_asked_for(session):
    paper = after(session, set_loss("paper"))
    for at_hand in (session, paper):
        own = at_hand.document.settings
        assert at_hand.mapped == (own,)
        both = after(at_hand, set_fields("display", mapped_loss="both")).mapped
        assert [settings.loss for settings in both] == ["default", "paper"]
        assert own in both
        assert after(at_hand, set_fields("display", mapped_loss="default")).mapped == (SETTINGS,)


def test_a_comparison_searches_from_the_start_by_both_methods(session, steps):
    centre = session.document.mesh.centre
    methods = [progress.settings.loss for progress, *_ in steps]
    assert sorted(set(methods)) == ["default", "paper"]
    assert methods == sorted(methods, reverse=True)  # the chosen one last
    for progress, *_ in steps:
        first = progress.problem.chart.to_pose(progress.problem.start)
        assert first.project(centre) == pytest.approx(session.document.start.project(centre))
    done, comparison = compared(session, steps)
    assert not done.is_searching
    assert done.history.past == (*session.history.past, session.document)
    assert [end.settings.loss for end in comparison.ends] == ["default", "paper"]
    assert_same_pose(done.document.pose, comparison.ends[0].progress.pose)
    own = [end.progress.loss for end in comparison.ends]
    assert comparison.losses.diagonal() == pytest.approx(own, rel=1e-9)
    assert np.all(comparison.losses[0] != comparison.losses[1])  # each judged by each loss
    stopped = after(done, compare_losses())
    stopped = after(stopped, search_advanced(asked_of(stopped), steps[5][0]), stop_search())
    assert stopped.comparison is comparison
    assert after(done, open_document(make_document())).comparison is None


@pytest.mark.parametrize("index", [0, 1])
def test_each_end_can_be_taken_with_its_method_and_undone(session, steps, index):
    done, comparison = compared(session, steps)
    end = comparison.ends[index]
    taken = after(done, take_end(index))
    assert_same_pose(taken.document.pose, end.progress.pose)
    assert taken.document.settings == end.settings
    assert taken.search_progress is end
    assert not taken.is_searching
    assert taken.comparison is comparison
    assert after(taken, undo()).document is done.document
    other = after(taken, take_end(1 - index))
    assert_same_pose(other.document.pose, comparison.ends[1 - index].progress.pose)
    assert after(other, set_loss("default")).document.settings == SETTINGS
    assert after(done, take_end(2)) is done
