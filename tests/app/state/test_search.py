"""Searches, by one loss and by both, and maps in the session; and what waits until all is ready."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.state.edits import Edit
from poseviewer.app.state.hiding import mask_pixels
from poseviewer.app.state.results import Landscape, LossComparison, Preparation, ProposedStarts
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import run_search, search_edits
from poseviewer.app.workers.maps import refine_maps
from poseviewer.app.workers.overlay import LossReader
from poseviewer.fit.problem import make_problem
from poseviewer.fit.progress import SearchProgress
from poseviewer.render.pool import RendererPool
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.settings import FitSettings, Limits
from tests.app.state import edits as c
from tests.app.state.documents import (
    after,
    asked_of,
    assert_same_pose,
    make_document,
    make_photo,
    make_session,
    open_files,
    refused,
)

SETTINGS = FitSettings(grey=True, seed=3, limits=Limits(evaluations=60))
Step = tuple[SearchProgress, LossComparison | None]


@pytest.fixture(scope="module")
def session(scene) -> Session:
    """The small scene, moved a little from its start."""
    document = open_files(scene.photo, scene.model, scene.start)
    moved = after(Session(document.with_object(settings=SETTINGS)), c.nudge("move", 2.0))
    return Session(moved.document)


@pytest.fixture(scope="module")
def updates(session) -> list[SearchProgress]:
    """All updates of a short search from the start."""
    return list(run_search(asked_of(after(session, c.start_search()))))


@pytest.fixture(scope="module")
def landscape(session) -> tuple[Landscape, ...]:
    """The whole of small maps about the start."""
    document = session.document
    problem, _ = make_problem(document.at_start.scene)
    about = Landscape(document, problem, document.start, document.params_in(problem), 0.2)
    with RendererPool(SoftwareRenderer(document.mesh)) as pool:
        *_, last = refine_maps(about, problem, pool, 5)
    return (last,)


def searched(session: Session, updates, count: int) -> Session:
    """After the start of a search and its first updates."""
    session = after(session, c.start_search())
    asked = asked_of(session)
    return after(session, *(c.search_advanced(asked, item) for item in updates[:count]))


def shown(maps: tuple[Landscape, ...]) -> Edit:
    return c.show_results(maps[0].document, landscapes=maps)


def test_the_focal_length_is_searched_for_by_one_press():
    session = make_session(make_photo().default_camera())
    asked = after(session, c.find_focal_length())
    assert asked.is_searching
    assert asked_of(asked).methods[0].free_focal
    assert not asked.document.settings.free_focal  # a press changes no setting
    assert asked.history.past == (session.document,)
    assert after(asked, c.revert_search()).document is session.document


def test_no_search_begins_where_nobody_has_placed_the_model():
    session = Session(make_document().with_object(is_placed=False))
    looking = after(session, c.toggle_search())
    assert looking.is_looking
    assert looking.search is None
    for edit in (c.toggle_search(), c.find_focal_length(), c.compare_losses()):
        assert "is not placed: press a proposal, or the photo" in refused(looking, edit)
    found_none = after(looking, c.list_starts(ProposedStarts(looking.document)))
    assert "is not placed" in refused(found_none, c.toggle_search())


def test_a_search_is_one_step_to_its_best_pose(session, updates):
    done = searched(session, updates, len(updates))
    assert not done.is_searching
    assert_same_pose(done.document.pose, updates[-1].progress.pose)
    assert done.history.past == (session.document,)
    accepted = after(done, c.accept_search())
    assert accepted.search is None
    assert accepted.document is done.document
    assert after(accepted, c.undo()).document is session.document


def test_a_pose_has_one_loss_whatever_led_to_it(session, updates):
    reader = LossReader(SoftwareRenderer(session.document.mesh))
    done = searched(session, updates, len(updates))
    kept = after(done, c.accept_search())
    elsewhere = after(session, c.nudge("move", 3.0), c.make_start())
    ways = [
        done,
        kept,
        after(kept, c.nudge("move", 1.0), c.undo()),
        after(session, c.set_fields(document=session.document.at_pose(done.document.pose))),
        elsewhere.with_document(elsewhere.document.at_pose(done.document.pose)),
        after(kept, c.alter_settings(lambda now: replace(now, free_focal=True))),
    ]
    means = [reader.read(way).mean for way in ways]
    losses = [mean.loss for mean in means if mean is not None]
    np.testing.assert_allclose(losses, [losses[0]] * len(ways), rtol=1e-9)
    assert done.at_pose == kept.at_pose  # it is read once


def test_a_stopped_search_keeps_its_best(session, updates):
    running = searched(session, updates, 40)
    assert after(running, c.start_search()) is running
    stopped = after(running, c.stop_search())
    assert not stopped.is_searching
    assert stopped.document is running.document
    # Updates on their way come too late, also for one that is begun anew.
    late, failed = c.search_advanced(asked_of(running), updates[-1]), asked_of(running)
    for now in (stopped, after(stopped, c.start_search())):
        assert after(now, late) is now
    again = after(stopped, c.start_search())
    assert after(again, c.search_failed(failed)) is again
    assert after(again, c.search_advanced(asked_of(again), updates[30])) is not again


@pytest.mark.parametrize("back", [c.undo(), c.revert_search(), None])
def test_back_in_the_midst_of_a_search_is_before_it(session, updates, back):
    running = searched(session, updates, 40)
    reverted = after(running, back or c.search_failed(asked_of(running)))
    assert reverted.document is session.document
    assert reverted.search is None
    assert after(reverted, c.redo()).document is running.document


def test_a_drag_stops_a_search_and_is_kept(session, updates):
    running = searched(session, updates, 40)
    centre = session.document.mesh.centre
    x, y = running.document.pose.project(centre)
    dragged = after(running, c.press(x, y))
    assert dragged.is_searching  # a click alone does not stop it
    dragged = after(dragged, c.drag_to(x + 6.0, y - 2.0))
    assert not dragged.is_searching
    assert after(dragged, c.search_advanced(asked_of(running), updates[-1])) is dragged
    done = after(dragged, c.drag_to(x + 7.0, y - 3.0), c.release())
    assert done.document.pose.project(centre) == pytest.approx([x + 7.0, y - 3.0], abs=1e-9)
    back = after(done, c.undo())
    assert back.document is running.document
    assert after(back, c.undo()).document is session.document


def test_a_picked_point_of_a_map_is_the_pose(session, landscape):
    with_maps = after(session, shown(landscape))
    (about,) = landscape
    piece = about.slices[0]
    picked = after(with_maps, c.pick_in_landscape(piece.first, piece.second, 1.0, 0.25))
    wanted = c.parameters_at(piece, about.parameters, (1.0, 0.25))
    assert picked.document.parameters == pytest.approx(wanted, abs=1e-9)
    assert picked.history.past == (session.document,)
    assert after(with_maps, c.pick_in_landscape(0, 99, 0.5, 0.5)) is with_maps
    assert after(session, c.pick_in_landscape(0, 1, 0.5, 0.5)) is session


def test_maps_of_another_photo_are_not_kept(session, landscape):
    with_maps = after(session, shown(landscape))
    other = make_document(photo=make_photo(1))
    opened = after(with_maps, c.open_document(other))
    assert opened.results.landscapes == ()
    again = after(opened, shown(landscape), c.undo())
    assert again.document is session.document
    assert again.results.landscapes == ()
    same = after(with_maps, c.nudge("move", 2.0), c.undo())
    assert same.results.landscapes is landscape


TROUBLE = "No kernels; install numba again."


@pytest.fixture
def compiling() -> Session:
    return Session(make_document(), preparation=Preparation(0.5))


def test_a_search_that_waits_runs_once_all_is_ready_or_is_taken_back(compiling: Session):
    waiting = after(compiling, c.start_search(), c.preparation_advanced(Preparation(0.9)))
    ready = after(waiting, c.preparation_advanced(None))
    assert (waiting.is_searching, ready.is_searching, ready.preparation) == (True, True, None)
    stopped = after(waiting, c.stop_search())
    assert (stopped.search, stopped.document) == (None, compiling.document)
    assert stopped.history.past == compiling.history.past


def test_trouble_ends_what_waits_and_refuses_more(compiling: Session):
    waiting = after(compiling, c.start_search(), c.propose_starts())
    failed = after(waiting, c.preparation_advanced(Preparation(trouble=TROUBLE)))
    assert failed.search is None
    assert failed.proposals is None
    assert refused(failed, c.start_search()) == TROUBLE
    assert after(failed, c.nudge("move", 3.0)).document is not failed.document


@pytest.fixture(scope="module")
def steps(session) -> list[Step]:
    """All steps of a comparison of the methods."""
    edits = search_edits(asked_of(after(session, c.compare_losses())))
    return [(edit.arguments[1], *edit.arguments[2:]) for edit in edits]


def compared(session: Session, steps: list[Step]) -> tuple[Session, LossComparison]:
    """After the whole of a comparison, and the comparison."""
    session = after(session, c.compare_losses())
    asked = asked_of(session)
    done = after(session, *(c.search_advanced(asked, *step) for step in steps))
    assert done.comparison is not None
    return done, done.comparison


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
        both = after(at_hand, c.set_fields("display", mapped_loss="all")).mapped
        assert [settings.loss for settings in both] == ["default", "paper"]
        assert own in both
        assert after(at_hand, c.set_fields("display", mapped_loss="default")).mapped == (SETTINGS,)


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
    stopped = after(done, c.compare_losses())
    stopped = after(stopped, c.search_advanced(asked_of(stopped), steps[5][0]), c.stop_search())
    assert stopped.comparison is comparison
    assert after(done, c.open_document(make_document())).comparison is None


@pytest.mark.parametrize("index", [0, 1])
def test_each_end_can_be_taken_with_its_method_and_undone(session, steps, index):
    done, comparison = compared(session, steps)
    end = comparison.ends[index]
    taken = after(done, c.take_end(index))
    assert_same_pose(taken.document.pose, end.progress.pose)
    assert taken.document.settings == end.settings
    assert taken.search_progress is end
    assert not taken.is_searching
    assert taken.comparison is comparison
    assert after(taken, c.undo()).document is done.document
    other = after(taken, c.take_end(1 - index))
    assert_same_pose(other.document.pose, comparison.ends[1 - index].progress.pose)
    assert after(other, c.set_loss("default")).document.settings == SETTINGS
    assert after(done, c.take_end(2)) is done


def test_what_is_hidden_after_a_comparison_stays_hidden_at_its_other_end(session, steps):
    done, _ = compared(session, steps)
    photo = done.document.photo
    left = np.zeros((photo.height, photo.width), bool)
    left[:, :9] = True
    hidden = after(done, mask_pixels(photo, left))
    mask = hidden.document.view.mask
    assert mask is not None
    assert after(hidden, c.take_end(1)).document.view.mask is mask
