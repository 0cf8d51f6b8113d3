"""What runs beside the session gives what the command line gives, piece by piece."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from poseviewer.app.state.document import Document
from poseviewer.app.state.edits import set_fields, update
from poseviewer.app.state.pose_edits import make_start, nudge
from poseviewer.app.state.results import Landscape, LossReading, SearchRequest
from poseviewer.app.state.session import Display, Session
from poseviewer.app.workers.jobs import renderer_of, run_search
from poseviewer.app.workers.maps import MapMaker, refine_maps, serves
from poseviewer.app.workers.overlay import LossReader, OverlayDrawer, draw_fine_lines
from poseviewer.errors import SettingsError
from poseviewer.fit.problem import make_problem, pose_loss
from poseviewer.fit.progress import SearchProgress
from poseviewer.fit.stages import fit_pose
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.gpu.gpu_renderer import GpuRenderer
from poseviewer.render.pool import RendererPool
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.settings import FitSettings, Limits
from tests.app.state.documents import after, held, open_files
from tests.app.state.sets import document_of
from tests.renderers import require_gpu
from tests.several import TRUTH

SETTINGS = FitSettings(limits=Limits(evaluations=150))


@pytest.fixture(scope="module")
def document(scene) -> Document:
    return compared_by(open_files(scene.photo, scene.model, scene.start), SETTINGS)


@pytest.fixture(scope="module")
def renderer(document) -> SoftwareRenderer:
    return SoftwareRenderer(document.mesh)


def compared_by(document: Document, settings: FitSettings) -> Document:
    return document.with_object(settings=settings)


def searched(document: Document) -> list[SearchProgress]:
    """All updates of a search from where the model is, but for the last word."""
    *updates, _ = run_search(SearchRequest(document, (document.settings,), (0,)))
    return updates


def losses_of(document: Document, renderer: SoftwareRenderer) -> LossReading:
    return LossReader(renderer).read(Session(document))


def test_both_drawings_go_round_the_model(document, renderer):
    request = Session(document)
    quick, fine = OverlayDrawer(renderer).draw(request), draw_fine_lines(request, renderer)
    assert quick.picture is fine.picture is None
    # Within a pixel of the box of its vertices.
    seen = document.pose.project(document.mesh.vertices)
    for overlay in (quick, fine):
        points = overlay.outline.reshape(-1, 2)
        assert points.min(axis=0) == pytest.approx(seen.min(axis=0), abs=1.0)
        assert points.max(axis=0) == pytest.approx(seen.max(axis=0), abs=1.0)


@pytest.mark.parametrize("settings", [SETTINGS, FitSettings("paper", pixels="whole")])
def test_the_loss_is_that_of_the_search(document, renderer, settings):
    document = compared_by(document, settings)
    problem, _ = make_problem(document.scene)
    reader = LossReader(renderer)
    for shift in (0.0, 0.05, -0.1):
        there = document.at_params(problem, problem.start + shift)
        moving = held(Session(there, anchor=document.scene, display=Display("none")))
        losses = reader.read(moving)
        assert losses.mean is not None
        wanted = pose_loss(problem, renderer, problem.start + shift)
        assert losses.mean.loss == pytest.approx(wanted, rel=1e-12)
        assert losses.start == pytest.approx(pose_loss(problem, renderer, problem.start))


def test_the_compared_pixels_stay_with_the_anchor_and_go_with_the_settings(document, renderer):
    reader = LossReader(renderer)
    request = Session(document)
    other = Session(document.with_in_view(region=Rectangle(40, 30, 80, 60)))
    read = [reader.read(asked).mean for asked in (request, other, request)]
    fresh = [losses_of(asked.document, renderer).mean for asked in (request, other, request)]
    losses = [None if mean is None else mean.loss for mean in read]
    assert losses == [None if mean is None else mean.loss for mean in fresh]
    assert losses[0] == losses[2] != losses[1]


def test_the_start_is_the_start_pose_wherever_the_pixels_are_about(document, renderer):
    session, reader = Session(document), LossReader(renderer)
    picked = after(session, nudge("move", 9.0))  # as a press on a map, or undo: pixels about it
    losses = reader.read(picked)
    about = replace(picked, document=document, anchor=picked.document.scene)
    at_start = reader.read(held(about)).mean
    assert losses.mean is not None
    assert at_start is not None
    assert losses.start == pytest.approx(at_start.loss) != losses.mean.loss
    started = reader.read(after(picked, make_start()))
    assert started.start == pytest.approx(losses.mean.loss)


def test_why_there_is_no_loss_is_told(document, renderer):
    losses = losses_of(document.with_in_view(region=Rectangle(0, 0, 2, 2)), renderer)
    assert losses.mean is None
    assert len(losses.note) > 20


def test_a_search_ends_where_a_fit_ends(document, renderer):
    problem, _ = make_problem(document.scene)
    *_, last = fit_pose(problem, renderer)
    updates = searched(document)
    assert np.array_equal(updates[-1].progress.parameters, last.parameters)
    assert updates[-1].progress.loss == last.loss
    assert updates[-1].progress.status is last.status
    counts = [item.progress.evaluations for item in updates]
    assert counts == sorted(counts)
    assert (counts[0], counts[-1]) == (1, 150)
    losses = [step.loss for step in updates[-1].improvements]
    assert losses == sorted(set(losses), reverse=True)
    assert (losses[0], losses[-1]) == (updates[0].progress.loss, last.loss)
    assert all(item.improvements[-1].loss == item.progress.loss for item in updates)


@pytest.mark.slow
@pytest.mark.long
def test_a_search_and_its_maps_are_by_the_renderer_of_the_settings(document, monkeypatch):
    require_gpu(monkeypatch)
    judged, moments_at = list[int](), GpuRenderer.moments_at
    monkeypatch.setattr(
        GpuRenderer, "moments_at", lambda *given: judged.append(len(given[1])) or moments_at(*given)
    )
    session = Session(compared_by(document, FitSettings(limits=Limits(10))).with_renderer("gpu"))
    request = SearchRequest(session.document, (session.document.settings,), (0,))
    first = next(iter(run_search(request))).progress
    assert judged
    own = pose_loss(first.problem, renderer_of(document.mesh), first.parameters)
    assert first.loss == pytest.approx(own, abs=1e-3)
    judged.clear()
    next(MapMaker(renderer_of(document.mesh, "gpu")).run(held(session)))
    assert sum(judged) > 15
    with pytest.raises(SettingsError, match=r"no renderer opengl; choose .* Renderer"):
        searched(document.with_renderer("opengl"))


def test_what_stands_wholly_behind_another_is_said():
    front, place = TRUTH[1].pose, TRUTH[1].pose.camera_from_model
    far = replace(place, translation=3.0 * place.translation)
    hidden = document_of([replace(front, camera_from_model=far), front]).with_object(1, locked=True)
    with pytest.raises(SettingsError, match="stands wholly behind other objects"):
        searched(hidden)


@pytest.mark.parametrize("lock", [(), ("rotation_x", "shift_y", "log_depth", "rotation_z")])
def test_maps_become_known_until_they_are_complete(document, renderer, lock):
    settings = replace(SETTINGS, lock=lock)
    problem, _ = make_problem(compared_by(document, settings).scene)
    about = Landscape(document, problem, document.pose, problem.start, 0.2)
    with RendererPool(renderer) as pool:
        updates = list(refine_maps(about, problem, pool, 5))
    known = [sum(int(np.isfinite(s.losses).sum()) for s in item.slices) for item in updates]
    assert known == sorted(known)
    assert 0 < known[0] < known[-1]
    pairs = [(piece.first, piece.second) for piece in updates[-1].slices]
    assert sorted(pairs) == [*combinations(problem.free_indices.tolist(), 2)]
    assert all(np.isfinite(piece.losses).all() for piece in updates[-1].slices)
    # In the middle of each: the loss of the pose itself.
    loss = pose_loss(problem, renderer, problem.start.copy())
    for piece in updates[-1].slices:
        assert piece.losses[2, 2] == pytest.approx(loss, rel=1e-9)
        assert math.isclose(piece.first_values[2], problem.start[piece.first], abs_tol=1e-12)


def test_restarts_are_told_where_they_begin(document):
    settings = FitSettings("paper", limits=Limits(evaluations=900))
    last = searched(compared_by(document, settings))[-1]
    begun = last.restarts
    assert [step.restart for step in begun] == list(range(1, last.progress.restart + 1))
    counts = [step.evaluations for step in begun]
    assert counts == sorted(counts)
    assert len(counts) > 1


def test_two_losses_are_mapped_about_one_pose(document, renderer):
    session = Session(document)
    session = update(session, set_fields("display", mapped_loss="all"))
    moving = held(session)
    found = list(MapMaker(renderer).run(moving))
    assert all(len(item) == 2 for item in found)  # none is shown without the other
    ours, paper = found[-1]
    assert (ours.problem.settings, paper.problem.settings) == session.mapped
    assert ours.problem.chart.names == paper.problem.chart.names
    for one, other in zip(ours.slices, paper.slices, strict=True):
        assert np.isfinite([one.losses, other.losses]).all()
        assert np.array_equal(one.first_values, other.first_values)
        assert np.array_equal(one.second_values, other.second_values)
        assert other.losses.max() <= 1.0 < one.losses.max()
    assert not serves(moving, after(moving, set_fields("display", mapped_loss="paper")), busy=True)
