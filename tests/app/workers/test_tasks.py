"""Tasks are done in order; those that are dropped bring nothing."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.requests import Upload
from poseviewer.app.workers.tasks import Found, Tasks
from poseviewer.errors import FileSetError
from tests.app.state.documents import make_session

PATIENCE_S = 60.0


def test_a_task_that_is_dropped_brings_nothing(tmp_path: Path):
    begun, ended, told = threading.Event(), threading.Event(), threading.Event()
    tasks, session = Tasks(told.set, tmp_path), make_session()

    def slow(_: object) -> Iterator[Found]:
        begun.set()
        ended.wait(PATIENCE_S)
        yield Found((c.undo(),))

    assert not tasks.drop()
    tasks.add(slow)
    tasks.add(slow)
    tasks.follow(session)
    assert begun.wait(PATIENCE_S)
    assert tasks.drop()
    assert not tasks.drop()
    ended.set()
    tasks.add(lambda _: iter([Found((c.redo(),))]))
    tasks.follow(session)
    found = None
    while found is None:
        assert told.wait(PATIENCE_S)
        told.clear()
        found = tasks.collect()
    result, error = found
    assert error is None
    assert isinstance(result, Found)
    assert result.requests == (c.redo(),)
    tasks.close()


def test_uploads_that_wait_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("poseviewer.app.workers.tasks.LARGEST_UPLOAD", 100)
    tasks = Tasks(lambda: None, tmp_path)
    tasks.add_upload(Upload("photo", "large.png", bytes(150)))  # one alone is bounded before
    with pytest.raises(FileSetError, match=r"small.png: other uploads are still being read"):
        tasks.add_upload(Upload("photo", "small.png", bytes(10)))
    tasks.drop()
    for _ in range(10):
        tasks.add_upload(Upload("photo", "small.png", bytes(10)))
    with pytest.raises(FileSetError, match="other uploads"):
        tasks.add_upload(Upload("photo", "small.png", bytes(10)))
    tasks.close()
