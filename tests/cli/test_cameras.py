"""``poseviewer cameras``: a set is written, says what it is, and is fitted in."""

import json
from pathlib import Path

import numpy as np
import pytest

from poseviewer.errors import SettingsError
from poseviewer.files.photo import save_image
from poseviewer.files.pose import PoseRecord, save_pose
from poseviewer.files.scene_json import load_scene
from poseviewer.files.structs import PhotoReference
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.lens import Lens
from poseviewer.geometry.transform import RigidTransform
from poseviewer.opening.photo_sets import load_views
from poseviewer.still.still_cameras import find_cameras
from tests.commands import refusal, run
from tests.lenses import write_camera
from tests.meshes import make_box
from tests.moving import ball, box, sequence, write_sequence
from tests.several import save_model
from tests.still_scene import CAMERA, MARKER, MARKERS, arc, draw, errors, room, write_pictures
from tests.videos import write_pictures as write_film
from tests.writing import write

CAMERAS = arc(4, 30.0)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("table")
    write_pictures(folder, CAMERAS, MARKERS, boxes=())
    write_camera(folder / "camera.yml", CAMERA, Lens("opencv", (0.0, 0.0, 0.0, 0.0)))
    return folder


def command(folder: Path, out: Path, *more: object) -> int:
    words = "--marker-size", MARKER, "--unit", "m", "--calibration", folder / "camera.yml"
    return run("cameras", folder, "--out", out, *words, *more)


@pytest.mark.slow
def test_a_set_is_written_and_fitted_in_and_no_set_is_replaced(pictures, tmp_path, capsys):
    out = tmp_path / "set"
    assert command(pictures, out) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "4 of 4 pictures have cameras, by markers"
    assert "scale: known, in m" in said
    assert said[-1] == f"set: {out / 'set.json'}"
    data = json.loads((out / "set.json").read_text())
    assert data["unit"] == "m"
    assert not data.get("objects")
    found = load_views(out)
    assert [view.file.location.resolve() for view in found.views] == sorted(pictures.glob("*.png"))
    assert errors([view.camera_from_world for view in found.views], CAMERAS, 1.0)[1] < 1.0
    # A box of a print of its own, where there is none: the pose is read by the set's camera.
    save_model(tmp_path / "m.ply", make_box((0.1, 0.1, 0.1)))
    place = RigidTransform(np.eye(3), np.array([0.0, 0.0, 0.8]))
    pose = PoseRecord.of(Pose(found.views[0].camera, place), PhotoReference("0000.png", 320, 240))
    save_pose(tmp_path / "start.json", pose)
    words = "--pose", tmp_path / "start.json", "--evaluations", 5, "--out", tmp_path / "found.json"
    assert run("fit", "--views", out, tmp_path / "m.ply", *words) == 0
    assert len(load_scene(tmp_path / "found.json").views) == 4
    before = (out / "set.json").read_bytes()
    capsys.readouterr()
    sentence = refusal(capsys, "cameras", pictures, "--out", out)
    assert "set.json: is there already" in sentence
    assert "--overwrite" in sentence
    assert (out / "set.json").read_bytes() == before
    assert command(pictures, out, "--by", "markers", "--overwrite") == 0


def test_frames_of_a_clip_lie_in_the_set(pictures, tmp_path):
    shown = [draw([room(), *MARKERS], place, seed=i) for i, place in enumerate(CAMERAS)]
    clip = write_film(tmp_path / "clip.mp4", shown)
    out = tmp_path / "set"
    words = "--every", 2, "--calibration", pictures / "camera.yml", "--quiet"
    assert run("cameras", clip, "--out", out, "--by", "markers", *words) == 0
    names = [view.path for view in load_scene(out / "set.json").views]
    assert names == [out / "images" / "000000.jpg", out / "images" / "000002.jpg"]
    assert json.loads((out / "set.json").read_text())["free_scale"] is True


def test_an_object_that_was_followed_gives_the_cameras(tmp_path, capsys):
    scene = sequence({0: [ball(0), box(0)], 2: [ball(2), box(2)]}, drawn=(ball, box), count=4)
    path = write_sequence(tmp_path, scene)
    words = "cameras", path, "--by", "object", "--out", tmp_path / "set"
    assert "2 objects, a, b; name the one" in refusal(capsys, *words)
    assert run(*words, "--object", "a") == 0
    said = capsys.readouterr().out
    assert "2 of 4 pictures have cameras, by object" in said
    assert "left out: 1.png, 3.png: no pose of" in said
    views = load_scene(tmp_path / "set" / "set.json").views
    for view, index in zip(views, (0, 2), strict=True):
        true = ball(index).pose.camera_from_model
        np.testing.assert_allclose(view.camera_from_world.as_matrix(), true.as_matrix(), atol=1e-9)


def test_what_cannot_be_is_refused_in_a_sentence(pictures, tmp_path, capsys):
    def refused(*words: object) -> str:
        said = refusal(capsys, "cameras", "--out", tmp_path / "new" / "set", *words)
        assert not (tmp_path / "new").exists()
        return said

    assert "no picture in it" in refused(tmp_path)
    save_image(tmp_path / "one.png", np.zeros((20, 20, 3), np.uint8))
    assert "1 picture; wanted two" in refused(tmp_path)
    assert "--by object" in refused(pictures, "--by", "object")
    assert "--object" in refused(pictures, "--object", "a")
    assert "--unit yd: wanted one of km, m" in refused(pictures, "--unit", "yd")
    assert "without the markers' size" in refused(pictures, "--unit", "m")
    with pytest.raises(SettingsError, match="wanted a number above 0"):
        next(iter(find_cameras([pictures, pictures], marker_size=float("nan"))))
    grid = {"tagCols": 6, "tagRows": 6, "tagSize": 0.08, "tagSpacing": 0.3}
    board = write(tmp_path / "grid.json", grid)
    assert "with features" in refused(pictures, "--by", "features", "--board", board)
    assert "the size out" in refused(pictures, "--board", board, "--marker-size", 1)
    assert "no board of markers" in refused(pictures, "--board", write(board, {}))
    (tmp_path / "mine").mkdir()
    assert "1 picture" in refusal(capsys, "cameras", tmp_path, "--out", tmp_path / "mine")
    assert (tmp_path / "mine").is_dir()
