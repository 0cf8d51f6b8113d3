"""The command line as a user meets it: results, files, one-line errors, exit codes."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from poseviewer.cli import main as cli
from poseviewer.files.demo import demo_case
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.geometry.pose_error import pose_error
from tests.commands import run
from tests.ctrl_c import ctrl_c_ends_them
from tests.schemas import json_schema


@pytest.mark.slow
def test_fit_finds_the_pose_and_writes_what_it_says(scene, tmp_path, capsys):
    out, picture = tmp_path / "pose.json", tmp_path / "overlay.png"
    assert run("fit", scene.photo, scene.model, "--pose", scene.start, "--out", out,
               "--overlay", picture) == 0  # fmt: skip
    printed = capsys.readouterr()
    assert "Converged" in printed.out
    assert str(out) in printed.out
    assert "free-body chart" in printed.err
    truth = load_pose(scene.truth, 160, 120).pose
    found = load_pose(out, 160, 120)
    assert pose_error(load_mesh(scene.model), found.pose, truth).reprojection_px < 1.0
    assert found.warnings == ()
    data = json.loads(out.read_text())
    jsonschema.validate(data, json_schema("pose"))
    assert data["photo"]["file"] == scene.photo.name
    assert data["settings"]["chart"] == "auto"
    assert 0.0 < data["unexplained"] < 1.0
    assert f"unexplained {data['unexplained']:.3f} (start " in printed.out
    assert "unexplained by part: light " in printed.out
    assert found.covariance is not None
    assert f"how sure, as standard deviations: {found.covariance.words()}" in printed.out
    assert run("info", out) == 0
    assert found.covariance.words() in capsys.readouterr().out
    assert load_photo(picture).pixels.shape == (120, 160, 3)


def test_fit_stops_at_its_limit_and_says_what_to_do(scene, tmp_path, capsys):
    out = tmp_path / "pose.json"
    assert run("fit", scene.photo, scene.model, "--pose", scene.start, "--out", out,
               "--evaluations", 25, "--quiet") == 0  # fmt: skip
    printed = capsys.readouterr()
    assert "25 evaluations" in printed.out
    assert 'raise "Max evaluations" (--evaluations)' in printed.out
    assert printed.err == ""
    assert out.exists()


def test_landscape_writes_a_sheet_and_the_numbers(scene, tmp_path, capsys):
    folder = tmp_path / "maps" / "here"
    assert run("landscape", scene.photo, scene.model, "--pose", scene.truth, "--out", folder,
               "--size", 5, "--range", 0.1, "--quiet") == 0  # fmt: skip
    assert load_photo(folder / "landscape.png").width > 500
    with np.load(folder / "landscape.npz", allow_pickle=False) as saved:
        losses = saved["losses"]
    assert losses.shape == (15, 5, 5)
    assert np.isfinite(losses).all()
    # The truth is near the bottom of every map.
    assert np.all(losses[:, 2, 2] <= np.median(losses, axis=(1, 2)))
    assert "landscape.npz" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("photo", ["160 x 120 px", "colour", "50 degrees"]),
        ("model", ["1,280 on", "vertices", "free-body"]),
        ("start", ["perspective", "fx 300", "cx 82.5"]),
    ],
)
def test_info_says_what_was_understood(scene, file, words, capsys):
    assert run("info", getattr(scene, file)) == 0
    printed = capsys.readouterr().out
    assert all(word in printed for word in words), printed


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--chart", "vehicle"], "keypoints.json"),
        (["--lock", "mu_x"], "no such number"),
        (["--region", "500,500,10,10"], "no pixel"),
        (["--region", "1,2,3"], "left,top,width,height"),
        (["--seconds", "-1"], "above 0"),
        (["--evaluations", "many"], "many is not a whole number above 0"),
        (["--lock", "rotation_x,rotation_y,rotation_z,shift_x,shift_y,log_depth"], "leave one"),
        (["--overlay", "/no/such/folder/x.png"], "no folder"),
        (["--look", "fancy"], "outline"),
        (["--method", "paper", "--pixels", "near"], "--pixels"),
        (["--method", "paper", "--colour-reflectance"], "--colour-reflectance"),
    ],
    ids=lambda value: value[-1] if isinstance(value, list) else "",
)
def test_wrong_settings_are_said_before_any_work(scene, tmp_path, more, words, capsys):
    out = tmp_path / "pose.json"
    assert run("fit", scene.photo, scene.model, "--pose", scene.start, "--out", out, *more) == 2
    printed = capsys.readouterr()
    assert words in printed.err
    assert "Traceback" not in printed.err
    assert not out.exists()


@pytest.mark.slow
def test_without_opengl_only_its_own_option_fails(scene, tmp_path):
    """EGL without any driver, which is what a machine without Mesa has."""
    blind = {**os.environ, "PYOPENGL_PLATFORM": "egl", "__EGL_VENDOR_LIBRARY_DIRS": str(tmp_path)}
    command = [sys.executable, "-m", "poseviewer.cli.main", "fit",
               str(scene.photo), str(scene.model),
               "--pose", str(scene.start), "--out", str(tmp_path / "o.json"), "--quiet",
               "--evaluations", "5"]  # fmt: skip
    plain = subprocess.run(command, env=blind, capture_output=True, text=True, check=False)
    assert plain.returncode == 0, plain.stderr
    opengl = subprocess.run(
        [*command, "--renderer", "opengl"], env=blind, capture_output=True, text=True, check=False
    )
    assert opengl.returncode == 2, opengl.stderr
    assert "libegl1" in opengl.stderr
    assert opengl.stderr.count("\n") == 1


def test_results_are_not_lost_to_a_wrong_place(scene, tmp_path, capsys):
    """A place that cannot be written to is said before the work, not after it."""
    assert run("fit", scene.photo, scene.model, "--pose", scene.start, "--out", tmp_path,
               "--seconds", 1e6) == 2  # fmt: skip
    assert "is a folder" in capsys.readouterr().err
    (tmp_path / "file").write_text("kept")
    assert run("landscape", scene.photo, scene.model, "--pose", scene.start, "--out",
               tmp_path / "file", "--size", 401, "--quiet") == 2  # fmt: skip
    assert "folder of yours" in capsys.readouterr().err
    assert (tmp_path / "file").read_text() == "kept"


@pytest.mark.parametrize(
    ("code", "heavy"),
    [
        (
            "from poseviewer.cli.main import COMMANDS, make_parser, parser_of; make_parser();"
            "[parser_of(name, name) for name in COMMANDS if name != 'convert']",
            {"numpy", "scipy", "cv2", "numba", "trimesh", "viser", "matplotlib"},
        ),
        (
            "import poseviewer.app.app",
            {"numba", "scipy.stats", "trimesh", "matplotlib", "pyrender", "pandas"},
        ),
    ],
    ids=["help", "app"],
)
def test_nothing_is_imported_that_can_wait(code: str, heavy: set[str]):
    command = [sys.executable, "-c", f"{code}; import sys; print(*sys.modules)"]
    ended = subprocess.run(command, check=True, capture_output=True, text=True)
    assert not heavy & set(ended.stdout.split())


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT for one process there")
def test_ctrl_c_keeps_the_best_pose(tmp_path):
    out = tmp_path / "pose.json"
    demo = demo_case()  # large, so that it takes long enough to be stopped
    files = [demo.photo, demo.model, "--pose", demo.start, "--out"]
    command = [sys.executable, "-m", "poseviewer.cli.main", "fit", *files, out]
    command += ["--method", "paper", "--evaluations", 10_000_000]
    # On a terminal the progress is shown at once; in a pipe only every few seconds.
    terminal, its_end = pty.openpty()
    termios.tcsetwinsize(its_end, (24, 120))
    with ctrl_c_ends_them():
        process = subprocess.Popen(
            [str(part) for part in command], stdout=subprocess.PIPE, stderr=its_end, text=True
        )
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


def _wait_for(stream, word: str, seconds: float = 120.0) -> None:
    seen, end = "", time.monotonic() + seconds
    while word not in seen:
        assert time.monotonic() < end, seen
        piece = stream.read(1)
        assert piece, seen
        seen += piece


def test_no_command_at_all_is_the_app():
    options = cli.parse([])
    assert (options.command, options.photo, options.host) == ("app", None, "127.0.0.1")
    options = cli.parse(["car.jpg", "car.glb", "--pose", "p.json", "--no-browser"])
    assert (options.command, options.photo, options.model) == (
        "app",
        Path("car.jpg"),
        Path("car.glb"),
    )
    assert cli.parse(["demo"]).command == "demo"


def test_the_app_wants_a_model_with_a_photo(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["photo.jpg"]) == 2
    assert "name PHOTO and MODEL" in capsys.readouterr().err
    assert cli.main(["--pose", "pose.json"]) == 2
    assert "name all three" in capsys.readouterr().err


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_every_command_is_listed_and_describes_itself(command, capsys):
    assert f"\n    {command}" in cli.make_parser().format_help()
    with pytest.raises(SystemExit) as ended:
        cli.parse([command, "--help"])
    assert ended.value.code == 0
    assert f"usage: poseviewer {command} " in capsys.readouterr().out
