"""Searches and maps in the session, with real updates; and what waits until all is ready."""

import pytest

from poseviewer.app.state.display_edits import show_results
from poseviewer.app.state.document_edits import open_document, redo, undo
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.pointer_edits import drag_to, press, release
from poseviewer.app.state.pose_edits import nudge, pick_in_landscape, picked_parameters
from poseviewer.app.state.proposal_edits import propose_starts
from poseviewer.app.state.results import Landscape, Preparation
from poseviewer.app.state.search_edits import (
    accept_search,
    find_focal_length,
    preparation_advanced,
    revert_search,
    search_advanced,
    search_failed,
    start_search,
    stop_search,
)
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import run_search
from poseviewer.app.workers.maps import maps
from poseviewer.app.workers.opening import open_files
from poseviewer.fit.problem import make_problem
from poseviewer.fit.progress import SearchProgress
from poseviewer.render.pool import RendererPool
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.settings import FitSettings, Limits
from tests.app.state.documents import (
    after,
    asked_of,
    assert_same_pose,
    make_document,
    make_photo,
    make_session,
    refused,
)

SETTINGS = FitSettings(limits=Limits(evaluations=60))


@pytest.fixture(scope="module")
def session(scene) -> Session:
    """The small scene at its start."""
    document = open_files(scene.photo, scene.model, scene.start)
    return Session(document.with_object(settings=SETTINGS))


@pytest.fixture(scope="module")
def updates(session) -> list[SearchProgress]:
    """All updates of a short search from the start."""
    return list(run_search(asked_of(after(session, start_search()))))


@pytest.fixture(scope="module")
def landscape(session) -> tuple[Landscape, ...]:
    """The whole of small maps about the start."""
    document = session.document
    problem, _ = make_problem(document.scene)
    about = Landscape(document, problem, document.pose, problem.start, 0.2)
    with RendererPool(SoftwareRenderer(document.mesh)) as pool:
        *_, last = maps(about, problem, pool, 5)
    return (last,)


def searched(session: Session, updates, count: int) -> Session:
    """After the start of a search and its first updates."""
    session = after(session, start_search())
    asked = asked_of(session)
    return after(session, *(search_advanced(asked, item) for item in updates[:count]))


def shown(maps: tuple[Landscape, ...]) -> Edit:
    return show_results(maps[0].document, landscapes=maps)


def test_the_focal_length_is_searched_for_by_one_press():
    session = make_session(make_photo().default_camera())
    asked = after(session, find_focal_length())
    assert asked.is_searching
    assert asked_of(asked).methods[0].free_focal
    assert asked_of(asked).start.settings.free_focal
    assert not after(asked, revert_search(), undo()).document.settings.free_focal


def test_a_search_is_one_step_to_its_best_pose(session, updates):
    done = searched(session, updates, len(updates))
    assert not done.is_searching
    assert_same_pose(done.document.pose, updates[-1].progress.pose)
    assert done.history.past == (session.document,)
    accepted = after(done, accept_search())
    assert accepted.search is None
    assert accepted.document is done.document
    assert after(accepted, undo()).document is session.document


def test_a_stopped_search_keeps_its_best(session, updates):
    running = searched(session, updates, 40)
    assert after(running, start_search()) is running
    stopped = after(running, stop_search())
    assert not stopped.is_searching
    assert stopped.document is running.document
    # Updates on their way come too late, also for one that is begun anew.
    late, failed = search_advanced(asked_of(running), updates[-1]), asked_of(running)
    for now in (stopped, after(stopped, start_search())):
        assert after(now, late) is now
    again = after(stopped, start_search())
    assert after(again, search_failed(failed)) is again
    assert after(again, search_advanced(asked_of(again), updates[30])) is not again


@pytest.mark.parametrize("back", [undo(), revert_search(), None])
def test_back_in_the_midst_of_a_search_is_before_it(session, updates, back):
    running = searched(session, updates, 40)
    reverted = after(running, back or search_failed(asked_of(running)))
    assert reverted.document is session.document
    assert reverted.search is None
    assert after(reverted, redo()).document is running.document


def test_a_drag_stops_a_search_and_is_kept(session, updates):
    running = searched(session, updates, 40)
    centre = session.document.mesh.centre
    x, y = running.document.pose.project(centre)
    dragged = after(running, press(x, y))
    assert dragged.is_searching  # a click alone does not stop it
    dragged = after(dragged, drag_to(x + 6.0, y - 2.0))
    assert not dragged.is_searching
    assert after(dragged, search_advanced(asked_of(running), updates[-1])) is dragged
    done = after(dragged, drag_to(x + 7.0, y - 3.0), release())
    assert done.document.pose.project(centre) == pytest.approx([x + 7.0, y - 3.0], abs=1e-9)
    back = after(done, undo())
    assert back.document is running.document
    assert after(back, undo()).document is session.document


def test_a_picked_point_of_a_map_is_the_pose(session, landscape):
    with_maps = after(session, shown(landscape))
    (about,) = landscape
    piece = about.slices[0]
    picked = after(with_maps, pick_in_landscape(piece.first, piece.second, 1.0, 0.25))
    wanted = picked_parameters(piece, about.parameters, 1.0, 0.25)
    assert picked.document.parameters == pytest.approx(wanted, abs=1e-9)
    assert picked.history.past == (session.document,)
    assert after(with_maps, pick_in_landscape(0, 99, 0.5, 0.5)) is with_maps
    assert after(session, pick_in_landscape(0, 1, 0.5, 0.5)) is session


def test_maps_of_another_photo_are_not_kept(session, landscape):
    with_maps = after(session, shown(landscape))
    other = make_document(photo=make_photo(1))
    opened = after(with_maps, open_document(other))
    assert opened.results.landscapes == ()
    again = after(opened, shown(landscape), undo())
    assert again.document is session.document
    assert again.results.landscapes == ()
    same = after(with_maps, nudge("move", 2.0), undo())
    assert same.results.landscapes is landscape


TROUBLE = "No kernels; install numba again."


@pytest.fixture
def compiling() -> Session:
    return Session(make_document(), preparation=Preparation(0.5))


def test_a_search_that_waits_is_there_when_all_is_ready(compiling: Session):
    waiting = after(compiling, start_search(), preparation_advanced(Preparation(0.9)))
    assert waiting.is_searching
    ready = after(waiting, preparation_advanced(None))
    assert ready.is_searching
    assert ready.preparation is None


def test_a_search_that_waits_can_be_stopped_as_if_it_were_never_asked_for(compiling: Session):
    stopped = after(compiling, start_search(), stop_search())
    assert stopped.search is None
    assert stopped.document is compiling.document
    assert stopped.history.past == compiling.history.past


def test_trouble_ends_what_waits_and_refuses_more(compiling: Session):
    waiting = after(compiling, start_search(), propose_starts())
    failed = after(waiting, preparation_advanced(Preparation(trouble=TROUBLE)))
    assert failed.search is None
    assert failed.proposals is None
    assert refused(failed, start_search()) == TROUBLE
    assert after(failed, nudge("move", 3.0)).document is not failed.document
