"""Every command, with its configurations: what it prints and writes, or refuses in one line."""

import json
import subprocess
import sys
from argparse import ArgumentTypeError
from pathlib import Path

import numpy as np
import pytest

from poseviewer.cli import main as cli
from poseviewer.cli.options import READERS, RECTANGLE
from tests.commands import refusal, run
from tests.videos import pictures, turn_video, widen_pixels, write_jpegs, write_video

FIT = "fit p.png m.ply --pose start.json --out o.json"
SET = "--views set/set.json set/m.ply --pose set/start.json"
LOCK = "--lock rotation_x,rotation_y,shift_x,shift_y"
MAPS = "--size 3 --quiet"
PAPER = "--method paper"
WITH_SCENE = "with three.scene.json, which says it itself"


@pytest.mark.parametrize(
    ("line", "words", "written"),
    [
        (f"{FIT} --evaluations 25 --quiet", "25 evaluations|raise --evaluations N.", "o.json"),
        ("overlay p.png m.ply --pose true.json --out o.png --quiet", "overlay: o.png", "o.png"),
        (f"overlay {SET} --out o.png --quiet", "o.c.png", "o.a.png o.b.png o.c.png"),
        (f"landscape p.png m.ply --pose true.json --out in/maps {MAPS} --range 0.1",
         "maps: in/maps/landscape.png", "in/maps/landscape.png in/maps/landscape.npz"),
        (f"landscape {SET} --out maps {MAPS} {LOCK}", "", "maps/landscape.png"),
        (f"landscape three.scene.json --object ball --out maps {MAPS}", "landscape.npz",
         "maps/landscape.npz"),
        ("info p.png", "160 x 120 px|colour|50 degrees", ""),
        ("info m.ply", "1,280 on|vertices|free-body", ""),
        ("info start.json", "perspective|fx 300|cx 82.5", ""),
        ("info three.scene.json", "three.png, 320 x 240 px|front: front.ply at (", ""),
    ],
)  # fmt: skip
def test_a_command_says_and_writes_its_results(folder, capsys, line, words, written):
    assert run(line) == 0
    printed = capsys.readouterr()
    assert all(word in printed.out for word in words.split("|")), printed.out
    assert printed.err == ""
    assert all((folder / name).stat().st_size > 500 for name in written.split())


def test_landscape_maps_the_loss_that_is_named(folder):
    largest = {}
    for loss in ("default", "paper"):
        line = f"landscape p.png m.ply --pose true.json --out {loss} {MAPS} --loss {loss}"
        assert run(line) == 0
        with np.load(folder / loss / "landscape.npz") as maps:
            largest[loss] = float(np.max(maps["losses"]))
    assert largest["paper"] <= 1.0 < largest["default"]  # min(n, m) is 1 of grey


def test_fit_says_once_that_an_object_is_not_placed(folder, capsys):
    scene = json.loads((folder / "three.scene.json").read_text())
    scene["objects"][0]["placed"] = False
    (folder / "unplaced.scene.json").write_text(json.dumps(scene))
    assert run("fit unplaced.scene.json --out o.json --evaluations 5") == 0
    said = capsys.readouterr()
    assert "is not placed: no search moves it" in said.err + said.out
    assert "stands wholly behind others" not in said.out


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (f"{FIT} --chart vehicle", "keypoints.json"),
        (f"{FIT} --lock mu_x", "no such parameter"),
        (
            f"{FIT} --lock rotation_x,rotation_y,rotation_z,shift_x,shift_y,log_depth",
            "leave one out of --lock NAME",
        ),
        (f"{FIT} --region 500,500,10,10", "no pixel"),
        (f"{FIT} --region 1,2,3", "left,top,width,height"),
        (f"{FIT} --evaluations many", "many is not a whole number above 0"),
        (f"{FIT} --overlay /no/such/folder/x.png", "no folder"),
        (f"{FIT} --look fancy", "outline"),
        (f"{FIT} {PAPER} --pixels near", "--pixels"),
        (f"{FIT} {PAPER} --colour-reflectance", "--colour-reflectance"),
        (f"{FIT} --size 3", "--size 3; see poseviewer fit --help"),
        (f"{FIT} --scale 2", "--scale without --views"),
        (f"{FIT} --object ball", "--object without a scene"),
        ("fit p.png m.ply --pose start.json --out set", "is a folder"),
        ("fit none.json --out o.json", "none.json: no such file"),
        ("overlay start.json --out o.png", "name them: PHOTO MODEL --pose start.json"),
        ("fit p.png m.ply --pose none.csv --out o.json", "a table or a text"),
        ("info p.png --calibration none.xmp", "external parameters as CSV"),
        ("track f_%04d.png m.ply --pose start.json --out o", "name the folder of the images"),
        ("fit --pose three.scene.json --out o.json", "PHOTO and MODEL are wanted"),
        ("fit three.scene.json --pose p.json --out o.json", f"--pose {WITH_SCENE}"),
        ("fit three.scene.json --mask m.png --out o.json", f"--mask {WITH_SCENE}"),
        ("fit three.scene.json --object who --out o.json", "no object 'who' in"),
        ("fit three.scene.json --free-focal --out o.json", "share one camera"),
        ("fit three.scene.json --free-principal-point --out o.json", "share one camera"),
        (f"{FIT} --free-principal-point", "one photo of one object cannot tell"),
        ("fit --views set/set.json a.png set/m.ply --out o.json", "wants MODEL alone"),
        ("fit --views set/set.json set/m.ply --start auto --out o.json", "a start with --pose"),
        (f"fit {SET} --view z.png --out o.json", "no photo z.png"),
        ("landscape three.scene.json --out o", "several objects; say which"),
        ("landscape --views set/set.json set/m.ply --out o", "--pose"),
        ("landscape p.png m.ply --pose start.json --out p.png --quiet", "folder of yours"),
        ("convert three.scene.json o.yml --from scene --to opencv", "choose an object"),
        ("convert named.json o --to bop --photo none.png", "none.png: no such file"),
        ("convert named.json o --to gltf", "end in .glb"),
        ("convert named.json o.txt --to opencv", ".yaml"),
        ("convert none.json o.yml --to opencv", "no such file"),
        ("convert named.json o.json --from opencv", "rvec"),
        ("convert named.json o --to nothing", "invalid choice"),
        ("convert named.json o --photo-size 20", "1920x1080"),
        ("convert named.json o --photo-size 100x75", "200x150"),
        ("convert named.json o.glb --to gltf --model m.ply --photo p.png", "160x120"),
        ("convert named.json named.json", "--overwrite"),
        (f"{FIT} --chart vehicle", "--chart free-body"),
        (
            f"{FIT} --free-principal-point",
            "--free-principal-point with one photo",
        ),
        ("study --out o --kinds plain,snow", "snow is not one of plain, background"),
        ("study --out o --readings both", "both"),
        ("study --out o --deviations 1,150", "150"),
        ("study --out o --size 10x10", "--size"),
        ("study --out o --model none.ply", "none.ply"),
        ("study --out o --degrees 5", "--degrees goes with --real"),
        ("study --out o --paper --pixels near", "--loss paper with --pixels near"),
        ("study --out o --real none --paper", "--paper goes with synthetic"),
        ("study --out o --real none --photos 3", "--photos goes with synthetic"),
        ("study --out o --real none --bop none", "two studies"),
        (f"study --out o {PAPER} --pixels near", "--pixels"),
        ("study --out o --real set", "starts.json"),
        ("batch none.csv --out o", "no such file"),
        ("batch jobs.csv --out m.ply", "name a folder of yours"),
        ("undistort p.png --out u.png", "give --calibration"),
        ("bench --quick --json set", "is a folder"),
        ("photo.jpg", "name PHOTO and MODEL"),
        ("--pose pose.json", "name all three"),
        ("bad.scene.json", "bad.scene.json: "),  # before there is a page
    ],
)
def test_what_cannot_work_is_said_in_a_line_before_any_work(folder, capsys, line, words):
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    assert words in refusal(capsys, line)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before


@pytest.mark.parametrize(
    ("shown", "text", "wanted", "refused"),
    [
        ("WIDTHxHEIGHT", "640X480", (640, 480), ("", "640", "0x4", "4x-1", "4x4x4")),
        (RECTANGLE, "1,-2,30,40", (1, -2, 30, 40), ("", "1,2,3", "1,2,3,4.5")),
        ("SECONDS", "1e-4", 1e-4, ("0", "-1", "nan", "inf", "a")),
        ("N", "7", 7, ("0", "1.5", "")),
        ("PORT", "0", 0, ("-1", "65536", "a")),
        ("SEED", "0", 0, ("-1", "1.5", "")),
        ("POINTS", "9", 9, ("8", "1", "403")),
        ("N,...", "5, 15", (5, 15), ("5,,15",)),
        ("NAME,...", "a, b,", ("a", "b"), ()),
    ],
)
def test_values_are_read_or_refused(shown, text, wanted, refused):
    assert READERS[shown](text) == wanted
    for other in refused:
        with pytest.raises(ArgumentTypeError):
            READERS[shown](other)


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


@pytest.mark.parametrize(
    ("code", "heavy"),
    [
        ("from poseviewer.cli.main import COMMANDS, make_parser;"
         "[make_parser(name) for name in COMMANDS if name != 'convert']",
         {"numpy", "scipy", "cv2", "numba", "trimesh", "viser", "matplotlib"}),
        ("import poseviewer.app.app",
         {"numba", "scipy.stats", "trimesh", "matplotlib", "pyrender", "pandas"}),
    ],
    ids=["help", "app"],
)  # fmt: skip
def test_nothing_is_imported_that_can_wait(code: str, heavy: set[str]):
    command = [sys.executable, "-c", f"{code}; import sys; print(*sys.modules)"]
    ended = subprocess.run(command, check=True, capture_output=True, text=True)
    assert not heavy & set(ended.stdout.split())


def test_info_says_what_a_video_is(tmp_path, capsys):
    clip = write_video(tmp_path / "clip.mp4", 20)
    turn_video(clip)
    widen_pixels(clip, 4, 3)
    assert run("info", clip) == 0
    assert capsys.readouterr().out.splitlines() == [
        "video:       clip.mp4",
        "size:        48 x 85 px, of 48 x 64 px that are not square",
        "frames:      20 in the file, 25 a second",
        "length:      0.8 s",
        "turned:      by 90 degrees clockwise, which the size says already",
        "codec:       FMP4",
    ]
    recorded = write_jpegs(tmp_path / "clip.webm", pictures(3), [0, 244, 960])
    assert run("info", recorded) == 0
    assert "frames:      3 in the file, 2.083 a second" in capsys.readouterr().out
    clip.write_bytes(b"no video")
    assert "clip.mp4: not a video that can be read" in refusal(capsys, "info", clip)
