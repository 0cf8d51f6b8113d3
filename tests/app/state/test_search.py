"""Searches and maps in the session, with real updates; and any commands in any order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.document import MOST_STEPS
from poseviewer.app.state.session import LandscapeUpdate, OverlayRequest, SearchUpdate, Session
from poseviewer.app.state.update import update
from poseviewer.app.workers.jobs import case_of, run_search
from poseviewer.app.workers.maps import maps
from poseviewer.app.workers.opening import open_files
from poseviewer.app.workers.overlay import OverlayDrawer
from poseviewer.fit.progress import Status
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.render.pool import RendererPool
from poseviewer.render.software.software_renderer import SoftwareRenderer
from tests.app.state.documents import (
    PARALLEL,
    PERSPECTIVE,
    after,
    assert_same_pose,
    make_document,
    make_photo,
)

SETTINGS = FitSettings(limits=Limits(evaluations=60))
UPDATES = (c.SearchAdvanced, c.LandscapeAdvanced, c.OverlayDrawn)
"""They leave an error message standing: it is about what the user did."""


@pytest.fixture(scope="module")
def session(scene) -> Session:
    """The small scene at its start."""
    document = open_files(scene.photo, scene.model, scene.start).document
    return Session(document.with_object(settings=SETTINGS))


@pytest.fixture(scope="module")
def updates(session) -> list[SearchUpdate]:
    """All updates of a short search from the start."""
    asked = after(session, c.StartSearch()).search
    assert asked is not None
    return list(run_search(asked))


@pytest.fixture(scope="module")
def landscape(session) -> tuple[LandscapeUpdate, ...]:
    """The whole of small maps about the start."""
    document = session.document
    renderer = SoftwareRenderer(document.mesh)
    case = case_of(document.scene, 0, 0, SETTINGS, renderer)
    with RendererPool(renderer) as pool:
        *_, last = maps(case, document, pool, 0.2, 5)
    return (last,)


def searched(session: Session, updates, count: int) -> Session:
    """After the start of a search and its first updates."""
    session = after(session, c.StartSearch())
    number = session.searches
    return after(session, *(c.SearchAdvanced(number, item) for item in updates[:count]))


def test_a_search_is_one_step_to_its_best_pose(session, updates):
    done = searched(session, updates, len(updates))
    assert not done.searching
    assert done.search is not None
    assert_same_pose(done.document.pose, updates[-1].progress.pose)
    assert done.history.past == (session.document,)
    assert after(done, c.Undo()).document is session.document
    assert after(done, c.RevertSearch()).document is session.document
    accepted = after(done, c.AcceptSearch())
    assert accepted.search is None
    assert accepted.document is done.document
    assert after(accepted, c.Undo()).document is session.document


def test_a_stopped_search_keeps_its_best(session, updates):
    running = searched(session, updates, 40)
    assert running.searching
    assert after(running, c.StartSearch()).searches == running.searches
    stopped = after(running, c.StopSearch())
    assert not stopped.searching
    assert stopped.document is running.document
    # Updates on their way come too late.
    assert after(stopped, c.SearchAdvanced(stopped.searches, updates[-1])) is stopped
    assert after(stopped, c.RevertSearch()).document is session.document


@pytest.mark.parametrize("back", [c.Undo(), c.RevertSearch()])
def test_back_in_the_midst_of_a_search_is_before_it(session, updates, back):
    running = searched(session, updates, 40)
    reverted = after(running, back)
    assert reverted.document is session.document
    assert reverted.search is None
    assert after(reverted, c.SearchAdvanced(running.searches, updates[50])) is reverted
    assert after(reverted, c.Redo()).document is running.document


def test_updates_of_an_older_search_are_dropped(session, updates):
    first = searched(session, updates, 10)
    second = after(first, c.StopSearch(), c.StartSearch())
    assert second.searches == first.searches + 1
    assert after(second, c.SearchAdvanced(first.searches, updates[30])) is second
    assert after(second, c.SearchFailed(first.searches, "no")) is second
    assert after(second, c.SearchAdvanced(second.searches, updates[30])) is not second


def test_a_drag_stops_a_search_and_is_kept(session, updates):
    running = searched(session, updates, 40)
    centre = session.document.mesh.centre
    x, y = running.document.pose.project(centre)
    dragged = after(running, c.Press(x, y))
    assert dragged.searching  # a click alone does not stop it
    dragged = after(dragged, c.DragTo(x + 6.0, y - 2.0))
    assert not dragged.searching
    assert after(dragged, c.SearchAdvanced(dragged.searches, updates[-1])) is dragged
    done = after(dragged, c.DragTo(x + 7.0, y - 3.0), c.Release())
    assert done.document.pose.project(centre) == pytest.approx([x + 7.0, y - 3.0], abs=1e-9)
    back = after(done, c.Undo())
    assert back.document is running.document
    assert after(back, c.Undo()).document is session.document


def test_a_search_that_cannot_run_goes_back_and_says_why(session):
    started = after(session, c.StartSearch())
    failed = update(started, c.SearchFailed(started.searches, "the region has no pixel"))
    assert failed.error_message == "The region has no pixel."
    assert failed.document is session.document
    assert failed.search is None


def test_a_picked_point_of_a_map_is_the_pose(session, landscape):
    with_maps = after(session, c.LandscapeAdvanced(landscape))
    (about,) = landscape
    piece = about.slices[0]
    for u, v in ((0.0, 0.0), (1.0, 0.25), (0.5, 0.5)):
        picked = after(with_maps, c.PickInLandscape(piece.first, piece.second, u, v))
        parameters = picked.document.parameters
        wanted = np.array(about.parameters)
        for index, values, share in (
            (piece.first, piece.first_values, u),
            (piece.second, piece.second_values, v),
        ):
            wanted[index] = values[0] + share * (values[-1] - values[0])
        assert parameters == pytest.approx(wanted, abs=1e-9)
        assert picked.history.past == (session.document,)
    beyond = after(with_maps, c.PickInLandscape(piece.first, piece.second, 7.0, -3.0))
    corner = after(with_maps, c.PickInLandscape(piece.first, piece.second, 1.0, 0.0))
    assert np.array_equal(beyond.document.parameters, corner.document.parameters)
    assert after(with_maps, c.PickInLandscape(0, 99, 0.5, 0.5)) is with_maps
    assert after(session, c.PickInLandscape(0, 1, 0.5, 0.5)) is session


def test_maps_of_another_photo_are_not_kept(session, landscape):
    with_maps = after(session, c.LandscapeAdvanced(landscape))
    other = make_document(photo=make_photo(1))
    opened = after(with_maps, c.Open(other))
    assert opened.landscapes == ()
    again = after(opened, c.LandscapeAdvanced(landscape), c.Undo())
    assert again.document is session.document
    assert again.landscapes == ()
    same = after(with_maps, c.Nudge("move", 2.0), c.Undo())
    assert same.landscapes is landscape


def test_maps_of_more_photos_than_are_left_come_too_late(session, landscape):
    scene = session.document.scene
    one = replace(scene.objects[0], in_views=scene.objects[0].in_views * 2)
    both = replace(session.document, scene=replace(scene, views=scene.views * 2, objects=(one,)))
    late = tuple(replace(maps, document=both) for maps in landscape)
    assert after(session, c.LandscapeAdvanced(late)) is session


def random_command(random, session: Session, updates, landscape, others) -> c.Command:
    """Any command, sometimes with nonsense in it."""
    x, y = random.uniform(-20.0, 180.0, 2)
    if random.uniform() < 0.7:
        x, y = session.document.pose.project(session.document.mesh.centre)
        x, y = np.array([x, y]) + random.normal(size=2) * 15.0
    if random.uniform() < 0.02:
        x = random.choice([np.nan, np.inf, 1e300, -1e8])
    x, y, amount = float(x), float(y), float(random.normal() * 3.0)
    flip = [bool(v) for v in random.integers(0, 2, 3)]
    pick = random.integers
    names = (*session.document.chart.names, "nonsense")
    sides = ("three-quarter", "left", "right", "front", "back", "top", "bottom", "nowhere")
    search_number = session.searches - int(random.uniform() < 0.2)
    settings = replace(SETTINGS, free_focal=flip[0], grey=flip[1])
    kinds = ("move", "turn", "roll", "scale")
    made: list[c.Command] = [
        *[c.Press(x, y, float(random.uniform(0.3, 4.0)), flip[0], flip[1])] * 3,
        *[c.DragTo(x, y)] * 5,
        *[c.Release()] * 2,
        c.CancelDrag(),
        *[c.DoublePress(x, y, 2.0)] * 2,
        c.Nudge(kinds[pick(4)], amount, -amount),
        c.SetNumber(names[pick(len(names))], float(random.normal() * 0.3)),
        c.ResetToStart(),
        c.MakeStart(),
        c.LookFrom(sides[pick(len(sides))]),
        c.Undo(),
        c.Redo(),
        c.AlterSettings(lambda _: settings),
        c.SetProjection("parallel" if flip[0] else "perspective"),
        c.SetCamera(float(random.uniform(-50.0, 500.0)), 300.0, x, y),
        c.Open(others[pick(len(others))]),
        c.SetTool("region" if flip[0] else "pose"),
        c.ChangeView(hidden=flip[0]),
        c.ChangeLandscape(large=(0, 1)),
        c.PickInLandscape(int(pick(6)), int(pick(6)), float(random.uniform(-1, 2)), 0.5),
        *[c.StartSearch()] * 2,
        c.StopSearch(),
        c.AcceptSearch(),
        c.RevertSearch(),
        *[c.SearchAdvanced(search_number, updates[pick(len(updates))])] * 3,
        c.SearchFailed(search_number, "it could not"),
        c.LandscapeAdvanced(landscape),
        c.Saved(session.document),
    ]
    return made[pick(len(made))]


@pytest.mark.parametrize("seed", range(3))
def test_any_commands_in_any_order_leave_a_session_that_can_be_undone(
    session, updates, landscape, seed
):
    random = np.random.default_rng(seed)
    renderer = SoftwareRenderer(session.document.mesh)
    others = [make_document(PARALLEL), make_document(PERSPECTIVE, vehicle=True), session.document]
    now = session
    for request in OverlayDrawer(renderer).draw(_request(session)):
        now = after(now, c.OverlayDrawn(request))
    for _ in range(500):
        command = random_command(random, now, updates, landscape, others)
        before, now = now, update(now, command)
        assert now.error_message == "" or now.error_message.endswith((".", "!", "?"))
        assert np.isfinite(now.document.parameters).all()
        if now.error_message and not isinstance(command, (c.SearchFailed, *UPDATES)):
            assert now.document is before.document
    assert 50 < len(now.history.past) < MOST_STEPS  # so that the first one is in reach
    while now.history.past:
        now = after(now, c.Undo())
    assert now.document is session.document


def _request(session: Session) -> OverlayRequest:
    document = session.document
    return OverlayRequest(document, document.scene, "outline")


def test_the_updates_are_of_a_search_that_ended(updates):
    assert updates[-1].progress.status is Status.EVALUATIONS_SPENT
    assert all(item.progress.status is Status.RUNNING for item in updates[:-2])
