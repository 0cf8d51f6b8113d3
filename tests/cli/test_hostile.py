"""Names and arguments that are meant to do harm, and errors that nobody foresaw."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.commands import refusal, run

ESCAPES = "\x1b[2J\x1b]0;owned\x07\u202e"


needs_pipes = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "line",
    [
        "fit ODD m.ply --pose start.json --out o.json",
        "convert ODD o.json",
        "batch ODD --out o",
        "app ODD m.ply",
        "fit p.png m.ply --pose start.json --out o.json --evaluations ODD",
        "ODD",
    ],
)
@pytest.mark.parametrize("value", ["x" * 100_000, ESCAPES, "a\udce4b.png", "-" + "9" * 5000])
def test_any_argument_gives_one_line_and_exit_code_2(line, value, capsys):
    assert refusal(capsys, line.replace("ODD", value)).startswith("poseviewer")


@needs_pipes
@pytest.mark.parametrize(
    "line",
    [
        "fit p.png m.ply --pairs odd.csv --out o.json",
        "fit --views odd.json m.ply --pose start.json --out o.json",
        "undistort p.png --calibration cameras.txt --out o.png",
        "batch odd.csv --out o",
        "info odd.glb",
    ],
)
@pytest.mark.usefixtures("folder")
def test_a_pipe_is_refused_wherever_a_file_is_wanted(line, capsys):
    (name,) = (word for word in line.split() if word.startswith(("odd", "cameras")))
    os.mkfifo(name)
    assert name in refusal(capsys, line)


@needs_pipes
@pytest.mark.parametrize(
    "line",
    [
        "fit p.png m.ply --pose start.json --out pipe.json",
        "convert start.json pipe.json --photo p.png --overwrite",
    ],
)
def test_what_is_no_regular_file_is_not_replaced(folder, capsys, line):
    os.mkfifo("pipe.json")
    assert "no regular file" in refusal(capsys, line)
    assert (folder / "pipe.json").is_fifo()


def test_names_that_are_no_text_can_be_used(folder: Path, capsys):
    photo, model, start, out = (
        os.fsdecode(name) for name in (b"f\xe4hre.png", b"\xe4.ply", b"\xe4.json", b"\xfc.json")
    )
    try:
        for name, old in ((photo, "p.png"), (model, "m.ply"), (start, "start.json")):
            shutil.copy(folder / old, name)
    except OSError:
        pytest.skip("this file system takes text alone")
    assert run("fit", photo, model, "--pose", start, "--out", out, "--evaluations", 40) == 0
    printed = capsys.readouterr()
    assert "\udce4" not in printed.out + printed.err
    assert json.loads((folder / out).read_text())["photo"]["file"] == "f?hre.png"
    assert [run("info", path) for path in (photo, model, out)] == [0, 0, 0]
    assert "f?hre.png" in capsys.readouterr().out
    assert run("overlay", photo, model, "--pose", out, "--out", "o.png") == 0
    assert run("convert", out, "t.json", "--to", "nerfstudio") == 0


def test_escapes_in_names_do_not_reach_the_terminal(tmp_path: Path, capsys):
    folder = tmp_path / f"a{ESCAPES}"
    folder.mkdir()
    model = folder / f"m{ESCAPES}.obj"
    names = f"mtllib {ESCAPES}.mtl\no thing{ESCAPES}\ng group{ESCAPES}\nusemtl stuff{ESCAPES}\n"
    model.write_text(names + "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2\nf 1 2 3\n")
    assert run("info", model) == 0
    assert run("info", folder / f"none{ESCAPES}.obj") == 2
    assert run("info", folder) == 2
    printed = capsys.readouterr()
    assert "thing?[2J" in printed.out
    for line in (printed.out + printed.err).splitlines():
        assert line.isprintable(), line


def test_half_a_character_in_a_pose_file_does_no_harm(folder: Path, capsys):
    data = json.loads((folder / "start.json").read_text())
    data["photo"] = {"file": "p\ud800.png", "width": 160, "height": 120}
    data["model"] = {"file": f"{ESCAPES}.ply", "unit": "m\udfff"}
    data["verdict"] = {"word": "found", "probability": 1, "evidence": {"\ud800": 1.0}}
    data["settings"] = {"\ud800": "\udc00"}
    (folder / "s.json").write_text(json.dumps(data))
    lines = ["info s.json", "fit p.png m.ply --pose s.json --out found.json --evaluations 40"]
    outs = {"poseviewer": "p.json", "nerfstudio": "n.json", "opencv": "o.yml"}
    lines += [f"convert s.json {out} --to {name}" for name, out in outs.items()]
    assert [run(line) for line in lines] == [0] * 5
    assert all((folder / out).read_bytes().decode() for out in outs.values())
    printed = capsys.readouterr()
    assert all(line.isprintable() for line in (printed.out + printed.err).splitlines())


def test_the_log_says_where_it_happened():
    script = (
        "from poseviewer.cli import info_command, main\n"
        "def fails(options): raise RuntimeError('boom')\n"
        "info_command.run = fails\n"
        "raise SystemExit(main.main(['info', 'p.png']))\n"
    )
    for log, traced in (("", False), ("1", True)):
        env = {**os.environ, "POSEVIEWER_LOG": log, "PYTHONPATH": str(Path(__file__).parents[2])}
        line = [sys.executable, "-c", script]
        found = subprocess.run(line, env=env, capture_output=True, text=True, check=False)
        assert found.returncode == 1
        assert ("Traceback" in found.stderr) is traced
        assert "poseviewer: Something went wrong inside (RuntimeError: boom)" in found.stderr


@pytest.mark.parametrize("link", [None, os.link, os.symlink], ids=["itself", "hard", "soft"])
@pytest.mark.parametrize(
    ("line", "own"),
    [
        ("overlay p.png m.ply --pose start.json --out ODD", "p.png"),
        ("fit p.png m.ply --pose start.json --out o.json --overlay ODD", "p.png"),
        ("fit p.png m.ply --pose start.json --out ODD", "m.ply"),
        ("fit p.png m.ply --pose start.json --out ODD", "start.json"),
        ("fit p.png m.ply --pose start.json --mask three.png --out ODD", "three.png"),
        ("fit three.scene.json --out ODD", "ball.ply"),
        ("undistort p.png --calibration camera.yml --out ODD", "camera.yml"),
        ("undistort p.png --calibration camera.yml --out ODD", "p.png"),
        ("convert start.json ODD --overwrite", "start.json"),
        ("batch jobs.csv --out .", "results.csv"),
    ],
)
def test_a_file_that_is_read_is_never_written_over(folder: Path, capsys, line, own, link):
    for name in ("camera.yml", "results.csv"):
        shutil.copy(folder / "jobs.csv", name)
    if own == "results.csv":
        line, link = line.replace("jobs.csv", own), None
    odd = own if link is None else f"odd{Path(own).suffix}"
    if link is not None:
        link(own, odd)
    before = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    assert run(line.replace("ODD", odd)) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert f"{odd}: is " in error
    assert "is read as an input" in error or ("is a link" in error and link is os.symlink)
    after = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    assert after == before


@pytest.mark.parametrize("own", ["texture.png", "paint.mtl"])
def test_files_that_a_model_names_are_not_written_over(folder: Path, capsys, own: str):
    (folder / "paint.mtl").write_text("newmtl paint\nmap_Kd texture.png\n")
    shutil.copy("p.png", "texture.png")
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
    (folder / "t.obj").write_text(f"mtllib paint.mtl\n{corners}usemtl paint\nf 1/1 2/2 3/3\n")
    before = (folder / own).read_bytes()
    out = "--out" if own == "paint.mtl" else "--out o.json --overlay"
    assert run(f"fit p.png t.obj --pose start.json --evaluations 40 {out} {own}") == 2
    assert f"{own}: is read as an input" in capsys.readouterr().err.splitlines()[-1]
    assert (folder / own).read_bytes() == before


def test_a_batch_writes_through_no_link(folder: Path):
    (folder / "mine").write_text("mine")
    for link in ("o/.at-work", "o/results.csv"):
        (folder / link).parent.mkdir(exist_ok=True)
        (folder / link).symlink_to(folder / "mine")
    line = "batch jobs.csv --out o --quiet --evaluations 40"
    assert run(line) == 2
    (folder / "o/results.csv").unlink()
    assert run(line) == 0
    (folder / "mine").unlink()
    run(line)
    assert not (folder / "mine").exists()


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("camera", "shift", "words"),
    [
        ({"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1e-29}}, 0.0, "camera.scale"),
        ({"type": "perspective", "perspective": {"yfov": 0.6}}, 9e29, "1.8e+30; wanted a number"),
    ],
)
def test_no_pose_is_written_that_cannot_be_read(capsys, camera, shift, words):
    nodes = [{"children": [1], "translation": [shift, 0, 0]}, {"translation": [shift, 0, 0]}]
    nodes[1]["camera"] = 0
    scene = {"asset": {"version": "2.0"}, "nodes": nodes, "cameras": [camera]}
    Path("c.gltf").write_text(json.dumps(scene))
    line = "convert --from gltf c.gltf o.json --photo p.png --model m.ply"
    assert words in refusal(capsys, line)
    assert not Path("o.json").exists()


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("closed", [(), (2,), (0, 1, 2)])
def test_closed_streams_and_settings_of_numba_do_no_harm(closed: tuple[int, ...]):
    line = "fit p.png m.ply --pose start.json --out o.json --overlay o.png --evaluations 40"
    lines = f"import os; [os.close(number) for number in {closed}]\n"
    lines += f"os.execv({sys.executable!r}, [{sys.executable!r}, '-m', 'poseviewer.cli.main'"
    lines += "".join(f", {word!r}" for word in line.split()) + "])"
    strange = {"NUMBA_DISABLE_JIT": "1", "NUMBA_NUM_THREADS": "0"}
    python_path = os.pathsep.join([str(Path(__file__).parents[2]), *sys.path])
    env = {**os.environ, "PYTHONPATH": python_path, **strange}
    assert subprocess.run([sys.executable, "-c", lines], env=env, check=False).returncode == 0
    assert run("info", "o.json") == run("info", "o.png") == 0


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("number", ["9" * 5000, "²"])
def test_a_number_that_is_none_is_said(capsys, number):
    named = "convert start.json o --to bop --photo p.png --model m.ply"
    for option in ("--object", "--image"):
        assert "went wrong" not in refusal(capsys, named, option, number)
    shutil.copy("p.png", "²²².png")
    cameras = {str(key): {"cam_K": [9 * key, 0, 1, 0, 9, 1, 0, 0, 1]} for key in (1, 2)}
    Path("scene_camera.json").write_text(json.dumps(cameras))
    line = "info ²²².png --calibration scene_camera.json"
    assert "choose one with --calibration-camera NAME" in refusal(capsys, line)
