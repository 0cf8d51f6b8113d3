"""``--calibration`` as a user meets it: a photo taken through a lens, and all that is written."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import jsonschema
import numpy as np
import pytest

from poseviewer.errors import CalibrationFileError
from poseviewer.files.cameras import Calibration
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_calibrated_photo, load_photo, same_undistortion, save_image
from poseviewer.files.pose import load_pose, save_pose
from poseviewer.fit.problem import make_problem
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.camera import Parallel, Perspective
from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.geometry.pose_error import pose_error
from poseviewer.starts.loading import open_photo
from tests.commands import run
from tests.lenses import from_taken
from tests.scene import Scene
from tests.schemas import json_schema

TAKEN = Perspective(300.0, 300.0, 83.0, 58.0, 160, 120)
LENSES = {
    "opencv": Lens("opencv", (-0.9, 0.0, 0.0, 0.0, 0.0)),
    "fisheye": Lens("fisheye", (-0.6, 0.0, 0.0, 0.0)),
}


def taken_through(lens: Lens, scene: Scene, folder: Path) -> tuple[Path, Path]:
    """The scene's photo as a lens takes it, and its calibration as OpenCV writes it."""
    pixels = np.array(load_photo(scene.photo).pixels, np.uint8)
    v, u = np.mgrid[:120, :160] + 0.5
    seen = from_taken(Undistortion.of(lens, TAKEN), np.stack([u, v], -1).reshape(-1, 2)) - 0.5
    maps = seen.reshape(120, 160, 2).astype(np.float32)
    assert np.abs(maps - np.stack([u, v], -1) + 0.5).max() > 5.0
    photo, calibration = folder / "taken.png", folder / "camera.yml"
    save_image(photo, cv2.remap(pixels, maps[..., 0], maps[..., 1], cv2.INTER_CUBIC))
    storage = cv2.FileStorage(str(calibration), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", 160), ("image_height", 120)):
        storage.write(name, value)
    storage.write("fisheye_model", int(lens.model == "fisheye"))
    storage.write("camera_matrix", np.array([[300, 0, 82.5], [0, 300, 57.5], [0, 0, 1.0]]))
    storage.write("distortion_coefficients", lens.array)
    storage.release()
    return photo, calibration


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_a_fit_through_a_lens_finds_the_pose_and_says_whose_it_is(scene, tmp_path, lens):
    photo, calibration = taken_through(lens, scene, tmp_path)
    out = tmp_path / "pose.json"
    assert run("fit", photo, scene.model, "--pose", scene.start, "--calibration", calibration,
               "--out", out, "--quiet") == 0  # fmt: skip
    mesh, truth = load_mesh(scene.model), load_pose(scene.truth, 160, 120).pose
    found = load_pose(out, 160, 120)
    assert pose_error(mesh, found.pose, truth).reprojection_px < 1.0
    assert same_undistortion(found.undistortion, Undistortion.of(lens, TAKEN))
    data = json.loads(out.read_text())
    jsonschema.validate(data, json_schema("pose"))
    assert "undistorted photo" in data["distortion"]["note"]
    assert data["distortion"]["coefficients"] == list(lens.coefficients)
    assert data["photo"]["sha256"] == load_photo(photo).sha256


def test_a_pose_file_undistorts_its_photo_by_itself(scene, tmp_path):
    """The same loss comes out, with the calibration or with the pose file that was made by it."""
    photo, calibration = taken_through(LENSES["opencv"], scene, tmp_path)
    first, second = tmp_path / "a.json", tmp_path / "b.json"
    head = ("fit", photo, scene.model, "--evaluations", 1, "--quiet", "--pose")
    assert run(*head, scene.truth, "--calibration", calibration, "--out", first) == 0
    assert run(*head, first, "--out", second) == 0
    one, two = (json.loads(path.read_text()) for path in (first, second))
    assert two["loss"] == pytest.approx(one["loss"], abs=1e-6)
    assert two["distortion"] == one["distortion"]
    assert run(*head, scene.truth, "--out", tmp_path / "c.json") == 0
    assert json.loads((tmp_path / "c.json").read_text())["loss"] > one["loss"] + 0.02


def test_the_calibrated_camera_stands_in_for_the_starts(scene, tmp_path, capsys):
    _, calibration = taken_through(LENSES["opencv"], scene, tmp_path)
    start = load_pose(scene.start, 160, 120)
    camera = replace(start.pose.camera, fx=200.0, fy=200.0)
    save_pose(tmp_path / "guess.json", replace(start, pose=replace(start.pose, camera=camera)))
    found = open_photo(
        tmp_path / "taken.png",
        scene.model,
        tmp_path / "guess.json",
        calibration=Calibration(calibration),
    )
    assert found.views[0].camera == TAKEN
    assert any("fx 300.0" in note and "fx 200.0" in note for note in found.notes)
    flat = replace(start, pose=replace(start.pose, camera=Parallel(40.0, 80.0, 60.0, 160, 120)))
    save_pose(tmp_path / "flat.json", flat)
    assert run("overlay", tmp_path / "taken.png", scene.model, "--pose", tmp_path / "flat.json",
               "--calibration", calibration, "--out", tmp_path / "o.png") == 2  # fmt: skip
    assert "parallel projection" in capsys.readouterr().err


def test_pixels_that_the_photo_does_not_show_count_nothing(scene, tmp_path):
    pincushion = Lens("opencv", (2.0, 0.0, 0.0, 0.0, 0.0))
    _, calibration = taken_through(pincushion, scene, tmp_path)
    choice = Calibration(calibration)
    settings = FitSettings(pixels="whole")
    found = open_photo(tmp_path / "taken.png", scene.model, scene.start, settings, choice)
    covered = found.views[0].photo.covered
    assert covered is not None
    problem, _ = make_problem(found)
    np.testing.assert_array_equal(problem.photo.weights > 0, covered)
    assert 0.1 < covered.mean() < 0.9


def test_undistort_writes_the_photo_that_poses_belong_to(scene, tmp_path, capsys):
    photo, calibration = taken_through(LENSES["fisheye"], scene, tmp_path)
    for name in ("flat.png", "flat.jpg"):
        assert run("undistort", photo, "--calibration", calibration, "--out", tmp_path / name) == 0
        assert "fx 300, fy 300, cx 82.5" in capsys.readouterr().out
    wanted = load_calibrated_photo(photo, Calibration(calibration)).pixels
    np.testing.assert_array_equal(load_photo(tmp_path / "flat.png").pixels, wanted)
    assert (tmp_path / "flat.jpg").is_file()
    original = load_photo(scene.photo).pixels.astype(int)
    middle = np.s_[20:100, 20:140]
    back, bent = (
        np.abs(p.astype(int) - original)[middle] for p in (wanted, load_photo(photo).pixels)
    )
    assert np.mean(back > 20) < 0.2 * np.mean(bent > 20)


def test_a_camera_without_distortion_leaves_the_photo_as_it_is(scene, tmp_path, capsys):
    bop = {"fx": 300.0, "fy": 300.0, "cx": 82.5, "cy": 57.5, "width": 160, "height": 120}
    (tmp_path / "camera.json").write_text(json.dumps(bop))
    out = tmp_path / "pose.json"
    assert run("fit", scene.photo, scene.model, "--pose", scene.start, "--calibration",
               tmp_path / "camera.json", "--evaluations", 1, "--out", out) == 0  # fmt: skip
    assert "distortion" not in json.loads(out.read_text())
    capsys.readouterr()
    assert run("undistort", scene.photo, "--calibration", tmp_path / "camera.json", "--out",
               tmp_path / "u.png") == 2  # fmt: skip
    assert "nothing to undo" in capsys.readouterr().err


def test_a_lens_that_shows_nothing_is_refused(scene, tmp_path):
    matrix = [[300, 0, 5000.0], [0, 300, 5000.0], [0, 0, 1]]
    data = {"K": matrix, "D": [-900.0, 0.0, 0.0, 0.0, 0.0]}
    (tmp_path / "c.json").write_text(json.dumps(data))
    with pytest.raises(CalibrationFileError, match="shows nothing"):
        load_calibrated_photo(scene.photo, Calibration(tmp_path / "c.json"))
