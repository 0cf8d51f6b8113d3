"""``poseviewer convert`` as a user meets it: files, what is printed, one-line errors."""

from __future__ import annotations

import json

import cv2
import jsonschema
import numpy as np
import pytest
from PIL import Image

from poseviewer.files.pose import load_pose, save_pose
from poseviewer.files.scene_file import load_scene
from tests.commands import run
from tests.files.formats.cases import HEIGHT, WIDTH, perspective_record, write_files
from tests.schemas import json_schema


@pytest.fixture
def pose(tmp_path):
    """A pose file with its photo and model beside it."""
    write_files(tmp_path)
    save_pose(tmp_path / "pose.json", perspective_record())
    return tmp_path / "pose.json"


def test_there_and_back(pose, tmp_path, capsys):
    out, back = tmp_path / "model", tmp_path / "back.json"
    assert run("convert", pose, "--to", "colmap", out) == 0
    assert str(out / "images.txt") in capsys.readouterr().out
    assert run("convert", out, "--from", "colmap", back, "--unit", "m") == 0
    data = json.loads(back.read_text())
    jsonschema.validate(data, json_schema("pose"))
    assert data["photo"] == {"file": "000003.png", "width": WIDTH, "height": HEIGHT}
    assert data["model"] == {"unit": "m"}
    found = load_pose(back, WIDTH, HEIGHT).pose.camera_from_model.translation
    assert found.tolist() == pytest.approx([0.15, -0.1, 6.0], abs=1e-12)
    files = ("--photo", tmp_path / "000003.png", "--model", tmp_path / "obj_000005.ply")
    assert (
        run("convert", out, "--from", "colmap", "--to", "scene", tmp_path / "s.json", *files) == 0
    )
    again = load_scene(tmp_path / "s.json").pose(0).camera_from_model.translation
    assert again.tolist() == found.tolist()


def test_a_photo_that_is_stored_turned_is_told(pose, tmp_path, capsys):
    """poseviewer shows photos upright, by EXIF; other tools show what is stored."""
    exif = Image.Exif()
    exif[0x0112] = 6  # a quarter turn
    with Image.open(tmp_path / "000003.png") as upright:
        stored = upright.transpose(Image.Transpose.ROTATE_90)
    stored.save(tmp_path / "turned.jpg", exif=exif)
    named = ("--photo", tmp_path / "turned.jpg")
    assert run("convert", pose, "--to", "meshlab", tmp_path / "out.mlp", *named) == 0
    assert "turned.jpg is stored turned" in capsys.readouterr().out
    assert run("convert", pose, "--to", "gltf", tmp_path / "out.glb", *named) == 0
    assert "turned" not in capsys.readouterr().out


def test_files_that_are_named_come_first(pose, tmp_path):
    other = tmp_path / "elsewhere"
    other.mkdir()
    (other / "photo.png").write_bytes((tmp_path / "000003.png").read_bytes())
    out = tmp_path / "transforms.json"
    assert run("convert", pose, "--to", "nerfstudio", out, "--photo", other / "photo.png") == 0
    assert json.loads(out.read_text())["frames"][0]["file_path"] == "elsewhere/photo.png"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("POSE --to bop OUT --photo none.png", "none.png: no such file"),
        ("POSE --to gltf OUT", "end in .glb"),
        ("POSE --to opencv OUT.txt", ".yaml"),
        ("none.json --to opencv OUT.yml", "no such file"),
        ("POSE --from opencv OUT.json", "camera_matrix"),
        ("POSE --to nothing OUT", "invalid choice"),
        ("POSE --photo-size 20 OUT", "1920x1080"),
        ("POSE --photo-size 100x75 OUT", "200x150"),
        ("POSE --to gltf OUT.glb --model MODEL --photo WRONG", "10x10"),
        ("POSE POSE", "--overwrite"),
    ],
)
def test_bad_input_is_one_sentence(pose, tmp_path, capsys, arguments, says):
    cv2.imwrite(str(tmp_path / "wrong.png"), np.zeros((10, 10, 3), np.uint8))
    names = {
        "POSE": pose,
        "MODEL": tmp_path / "obj_000005.ply",
        "WRONG": tmp_path / "wrong.png",
    } | {f"OUT{end}": tmp_path / f"out{end}" for end in ("", ".txt", ".yml", ".json", ".glb")}
    before = sorted(tmp_path.iterdir()), pose.read_bytes()
    words = [str(names.get(word, word)) for word in arguments.split()]
    assert run("convert", *words) == 2
    printed = capsys.readouterr()
    assert says in printed.err
    assert len(printed.err.strip().splitlines()) == 1
    assert (sorted(tmp_path.iterdir()), pose.read_bytes()) == before
