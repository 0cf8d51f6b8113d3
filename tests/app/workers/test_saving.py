"""Names of saved poses, and what becomes of files that are there already."""

from dataclasses import replace
from errno import EROFS
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest

from poseviewer.app.state.pose_edits import nudge
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import export
from poseviewer.app.workers.opening import open_pose
from poseviewer.app.workers.saving import Autosaver
from poseviewer.errors import PoseFileError
from poseviewer.files.keypoints import is_equal, keypoints_path
from poseviewer.files.pose import load_pose
from poseviewer.opening.uploads import keep_set, pack
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints
from tests.app.state.documents import after, make_keypoints, open_files
from tests.scene import Scene, make_scene


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    (tmp_path / "photos").mkdir()
    return make_scene(tmp_path / "photos")


@pytest.fixture
def session(scene: Scene) -> Session:
    return Session(open_files(scene.photo, scene.model, scene.start))


@pytest.fixture
def saver(tmp_path: Path) -> Autosaver:
    return Autosaver(tmp_path / "state")


def test_models_on_one_photo_have_files_of_their_own(scene, session, saver):
    other = scene.model.rename(scene.model.with_name("other.ply"))
    second = Session(open_files(scene.photo, other, scene.start))
    names = [saver.save(each)[0].name for each in (session, second)]
    assert names == ["p.m.pose.json", "p.other.pose.json"]
    assert next(iter(export("pose", session))) == names[0]  # as it is downloaded


@pytest.mark.parametrize("name", ["p.m.pose.json", "p.m.mask.png"])
def test_what_others_wrote_is_asked_about_and_kept(session, saver, scene, name):
    path, other = scene.photo.with_name("p.m.pose.json"), scene.photo.with_name(name)
    assert saver.file_to_replace(session.document) is None
    other.write_text("mine")
    assert saver.file_to_replace(session.document) == path
    assert saver.save(session) == (path,)
    backup = other.with_name(f"{name}.bak")
    assert backup.read_text() == "mine"
    assert saver.file_to_replace(session.document) is None  # this session's own by now
    saver.save(after(session, nudge("move", 1.0)))
    assert backup.read_text() == "mine"
    other.write_text("changed by another program")
    assert saver.file_to_replace(session.document) == path


def test_another_model_of_the_same_name_does_not_replace_the_first_ones_pose(session, saver):
    saver.save(session)
    model = replace(session.document.model, sha256="1" * 64)
    other = replace(session, document=session.document.with_object(model=model))
    assert saver.file_to_replace(other.document) is not None


def test_another_name_stays_the_sessions_own(session: Session, saver: Autosaver, scene: Scene):
    path = scene.photo.with_name("p.m.pose.json")
    path.write_text("mine")
    second = path.with_name("p.m.2.pose.json")
    assert saver.save(session, beside=True) == (second,)
    assert saver.where(session) == second.name
    assert saver.file_to_replace(session.document) is None
    moved = after(session, nudge("move", 5.0))
    assert saver.save(moved) == (second,)
    place = load_pose(second).pose.camera_from_model
    assert place.translation == pytest.approx(moved.document.pose.camera_from_model.translation)
    assert path.read_text() == "mine"


def test_wheels_given_by_hand_are_written_beside_the_model(session, saver, scene):
    model = session.document.model.with_content(keypoints=make_keypoints())
    document = session.document.with_object(model=model)
    beside = keypoints_path(scene.model)
    assert saver.save(replace(session, document=document))[1:] == (beside,)
    again = open_files(scene.photo, scene.model, scene.start).model.keypoints
    np.testing.assert_array_equal(again.left.axle, make_keypoints().left.axle)
    np.testing.assert_array_equal(again.right.front_wheel, make_keypoints().right.front_wheel)
    assert saver.save(replace(session, document=document))[1:] == ()  # they stand there already
    swapped = VehicleKeypoints(again.right, again.left)
    anew = document.with_object(model=model.with_content(keypoints=swapped))
    assert saver.save(replace(session, document=anew))[1:] == (beside,)
    assert beside.with_name(f"{beside.name}.bak").exists()
    now = open_files(scene.photo, scene.model, scene.start).model.keypoints
    assert now is not None
    assert is_equal(now, swapped)


def test_a_dropped_photo_saves_under_its_own_name(scene, saver, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    uploads = tmp_path / "state" / "uploads"
    photo = keep_set(uploads, pack([("Mein Foto.png", scene.photo.read_bytes())])) / "Mein Foto.png"
    dropped = Session(open_files(photo, scene.model, scene.start))
    assert saver.save(dropped) == (tmp_path / "Mein Foto.m.pose.json",)


def test_very_long_names_can_be_saved(scene: Scene, saver: Autosaver):
    photo = scene.photo.rename(scene.photo.with_name("ä" * 120 + ".png"))
    model = scene.model.rename(scene.model.with_name("ß" * 120 + ".ply"))
    assert saver.save(Session(open_files(photo, model, scene.start)))[0].exists()


def test_a_folder_that_is_read_only_is_said_in_a_sentence(scene, session, saver, monkeypatch):
    before = sorted(scene.photo.parent.iterdir())

    def refuse(path: Path, mode: str = "r", *more: Any, **options: Any) -> IO[Any]:
        if "x" in mode:
            raise OSError(EROFS, "Read-only file system")
        return open(path, mode, *more, **options)  # noqa: PTH123 - Path's own is replaced

    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", refuse)
        with pytest.raises(PoseFileError, match=r"^p\.m\.pose\.json: cannot be written to .*yours"):
            saver.save(session)
    assert sorted(scene.photo.parent.iterdir()) == before
    assert saver.save(session)[0].exists()


def test_a_note_comes_back_from_the_pose_file(scene: Scene, session: Session, saver: Autosaver):
    noted = replace(session, document=session.document.with_object(note="scratched at the left"))
    (path,) = saver.save(noted)
    assert load_pose(path).note == "scratched at the left"
    again = open_files(scene.photo, scene.model, path)
    assert again.object.note == "scratched at the left"
    assert open_pose(session.document, path).object.note == "scratched at the left"
