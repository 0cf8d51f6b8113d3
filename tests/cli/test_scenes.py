"""Several objects in one photo from the command line: fitted, drawn, mapped, converted."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import trimesh

from poseviewer.api import load, make_scene
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo
from poseviewer.files.scene_file import load_scene
from poseviewer.geometry.camera import Perspective
from tests.commands import run
from tests.schemas import json_schema
from tests.several import IDS, MESHES, STARTS, TRUTH, make_bop, make_three


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return make_three(tmp_path)


def off(scene, index: int) -> float:
    """The mean distance of an object's vertices from the truth, px."""
    vertices = MESHES[index].vertices
    apart = scene.pose(index).project(vertices) - TRUTH[index].pose.project(vertices)
    return float(np.linalg.norm(apart, axis=1).mean())


@pytest.mark.slow
def test_a_scene_is_fitted_and_written_again(path, tmp_path, capsys):
    out = tmp_path / "fitted.json"
    assert run("fit", path, "--out", out, "--quiet", "--overlay", tmp_path / "o.png") == 0
    printed = capsys.readouterr().out
    for name in IDS:
        assert f"{name} (seen to " in printed
    jsonschema.validate(json.loads(out.read_text()), json_schema("scene"))
    before, after = load_scene(path), load_scene(out)
    for index, one in enumerate(after.objects):
        assert off(after, index) < 0.3 * off(before, index)
        assert one.result is not None
        assert one.result.verdict is not None
    assert (load_photo(tmp_path / "o.png").pixels != load_photo(before.views[0].path).pixels).any()


@pytest.mark.slow
def test_one_object_of_a_scene_is_fitted_and_the_others_stay(path, tmp_path):
    out = tmp_path / "fitted.json"
    assert run("fit", path, "--object", "apart", "--out", out, "--quiet") == 0
    before, after = load_scene(path), load_scene(out)
    assert off(after, 2) < 0.3 * off(before, 2)
    for index in (0, 1):
        assert before.objects[index].place == after.objects[index].place


def test_what_is_behind_another_is_not_drawn(path, tmp_path):
    make_three(tmp_path, TRUTH)
    assert run("overlay", path, "--out", tmp_path / "o.png", "--look", "normals") == 0
    shown = load(path).visibility
    scene = load(path).data
    alone = [make_scene(replace(scene, objects=(one,))).picture("normals") for one in scene.objects]
    drawn, photo = load_photo(tmp_path / "o.png").pixels, scene.views[0].photo.pixels
    for index in range(3):
        seen = shown.seen(index)
        assert np.array_equal(drawn[seen], alone[index][seen])
    nothing = shown.nearest < 0
    assert np.array_equal(drawn[nothing], photo[nothing])


def test_the_landscape_is_that_of_one_object_among_the_others(path, tmp_path):
    out = tmp_path / "maps"
    more = ("--out", out, "--size", "3", "--quiet")
    assert run("landscape", path, "--object", "ball", *more) == 0
    assert (out / "landscape.npz").is_file()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("fit", "S", "--pose", "p.json", "--out", "o.json"),
            "--pose with three.scene.json, which says it itself",
        ),
        (("fit", "S", "--object", "who", "--out", "o.json"), "no object 'who' in"),
        (("fit", "half.json", "--out", "o.json"), "half.json: no such file"),
        (("fit", "S", "--out", "o.json", "--mask", "m.png"), "--mask with three.scene.json"),
        (("fit", "S", "--out", "o.json", "--free-focal"), "share one camera"),
        (("fit", "--pose", "S", "--out", "o.json"), "PHOTO and MODEL are wanted"),
        (("landscape", "S", "--out", "o"), "several objects; say which"),
        (("convert", "S", "o.yml", "--from", "scene", "--to", "opencv"), "choose an object"),
    ],
)
def test_what_does_not_go_together_is_said(path, capsys, monkeypatch, arguments, words):
    monkeypatch.chdir(path.parent)
    assert run(*(path if word == "S" else word for word in arguments)) == 2
    said = capsys.readouterr().err.strip()
    assert words in said
    assert "\n" not in said
    assert not Path("o").exists()


def test_an_object_wholly_behind_another_is_said(path, tmp_path, capsys):
    data = json.loads(path.read_text())
    data["objects"][0]["world_from_model"]["translation"] = [4.4, 0.8, 40.0]
    for one in data["objects"][1:]:
        one["locked"] = True
    path.write_text(json.dumps(data))
    assert run("fit", path, "--object", "ball", "--out", tmp_path / "o.json") == 2
    assert "wholly behind other objects" in capsys.readouterr().err


def test_a_scene_becomes_an_image_of_a_bop_scene_and_back(path, tmp_path, capsys):
    out, models = tmp_path / "out", make_bop(tmp_path).parent / "models"
    (out / "rgb").mkdir(parents=True)
    (out / "rgb" / "000004.png").write_bytes((tmp_path / "three.png").read_bytes())
    data = json.loads(path.read_text())
    for number, one in enumerate(data["objects"], 1):
        one["model"].update(file=f"models/obj_{number:06d}.ply", unit="mm")
    path.write_text(json.dumps(data))
    arguments = ("convert", path, out, "--from", "scene", "--to", "bop", "--image", "4")
    assert run(*arguments) == 0
    assert run(*arguments) == 2
    assert "there already" in capsys.readouterr().err
    seen = load(path).visibility
    for index in range(3):
        for folder, wanted in (("mask", seen.drawn[index]), ("mask_visib", seen.seen(index))):
            mask = load_photo(out / folder / f"000004_{index:06d}.png").pixels
            assert np.array_equal(mask, 255 * wanted[..., None].astype(np.uint8))
    back = tmp_path / "back.json"
    assert run("convert", out, back, "--from", "bop", "--to", "scene", "--model", models) == 0
    again = load_scene(back)
    assert [one.id for one in again.objects] == ["1", "2", "3"]
    for index, start in enumerate(STARTS):
        place = again.pose(index).camera_from_model
        assert place.translation == pytest.approx(start.pose.camera_from_model.translation)
    assert again.views[0].camera == Perspective(420.0, 420.0, 160.5, 120.5, 320, 240)


def test_a_scene_becomes_one_gltf_file(path, tmp_path):
    out = tmp_path / "out.glb"
    assert run("convert", path, out, "--from", "scene", "--to", "gltf") == 0
    found = trimesh.load_scene(str(out))
    corners = np.concatenate(
        [one.pose.camera_from_model.apply(load_mesh(tmp_path / f"{name}.ply").vertices)
         for name, one in zip(IDS, STARTS, strict=True)]
    )  # fmt: skip
    whole = np.concatenate(
        [trimesh.transform_points(found.geometry[found.graph[node][1]].vertices,
                                  found.graph[node][0]) for node in IDS]
    )  # fmt: skip
    wanted = corners * (1.0, -1.0, -1.0)
    assert np.allclose(whole.min(axis=0), wanted.min(axis=0), atol=1e-5)
    assert np.allclose(whole.max(axis=0), wanted.max(axis=0), atol=1e-5)


def test_one_object_of_a_scene_becomes_a_pose_file(path, tmp_path):
    out = tmp_path / "front.json"
    assert run("convert", path, out, "--from", "scene", "--object", "front") == 0
    data = json.loads(out.read_text())
    assert data["model"]["file"] == "front.ply"
    wanted = STARTS[1].pose.camera_from_model.translation
    assert data["camera_from_model"]["translation"] == wanted.tolist()


def test_info_says_what_is_in_a_scene(path, capsys):
    assert run("info", path) == 0
    printed = capsys.readouterr().out
    assert "three.png, 320 x 240 px" in printed
    assert "front: front.ply at (" in printed
