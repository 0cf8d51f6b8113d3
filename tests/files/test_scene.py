"""Scene files: what is written is read back, and what is wrong is said in a sentence."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from poseviewer.errors import PoseViewerError
from poseviewer.files.pose import ChartParameters, RecordedVerdict, save_pose
from poseviewer.files.scene import load_scene, save_scene
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.mask import Mask
from poseviewer.starts.registration import load_scene_registrations
from tests.schemas import json_schema
from tests.several import IDS, STARTS, TRUTH, make_three


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return make_three(tmp_path)


def changed(path: Path, change) -> Path:
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
    return path


def test_what_is_written_is_read_to_the_last_digit(path, tmp_path):
    scene = load_scene(path)
    assert [one.id for one in scene.objects] == list(IDS)
    first = replace(
        scene.objects[0].record,
        chart=ChartParameters("free-body", ("x",), (1.0 / 3.0,)),
        loss=-1.5,
        unexplained=0.25,
        verdict=RecordedVerdict("found", 0.9, ("It is seen.",), {"a": 0.5}),
        notes=("The focal length is assumed.",),
        settings={"grey": True},
    )
    named = replace(scene.objects[0], record=first, name="the ball")
    told = replace(scene, objects=(named, *scene.objects[1:]))
    elsewhere = tmp_path / "below"
    elsewhere.mkdir()
    save_scene(elsewhere / "s.json", told)
    again = load_scene(elsewhere / "s.json")
    jsonschema.validate(json.loads((elsewhere / "s.json").read_text()), json_schema("scene"))
    assert again.camera == scene.camera
    assert again.photo.resolve() == scene.photo.resolve()
    assert again.objects[0].name == "the ball"
    for one, other, start in zip(told.objects, again.objects, STARTS, strict=True):
        assert other.model.resolve() == one.model.resolve()
        place, wanted = other.record.pose.camera_from_model, start.pose.camera_from_model
        assert np.array_equal(place.rotation, wanted.rotation)
        assert np.array_equal(place.translation, wanted.translation)
        for name in ("chart", "loss", "unexplained", "verdict", "notes", "settings"):
            assert getattr(other.record, name) == getattr(one.record, name), name


def test_a_pose_may_be_a_file_with_its_mask(path, tmp_path):
    record = replace(load_scene(path).objects[1].record, pose=TRUTH[1].pose, mask="m.png")
    save_pose(tmp_path / "front.json", record)
    white = np.ones((240, 320))
    save_scene(tmp_path / "other.json", load_scene(path), {"front": Mask.of(white)})
    (tmp_path / "other.2.mask.png").rename(tmp_path / "m.png")
    changed(path, lambda data: data["objects"][1].update(pose="front.json"))
    found = load_scene(path).objects[1]
    assert np.array_equal(
        found.record.pose.camera_from_model.translation,
        TRUTH[1].pose.camera_from_model.translation,
    )
    assert found.mask == tmp_path / "m.png"
    _, opened = load_scene_registrations(load_scene(path))
    assert opened[1].mask is not None
    assert np.array_equal(opened[1].mask.weights, white)
    assert opened[0].mask is None


def test_each_object_is_opened_among_the_others(path):
    _, opened = load_scene_registrations(load_scene(path))
    assert [len(one.others) for one in opened] == [2, 2, 2]
    assert opened[0].others[0].mesh is opened[1].mesh
    assert opened[2].others[1].pose.camera_from_model is opened[1].start.camera_from_model
    assert len({id(one.photo) for one in opened}) == 1


def test_the_same_model_may_be_there_twice(path):
    changed(path, lambda data: data["objects"].append({**data["objects"][0], "id": "again"}))
    _, opened = load_scene_registrations(load_scene(path))
    assert opened[3].mesh is opened[0].mesh


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["objects"][1]["model"].update(file="gone.ply"), "gone.ply, and there is no"),
        (lambda d: d["objects"][1].update(id="ball"), "two objects have the id 'ball'"),
        (lambda d: d["objects"][1].update(id=7), r"objects\[1\].id is 7; wanted a text"),
        (lambda d: d["objects"][1].update(pose="gone.json"), "gone.json, and there is no"),
        (lambda d: d["objects"][1].pop("pose"), "pose is missing"),
        (lambda d: d["objects"][1]["pose"].clear(), r"objects\[1\]: camera_from_model is missing"),
        (lambda d: d["objects"][1].update(mask="gone.png"), "gone.png, and there is no"),
        (lambda d: d["objects"].clear(), "objects is a list of 0; wanted a list of one or more"),
        (lambda d: d.update(format="poseviewer-pose"), "wanted 'poseviewer-scene'"),
        (lambda d: d.update(version=2), "version is 2"),
        (lambda d: d["photo"].update(file="gone.png"), "gone.png, and there is no"),
        (lambda d: d["photo"].pop("width"), "photo.width or photo.height is missing"),
        (lambda d: d.pop("camera"), "camera is missing"),
    ],
)
def test_what_is_wrong_is_said(path, change, words):
    changed(path, change)
    with pytest.raises(PoseViewerError, match=words):
        load_scene(path)


def test_another_size_unit_or_camera_is_said(path, tmp_path):
    scene = load_scene(path)
    small = changed(path, lambda data: data["photo"].update(width=100))
    with pytest.raises(PoseViewerError, match="320x240 px, and the scene is one for 100x240"):
        load_scene_registrations(load_scene(small))
    save_scene(path, scene)

    def set_units(data) -> None:
        data["objects"][0]["model"]["unit"] = "mm"
        data["objects"][2]["model"]["unit"] = "m"

    with pytest.raises(PoseViewerError, match="ball is in mm and apart in m"):
        load_scene_registrations(load_scene(changed(path, set_units)))
    save_scene(path, scene)
    other = replace(scene.camera, fx=500.0)
    record = replace(scene.objects[0].record, pose=replace(STARTS[0].pose, camera=other))
    save_pose(tmp_path / "other.json", record)
    changed(path, lambda data: data["objects"][0].update(pose="other.json"))
    with pytest.raises(PoseViewerError, match="'ball' is by another camera than the scene's"):
        load_scene(path)
    first = replace(scene.objects[0], record=record)
    with pytest.raises(PoseViewerError, match="by another camera"):
        save_scene(tmp_path / "new.json", replace(scene, objects=(first, *scene.objects[1:])))
    assert not (tmp_path / "new.json").exists()


def test_a_mask_of_another_size_is_said(path, tmp_path):
    save_scene(path, load_scene(path), {"ball": Mask.of(np.ones((10, 20)))})
    assert (tmp_path / "three.scene.1.mask.png").is_file()
    with pytest.raises(PoseViewerError, match="20x10 px, the photo 320x240"):
        load_scene_registrations(load_scene(path))


def test_objects_have_scales_of_their_own_under_parallel_projection(path, tmp_path):
    scene = load_scene(path)
    flat = Parallel(40.0, 160.5, 120.5, 320, 240)
    cameras = (replace(flat, scale=30.0), replace(flat, scale=55.5), flat)
    records = [
        replace(one.record, pose=Pose(camera, one.record.pose.camera_from_model), seen=0.625)
        for one, camera in zip(scene.objects, cameras, strict=True)
    ]
    save_scene(tmp_path / "flat.json", replace(scene.with_records(records), camera=flat))
    data = json.loads((tmp_path / "flat.json").read_text())
    jsonschema.validate(data, json_schema("scene"))
    assert [one["pose"].get("scale") for one in data["objects"]] == [30.0, 55.5, None]
    again = load_scene(tmp_path / "flat.json")
    assert [one.record.pose.camera for one in again.objects] == list(cameras)
    assert [one.record.seen for one in again.objects] == [0.625] * 3
    _, opened = load_scene_registrations(again)
    assert [one.start.camera for one in opened] == list(cameras)
    # Another centre is another camera.
    aside = replace(records[1], pose=Pose(replace(flat, cx=9.0), records[1].pose.camera_from_model))
    with pytest.raises(PoseViewerError, match="by another camera"):
        save_scene(
            tmp_path / "no.json",
            replace(scene.with_records([records[0], aside, records[2]]), camera=flat),
        )
    changed(tmp_path / "flat.json", lambda data: data["objects"][1]["pose"].update(scale=-1))
    with pytest.raises(PoseViewerError, match=r"objects\[1\].*scale"):
        load_scene(tmp_path / "flat.json")
