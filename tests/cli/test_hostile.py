"""Names and arguments that are meant to do harm, and errors that nobody foresaw."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.commands import run
from tests.scene import Scene

ESCAPES = "\x1b[2J\x1b]0;owned\x07\u202e"


def one_line(printed: str) -> str:
    """What was printed: a line that does no harm."""
    assert printed.endswith("\n")
    line = printed[:-1]
    assert line.isprintable()
    assert len(line) < 1200
    return line


@pytest.mark.parametrize(
    "arguments",
    [
        ("fit", "PHOTO", "m.ply", "--pose", "s.json", "--out", "o.json"),
        ("convert", "PHOTO", "o.json"),
        ("batch", "PHOTO", "--out", "o"),
        ("app", "PHOTO", "m.ply"),
        ("fit", "p.png", "m.ply", "--pose", "s.json", "--out", "o.json", "--evaluations", "PHOTO"),
        ("PHOTO",),
    ],
    ids=lambda words: " ".join(words)[:40],
)
@pytest.mark.parametrize("value", ["x" * 100_000, ESCAPES, "a\udce4b.png", "-" + "9" * 5000])
def test_any_argument_gives_one_line_and_exit_code_2(
    scene: Scene, arguments: tuple[str, ...], value: str, tmp_path: Path, capsys, monkeypatch
) -> None:
    for path in (scene.photo, scene.model, scene.start):
        shutil.copy(path, tmp_path / {"p.png": "p.png", "m.ply": "m.ply"}.get(path.name, "s.json"))
    monkeypatch.chdir(tmp_path)
    assert run(*(value if word == "PHOTO" else word for word in arguments)) == 2
    printed = capsys.readouterr()
    assert one_line(printed.err).startswith("poseviewer")
    assert printed.out == ""


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
@pytest.mark.parametrize("kind", ["pipe", "device", "hole"])
@pytest.mark.parametrize(
    "arguments",
    [
        ("fit", "p.png", "m.ply", "--pairs", "odd.csv", "--out", "o.json"),
        ("fit", "--views", "odd.json", "m.ply", "--pose", "s.json", "--out", "o.json"),
        ("undistort", "p.png", "--calibration", "cameras.txt", "--out", "o.png"),
        ("batch", "odd.csv", "--out", "o"),
        ("info", "odd.glb"),
    ],
    ids=" ".join,
)
def test_what_is_no_regular_file_is_refused_wherever_one_is_wanted(
    scene: Scene, arguments: tuple[str, ...], kind: str, tmp_path: Path, capsys, monkeypatch
) -> None:
    for path, name in ((scene.photo, "p.png"), (scene.model, "m.ply"), (scene.start, "s.json")):
        shutil.copy(path, tmp_path / name)
    (name,) = (word for word in arguments if word.startswith(("odd", "cameras")))
    if kind == "pipe":
        os.mkfifo(tmp_path / name)
    elif kind == "device":
        (tmp_path / name).symlink_to("/dev/zero")
    else:
        with (tmp_path / name).open("wb") as file:
            file.truncate(3_000_000_000)
    monkeypatch.chdir(tmp_path)
    assert run(*arguments) == 2
    assert name in one_line(capsys.readouterr().err)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_what_is_no_regular_file_is_not_replaced(scene: Scene, tmp_path: Path, capsys) -> None:
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    for arguments in (
        ("fit", scene.photo, scene.model, "--pose", scene.start, "--out", pipe),
        ("convert", scene.start, pipe, "--photo", scene.photo, "--overwrite"),
    ):
        assert run(*arguments) == 2
        assert "no regular file" in one_line(capsys.readouterr().err)
    assert pipe.is_fifo()


def test_names_that_are_no_text_can_be_used(scene: Scene, tmp_path: Path, capsys) -> None:
    photo, model, start = (
        tmp_path / os.fsdecode(b"f\xe4hre." + ending) for ending in (b"png", b"ply", b"json")
    )
    try:
        for path, made in ((photo, scene.photo), (model, scene.model), (start, scene.start)):
            shutil.copy(made, path)
    except OSError:
        pytest.skip("this file system takes text alone")
    out = tmp_path / os.fsdecode(b"\xfc.json")
    assert run("fit", photo, model, "--pose", start, "--out", out, "--evaluations", 40) == 0
    printed = capsys.readouterr()
    assert "\udce4" not in printed.out + printed.err
    assert json.loads(out.read_text())["photo"]["file"] == "f?hre.png"
    for path in (photo, model, out):
        assert run("info", path) == 0
    assert "f?hre.png" in capsys.readouterr().out
    assert run("overlay", photo, model, "--pose", out, "--out", tmp_path / "o.png") == 0
    assert run("convert", out, tmp_path / "t.json", "--to", "nerfstudio") == 0


def test_escapes_in_names_do_not_reach_the_terminal(tmp_path: Path, capsys) -> None:
    folder = tmp_path / f"a{ESCAPES}"
    folder.mkdir()
    model = folder / f"m{ESCAPES}.obj"
    model.write_text(
        f"mtllib {ESCAPES}.mtl\no thing{ESCAPES}\ng group{ESCAPES}\nusemtl stuff{ESCAPES}\n"
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2\nf 1 2 3\n"
    )
    assert run("info", model) == 0
    assert run("info", folder / f"none{ESCAPES}.obj") == 2
    assert run("info", folder) == 2
    printed = capsys.readouterr()
    assert "thing?[2J" in printed.out
    for line in (printed.out + printed.err).splitlines():
        assert line.isprintable(), line


def test_half_a_character_in_a_pose_file_does_no_harm(scene: Scene, tmp_path: Path, capsys) -> None:
    data = json.loads(scene.start.read_text())
    data["photo"] = {"file": "p\ud800.png", "width": 160, "height": 120}
    data["model"] = {"file": f"{ESCAPES}.ply", "unit": "m\udfff"}
    data["verdict"] = {"word": "found", "probability": 1, "evidence": {"\ud800": 1.0}}
    data["settings"] = {"\ud800": "\udc00"}
    start = tmp_path / "s.json"
    start.write_text(json.dumps(data))
    assert run("info", start) == 0
    for name in ("poseviewer", "nerfstudio", "opencv"):
        out = tmp_path / f"{name}.{'yml' if name == 'opencv' else 'json'}"
        assert run("convert", start, out, "--to", name) == 0
        out.read_bytes().decode()
    out = tmp_path / "found.json"
    assert run("fit", scene.photo, scene.model, "--pose", start, "--out", out,
               "--evaluations", 40) == 0  # fmt: skip
    printed = capsys.readouterr()
    assert all(line.isprintable() for line in (printed.out + printed.err).splitlines())


def test_the_log_says_where_it_happened() -> None:
    script = (
        "from poseviewer.cli import info_command, main\n"
        "def fails(options): raise RuntimeError('boom')\n"
        "info_command.run = fails\n"
        "raise SystemExit(main.main(['info', 'p.png']))\n"
    )
    for log, traced in (("", False), ("1", True)):
        found = subprocess.run(
            [sys.executable, "-c", script],
            env={**os.environ, "POSEVIEWER_LOG": log},
            capture_output=True,
            text=True,
            check=False,
            cwd=Path(__file__).parents[2],
        )
        assert found.returncode == 1
        assert ("Traceback" in found.stderr) is traced
        assert "poseviewer: Something went wrong inside (RuntimeError: boom)" in found.stderr
