"""The photos of a set through the app's workers: opened, drawn, mapped, searched, saved, kept."""

from __future__ import annotations

import json
from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer.api import load_views
from poseviewer.app.state import commands as c
from poseviewer.app.state.hiding import Paint, Stroke
from poseviewer.app.state.objects import ComparePhoto, LookAt
from poseviewer.app.state.session import Overlay, OverlayRequest, Session
from poseviewer.app.workers.autosaving import Autosaver
from poseviewer.app.workers.exporting import record_of
from poseviewer.app.workers.jobs import run_search
from poseviewer.app.workers.maps import MapJob, MapMaker
from poseviewer.app.workers.opening import open_pose, open_set, restore
from poseviewer.app.workers.overlay import OverlayDrawer
from poseviewer.errors import PoseViewerError, SettingsError
from poseviewer.files.state.autosave import load_autosave
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.software.renderer import SoftwareRenderer
from tests.app.state.documents import after
from tests.app.state.sets import set_of
from tests.view_sets import MESH, TRUTH, write_views

STROKE = Stroke("brush", np.array([[300.0, 20.0], [310.0, 30.0]]), 8.0)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    return write_views(tmp_path_factory.mktemp("set"))


@pytest.fixture
def session(files: tuple[Path, Path, Path]) -> Session:
    document = open_set(*files).document
    return Session(document, anchor=document.pose, saved=document)


def drawn(session: Session) -> Overlay:
    document = session.document
    drawer = OverlayDrawer(SoftwareRenderer(document.registration.mesh))
    request = OverlayRequest(
        document.registration,
        document.settings,
        document.pose,
        document.pose,
        "outline",
        moving=True,
        document=document,
    )
    return deque(drawer.draw(request), maxlen=1)[0]


def test_the_loss_is_the_mean_over_the_photos_that_are_compared(session: Session):
    overlay = drawn(session)
    assert overlay.unexplained is not None
    assert set(overlay.of_photos) == {0, 1, 2}
    losses = [one.loss for one in overlay.of_photos.values()]
    assert overlay.unexplained.loss == pytest.approx(np.mean(losses))
    left = drawn(after(session, ComparePhoto(2, False)))
    assert left.unexplained is not None
    assert left.unexplained.loss == pytest.approx(np.mean(losses[:2]))
    # It is the same, whichever photo is large.
    other = drawn(after(session, LookAt(1)))
    assert other.of_photos[0].loss == pytest.approx(losses[0], abs=1e-6)


@pytest.mark.slow
def test_maps_are_of_the_mean_loss_and_a_press_moves_all(session: Session):
    maker = MapMaker(SoftwareRenderer(session.document.registration.mesh))
    job = MapJob.wanted(session, moving=True)
    *_, (latest,) = maker.run(job)
    assert len(latest.case.problem.others) == 2
    mapped = replace(session, landscapes=(latest,))
    picked = after(mapped, c.PickInLandscape(0, 3, 1.0, 0.5))
    np.testing.assert_allclose(picked.document.parameters, [0.2, 0, 0, 0, 0, 0], atol=1e-9)
    assert set_of(picked).poses[2] is not set_of(session).poses[2]


@pytest.mark.slow
def test_a_search_finds_the_pose_in_all_photos_and_says_of_each(session: Session):
    asked = after(session, c.StartSearch())
    assert asked.search is not None
    for update in run_search(asked.search):
        # Another photo may be looked at meanwhile.
        asked = after(asked, c.SearchAdvanced(1, update), LookAt(update.progress.evaluations % 3))
    for pose, truth in zip(set_of(asked).poses, TRUTH, strict=True):
        assert pose_error(MESH, pose, truth).percent < 1.0
    for index in range(3):
        seen = after(asked, LookAt(index))
        assert seen.document.verdict == "found"
        assert seen.covariance is not None
        own, its = seen.covariance.pose.camera_from_model, seen.document.pose.camera_from_model
        np.testing.assert_allclose(own.translation, its.translation, atol=1e-9)
        end = seen.document.own_of_photos[index].end
        assert end is not None
        assert end.alone == "found"
    # What is saved is what the command line writes: of the photo that the search began in.
    record = record_of(after(asked, LookAt(2)))
    assert record.photo is not None
    assert record.photo.file == "a.png"
    assert record.in_set is not None
    assert [one["name"] for one in record.in_set["views"]] == ["a.png", "b.png", "c.png"]


def test_a_pose_of_no_search_is_saved_with_its_set(session: Session):
    record = record_of(after(session, LookAt(1), ComparePhoto(0, False)))
    assert record.photo is not None
    assert record.photo.file == "b.png"
    assert record.in_set is not None
    assert [one["name"] for one in record.in_set["views"]] == ["b.png", "c.png"]


def test_a_session_on_a_set_is_kept_to_the_last_digit(session: Session, tmp_path: Path):
    changed = after(session, Paint(STROKE), ComparePhoto(2, False), LookAt(1), c.Nudge("roll", 3.0))
    document = changed.document
    Autosaver(tmp_path).close(changed)
    (path,) = (tmp_path / "sessions").iterdir()
    again = next(iter(restore(load_autosave(path)))).document
    before, now = document.views, again.views
    assert before is not None
    assert now is not None
    assert (now.at, now.compared, now.scale) == (before.at, before.compared, before.scale)
    np.testing.assert_array_equal(
        again.pose.camera_from_model.rotation, document.pose.camera_from_model.rotation
    )
    masks = [own.mask for own in again.own_of_photos]
    assert masks[1] is masks[2] is None
    painted = document.own_of_photos[0].mask
    assert masks[0] is not None
    assert painted is not None
    np.testing.assert_array_equal(masks[0].weights, painted.weights)


def test_a_pose_file_opens_in_its_photo_of_the_set(session: Session, files):
    looked = after(session, LookAt(2), c.Nudge("move", 30.0))
    (opened,) = open_pose(looked.document, files[2])
    assert opened.document.registration.photo.name == "a.png"
    assert opened.document.views is not None
    for own, its in zip(opened.document.views.poses, set_of(session).poses, strict=True):
        np.testing.assert_allclose(
            own.camera_from_model.translation, its.camera_from_model.translation, atol=1e-6
        )


def test_a_set_opens_without_a_pose_and_waits_for_a_press(files):
    document = open_set(files[0], files[1], None).document
    assert document.awaits_place
    placed = after(Session(document), c.Press(100.0, 80.0), c.Release())
    assert not placed.document.awaits_place


def test_fewer_than_two_photos_that_see_the_model_are_said(session: Session):
    away = after(session, c.Nudge("move", 3000.0))
    asked = after(away, c.StartSearch())
    assert asked.search is not None
    with pytest.raises(SettingsError, match="of 3 photos"):
        next(iter(run_search(asked.search)))


def one_photo(data: dict) -> None:
    del data["views"][1:]


def one_twice(data: dict) -> None:
    data["views"][2]["photo"] = "a.png"


@pytest.mark.parametrize(
    ("change", "said"),
    [(one_photo, "1 photo; a set has two or more"), (one_twice, "one photo twice")],
)
def test_a_set_that_cannot_be_used_is_one_sentence(tmp_path: Path, change, said: str):
    of_set, model, start = write_views(tmp_path)
    data = json.loads(of_set.read_text())
    change(data)
    of_set.write_text(json.dumps(data))
    with pytest.raises(PoseViewerError, match=said) as caught:
        open_set(of_set, model, start)
    assert "\n" not in str(caught.value)


def test_masks_of_all_photos_are_saved_with_the_pose_and_opened_again(
    session: Session, files: tuple[Path, Path, Path], tmp_path: Path
):
    painted = after(session, Paint(STROKE), LookAt(1), Paint(STROKE))
    saver = Autosaver(tmp_path)
    path = saver.save_pose(painted, record_of(painted))
    assert path.name == "b.pose.json"
    assert path.with_name("b.a.mask.png").is_file()
    again = open_set(files[0], files[1], path).document
    masks = [own.mask for own in again.own_of_photos]
    assert masks[2] is None
    stroke = painted.document.registration.mask
    assert stroke is not None
    for own in masks[:2]:
        assert own is not None
        np.testing.assert_array_equal(own.weights, stroke.weights)
    (opened,) = open_pose(session.document, path)
    assert [own.mask is None for own in opened.document.own_of_photos] == [False, False, True]
    case = load_views(*files[:2], path)
    assert [one.mask is None for one in case.registration.registrations] == [False, False, True]
    saver.close(painted)
