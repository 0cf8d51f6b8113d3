"""What runs beside the session gives what the command line gives, piece by piece."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.document import Document
from poseviewer.app.state.session import OverlayRequest, Session
from poseviewer.app.state.update import update
from poseviewer.app.workers.jobs import case_at, search
from poseviewer.app.workers.maps import MapJob, MapMaker, maps
from poseviewer.app.workers.overlay import OverlayDrawer
from poseviewer.fit.landscape import free_pairs
from poseviewer.fit.problem import make_problem, pose_loss
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.fit.stages import fit_pose
from poseviewer.render.pool import RendererPool
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.starts.registration import load_registration

SETTINGS = FitSettings(limits=Limits(evaluations=150))


@pytest.fixture(scope="module")
def registration(scene) -> Registration:
    return load_registration(scene.photo, scene.model, scene.start)


@pytest.fixture(scope="module")
def renderer(registration) -> SoftwareRenderer:
    return SoftwareRenderer(registration.mesh)


def request_of(registration, look="outline", **more) -> OverlayRequest:
    pose = registration.start
    return OverlayRequest(registration, SETTINGS, pose, pose, look, **more)


def test_an_outline_is_drawn_quickly_then_finely(registration, renderer):
    quick, fine = OverlayDrawer(renderer).draw(request_of(registration))
    assert len(quick.outline) > 10
    assert quick.picture is None
    assert fine.picture is not None
    assert fine.unexplained == quick.unexplained
    left, top, width, height = fine.place
    assert fine.picture.shape[2] == 4
    assert fine.picture.shape[1] / fine.picture.shape[0] == pytest.approx(width / height)
    # Both go round the model: within a pixel of the box of its vertices.
    seen = registration.start.project(registration.mesh.vertices)
    for overlay in (quick, fine):
        points = overlay.outline.reshape(-1, 2)
        assert points.min(axis=0) == pytest.approx(seen.min(axis=0), abs=1.0)
        assert points.max(axis=0) == pytest.approx(seen.max(axis=0), abs=1.0)
    assert np.all(fine.outline >= [left, top])
    assert np.all(fine.outline <= [left + width, top + height])


def test_a_moving_model_is_drawn_quickly_alone(registration, renderer):
    first, second = OverlayDrawer(renderer).draw(request_of(registration, moving=True))
    assert (first.loss_is_current, second.loss_is_current) == (False, True)
    assert second.unexplained is not None
    for overlay in (first, second):
        assert overlay.picture is None
        assert len(overlay.outline) > 10


def test_the_loss_is_that_of_the_search(registration, renderer):
    problem, _ = make_problem(registration, SETTINGS)
    drawer = OverlayDrawer(renderer)
    for shift in (0.0, 0.05, -0.1):
        parameters = problem.start + shift
        request = replace(request_of(registration, "none"), pose=problem.chart.to_pose(parameters))
        (overlay,) = drawer.draw(request)
        wanted = pose_loss(problem, renderer, parameters)
        assert overlay.unexplained is not None
        assert overlay.unexplained.loss == pytest.approx(wanted, rel=1e-12)
        assert overlay.start_loss == pytest.approx(pose_loss(problem, renderer, problem.start))


def test_the_compared_pixels_stay_with_the_anchor_and_go_with_the_settings(registration, renderer):
    drawer = OverlayDrawer(renderer)
    request = request_of(registration, "none")

    def loss(asked: OverlayRequest) -> float:
        (overlay,) = drawer.draw(asked)
        assert overlay.unexplained is not None
        return overlay.unexplained.loss

    other = replace(request, settings=replace(SETTINGS, region=(40, 30, 80, 60)))
    for asked in (request, other, request):
        fresh = next(iter(OverlayDrawer(renderer).draw(asked))).unexplained
        assert fresh is not None
        assert loss(asked) == fresh.loss
    assert loss(request) != loss(other)


def test_why_there_is_no_loss_is_told(registration, renderer):
    settings = replace(SETTINGS, region=(0, 0, 2, 2))
    request = replace(request_of(registration), settings=settings)
    for overlay in OverlayDrawer(renderer).draw(request):
        assert overlay.unexplained is None
        assert len(overlay.note) > 20
        assert len(overlay.outline) > 10


@pytest.mark.parametrize("look", ["solid", "relit", "residual"])
def test_pictures_cover_the_photo(registration, renderer, look):
    (overlay,) = OverlayDrawer(renderer).draw(request_of(registration, look))
    assert overlay.picture is not None
    assert overlay.picture.shape[:2] == (120, 160)
    assert overlay.place == (0.0, 0.0, 160.0, 120.0)
    photo = registration.photo.as_rgb8(160, 120)
    assert np.any(overlay.picture[..., :3] != photo)


def test_a_search_ends_where_a_fit_ends(registration, renderer):
    problem, _ = make_problem(registration, SETTINGS)
    *_, last = fit_pose(problem, renderer)
    pose = registration.start
    updates = list(search(registration, pose, SETTINGS, renderer))
    assert np.array_equal(updates[-1].progress.parameters, last.parameters)
    assert updates[-1].progress.loss == last.loss
    assert updates[-1].progress.status is last.status
    counts = [item.progress.evaluations for item in updates]
    assert counts == sorted(counts)
    assert counts[0] == 1
    assert counts[-1] == 150


def test_a_search_starts_at_the_pose_at_hand(registration, renderer):
    problem, _ = make_problem(registration, SETTINGS)
    pose = problem.chart.to_pose(problem.start + 0.03)
    first = next(iter(search(registration, pose, SETTINGS, renderer)))
    assert first.progress.pose.project(registration.mesh.vertices) == pytest.approx(
        pose.project(registration.mesh.vertices), abs=1e-9
    )


def test_improvements_are_each_better_than_the_last(registration, renderer):
    updates = list(search(registration, registration.start, SETTINGS, renderer))
    losses = [step.loss for step in updates[-1].improvements]
    assert losses == sorted(losses, reverse=True)
    assert len(set(losses)) == len(losses) > 2
    assert losses[0] == updates[0].progress.loss
    assert losses[-1] == updates[-1].progress.loss
    for item in updates:
        assert item.improvements[-1].loss == item.progress.loss


@pytest.mark.parametrize("lock", [(), ("rotation_x", "shift_y", "log_depth", "rotation_z")])
def test_maps_become_known_until_they_are_complete(registration, renderer, lock):
    settings = replace(SETTINGS, lock=lock)
    pose = registration.start
    case = case_at(registration, pose, settings, renderer)
    problem = case.problem
    with RendererPool(renderer) as pool:
        updates = list(maps(case, Document(registration, pose), pool, 0.2, 5))
    known = [sum(int(np.isfinite(s.losses).sum()) for s in item.slices) for item in updates]
    assert known == sorted(known)
    assert 0 < known[0] < known[-1]
    pairs = [(piece.first, piece.second) for piece in updates[-1].slices]
    assert sorted(pairs) == sorted(free_pairs(problem))
    assert all(piece.complete for piece in updates[-1].slices)
    # In the middle of each: the loss of the pose itself.
    loss = pose_loss(problem, renderer, problem.start.copy())
    for piece in updates[-1].slices:
        assert piece.losses[2, 2] == pytest.approx(loss, rel=1e-9)
        assert math.isclose(piece.first_values[2], problem.start[piece.first], abs_tol=1e-12)


def test_restarts_are_told_where_they_begin(registration, renderer):
    settings = FitSettings("paper", limits=Limits(evaluations=900))
    *_, last = search(registration, registration.start, settings, renderer)
    begun = last.restarts
    assert [step.restart for step in begun] == list(range(1, last.progress.restart + 1))
    counts = [step.evaluations for step in begun]
    assert counts == sorted(counts)
    assert len(counts) > 1


@pytest.mark.parametrize("pixels", ["clip", "whole"])
def test_the_papers_loss_is_drawn_as_it_is_searched(registration, renderer, pixels):
    settings = FitSettings("paper", pixels=pixels)
    problem, _ = make_problem(registration, settings)
    (overlay,) = OverlayDrawer(renderer).draw(
        replace(request_of(registration, "none"), settings=settings)
    )
    assert overlay.unexplained is not None
    loss = overlay.unexplained.loss
    assert loss == pytest.approx(pose_loss(problem, renderer, problem.start.copy()))
    assert 0.0 < loss <= 1.0


def test_two_losses_are_mapped_about_one_pose(registration, renderer):
    session = Session(Document(registration, registration.start, SETTINGS))
    session = update(session, c.ChangeLandscape(whose="both"))
    job = MapJob.wanted(session, moving=True)
    found = list(MapMaker(renderer).run(job))
    assert all(len(item) == 2 for item in found)  # none is shown without the other
    ours, paper = found[-1]
    assert (ours.case.settings, paper.case.settings) == session.mapped
    assert ours.case.problem.chart.names == paper.case.problem.chart.names
    for one, other in zip(ours.slices, paper.slices, strict=True):
        assert one.complete
        assert other.complete
        assert np.array_equal(one.first_values, other.first_values)
        assert np.array_equal(one.second_values, other.second_values)
        assert other.losses.max() <= 1.0 < one.losses.max()
    other = replace(session, maps=replace(session.maps, whose="paper"))
    assert MapJob.wanted(other, moving=True).replaces(job, busy=True)
