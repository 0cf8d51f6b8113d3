"""A search for cameras that is stopped leaves no set, no process and no file behind."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil
import pytest

from poseviewer.errors import SettingsError
from poseviewer.files.scene_json import load_scene
from poseviewer.still.still_cameras import find_cameras
from tests.commands import run
from tests.ctrl_c import ctrl_c_ends_them
from tests.still_scene import MARKERS, arc, write_pictures


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return write_pictures(tmp_path_factory.mktemp("still"), arc(8), MARKERS)


def searching() -> list[psutil.Process]:
    """Processes of this one that search for cameras."""
    return psutil.Process().children(recursive=True)


@pytest.mark.slow
@pytest.mark.parametrize("line", ["looking for markers", "features 3 of 8", "matched ", "placed 3"])
def test_closing_the_iteration_ends_the_process_at_any_line(pictures, tmp_path, monkeypatch, line):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    steps = find_cameras(pictures, "auto" if "markers" in line else "features")
    before = {process.pid for process in searching()}
    for step in steps:
        if str(step).startswith(line):
            break
    else:
        pytest.fail(f"no line {line}")
    assert {process.pid for process in searching()} - before
    assert [path.name[:11] for path in tmp_path.iterdir()] == ["poseviewer-"]
    steps.close()  # pyright: ignore[reportAttributeAccessIssue]
    assert not {process.pid for process in searching()} - before
    assert not [*tmp_path.iterdir()]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C of one process alone")
@pytest.mark.parametrize(
    ("by", "after_s"), [("features", 0.3), ("features", 3.0), ("markers", 0.3)]
)
def test_ctrl_c_ends_the_command_without_a_set_and_the_command_can_be_given_again(
    pictures, tmp_path, by, after_s
):
    out, scratch = tmp_path / "set", tmp_path / "scratch"
    scratch.mkdir()
    folder = pictures[0].parent
    words = [sys.executable, "-m", "poseviewer.cli.main", "cameras", folder, "--out", out]
    environment = {**os.environ, "TMPDIR": str(scratch)}
    with ctrl_c_ends_them():
        command = subprocess.Popen(
            [*map(str, words), "--by", by], stderr=subprocess.PIPE, text=True,
            env=environment,
        )  # fmt: skip
        own = psutil.Process(command.pid)
        while not (own.children() and any(scratch.iterdir())):
            assert command.poll() is None
            time.sleep(0.01)
        time.sleep(after_s)  # into any part of its work
        children = own.children(recursive=True)
        command.send_signal(signal.SIGINT)
        said = command.communicate()[1]
    assert command.returncode == 130
    assert said.splitlines()[-1].startswith("poseviewer: stopped; no set was written")
    assert not [child for child in children if child.is_running() and child.status() != "zombie"]
    assert not out.exists()
    assert not [*scratch.iterdir()]
    assert run("cameras", folder, "--out", out, "--by", by, "--quiet") == 0
    assert len(load_scene(out / "set.json").views) == len(pictures)


def test_one_picture_is_too_few(pictures):
    with pytest.raises(SettingsError, match=r"1 picture; wanted two or more"):
        next(iter(find_cameras(pictures[:1])))
