"""``poseviewer convert``: there and back; scenes of several objects; files that are named."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from poseviewer.api import load
from poseviewer.files.formats.bop import BopObject
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_assets import model_file
from poseviewer.files.scene_json import load_scene, save_scene
from poseviewer.geometry.camera import Perspective
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from poseviewer.scene.types import SceneObject
from tests.commands import refusal, run
from tests.files.formats.cases import HEIGHT, WIDTH
from tests.schemas import load_valid
from tests.several import IDS, MESHES, STARTS, make_bop, save_model, write_bop_scene
from tests.view_sets import (
    BOX,
    BOX_TRUTH,
    CAMERA,
    CAMERAS_FROM_SET,
    MESH,
    NAMES,
    TRUTH,
    write_two,
)


def test_there_and_back(folder, capsys):
    assert run("convert", "named.json", "--to", "colmap", "out") == 0
    assert "out/images.txt" in capsys.readouterr().out
    assert run("convert", "out", "--from", "colmap", "back.json", "--unit", "m") == 0
    data = load_valid(folder / "back.json", "pose")
    assert data["photo"] == {"file": "000003.png", "width": WIDTH, "height": HEIGHT}
    assert data["model"] == {"unit": "m"}
    found = load_pose(folder / "back.json").pose.camera_from_model.translation
    assert found.tolist() == pytest.approx([0.15, -0.1, 6.0], abs=1e-12)
    files = ("--photo", "000003.png", "--model", "obj_000005.ply")
    assert run("convert", "out", "--from", "colmap", "--to", "scene", "s.json", *files) == 0
    again = load_scene(folder / "s.json").pose(0).camera_from_model.translation
    assert again.tolist() == found.tolist()


@pytest.mark.usefixtures("folder")
def test_a_photo_that_is_stored_turned_is_told(capsys):
    """poseviewer shows photos upright, by EXIF; other tools show what is stored."""
    exif = Image.Exif()
    exif[0x0112] = 6  # a quarter turn
    with Image.open("000003.png") as upright:
        upright.transpose(Image.Transpose.ROTATE_90).save("turned.jpg", exif=exif)
    named = ("convert", "named.json", "--photo", "turned.jpg", "--to")
    assert run(*named, "meshlab", "out.mlp") == 0
    assert "turned.jpg is stored turned" in capsys.readouterr().out
    assert run(*named, "gltf", "out.glb") == 0
    assert "turned" not in capsys.readouterr().out


TURNS = {3: [(-1, 0, 0), (0, -1, 0), (0, 0, 1)], 6: [(0, -1, 0), (1, 0, 0), (0, 0, 1)]}
"""Axes of the upright photo's camera by those of the pixels as stored."""


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("orientation", TURNS)
@pytest.mark.parametrize("kind", ["colmap", "nerfstudio"])
def test_a_photo_that_is_stored_turned_turns_camera_and_pose(kind, orientation, capsys):
    """COLMAP and nerfstudio take the pixels as stored, whatever EXIF says."""
    exif, truth = Image.Exif(), load_pose("named.json").pose
    exif[0x0112] = orientation
    size = (HEIGHT, WIDTH) if orientation == 6 else (WIDTH, HEIGHT)
    Image.new("RGB", size).save("turned.jpg", exif=exif)  # upright: WIDTH x HEIGHT
    back = ("--photo", "turned.jpg", "--from", kind, "back.json")
    assert run("convert", "named.json", "--photo", "turned.jpg", "--to", kind, "turned") == 0
    assert "turned.jpg is stored turned (EXIF); camera and pose are" in capsys.readouterr().out
    assert run("convert", "turned", *back) == 0
    assert "turned with it" in capsys.readouterr().out
    found = load_pose("back.json").pose
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (9, 3))
    np.testing.assert_allclose(found.project(points), truth.project(points), atol=1e-9)
    Image.new("RGB", size).save("turned.jpg")  # without EXIF, pixels are shown as stored
    assert run("convert", "turned", *back, "--overwrite") == 0
    stored, turn = load_pose("back.json").pose, np.array(TURNS[orientation])
    place = found.camera_from_model
    assert np.allclose(place.rotation, turn @ stored.camera_from_model.rotation)
    assert np.allclose(place.translation, turn @ stored.camera_from_model.translation)
    exif[0x0112] = 4
    Image.new("RGB", size).save("turned.jpg", exif=exif)
    assert run("convert", "turned", *back, "--overwrite") == 2
    assert "a mirror image; save it upright" in capsys.readouterr().err


def test_files_that_are_named_come_first(folder):
    (folder / "000003.png").rename(folder / "set" / "photo.png")
    line = "convert named.json --to nerfstudio out.json --photo set/photo.png"
    assert run(*line.split()) == 0
    assert json.loads(Path("out.json").read_text())["frames"][0]["file_path"] == "set/photo.png"


def test_a_scene_becomes_an_image_of_a_bop_scene_and_back(folder, capsys):
    make_bop(folder)
    (folder / "out" / "rgb").mkdir(parents=True)
    (folder / "three.png").rename(folder / "out" / "rgb" / "000004.png")
    data = json.loads(Path("three.scene.json").read_text())
    data["views"][0]["photo"]["file"] = "out/rgb/000004.png"
    for number, one in enumerate(data["objects"], 1):
        one["model"].update(file=f"models/obj_{number:06d}.ply", unit="mm")
    Path("three.scene.json").write_text(json.dumps(data))
    line = "convert three.scene.json out --from scene --to bop --image 4"
    assert [run(*line.split()) for _ in range(2)] == [0, 2]
    assert "there already" in capsys.readouterr().err
    shown = load("three.scene.json").visibility
    for index in range(3):
        for kind, wanted in (("mask", shown.silhouettes[index]), ("mask_visib", shown.mask(index))):
            mask = load_photo(folder / "out" / kind / f"000004_{index:06d}.png").pixels
            assert np.array_equal(mask, 255 * wanted[..., None].astype(np.uint8))
    line = "convert out back.json --from bop --to scene --model models"
    assert run(*line.split()) == 0
    again = load_scene(folder / "back.json")
    assert [one.id for one in again.objects] == ["1", "2", "3"]
    for index, start in enumerate(STARTS):
        place = again.pose(index).camera_from_model
        assert place.translation == pytest.approx(start.pose.camera_from_model.translation)
    assert again.views[0].camera == Perspective(420.0, 420.0, 160.5, 120.5, 320, 240)


@pytest.mark.usefixtures("folder")
def test_objects_are_chosen_and_numbered(capsys):
    line = "convert three.scene.json out --to bop --image 4 --unit mm --overwrite"
    places = [start.pose.camera_from_model.translation for start in STARTS]
    for words, numbers, indices in (
        ("--object front=7", [7], [1]),
        ("--object apart=12 --object ball=0", [12, 0], [2, 0]),
        ("--object ball=3 --object front=1 --object apart=2", [3, 1, 2], [0, 1, 2]),
    ):
        shutil.rmtree("out", ignore_errors=True)
        assert run(f"{line} {words}") == 0
        poses = json.loads(Path("out/scene_gt.json").read_text())["4"]
        assert [pose["obj_id"] for pose in poses] == numbers
        shifts = [pose["cam_t_m2c"] for pose in poses]
        np.testing.assert_allclose(shifts, [places[index] for index in indices])
    back = "convert out other --from bop --to bop --image 4 --photo-size 320x240"
    assert run(f"{back} --object 3=5 --object 2=2") == 0
    poses = json.loads(Path("other/scene_gt.json").read_text())["4"]
    assert [pose["obj_id"] for pose in poses] == [5, 2]
    capsys.readouterr()
    for words, said in (
        ("--object front", "say it with --object front=NUMBER"),
        ("--object who=3", "There is no object 'who'"),
        ("--object ball=3 --object front=3", "with --object front=NUMBER"),
    ):
        assert said in refusal(capsys, f"{line} {words}")


@pytest.mark.usefixtures("folder")
def test_models_without_names_in_bop_are_numbered_as_the_refusal_says(capsys):
    """Ids that are numbers are those of all objects, but not of one that is chosen."""
    data = json.loads(Path("three.scene.json").read_text())
    for number, one in enumerate(data["objects"], 1):
        one["id"] = str(number)
    data["objects"][2]["model"] = data["objects"][0]["model"]
    Path("three.scene.json").write_text(json.dumps(data))
    line = "convert three.scene.json out --to bop --image 4 --unit mm --overwrite"
    assert run(line) == 0
    poses = json.loads(Path("out/scene_gt.json").read_text())["4"]
    assert [pose["obj_id"] for pose in poses] == [1, 2, 1]  # a model twice
    capsys.readouterr()
    assert "say it with --object 2=NUMBER" in refusal(capsys, line, "--object", 2)
    shutil.rmtree("out")
    assert run(f"{line} --object 2=6") == 0
    capsys.readouterr()
    ((pose,),) = json.loads(Path("out/scene_gt.json").read_text()).values()
    assert pose["obj_id"] == 6
    shutil.copy("obj_000005.ply", "m.ply")
    line = "convert named.json one --to bop --model m.ply --image 4"
    assert "say it with --object 1=NUMBER" in refusal(capsys, line)
    for words, number in (("1=3", 3), ("4", 4)):
        assert run(f"{line} --object {words}") == 0
        poses = json.loads(Path("one/scene_gt.json").read_text())["4"]
        assert poses[-1]["obj_id"] == number


def test_a_scene_becomes_one_gltf_file_and_one_of_its_objects_a_pose_file(folder):
    assert run("convert", "three.scene.json", "o.glb", "--from", "scene", "--to", "gltf") == 0
    found = trimesh.load_scene(str(folder / "o.glb"))
    for name, one, mesh in zip(IDS, STARTS, MESHES, strict=True):
        transform, geometry = found.graph[name]
        corners = trimesh.transform_points(found.geometry[geometry].vertices, transform)
        wanted = one.pose.camera_from_model.apply(mesh.vertices) * (1.0, -1.0, -1.0)
        assert np.allclose(corners.min(axis=0), wanted.min(axis=0), atol=1e-5)
        assert np.allclose(corners.max(axis=0), wanted.max(axis=0), atol=1e-5)
    line = "convert three.scene.json front.json --from scene --object front"
    assert run(*line.split()) == 0
    data = json.loads((folder / "front.json").read_text())
    assert data["model"]["file"] == "front.ply"
    wanted = STARTS[1].pose.camera_from_model.translation
    assert data["camera_from_model"]["translation"] == wanted.tolist()


def test_nothing_is_written_where_bop_lacks_an_objects_number(tmp_path: Path, capsys) -> None:
    cameras, ball, _ = write_two(tmp_path)
    scene, out = load_scene(cameras), tmp_path / "out"
    place = scene.views[0].world_from_model(TRUTH[0])
    item = SceneObject(id="ball", model=model_file(ball), world_from_model=place)
    save_scene(tmp_path / "ball.scene.json", replace(scene, objects=(item,)))
    line = "convert", tmp_path / "ball.scene.json", out, "--from", "scene", "--to", "bop"
    assert "--object ball=NUMBER" in refusal(capsys, *line, "--unit", "mm")
    assert not out.exists()


def test_a_bop_scene_that_stands_still_becomes_one_scene(tmp_path: Path, capsys) -> None:
    write_two(tmp_path)
    bop, models = tmp_path / "bop", tmp_path / "models"
    places = {n: (TRUTH[n].camera_from_model, BOX_TRUTH[n].camera_from_model) for n in range(3)}
    objects = {n: [BopObject(i + 1, own) for i, own in enumerate(places[n])] for n in places}
    photos = {number: tmp_path / name for number, name in enumerate(NAMES)}
    seen = {0: objects[0], 2: objects[2]}  # in the second image the scene has no poses
    write_bop_scene(bop, CAMERA, photos, seen, dict(enumerate(CAMERAS_FROM_SET)))
    models.mkdir()
    for number, mesh in ((1, MESH), (2, BOX)):
        save_model(models / f"obj_{number:06d}.ply", mesh)
    out = tmp_path / "whole.scene.json"
    line = "convert", bop, out, "--from", "bop", "--to", "scene", "--model", models
    assert run(*line) == 0
    found = open_scene(Sources(scene=out))
    assert [item.id for item in found.objects] == ["1", "2"]
    assert [item.model.name for item in found.objects] == ["obj_000001.ply", "obj_000002.ply"]
    assert (found.unit, found.free_scale, len(found.views)) == ("mm", False, 3)
    for number, poses in places.items():
        for index, pose in enumerate(poses):
            there = found.pose(index, number).camera_from_model
            np.testing.assert_allclose(there.rotation, pose.rotation, atol=1e-9)
            np.testing.assert_allclose(there.translation, pose.translation, atol=1e-9)
    assert "Objects are where" not in capsys.readouterr().out
    # One image alone, as before; what moved is no such scene.
    assert run(*line[:2], tmp_path / "one.json", *line[3:], "--image", 2) == 0
    assert len(load_scene(tmp_path / "one.json").views) == 1
    turned = replace(places[2][1], rotation=places[2][1].rotation @ np.diag([-1.0, -1.0, 1.0]))
    shutil.rmtree(bop)
    seen[2] = [objects[2][0], BopObject(2, turned)]
    write_bop_scene(bop, CAMERA, photos, seen, dict(enumerate(CAMERAS_FROM_SET)))
    capsys.readouterr()
    assert run(*line, "--overwrite") == 0
    assert "turned by up to 180.0 degrees" in capsys.readouterr().out
    objects[2][1] = BopObject(2, replace(places[2][1], translation=1.1 * places[2][1].translation))
    shutil.rmtree(bop)
    write_bop_scene(bop, CAMERA, photos, objects, dict(enumerate(CAMERAS_FROM_SET)))
    capsys.readouterr()
    said = refusal(capsys, *line, "--overwrite")
    assert "object 2 stands elsewhere in image 2" in said
    assert "--image" in said
