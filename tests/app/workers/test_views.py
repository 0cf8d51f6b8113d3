"""The photos of a set through the app's workers: opened, drawn, mapped, searched, saved, kept."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.state.hiding import Stroke, paint
from poseviewer.app.state.objects import add_object, compare_view, pick_object, show_view
from poseviewer.app.state.results import LossReading, Results
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import pose_file_view, scene_to_save
from poseviewer.app.workers.jobs import run_search
from poseviewer.app.workers.maps import MapMaker
from poseviewer.app.workers.opening import open_autosaved, open_pose, open_sources
from poseviewer.app.workers.overlay import LossReader
from poseviewer.app.workers.saving import Autosaver
from poseviewer.errors import SettingsError
from poseviewer.files.pose import PoseRecord
from poseviewer.files.scene_json import as_saved, pose_json
from poseviewer.files.state.session_file import load_autosave
from poseviewer.geometry.pose_error import pose_error
from poseviewer.opening.sources import Sources
from poseviewer.render.software.software_renderer import SoftwareRenderer
from tests.app.state import edits as c
from tests.app.state.documents import after, asked_of, assert_same_pose, held
from tests.view_sets import MESH, NAMES, TRUTH, write_views

STROKE = Stroke("brush", np.array([[300.0, 20.0], [310.0, 30.0]]), 8.0)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    return write_views(tmp_path_factory.mktemp("set"))


@pytest.fixture
def session(files: tuple[Path, Path, Path]) -> Session:
    document = open_sources(Sources(views=files[0], model=files[1], start=files[2]))
    return Session(document, anchor=document.scene, saved=document)


def saved_record(session: Session) -> PoseRecord:
    document = session.document
    return pose_json(as_saved(scene_to_save(session)), document.active, pose_file_view(document))


def losses_of(session: Session) -> LossReading:
    return LossReader(SoftwareRenderer(session.document.mesh)).read(session)


def test_the_loss_is_the_mean_over_the_photos_that_are_compared(session: Session):
    losses = losses_of(session)
    assert losses.mean is not None
    assert set(losses.by_view) == {0, 1, 2}
    by_view = [one.loss for one in losses.by_view.values()]
    assert losses.mean.loss == pytest.approx(np.mean(by_view))
    left = losses_of(after(session, compare_view(2, False))).mean
    assert left is not None
    assert left.loss == pytest.approx(np.mean(by_view[:2]))
    # It is the same, whichever photo is large.
    other = losses_of(after(session, show_view(1)))
    assert other.by_view[0].loss == pytest.approx(by_view[0], abs=1e-6)


@pytest.mark.slow
def test_maps_are_of_the_mean_loss_and_a_press_moves_all(session: Session):
    maker = MapMaker(SoftwareRenderer(session.document.mesh))
    *_, (latest,) = maker.run(held(session))
    assert len(latest.problem.views) == 3
    mapped = replace(session, results=Results(landscapes=(latest,)))
    picked = after(mapped, c.pick_in_landscape(0, 3, 1.0, 0.5))
    np.testing.assert_allclose(picked.document.parameters, [0.2, 0, 0, 0, 0, 0], atol=1e-9)
    assert picked.document.scene.pose(0, 2) is not session.document.scene.pose(0, 2)


@pytest.mark.slow
@pytest.mark.long
def test_a_search_finds_the_pose_in_all_photos_and_says_of_each(session: Session):
    asked = after(session, c.start_search())
    request = asked_of(asked)
    for update in run_search(request):
        # Another photo may be looked at meanwhile.
        asked = after(
            asked, c.search_advanced(request, update), show_view(update.progress.evaluations % 3)
        )
    result = asked.document.object.result
    assert result is not None
    assert result.verdict is not None
    assert result.verdict.label == "found"
    # One photo alone may leave another pose open.
    assert "lost" not in [one.label for one in result.verdict.views]
    for index in range(3):
        seen = after(asked, show_view(index))
        assert pose_error(MESH, seen.document.pose, TRUTH[index]).percent < 1.0
        sure = seen.covariance_in(index)
        assert sure is not None
        own, its = sure.pose.camera_from_model, seen.document.pose.camera_from_model
        np.testing.assert_allclose(own.translation, its.translation, atol=1e-9)
    # A pose file says it of the photo that the search began in.
    record = saved_record(after(asked, show_view(2)))
    assert record.photo is not None
    assert record.photo.file == "a.png"
    assert record.verdict is not None


def test_a_pose_file_opens_in_its_photo_of_the_set(session: Session, files):
    looked = after(session, show_view(2), c.nudge("move", 30.0))
    opened = open_pose(looked.document, files[2])
    assert opened.photo.name == "a.png"
    for index in range(3):
        own, its = (one.scene.pose(0, index) for one in (opened, session.document))
        assert_same_pose(own, its, 1e-6)


def test_a_set_opens_without_a_pose_and_waits_for_a_press(files):
    document = open_sources(Sources(views=files[0], model=files[1]))
    assert not document.object.is_placed
    placed = after(Session(document), c.press(100.0, 80.0), c.release())
    assert placed.document.object.is_placed


def test_a_model_that_no_photo_shows_is_said(session: Session):
    away = after(session, c.nudge("move", 3000.0))
    asked = after(away, c.start_search())
    assert asked.search is not None
    with pytest.raises(SettingsError, match="bring the start onto the photo"):
        next(iter(run_search(asked_of(asked))))


def test_objects_in_several_photos_come_back_from_scene_and_session(
    session: Session, tmp_path: Path
):
    added = after(
        session, add_object(), c.press(250.0, 60.0), c.release(), show_view(1), paint(STROKE)
    )
    changed = after(added, pick_object(1), compare_view(2, False), c.nudge("roll", 3.0))
    saver = Autosaver(tmp_path)
    (path,) = saver.save(changed)
    assert path.name == "b.scene.json"
    saver.close(changed)
    (kept,) = (tmp_path / "sessions").iterdir()
    restored, scene = open_autosaved(load_autosave(kept)), changed.document.scene
    assert (restored.view_index, restored.active) == (1, 0)
    for again, tolerance in (
        (open_sources(Sources(scene=path)).scene, 1e-6),
        (restored.scene, 0.0),
    ):
        assert [view.name for view in again.views] == list(NAMES)
        for index, view in product(range(2), range(3)):
            assert_same_pose(again.pose(index, view), scene.pose(index, view), tolerance)
            own, its = again.in_view(index, view), scene.in_view(index, view)
            assert own.is_compared == its.is_compared
            masks = again.masks(index, view), scene.masks(index, view)
            assert len(masks[1]) == (view == 1)
            for mask, other in zip(*masks, strict=True):
                np.testing.assert_array_equal(mask.weights, other.weights)
