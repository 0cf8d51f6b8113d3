"""Searches and maps in the session, with real updates; and what waits until all is ready."""

import pytest

from poseviewer import api
from poseviewer.app.state import commands as c
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.session import LandscapeUpdate, Preparation, SearchUpdate, Session
from poseviewer.app.workers.jobs import run_search
from poseviewer.app.workers.maps import maps
from poseviewer.app.workers.opening import open_files
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
def updates(session) -> list[SearchUpdate]:
    """All updates of a short search from the start."""
    return list(run_search(asked_of(after(session, c.start_search()))))


@pytest.fixture(scope="module")
def landscape(session) -> tuple[LandscapeUpdate, ...]:
    """The whole of small maps about the start."""
    document = session.document
    renderer = SoftwareRenderer(document.mesh)
    case = api.Scene(document.scene, {document.mesh: renderer}, 0, 0)
    with RendererPool(renderer) as pool:
        *_, last = maps(case, session, case.problem, pool, 5)
    return (last,)


def searched(session: Session, updates, count: int) -> Session:
    """After the start of a search and its first updates."""
    session = after(session, c.start_search())
    asked = asked_of(session)
    return after(session, *(c.search_advanced(asked, item) for item in updates[:count]))


def shown(maps: tuple[LandscapeUpdate, ...]) -> Edit:
    return c.show(maps[0].document, landscapes=maps)


def test_the_focal_length_is_searched_for_by_one_press():
    session = make_session(make_photo().default_camera())
    asked = after(session, c.find_focal_length())
    assert asked.searching
    assert asked_of(asked).methods[0].free_focal
    assert asked_of(asked).start.settings.free_focal
    assert not after(asked, c.revert_search(), c.undo()).document.settings.free_focal


def test_a_search_is_one_step_to_its_best_pose(session, updates):
    done = searched(session, updates, len(updates))
    assert not done.searching
    assert_same_pose(done.document.pose, updates[-1].progress.pose)
    assert done.history.past == (session.document,)
    accepted = after(done, c.accept_search())
    assert accepted.search is None
    assert accepted.document is done.document
    assert after(accepted, c.undo()).document is session.document


def test_a_stopped_search_keeps_its_best(session, updates):
    running = searched(session, updates, 40)
    assert after(running, c.start_search()) is running
    stopped = after(running, c.stop_search())
    assert not stopped.searching
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
    assert dragged.searching  # a click alone does not stop it
    dragged = after(dragged, c.drag_to(x + 6.0, y - 2.0))
    assert not dragged.searching
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
    wanted = c.picked_parameters(piece, about.parameters, 1.0, 0.25)
    assert picked.document.parameters == pytest.approx(wanted, abs=1e-9)
    assert picked.history.past == (session.document,)
    assert after(with_maps, c.pick_in_landscape(0, 99, 0.5, 0.5)) is with_maps
    assert after(session, c.pick_in_landscape(0, 1, 0.5, 0.5)) is session


def test_maps_of_another_photo_are_not_kept(session, landscape):
    with_maps = after(session, shown(landscape))
    other = make_document(photo=make_photo(1))
    opened = after(with_maps, c.open_document(other))
    assert opened.landscapes == ()
    again = after(opened, shown(landscape), c.undo())
    assert again.document is session.document
    assert again.landscapes == ()
    same = after(with_maps, c.nudge("move", 2.0), c.undo())
    assert same.landscapes is landscape


TROUBLE = "No kernels; install numba again."


@pytest.fixture
def compiling() -> Session:
    return Session(make_document(), preparation=Preparation(0.5))


def test_a_search_that_waits_is_there_when_all_is_ready(compiling: Session):
    waiting = after(compiling, c.start_search(), c.preparation_advanced(Preparation(0.9)))
    assert waiting.searching
    ready = after(waiting, c.preparation_advanced(None))
    assert ready.searching
    assert ready.preparation is None


def test_a_search_that_waits_can_be_stopped_as_if_it_were_never_asked_for(compiling: Session):
    stopped = after(compiling, c.start_search(), c.stop_search())
    assert stopped.search is None
    assert stopped.document is compiling.document
    assert stopped.history.past == compiling.history.past


def test_trouble_ends_what_waits_and_refuses_more(compiling: Session):
    waiting = after(compiling, c.start_search(), c.propose_starts())
    failed = after(waiting, c.preparation_advanced(Preparation(trouble=TROUBLE)))
    assert failed.search is None
    assert failed.proposals is None
    assert refused(failed, c.start_search()) == TROUBLE
    assert after(failed, c.nudge("move", 3.0)).document is not failed.document
