"""A sequence in the app's workers: frames are read, poses are propagated, all is saved."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.state.document import Document
from poseviewer.app.state.dragging import translate
from poseviewer.app.state.edits import undo
from poseviewer.app.state.frame_edits import edit_frames, step_frame
from poseviewer.app.state.results import PropagationRequest
from poseviewer.app.state.search_edits import find_focal_length, toggle_search
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import OF_FRAMES, export
from poseviewer.app.workers.jobs import search_edits
from poseviewer.app.workers.opening import open_sources
from poseviewer.app.workers.saving import Autosaver
from poseviewer.app.workers.tracking import count_frames, frame_reading, track_edits
from poseviewer.app.workers.worker import Worker
from poseviewer.errors import PhotoFileError
from poseviewer.files.cameras import Calibration
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.sequence_export import SEQUENCE_FORMATS
from poseviewer.files.image_sequence import load_sequence
from poseviewer.geometry.pose_error import pose_error
from poseviewer.opening.sources import Sources
from poseviewer.scene.assets import PhotoFile
from poseviewer.scene.sequence import key_indices, mark_stale, store_poses, with_frames
from poseviewer.scene.types import FramePose
from tests.app.sequences import COUNT, MESH, make_sequence, true_pose, write_sequence
from tests.app.state.documents import after, assert_same_pose, open_files
from tests.moving import ball, box, off, sequence


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
    assert session.propagation is not None
    pace = session.propagation.pace
    assert (pace.done, pace.total, pace.begun) == (COUNT - 1, COUNT - 1, 1.0)
    scene = session.document.scene
    for index, frame in enumerate(scene.frames):
        pose = scene.views[0].pose(frame.poses["1"].world_from_model)
        assert pose_error(MESH, pose, true_pose(index)).percent < 1.0


@pytest.mark.slow
def test_frames_between_keys_are_searched_twice_and_counted_once():
    session = keyed()
    last = session.document.at_frame(4, session.document.scene.frames[4].file)
    session = replace(session, document=last).with_document(last.at_pose(true_pose(4)))
    request = PropagationRequest(session.document, (0,), 0, COUNT - 1)
    # One to three both ways, five and six forwards.
    assert count_frames(request) == (5, 8)
    assert len([*track_edits(request)]) == 8 + 1


@pytest.mark.slow
def test_all_objects_are_propagated_together():
    """A ball and a box, each by a key of its own in the first frame."""
    scene = sequence({0: [ball(0), box(0)]}, (ball, box), count=3)
    session = after(Session(Document.of(scene)), edit_frames("to end"))
    assert session.propagation is not None
    session = after(session, *track_edits(session.propagation.request))
    assert session.propagation is not None
    assert session.propagation.frames == {1, 2}
    done = session.document.scene
    for name, model in (("1", ball), ("2", box)):
        assert off(done, 2, model(2), name) < 3.0  # 8 % where it stays


def test_objects_whose_ids_are_names_keep_their_poses():
    scene = sequence({0: [ball(0), box(0)]}, (ball, box), count=2)
    opened = Document.of(scene).scene
    assert [item.name for item in opened.objects] == ["a", "b"]
    assert [key_indices(opened, item.id) for item in opened.objects] == [[0], [0]]


def all_propagated() -> Session:
    session = after(keyed(), edit_frames("to end"))
    assert session.propagation is not None
    return after(session, *track_edits(session.propagation.request))


def errors(session: Session) -> list[float]:
    """Distance of the pose in each frame from the truth, %."""
    scene = session.document.scene
    poses = [scene.views[0].pose(frame.poses["1"].world_from_model) for frame in scene.frames]
    return [pose_error(MESH, pose, true_pose(i)).percent for i, pose in enumerate(poses)]


def with_wrong_poses(session: Session, indices: Sequence[int]) -> Session:
    """The session with propagated poses beside the truth in some frames."""
    scene = session.document.scene
    for index in indices:
        pose = translate(true_pose(index), MESH.centre, np.array([12.0, 0.0]))
        place = scene.views[0].world_from_model(pose)
        wrong = FramePose(world_from_model=place, source="propagated")
        scene = store_poses(scene, {index: {"1": wrong}})
    return replace(session, document=session.document.with_frames_of(scene))


@pytest.mark.slow
@pytest.mark.long
def test_the_search_key_mends_what_is_wrong_beside_it_and_undo_takes_all_back():
    session = with_wrong_poses(all_propagated(), [2, 3, 4])
    document = session.document
    session = replace(session, document=document.at_frame(3, document.scene.frames[3].file))
    assert [index for index, error in enumerate(errors(session)) if error > 1.0] == [2, 3, 4]
    begun = after(session, toggle_search())
    assert begun.search is not None
    found = after(begun, *search_edits(begun.search))
    assert found.is_propagating
    assert found.propagation is not None
    done = after(found, *track_edits(found.propagation.request))
    assert max(errors(done)) < 1.0
    assert not done.is_propagating
    assert done.propagation is not None
    assert done.propagation.frames == {2, 4}
    # It stays at its frame, with the search's result, and other frames keep their poses.
    assert done.wanted_frame is None
    assert done.search is found.search
    pairs = zip(session.document.scene.frames, done.document.scene.frames, strict=True)
    poses = [[one.poses["1"].world_from_model for one in pair] for pair in pairs]
    kept = [old is new for old, new in poses]
    assert kept == [index not in (2, 3, 4) for index in range(COUNT)]
    assert not any(frame.poses["1"].is_stale for frame in done.document.scene.frames)
    back = after(done, undo())
    assert back.document.scene.frames is session.document.scene.frames
    assert not back.history.past[len(session.history.past) :]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("what", ["nothing there", "new focal length", "stopped"])
def test_a_search_mends_nothing_where_nothing_is_there_all_is_changed_or_it_is_stopped(what: str):
    session = keyed() if what == "nothing there" else with_wrong_poses(keyed(), [1])
    edit = find_focal_length() if what == "new focal length" else toggle_search()
    begun = after(session, edit)
    assert begun.search is not None
    made = list(search_edits(begun.search))
    made = [*made[:1], toggle_search()] if what == "stopped" else made
    ended = after(begun, *made)
    assert not ended.is_searching
    assert ended.propagation is None


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


@pytest.mark.parametrize("what", ["all frames: csv", "opencv", "pose", "overlay"])
def test_stale_poses_in_an_export_are_said(opened: Session, what: str):
    document, notes = opened.document, list[str]()
    scene = document.scene
    propagated = replace(scene.frames[1].poses["1"], source="propagated")
    frame = replace(scene.frames[1], poses={"1": propagated})
    scene = replace(scene, frames=(scene.frames[0], frame, *scene.frames[2:]))
    fresh = replace(opened, document=document.with_frames_of(scene))
    scene = mark_stale(scene, "1", 0, 1)
    stale = replace(opened, document=document.with_frames_of(scene))
    export(what, fresh, notes)
    assert not any("stale" in note for note in notes)
    export(what, stale, notes)
    assert sum("poses is stale" in note for note in notes) == 1


def test_drawing_an_export_tells_of_each_frame_and_ends_where_it_is_stopped(opened: Session):
    told = list[tuple[float, int]]()
    export("all frames: video", opened, tell=lambda *how: told.append(how))
    assert told == [(number, COUNT) for number in range(1, COUNT + 1)]

    def stop(done: float, _: int) -> None:
        if done == 2:
            raise RuntimeError

    with pytest.raises(RuntimeError):
        export("all frames: video", opened, tell=stop)


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
