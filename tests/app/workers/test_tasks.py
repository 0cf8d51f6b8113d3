"""Tasks are done in order; those that are dropped bring nothing."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.workers.tasks import Result, Task, Tasks, upload
from poseviewer.errors import FileSetError
from tests.app.state.documents import make_session

PATIENCE_S = 60.0


def test_a_task_that_is_dropped_brings_nothing(tmp_path: Path):
    begun, ended, told = threading.Event(), threading.Event(), threading.Event()
    tasks, session = Tasks(told.set, tmp_path), make_session()

    def slow(*_: object) -> Result:
        begun.set()
        ended.wait(PATIENCE_S)
        return Result((c.undo(),))

    assert not tasks.drop()
    tasks.add(Task(slow))
    tasks.add(Task(slow))
    tasks.follow(session)
    assert begun.wait(PATIENCE_S)
    assert tasks.drop()
    assert not tasks.drop()
    ended.set()
    tasks.add(Task(lambda *_: Result((c.redo(),))))
    tasks.follow(session)
    results: list[Result] = []
    while not results:
        assert told.wait(PATIENCE_S)
        told.clear()
        results = [*tasks.take()]
    assert [result.edits for result in results] == [(c.redo(),)]
    tasks.close()


def test_uploads_that_wait_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("poseviewer.app.workers.tasks.LARGEST_UPLOAD", 100)
    tasks = Tasks(lambda: None, tmp_path)
    tasks.add(upload("photo", "large.png", bytes(150)))  # one alone is bounded before
    with pytest.raises(FileSetError, match="uploads are still being read"):
        tasks.add(upload("photo", "small.png", bytes(10)))
    tasks.drop()
    for _ in range(10):
        tasks.add(upload("photo", "small.png", bytes(10)))
    with pytest.raises(FileSetError, match="Other uploads"):
        tasks.add(upload("photo", "small.png", bytes(10)))
    tasks.close()
