"""``poseviewer fit`` to its end: a pose, a scene of several objects, a set of photos; stopped."""

import json
import os
import pty
import re
import signal
import subprocess
import sys
import termios
from pathlib import Path

import numpy as np
import pytest

from poseviewer.files.demo import demo_case
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_json import load_scene
from poseviewer.geometry.pose_error import pose_error
from tests.commands import run
from tests.ctrl_c import ctrl_c_ends_them
from tests.schemas import load_valid
from tests.several import IDS, MESHES, TRUTH
from tests.view_sets import MESH, SET_FROM_MODEL

FIT = [sys.executable, "-m", "poseviewer.cli.main", "fit"]


def test_the_pose_is_found_and_the_file_says_what_is_printed(folder, capsys):
    assert run("fit p.png m.ply --pose start.json --out pose.json --overlay overlay.png") == 0
    printed = capsys.readouterr()
    assert "Converged" in printed.out
    assert "pose: pose.json" in printed.out
    assert "free-body chart" in printed.err
    truth, found = load_pose(folder / "true.json").pose, load_pose(folder / "pose.json")
    assert pose_error(load_mesh(folder / "m.ply"), found.pose, truth).reprojection_px < 1.0
    assert found.warnings == ()
    data = load_valid(folder / "pose.json", "pose")
    assert data["photo"]["file"] == "p.png"
    assert data["settings"]["chart"] == "auto"
    assert 0.0 < data["unexplained"] < 1.0
    assert f"unexplained {data['unexplained']:.3f} (start " in printed.out
    assert "unexplained by part: light " in printed.out
    assert f"how sure, as standard deviations: {found.covariance.words()}" in printed.out
    assert run("info pose.json") == 0
    assert found.covariance.words() in capsys.readouterr().out
    assert load_photo(folder / "overlay.png").pixels.shape == (120, 160, 3)


def off(scene, index: int) -> float:
    """The mean distance of an object's vertices from the truth, px."""
    vertices = MESHES[index].vertices
    apart = scene.pose(index).project(vertices) - TRUTH[index].pose.project(vertices)
    return float(np.linalg.norm(apart, axis=1).mean())


@pytest.mark.slow
@pytest.mark.long
def test_all_objects_of_a_scene_are_found(folder, capsys):
    assert run("fit three.scene.json --out out.json --quiet --overlay o.png") == 0
    printed = capsys.readouterr().out
    assert all(f"{name} (seen to " in printed for name in IDS)
    load_valid(Path("out.json"), "scene")
    before, after = load_scene(folder / "three.scene.json"), load_scene(folder / "out.json")
    for index, new in enumerate(after.objects):
        assert off(after, index) < 0.5 * off(before, index)
        assert new.result.verdict is not None
    assert (load_photo(Path("o.png")).pixels != load_photo(Path("three.png")).pixels).any()


@pytest.mark.slow
@pytest.mark.long
def test_a_set_is_fitted_and_its_file_says_the_pose_in_the_set(folder, capsys):
    line = "fit --views set/set.json set/m.ply --pose set/start.json --out out.json --overlay o.png"
    assert run(line, "--lock", "rotation_z", "--quiet") == 0
    said = capsys.readouterr().out
    assert "b.png: unexplained" in said
    assert "By each of the 3 photos alone it is" in said
    data = load_valid(folder / "out.json", "scene")
    assert all((folder / f"o.{name}.png").is_file() for name in "abc")
    place = data["objects"][0]["world_from_model"]
    centre = np.array(place["rotation"]) @ MESH.centre + place["translation"]
    assert np.linalg.norm(centre - SET_FROM_MODEL.apply(MESH.centre)) < 0.1
    words = [view["word"] for view in data["objects"][0]["result"]["verdict"]["views"]]
    assert len(words) == 3


@pytest.mark.slow
@pytest.mark.long
def test_without_opengl_only_its_own_option_fails(folder):
    """EGL without any driver, which is what a machine without Mesa has."""
    blind = {"PYOPENGL_PLATFORM": "egl", "__EGL_VENDOR_LIBRARY_DIRS": str(folder)}
    env = {**os.environ, **blind, "PYTHONPATH": str(Path(__file__).parents[2])}
    line = "p.png m.ply --pose start.json --out o.json --quiet --evaluations 5"
    lines = [[*FIT, *f"{line} {more}".split()] for more in ("", "--renderer opengl")]
    ended = [subprocess.run(line, env=env, capture_output=True, text=True) for line in lines]
    assert [one.returncode for one in ended] == [0, 2], ended
    assert "libegl1" in ended[1].stderr
    assert ended[1].stderr.count("\n") == 1


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT for one process there")
def test_ctrl_c_keeps_the_best_pose(tmp_path):
    out, demo = tmp_path / "pose.json", demo_case()  # large: it takes long enough to be stopped
    command = [*FIT, demo.photo, demo.model, "--pose", demo.start, "--out", out]
    command += ["--method", "paper", "--evaluations", 10_000_000]
    # On a terminal the progress is shown at once; in a pipe only every few seconds.
    terminal, its_end = pty.openpty()
    termios.tcsetwinsize(its_end, (24, 120))
    with ctrl_c_ends_them():
        command = [str(part) for part in command]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=its_end, text=True)
    os.close(its_end)
    with os.fdopen(terminal, errors="replace") as shown:
        for _ in range(5):  # shown five times: it has come some way
            _wait_for(shown, "loss")
        process.send_signal(signal.SIGINT)
        printed, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Stopped by the user" in printed
    (before,) = re.findall(r"\(start ([0-9.]+)\)", printed)
    assert json.loads(out.read_text())["loss"] < float(before)


def _wait_for(stream, word: str) -> None:
    seen = ""
    while word not in seen:
        piece = stream.read(1)
        assert piece, seen
        seen += piece
