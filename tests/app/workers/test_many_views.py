"""A scene of many views through the app: stepped through, dragged, compared, saved, exported."""

import json
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from poseviewer.app.page.time_line import time_line
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.frame_edits import go_to_frame, step_frame
from poseviewer.app.state.objects import compare_view, set_unit
from poseviewer.app.state.results import LossReading, Results
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import export
from poseviewer.app.workers.maps import MapMaker
from poseviewer.app.workers.opening import open_autosaved, open_sources
from poseviewer.app.workers.outlines import OutlineRequest
from poseviewer.app.workers.overlay import LossReader
from poseviewer.app.workers.saving import Autosaver
from poseviewer.app.workers.tasks import paint_active
from poseviewer.app.workers.tracking import frame_reading
from poseviewer.app.workers.worker import Mailbox
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import SettingsError
from poseviewer.files.formats.bop import load_bop_images
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.photo import load_photo
from poseviewer.files.scene_json import load_scene
from poseviewer.files.state.session_file import load_autosave
from poseviewer.fit.visibility import visibility
from poseviewer.geometry.transform import RigidTransform, Similarity
from poseviewer.opening.photo_sets import load_views
from poseviewer.opening.sources import Sources
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.types import MANY_VIEWS, SearchResult
from tests.app.state import edits as c
from tests.app.state.documents import after, held
from tests.many_views import BALL, BOX, COUNT, NAMES, camera_from_world, write_two_in_many


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_two_in_many(tmp_path_factory.mktemp("many"))


@pytest.fixture
def session(file: Path) -> Session:
    document = open_sources(Sources(scene=file))
    return Session(document, anchor=document.scene, saved=document)


def shown(session: Session) -> Session:
    """The session once the worker has read the wanted photo."""
    worker = frame_reading()
    worker.mailbox = Mailbox[Edit]()
    while session.wanted_frame is not None:
        worker.follow(session)
        session = after(session, *worker.mailbox.take(1.0))
    worker.close()
    return session


def with_losses(session: Session, losses: LossReading) -> Session:
    return replace(session, results=Results(losses=losses))


def read_in(session: Session) -> list[int]:
    """Views whose photos are in memory."""
    views = enumerate(session.document.scene.views)
    return [index for index, view in views if "photo" in vars(view.file)]


def test_stepping_shows_one_photo_after_the_other_and_keeps_one(session: Session):
    assert session.document.photo.name == NAMES[0]
    for index in range(1, 5):
        session = shown(after(session, step_frame(1)))
        assert session.document.photo.name == NAMES[index]
        assert read_in(session) == [index]
    session = shown(after(session, go_to_frame((COUNT - 0.5) / COUNT), step_frame(1)))
    assert session.document.view_index == COUNT - 1
    assert (session.history.past, session.is_unsaved) == ((), False)
    # Of a step of undo no photo is kept either.
    moved = after(session, c.nudge("move", 3.0))
    (before,) = moved.history.past
    assert not any("photo" in vars(view.file) for view in before.scene.views)
    assert after(moved, c.undo()).document.photo.name == NAMES[-1]


def test_a_drag_in_one_photo_moves_the_model_in_all(session: Session):
    away = shown(after(session, step_frame(5)))
    x, y = away.document.pose.project(BALL.centre)
    dragged = after(away, c.press(x, y), c.drag_to(x + 9.0, y - 4.0))
    # While the button is down, too: each photo shows it once it is stepped to.
    scene, before = dragged.document.scene, away.document.scene
    np.testing.assert_allclose(scene.pose(0, 5).project(BALL.centre), [x + 9.0, y - 4.0], atol=1e-6)
    for view in (0, 9, COUNT - 1):
        there = [one.pose(0, view).project(BALL.centre) for one in (before, scene)]
        assert np.linalg.norm(there[1] - there[0]) > 3.0
    assert after(dragged, c.release()).document.scene.pose(1, 2) == before.pose(1, 2)


def test_loss_and_maps_are_those_of_the_shown_photo(session: Session):
    reader = LossReader(SoftwareRenderer(session.document.mesh))
    first = reader.read(session)
    assert list(first.by_view) == [0]
    # The photo that is read next is named before it is there.
    stepping = time_line(with_losses(after(session, step_frame(7)), first))
    assert NAMES[7] in stepping
    assert "not seen" not in stepping
    session = shown(after(session, step_frame(7)))
    second = reader.read(session)
    assert list(second.by_view) == [7]
    assert second.mean is not None
    assert "0." in time_line(with_losses(session, second))
    # What is known of the photo before is not said of this one.
    assert "not seen" not in time_line(with_losses(session, first))
    (landscape,) = next(iter(MapMaker(SoftwareRenderer(session.document.mesh)).run(held(session))))
    assert [view.view_index for view in landscape.problem.views] == [7]
    assert read_in(session) == [7]
    assert OutlineRequest.of(session).small == ()


def test_the_time_line_has_the_verdicts_of_the_views_that_a_search_compared(session: Session):
    alone = Verdict("found", 0.95), Verdict("doubtful", 0.6), Verdict("lost", 0.1)
    seen = tuple(1.0 if view in (2, 5, 9) else None for view in range(COUNT))
    result = SearchResult(verdict=Verdict("found", 0.9, views=alone), seen=seen, view=5)
    found = replace(session, document=session.document.with_object(result=result))
    found = after(found, step_frame(1, between_keys=True))
    assert found.wanted_frame == 2
    drawn = time_line(shown(found))
    # The view of the search comes first in its verdict.
    for label, view in (("found", 5), ("doubtful", 2), ("lost", 9)):
        assert f'class="pv-{label}" d="M{view} 0H{view + 1}V1' in drawn
    assert f"of {COUNT} · {NAMES[2]}" in drawn
    left = after(found, compare_view(4, False))
    assert 'class="pv-off" d="M4 0H5' in time_line(left)
    assert 'class="pv-found" d="M5 0H6' in time_line(left)
    without = after(left, compare_view(5, False))
    assert 'class="pv-off" d="M4 0H6' in time_line(without)
    assert without.document.object.result == result
    assert "not compared" in time_line(shown(after(left, step_frame(4))))
    assert len(time_line(left)) < 1500


def test_a_view_that_looks_away_is_shown_and_not_compared(session: Session):
    scene, turn = session.document.scene, np.diag([-1.0, 1.0, -1.0])
    place = scene.views[3].camera_from_world
    place = RigidTransform(turn @ place.rotation, turn @ place.translation)
    views = list(scene.views)
    views[3] = replace(views[3], camera_from_world=place)
    session = replace(
        session, document=replace(session.document, scene=replace(scene, views=tuple(views)))
    )
    away = shown(after(session, step_frame(3)))
    assert away.document.view_index == 3
    reading = LossReader(SoftwareRenderer(away.document.mesh)).read(away)
    assert reading.note or reading.mean is not None
    assert time_line(away)
    back = shown(after(away, step_frame(1)))
    assert list(LossReader(SoftwareRenderer(back.document.mesh)).read(back).by_view) == [4]


def test_many_views_are_saved_and_restored(session: Session, tmp_path: Path):
    session = shown(after(session, c.nudge("move", 2.0), step_frame(6)))
    saver = Autosaver(tmp_path)
    saver.close(session)
    (kept,) = (tmp_path / "sessions").glob("*.json")
    restored = open_autosaved(load_autosave(kept))
    assert (restored.view_index, restored.photo.name) == (6, NAMES[6])
    assert read_in(Session(restored)) == [6]
    (path,) = saver.save(session)
    scene = load_scene(path)
    for index in range(2):
        own, its = (one.objects[index].world_from_model for one in (scene, session.document.scene))
        np.testing.assert_allclose(own.rigid.translation, its.rigid.translation)


@pytest.mark.parametrize("several", [True, False])
def test_bop_has_every_object_in_every_photo_and_is_read_again(session, tmp_path, several):
    document = session.document
    if not several:  # nor do the models say their unit, which the set does
        document = set_unit(None)(session).document.without(1)
    session = replace(session, document=document)
    drawn = list[tuple[float, int]]()
    numbers = ConvertOptions(object_ids=(3, 8)[: 1 + several])
    files = export("bop", session, numbers=numbers, tell=lambda *of: drawn.append(of))
    assert drawn[-1] == (COUNT, COUNT)
    ((name, data),) = files.items()
    assert NAMES[0].partition(".")[0] not in name  # it is of all photos: named after their folder
    ZipFile(BytesIO(data)).extractall(tmp_path)
    folder = next(tmp_path.rglob("scene_gt.json")).parent
    scene, meshes = session.document.scene, (BALL, BOX)[: 1 + several]
    images = load_bop_images(folder)
    assert [image.number for image in images] == list(range(COUNT))
    infos = json.loads((folder / "scene_gt_info.json").read_text())
    for index, image in enumerate(images):
        assert image.camera_from_world is not None
        own = camera_from_world(index)
        np.testing.assert_allclose(image.camera_from_world.translation, 1000.0 * own.translation)
        np.testing.assert_allclose(image.camera_from_world.rotation, own.rotation, atol=1e-12)
        assert [item.object_id for item in image.objects] == [3, 8][: 1 + several]
        shown_models = visibility([scene.model_at(i, index) for i in range(len(meshes))])
        for number, item in enumerate(image.objects):
            place = scene.pose(number, index).camera_from_model
            moved = item.camera_from_model
            np.testing.assert_allclose(moved.translation, 1000.0 * place.translation)
            masks = shown_models.silhouettes[number], shown_models.mask(number)
            for kind, mask in zip(("mask", "mask_visib"), masks, strict=True):
                picture = load_photo(folder / kind / f"{index:06d}_{number:06d}.png").pixels
                assert np.array_equal(picture[..., 0], 255 * mask.astype(np.uint8))
            info, y_x = infos[str(index)][number], np.nonzero(masks[1])
            left, top = (int(own.min()) for own in y_x[::-1])
            assert info["bbox_visib"][:2] == [left, top]
            assert info["px_count_visib"] == np.count_nonzero(masks[1])
            assert info["visib_fract"] == pytest.approx(masks[1].sum() / info["px_count_all"])
    again = load_views(folder)
    assert again.unit == "mm"
    for view, known in zip(again.views, scene.views, strict=True):
        assert np.array_equal(view.photo.pixels, known.photo.pixels)
        ours, its = (
            one.pose(Similarity(place, size)).project(BALL.vertices)
            for one, place, size in (
                (known, scene.objects[0].world_from_model.rigid, 1.0),
                (view, _in_mm(scene.objects[0].world_from_model.rigid), 1000.0),
            )
        )
        np.testing.assert_allclose(ours, its, atol=1e-6)


def _in_mm(place: RigidTransform) -> RigidTransform:
    return RigidTransform(place.rotation, 1000.0 * place.translation)


@pytest.mark.parametrize("what", ["colmap", "nerfstudio"])
def test_cameras_of_many_views_are_a_set_again(session: Session, tmp_path: Path, what: str):
    ((name, data),) = export(what, session).items()
    (tmp_path / name).write_bytes(data)
    if name.endswith(".zip"):
        ZipFile(tmp_path / name).extractall(tmp_path)
        lines = next(tmp_path.rglob("images.txt")).read_text().splitlines()[::2]
        assert [line.split()[-1] for line in lines] == [*NAMES]
    else:
        frames = json.loads(data)["frames"]
        assert [Path(frame["file_path"]).name for frame in frames] == [*NAMES]


def test_a_stopped_export_leaves_nothing(session: Session):
    def stop(done: float, _: int) -> None:
        if done == 3:
            raise SettingsError("stopped")

    with pytest.raises(SettingsError, match="stopped"):
        export("bop", session, numbers=ConvertOptions(object_ids=(1, 2)), tell=stop)


@pytest.mark.slow
def test_a_model_is_painted_from_some_of_many_photos_which_are_not_kept(session: Session):
    document = session.document.with_view(4)
    session = replace(session, document=document)
    result = paint_active().run(session, Path(), lambda *_: None)
    (note,) = result.notes
    assert f"from {MANY_VIEWS} photos" in note
    assert read_in(session) in ([], [4])
