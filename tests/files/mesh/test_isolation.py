"""Whatever a reader of a model does to its process, the caller gets a sentence."""

import os
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.load import isolate, load_mesh
from poseviewer.files.mesh.parts import ModelParts, Part


def reads(path: Path) -> ModelParts:
    os.write(1, b"a library prints what it likes")
    texture = np.zeros((2, 2, 3), np.uint8)
    parts = [Part(name, np.eye(3), texture=texture) for name in (path.name, "b")]
    return ModelParts(parts, ["a note"])


def refuses(path: Path) -> ModelParts:
    raise MeshFileError(f"{path.name}: not this one.")


def crashes(_: Path) -> ModelParts:
    os.abort()


def fills(_: Path) -> ModelParts:
    return ModelParts([Part("", np.ones(10**10))], [])


def hangs(_: Path) -> ModelParts:
    time.sleep(600.0)
    raise AssertionError


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "a.3ds").write_bytes(b"a")
    return tmp_path / "a.3ds"


def test_what_it_reads_comes_back(path: Path) -> None:
    (first, second), notes, *_ = isolate(reads)(path)
    assert (first.name, second.name, notes) == ("a.3ds", "b", ["a note"])
    assert first.texture is second.texture


@pytest.mark.parametrize(("reader", "words"), [
    (refuses, "not this one"),
    (crashes, "its reader ended at it"),
    (hangs, "was not done after"),
    pytest.param(
        fills,
        "too large for this machine's memory",
        marks=pytest.mark.skipif(sys.platform == "win32", reason="memory is not bounded"),
    ),
])  # fmt: skip
def test_what_it_does_to_its_process_is_a_sentence(path: Path, monkeypatch, reader, words):
    seconds = 600.0 if reader != hangs else 3
    monkeypatch.setattr("poseviewer.files.mesh.load.DEADLINE_S", seconds)
    with pytest.raises(MeshFileError, match=rf"^a\.3ds: .*{words}"):
        isolate(reader)(path)


def test_a_file_that_crashed_its_library_gives_a_sentence_or_a_model(shared_cases: Path) -> None:
    begun = time.process_time()
    with suppress(MeshFileError):
        load_mesh(shared_cases / "crash_or_hang" / "c13_keyframe_deep.3ds")
    assert time.process_time() - begun < 10.0
