"""Tasks are done in order; those that are dropped bring nothing."""

import json
import os
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from poseviewer.app.page.texts import MODEL_HINT, every_text, hint_of
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.session import Session
from poseviewer.app.workers import jobs
from poseviewer.app.workers.maps import MapMaker
from poseviewer.app.workers.tasks import (
    LONG_VIDEO,
    LongVideo,
    QueuedTask,
    TaskQueue,
    TaskResult,
    Tell,
    UnsavedPose,
    upload,
)
from poseviewer.errors import FileSetError
from poseviewer.files.demo import demo_case
from poseviewer.opening.uploads import pack
from tests.app.below_viser.socket_page import SocketPage
from tests.app.running_app import running_app
from tests.app.state import edits as c
from tests.app.state.documents import make_session, open_files
from tests.scene import Scene
from tests.textured import write_obj
from tests.videos import write_video

PATIENCE_S = 60.0


def test_a_task_that_is_dropped_brings_nothing(tmp_path: Path):
    begun = threading.Event()
    ended = threading.Event()
    tasks, session = TaskQueue(tmp_path), make_session()

    def slow(*_: object) -> TaskResult:
        begun.set()
        ended.wait(PATIENCE_S)
        return TaskResult((c.undo(),))

    assert not tasks.drop()
    tasks.add(QueuedTask(slow))
    tasks.add(QueuedTask(slow))
    tasks.follow(session)
    assert begun.wait(PATIENCE_S)
    assert tasks.drop()
    assert not tasks.drop()
    ended.set()
    tasks.add(QueuedTask(lambda *_: TaskResult((c.redo(),))))
    tasks.follow(session)
    results: list[TaskResult] = []
    while not results:
        results = tasks.mailbox.take(PATIENCE_S)
    assert [result.edits for result in results] == [(c.redo(),)]
    tasks.close()


def test_progress_is_published_and_a_dropped_task_ends(tmp_path: Path):
    tasks, session, go = TaskQueue(tmp_path), make_session(), threading.Event()
    ends = list[str]()

    def slow(_: Session, __: Path, tell: Tell) -> TaskResult:
        tell(9, 698)
        assert go.wait(PATIENCE_S)
        try:
            tell(10, 698)
        finally:
            ends.append("told")
        ends.append("done")
        return TaskResult()

    tasks.add(QueuedTask(slow, "Reading clip.mp4 ..."))
    tasks.follow(session)
    items: list[Any] = []
    while not items:
        items = tasks.mailbox.take(PATIENCE_S)
    (progress,) = items
    assert progress.working == "Reading clip.mp4 ..."
    assert (progress.pace.done, progress.pace.total) == (9, 698)
    assert tasks.drop()
    go.set()
    tasks.close()
    assert ends == ["told"]
    assert tasks.mailbox.take(0.0) == []


def uploaded(tmp_path: Path, count: int) -> tuple[Session, QueuedTask]:
    """A session, and the upload of a video of some frames."""
    case = demo_case()
    video = write_video(tmp_path / "clip.mp4", count).read_bytes()
    document = open_files(case.photo, case.model, case.start)
    return Session(document, saved=document), upload(
        "photo", "clip.mp4", pack([("clip.mp4", video)]), client=7
    )


def test_a_long_video_is_asked_about_and_every_nth_frame_read(tmp_path: Path):
    session, task = uploaded(tmp_path, LONG_VIDEO + 1)
    asked = task.run(session, tmp_path, lambda *_: None)
    assert asked.edits == ()
    assert asked.client == 7
    question = asked.question
    assert isinstance(question, LongVideo)
    assert (question.name, question.frames) == ("clip.mp4", LONG_VIDEO + 1)
    assert "**301 frames**" in every_text(question, 1)
    assert "2 min to propagate" in every_text(question, 1)
    assert "**61 frames**" in every_text(question, 5)
    assert "21 s to propagate" in every_text(question, 5)
    told = list[tuple[float, int]]()
    (edit,) = question.open(5).run(session, tmp_path, lambda *how: told.append(how)).edits
    opened = edit(session)
    assert len(opened.document.scene.frames) == 61
    assert told[-1] == (61, 61)
    assert sorted(told) == told


def test_a_pose_in_no_file_is_asked_about(tmp_path: Path):
    saved, task = uploaded(tmp_path, 4)
    unsaved = replace(saved, saved=None)
    asked = task.run(unsaved, tmp_path, lambda *_: None)
    assert asked.edits == ()
    assert isinstance(asked.question, UnsavedPose)
    assert asked.question.name == "clip.mp4"
    result = asked.question.open.run(unsaved, tmp_path, lambda *_: None)
    assert result.question is None
    assert len(result.edits[0](unsaved).document.scene.frames) == 4
    # Nothing is lost where nothing is placed, or where the pose stays.
    nowhere = saved.document.with_object(is_placed=False)
    assert task.run(replace(unsaved, document=nowhere), tmp_path, lambda *_: None).question is None
    lens = json.dumps({"fx": 1500, "fy": 1500, "cx": 640, "cy": 480, "width": 1280, "height": 960})
    calibration = upload("photo", "lens.json", pack([("lens.json", lens.encode())]))
    assert not isinstance(calibration.run(unsaved, tmp_path, lambda *_: None).question, UnsavedPose)


def test_a_short_video_is_opened_at_once(tmp_path: Path):
    session, task = uploaded(tmp_path, 4)
    told = list[tuple[float, int]]()
    result = task.run(session, tmp_path, lambda *how: told.append(how))
    assert result.question is None
    assert len(result.edits[0](session).document.scene.frames) == 4
    assert told == [(number, 4) for number in (1, 2, 3, 4)]


def test_uploads_that_wait_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("poseviewer.app.workers.tasks.MAX_UPLOAD_BYTES", 100)
    tasks = TaskQueue(tmp_path)
    tasks.add(upload("photo", "large.png", bytes(150)))  # one alone is bounded before
    with pytest.raises(FileSetError, match="uploads are still being read"):
        tasks.add(upload("photo", "small.png", bytes(10)))
    tasks.drop()
    for _ in range(10):
        tasks.add(upload("photo", "small.png", bytes(10)))
    with pytest.raises(FileSetError, match="Other uploads"):
        tasks.add(upload("photo", "small.png", bytes(10)))
    tasks.close()


def test_a_photo_alone_waits_for_its_model_where_the_demo_is_open(scene: Scene, tmp_path: Path):
    case, photo = demo_case(), scene.photo.read_bytes()
    for model, is_looking in ((case.model, False), (scene.model, True)):
        document = open_files(case.photo, model, case.start)
        session = Session(document, saved=document)
        task = upload("photo", "own.png", pack([("own.png", photo)]))
        (edit,) = task.run(session, tmp_path, lambda *_: None).edits
        opened = edit(session)
        assert opened.is_looking is is_looking
        assert (hint_of(opened) == MODEL_HINT) is not is_looking


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("asked", ["task", "proposals"])
def test_maps_and_a_search_wait_for_what_was_asked_for(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: str
):
    """``done`` is the order in which they work; what is ``asked`` for ends once they have begun."""
    done = list[str]()
    nice = dict[str, int]()
    go = threading.Event()

    def telling(name: str, work: Callable[..., Iterator[Any]]) -> Callable[..., Iterator[Any]]:
        def tell(*given: Any) -> Iterator[Any]:
            done.append(name)
            if sys.platform == "linux":  # threads have a priority of their own there
                nice[name] = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
            yield from work(*given)

        return tell

    def task(*_: object) -> TaskResult:
        assert go.wait(PATIENCE_S)
        done.append(asked)
        return TaskResult()

    def proposed(*_: object) -> Iterator[Edit]:
        task()
        yield c.stop_proposing()

    with running_app(scene, tmp_path) as running, SocketPage(running.url) as page:
        app = running.app
        page.wait_until(lambda: app.session.results.landscapes and not app._mapper.busy)
        monkeypatch.setattr(MapMaker, "run", telling("maps", MapMaker.run))
        monkeypatch.setattr(jobs, "run_search", telling("search", jobs.run_search))
        monkeypatch.setattr(jobs, "propose_and_fit", proposed)
        app._mailbox.post(QueuedTask(task) if asked == "task" else c.propose_starts())
        page.wait_until(lambda: app._tasks.busy or app._proposer.busy)
        before = app.session.results.losses
        app._mailbox.post(c.nudge("move", 3.0))
        page.wait_until(lambda: app._mapper.busy)
        page.wait_until(lambda: app.session.results.losses is not before)  # long at it, else
        if asked == "task":  # a search ends proposals
            app._mailbox.post(c.toggle_search())
            page.wait_until(lambda: app._searcher.busy)
        overlay = app.session.results.overlay
        app._mailbox.post(c.show_style("solid"))
        page.wait_until(lambda: app.session.results.overlay is not overlay)  # they never wait
        assert not done
        go.set()
        begun = {"maps", "search"} if asked == "task" else {"maps"}
        page.wait_until(lambda: begun < {*done})
    assert done[0] == asked
    assert sys.platform != "linux" or nice["maps"] > nice.get("search", 0)


def test_a_missing_texture_of_any_name_completes_the_model_at_its_unsaved_pose(
    tmp_path: Path, scene: Scene
):
    document = open_files(scene.photo, write_obj(tmp_path, "oak.png"), None)
    session = Session(document.with_object(is_placed=True), saved=None)
    picture = pack([("photo 1.png", scene.photo.read_bytes())])
    task = upload("model", "photo 1.png", picture, missing=["oak.png"])
    result = task.run(session, tmp_path, lambda *_: None)
    assert result.question is None
    completed = result.edits[0](session).document
    assert len(completed.mesh.textures) == 1
    assert completed.pose is document.pose
