"""``--calibration``: a photo taken through a lens, and all that is written of it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from poseviewer.api import load
from poseviewer.errors import CalibrationFileError
from poseviewer.files.camera_forms import READ
from poseviewer.files.cameras import Calibration
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_calibrated_photo, load_photo, save_image, undistort_photo
from poseviewer.files.pose import load_pose, save_pose
from poseviewer.geometry.camera import Parallel, Perspective
from poseviewer.geometry.lens import Lens, Undistortion, same_undistortion
from poseviewer.geometry.pose_error import pose_error
from tests.commands import run
from tests.lenses import as_taken, write_camera
from tests.schemas import load_valid

TAKEN = Perspective(300.0, 300.0, 83.0, 58.0, 160, 120)
LENSES = {
    "opencv": Lens("opencv", (-0.9, 0.0, 0.0, 0.0, 0.0)),
    "fisheye": Lens("fisheye", (-0.6, 0.0, 0.0, 0.0)),
}
FIT = "fit taken.png m.ply --quiet"


def take(folder: Path, lens: Lens) -> Calibration:
    """Write ``p.png`` as a lens takes it, ``taken.png``, and ``camera.yml`` as OpenCV writes it."""
    pixels, undistortion = load_photo(folder / "p.png").pixels, Undistortion.of(lens, TAKEN)
    save_image(folder / "taken.png", as_taken(undistortion, pixels))
    return Calibration(write_camera(folder / "camera.yml", TAKEN, lens))


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_a_fit_through_a_lens_finds_the_pose_and_says_whose_it_is(folder, lens):
    take(folder, lens)
    line = f"{FIT} --pose start.json --calibration camera.yml --out out.json"
    assert run(*line.split()) == 0
    found, truth = load_pose(folder / "out.json"), load_pose(folder / "true.json").pose
    assert pose_error(load_mesh(folder / "m.ply"), found.pose, truth).reprojection_px < 1.0
    assert same_undistortion(found.undistortion, Undistortion.of(lens, TAKEN))
    data = load_valid(folder / "out.json", "pose")
    assert "undistorted photo" in data["distortion"]["note"]
    assert data["distortion"]["coefficients"] == list(lens.coefficients)
    assert data["photo"]["sha256"] == load_photo(folder / "taken.png").sha256


def test_a_pose_file_undistorts_its_photo_by_itself(folder):
    take(folder, LENSES["opencv"])
    lines = ("--pose true.json --calibration camera.yml --out a.json",
             "--pose a.json --out b.json", "--pose true.json --out c.json")  # fmt: skip
    for line in lines:
        assert run(*f"{FIT} --evaluations 1 {line}".split()) == 0
    one, two, bent = (json.loads((folder / f"{name}.json").read_text()) for name in "abc")
    assert two["loss"] == pytest.approx(one["loss"], abs=1e-6)
    assert two["distortion"] == one["distortion"]
    assert bent["loss"] > one["loss"] + 0.02


def test_the_calibrated_camera_stands_in_for_the_starts(folder, capsys):
    calibration = take(folder, LENSES["opencv"])
    start = load_pose(folder / "start.json", 160, 120)
    cameras = {
        "guess": replace(start.pose.camera, fx=200.0, fy=200.0),
        "flat": Parallel(40.0, 80.0, 60.0, 160, 120),
    }
    for name, camera in cameras.items():
        save_pose(f"{name}.json", start.with_pose(replace(start.pose, camera=camera)))
    found = load("taken.png", "m.ply", "guess.json", calibration=calibration)
    assert found.views[0].camera == TAKEN
    assert any("fx 300.0" in note and "fx 200.0" in note for note in found.notes)
    line = "overlay taken.png m.ply --pose flat.json --calibration camera.yml --out o.png"
    assert run(*line.split()) == 2
    assert "parallel projection" in capsys.readouterr().err


def test_pixels_that_the_photo_does_not_show_count_nothing(folder):
    calibration = take(folder, Lens("opencv", (2.0, 0.0, 0.0, 0.0, 0.0)))  # pincushion
    found = load("taken.png", "m.ply", "start.json", calibration=calibration, pixels="whole")
    covered = found.photo.covered
    assert covered is not None
    np.testing.assert_array_equal(found.problem.photo.weights > 0, covered)
    assert 0.1 < covered.mean() < 0.9


def test_undistort_writes_the_photo_that_poses_belong_to(folder, capsys):
    calibration = take(folder, LENSES["fisheye"])
    for name in ("flat.png", "flat.jpg"):
        assert run("undistort", "taken.png", "--calibration", "camera.yml", "--out", name) == 0
        assert "fx 300, fy 300, cx 82.5" in capsys.readouterr().out
    wanted = load_calibrated_photo("taken.png", calibration).pixels
    np.testing.assert_array_equal(load_photo("flat.png").pixels, wanted)
    original, bent = (load_photo(name).pixels.astype(int) for name in ("p.png", "taken.png"))
    off = [np.abs(pixels - original)[20:100, 20:140] for pixels in (wanted.astype(int), bent)]
    assert np.mean(off[0] > 20) < 0.2 * np.mean(off[1] > 20)


def test_a_camera_without_distortion_leaves_the_photo_as_it_is(folder, capsys):
    bop = {"fx": 300.0, "fy": 300.0, "cx": 82.5, "cy": 57.5, "width": 160, "height": 120}
    (folder / "camera.json").write_text(json.dumps(bop))
    line = "fit p.png m.ply --pose start.json --calibration camera.json --out o.json --quiet"
    assert run(*line.split()) == 0
    assert "distortion" not in json.loads((folder / "o.json").read_text())
    assert run("undistort", "p.png", "--calibration", "camera.json", "--out", "u.png") == 2
    assert "nothing to undo" in capsys.readouterr().err


def test_a_lens_that_shows_nothing_is_refused(folder):
    camera = Perspective(300.0, 300.0, 5000.0, 5000.0, 160, 120)
    lens = Lens("opencv", (-900.0, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(CalibrationFileError, match="shows nothing"):
        undistort_photo(load_photo(folder / "p.png"), Undistortion.of(lens, camera))


def test_the_camera_of_the_stored_pixels_is_turned_with_the_photo(folder, capsys):
    """The photo is stored as 160x120 px and shown as 120x160."""
    exif = Image.Exif()
    exif[0x0112] = 6
    with Image.open("p.png") as stored:
        stored.save("turned.png", exif=exif)
    numbers = {"fx": 300.0, "fy": 310.0, "cx": 82.5, "cy": 57.5}
    upright = {"fx": 310.0, "fy": 300.0, "cx": 61.5, "cy": 82.5, "width": 120, "height": 160}
    for said in (numbers | {"width": 160, "height": 120}, numbers, upright):
        (folder / "c.json").write_text(json.dumps(said))
        assert run("info", "turned.png", "--calibration", "c.json") == 0
        printed = capsys.readouterr().out
        assert "fx 310, fy 300, cx 61.5, cy 82.5" in printed
        assert "from c.json" in printed  # and the keys
        assert "turned.png is stored turned (EXIF), its camera" in printed
        assert ("belongs to the stored pixels" in printed) == (said is not upright)
    (folder / "cameras.txt").write_text("1 OPENCV 160 120 300 310 83 58 -0.1 0.02 0.003 0.004\n")
    assert run("info", "turned.png", "--calibration", "cameras.txt") == 0
    assert "opencv, -0.1, 0.02, 0.004, -0.003, 0" in capsys.readouterr().out


def test_the_help_and_a_refusal_say_whose_cameras_are_read(folder, capsys):
    assert run("info", "--calibration", "--help") == 0
    shown = capsys.readouterr().out
    (folder / "c.json").write_text("{}")
    assert run("info", "p.png", "--calibration", "c.json") == 2
    refused = capsys.readouterr().err
    for tools, files, keys in READ:
        assert f"{tools} ({files}):\n    {keys}" in shown
        assert tools in refused


@pytest.mark.parametrize("ending", ["dae2", "iges", "fbx"])
def test_info_of_a_model_that_is_not_read_says_so(folder, ending, capsys):
    (folder / f"part.{ending}").write_text("ISO-10303")
    assert run("info", f"part.{ending}") == 2
    assert f"unknown kind of model file '.{ending}'" in capsys.readouterr().err
