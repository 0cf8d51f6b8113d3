"""A sequence in the app's workers: frames are read, poses are propagated, all is saved."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from poseviewer.app.state.frame_edits import edit_frames, step_frame
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import OF_FRAMES, export
from poseviewer.app.workers.opening import open_sources
from poseviewer.app.workers.saving import Autosaver
from poseviewer.app.workers.tracking import frame_reading, track_edits
from poseviewer.app.workers.worker import Worker
from poseviewer.errors import PhotoFileError
from poseviewer.files.cameras import Calibration
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.sequence_export import SEQUENCE_FORMATS
from poseviewer.files.image_sequence import load_sequence
from poseviewer.geometry.pose_error import pose_error
from poseviewer.opening.sources import Sources
from poseviewer.scene.assets import PhotoFile
from poseviewer.scene.sequence import key_indices, with_frames
from tests.app.sequences import COUNT, MESH, make_sequence, true_pose, write_sequence
from tests.app.state.documents import after, assert_same_pose, open_files


def keyed() -> Session:
    """A key in the first frame."""
    document = make_sequence()
    return Session(document).with_document(document.at_pose(true_pose(0)))


def finish(worker: Worker, session: Session, until: Callable[[Session], bool]) -> Session:
    """The session once the worker has made it so."""
    while not until(session):
        worker.follow(session)
        for edit in worker.mailbox.take(60.0):
            if isinstance(edit, Exception):
                raise edit
            session = after(session, edit)
    return session


def test_poses_are_propagated_one_after_the_other():
    session = after(keyed(), edit_frames("to end"))
    assert session.propagation is not None
    for number, edit in enumerate(track_edits(session.propagation.request), 1):
        session = after(session, edit)
        assert session.propagation is not None
        assert session.propagation.steps == min(number, COUNT - 1)
    assert not session.is_propagating
    scene = session.document.scene
    for index, frame in enumerate(scene.frames):
        pose = scene.views[0].pose(frame.poses["1"].world_from_model)
        assert pose_error(MESH, pose, true_pose(index)).percent < 1.0


def test_frames_are_read_away_from_the_main_loop():
    worker = frame_reading()
    try:
        session = after(keyed(), step_frame(2))
        session = finish(worker, session, lambda now: now.wanted_frame is None)
        assert session.document.photo.name == "0002.png"
        # Once read, a photo stays for a while, and is the same.
        photo = session.document.photo
        for by in (1, -1):
            session = after(session, step_frame(by))
            session = finish(worker, session, lambda now: now.wanted_frame is None)
        assert session.document.photo is photo
    finally:
        worker.close()


def test_a_frame_that_is_gone_is_said_and_the_shown_one_stays():
    def read():
        raise PhotoFileError("0001.png: is gone.")

    session, worker = keyed(), frame_reading()
    scene = session.document.scene
    gone = PhotoFile(None, "0001.png", *scene.views[0].photo.pixels.shape[1::-1], read=read)
    frames = (scene.frames[0], replace(scene.frames[1], file=gone), *scene.frames[2:])
    document = session.document.with_frames_of(with_frames(scene, frames))
    session = after(replace(session, document=document), step_frame(1))
    try:
        with pytest.raises(PhotoFileError):
            finish(worker, session, lambda now: now.wanted_frame is None)
    finally:
        worker.close()


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """A folder of frames with keys in the first two."""
    frames, model, camera, start = write_sequence(tmp_path_factory.mktemp("sequence"))
    document = open_files(load_sequence(frames), model, start, Calibration(camera))
    second = document.at_frame(1, document.scene.frames[1].file)
    return Session(second).with_document(second.at_pose(true_pose(1)))


@pytest.mark.parametrize(("what", "kind"), OF_FRAMES.items())
def test_all_frames_are_exported(opened: Session, what: str, kind: str):
    numbers = ConvertOptions(unit="mm", object_ids=(1,))
    ((name, content),) = export(what, opened, numbers=numbers).items()
    assert name == f"frames.m{SEQUENCE_FORMATS[kind] or f'.{kind}.zip'}"
    assert content


def test_a_frame_is_exported_by_itself(opened: Session):
    (name,) = export("opencv", opened)
    assert name.startswith("0001.m.")


def test_a_sequence_is_saved_beside_its_folder_and_opened_again(opened: Session, tmp_path: Path):
    saver = Autosaver(tmp_path)
    path, *_ = saver.save(opened)
    assert path.name == "frames.m.scene.json"
    assert path.parent == opened.document.scene.frames[0].file.location.parents[1]
    # In whichever frame: it is this session's own file.
    document = opened.document
    other = document.at_frame(0, document.scene.frames[0].file)
    assert saver.file_to_replace(other) is None
    again = open_sources(Sources(scene=path))
    assert again.scene.frame_index == 1
    assert key_indices(again.scene, "1") == [0, 1]
    assert_same_pose(again.pose, true_pose(1), 1e-6)
