"""Exports of a sequence: what other tools read is what the frames have, and gaps are left out."""

import csv
import json
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poseviewer.errors import PoseFileError
from poseviewer.files.formats.bop import load_bop_images
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.sequence_export import SequencePictures, export_sequence
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_assets import frame_file
from poseviewer.files.scene_json import as_saved, load_scene, save_scene
from poseviewer.files.writing import sha256_of
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV
from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.sequence import show_frame, store_key
from poseviewer.scene.types import Scene
from tests.commands import refusal, run
from tests.files.test_scene_frames import sequence
from tests.schemas import load_valid
from tests.several import CAMERA, make_three


def no_picture(*_: Any) -> Any:
    """Stands where a format draws nothing."""
    raise AssertionError


STALE = "ball: 1 of 4 poses is stale, as others have changed since: propagate them anew."
NOTHING = SequencePictures(no_picture, no_picture)


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    """Five frames: the first object has a pose in all but the fourth, the second in the last."""
    made = sequence(make_three(tmp_path), 5)
    frames = list(made.frames)
    frames[3] = replace(frames[3], poses={})
    return store_key(show_frame(replace(made, frames=tuple(frames)), 4), 1)


def moves(scene: Scene, index: int) -> RigidTransform:
    """The first object by the camera, in a frame."""
    return scene.frames[index].poses["ball"].world_from_model.rigid


def test_a_table_has_a_row_for_each_pose(scene, tmp_path):
    (path,), notes = export_sequence("csv", scene, tmp_path / "t.csv", ConvertOptions(), NOTHING)
    rows = list(csv.DictReader(StringIO(path.read_text())))
    assert [row["frame"] for row in rows] == ["0", "1", "2", "4", "4"]
    assert [row["object"] for row in rows] == ["ball"] * 4 + ["front"]
    assert [row["source"] for row in rows] == ["key", *["propagated"] * 3, "key"]
    assert (rows[1]["stale"], rows[1]["verdict"], rows[1]["file"]) == ("True", "found", "f1.png")
    assert float(rows[3]["time_s"]) == 4 / 30.0
    turn = Rotation.from_quat([float(rows[2][key]) for key in ("qx", "qy", "qz", "qw")])
    np.testing.assert_allclose(turn.as_matrix(), moves(scene, 2).rotation, atol=1e-12)
    assert [float(rows[2][f"t{axis}"]) for axis in "xyz"] == moves(scene, 2).translation.tolist()
    sure = scene.frames[2].poses["ball"].result.covariance.deviations
    assert float(rows[2]["deviation_degrees"]) == sure["degrees"]
    assert rows[0]["deviation_px"] == rows[0]["verdict"] == ""
    assert notes == [
        "ball: 1 of 5 frames have no pose: left out.",
        "front: 4 of 5 frames have no pose: left out.",
        "apart: 5 of 5 frames have no pose: left out.",
        STALE,
    ]


def test_pose_files_are_those_of_the_frames(scene, tmp_path):
    files, _ = export_sequence("poseviewer", scene, tmp_path / "o", ConvertOptions(), NOTHING)
    names = [*(f"f{i}.ball.pose.json" for i in (0, 1, 2, 4)), "f4.front.pose.json"]
    assert [path.name for path in files] == names
    assert load_valid(files[2], "pose")["photo"]["file"] == "f2.png"
    pose = load_pose(files[2]).pose
    np.testing.assert_array_equal(pose.camera_from_model.rotation, moves(scene, 2).rotation)
    alone = replace(scene, objects=scene.objects[:1])
    files, _ = export_sequence("poseviewer", alone, tmp_path / "p", ConvertOptions(), NOTHING)
    assert files[-1].name == "f4.pose.json"


def animation_of(path: Path) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Document of a GLB file, and the values of its accessors."""
    data, values = path.read_bytes(), []
    length = int.from_bytes(data[12:16], "little")
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    for one in document["accessors"]:
        view = document["bufferViews"][one["bufferView"]]
        part = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        kind = {5126: "<f4", 5125: "<u4"}[one["componentType"]]
        values.append(np.frombuffer(part, kind).reshape(one["count"], -1))
    return document, values


def test_an_animation_moves_each_object_in_time(scene, tmp_path):
    options = ConvertOptions(unit="mm")
    (path,), notes = export_sequence("gltf", scene, tmp_path / "a.glb", options, NOTHING)
    assert not any("frames a second" in note for note in notes)
    document, values = animation_of(path)
    (animation,) = document["animations"]
    names = [node["name"] for node in document["nodes"]]
    by_node = {}
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        key = names[channel["target"]["node"]], channel["target"]["path"]
        by_node[key] = values[sampler["input"]][:, 0], values[sampler["output"]]
    assert {name for name, _ in by_node} == {"ball", "front"}
    times, turns = by_node["ball", "rotation"]
    assert times == pytest.approx(np.array([0, 1, 2, 4]) / 30.0)
    for row, index in enumerate((0, 1, 2, 4)):
        wanted = OPENGL_FROM_OPENCV @ moves(scene, index)
        turn = Rotation.from_quat(turns[row]).as_matrix()
        np.testing.assert_allclose(turn, wanted.rotation, atol=1e-6)
        shift = by_node["ball", "translation"][1][row]
        np.testing.assert_allclose(shift, wanted.translation, atol=1e-5)
    assert np.all(np.sum(turns[1:] * turns[:-1], axis=1) > 0.0)
    assert by_node["front", "translation"][1].shape == (1, 3)
    first = document["nodes"][names.index("ball")]
    assert first["rotation"] == pytest.approx(turns[0], abs=1e-6)
    assert len(load_mesh(path).faces) > 100
    untimed = replace(scene, frames=tuple(replace(one, time_s=None) for one in scene.frames))
    _, notes = export_sequence("gltf", untimed, tmp_path / "b.glb", options, NOTHING)
    assert "No time stamps are known: 30 frames a second are assumed." in notes


def saved(scene: Scene, folder: Path) -> Path:
    save_scene(folder / "s.scene.json", as_saved(scene))
    return folder / "s.scene.json"


def test_a_bop_scene_is_whole(scene, tmp_path, capsys):
    path, out = saved(scene, tmp_path), tmp_path / "bop"
    where = "--from", "scene", "--to", "bop", "--unit", "mm"
    assert run("convert", str(path), str(out), *where, "--object", "ball") == 2
    assert "say it with --object ball=NUMBER" in capsys.readouterr().err
    data = json.loads(path.read_text())
    for number, item in enumerate(data["objects"], 1):
        item["id"] = str(number)
        item["model"]["unit"] = "mm"
    for frame in data["frames"]:
        known = frame.get("poses", {})
        frame["poses"] = {{"ball": "1", "front": "2"}[name]: own for name, own in known.items()}
    path.write_text(json.dumps(data))
    assert run("convert", str(path), str(out), *where[:-2]) == 0
    images = load_bop_images(out, posed=True)
    assert [image.number for image in images] == [0, 1, 2, 4]
    assert [[item.object_id for item in image.objects] for image in images][2:] == [[1], [1, 2]]
    np.testing.assert_allclose(
        images[1].objects[0].camera_from_model.rotation, moves(scene, 1).rotation
    )
    assert images[3].photo == "rgb/000004.png"
    data["objects"] = data["objects"][:1]
    for frame in data["frames"]:
        frame["poses"].pop("2", None)
    path.write_text(json.dumps(data))
    assert run("convert", str(path), f"{out}5", "--to", "bop", "--object", "5") == 0
    assert load_bop_images(Path(f"{out}5"), posed=True)[0].objects[0].object_id == 5
    photo = load_photo(out / images[3].photo)
    assert photo.sha256 == load_photo(scene.frames[4].file.location).sha256
    infos = json.loads((out / "scene_gt_info.json").read_text())
    assert sorted(infos) == ["0", "1", "2", "4"]
    assert infos["4"][0]["visib_fract"] < infos["1"][0]["visib_fract"] == 1.0
    assert (out / "mask_visib" / "000004_000001.png").is_file()
    capsys.readouterr()
    assert "is there already and was not touched" in refusal(
        capsys, f"convert {path} {out} --from scene --to bop"
    )


def test_frames_that_are_no_longer_those_of_their_poses_are_said(scene, tmp_path, capsys):
    known = [replace(own.file, sha256=sha256_of(own.file.location)) for own in scene.frames]
    frames = (replace(f, file=file) for f, file in zip(scene.frames, known, strict=True))
    scene = replace(scene, frames=tuple(frames))
    path = saved(show_frame(scene, 0), tmp_path)
    line = "convert", str(path), str(tmp_path / "o.avi"), "--to", "video", "--overwrite"
    assert run(*line) == 0
    assert "fingerprints" not in capsys.readouterr().out
    for index in (2, 3, 4):  # the fourth has no pose
        photo = scene.frames[index].file.location
        data = photo.read_bytes()
        photo.unlink()  # they are one file
        photo.write_bytes(data + b"another picture")
    assert run(*line) == 0
    said = "note: 2 of 4 frames are other pictures than their poses were made with"
    named = "(the fingerprints differ): f2.png, f4.png."
    assert f"{said} {named}" in capsys.readouterr().out
    quiet = SequencePictures(no_picture, lambda *_: {})
    options = ConvertOptions(unit="mm", object_id=1)
    scene = replace(load_scene(path), objects=load_scene(path).objects[:1])
    frames = (replace(f, poses={"ball": f.poses.get("ball")}) for f in scene.frames[:3])
    scene = replace(scene, frames=tuple(frames))
    _, notes = export_sequence("bop", scene, tmp_path / "bop", options, quiet)
    assert ["1 of 3 frames are other pictures" in note for note in notes] == [False, True]


def test_photos_of_a_bop_scene_are_written_through_no_link(scene, tmp_path):
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "bop" / "rgb").mkdir(parents=True)
    (tmp_path / "bop" / "rgb" / "000000.png").symlink_to(tmp_path / "mine")
    objects = (scene.objects[0],)
    frames = tuple(replace(f, poses={"ball": f.poses.get("ball")}) for f in scene.frames[:1])
    scene = show_frame(replace(scene, objects=objects, frames=frames), 0)
    options = ConvertOptions(unit="mm", object_id=1, overwrite=True)
    with pytest.raises(PoseFileError, match="is a link and was not written through"):
        export_sequence("bop", scene, tmp_path / "bop", options, NOTHING)
    assert (tmp_path / "mine").read_text() == "mine"


def test_photos_of_a_bop_scene_are_undistorted(scene, tmp_path):
    undone = Undistortion.of(Lens("opencv", (0.2, 0.0, 0.0, 0.0)), CAMERA)
    view = replace(scene.views[0], file=replace(scene.views[0].file, undistortion=undone))
    frames = [replace(own, file=frame_file(own.file.location, view)) for own in scene.frames]
    scene = show_frame(replace(scene, views=(view,), frames=tuple(frames)), 0)
    objects = (replace(scene.objects[0], id="1"),)
    frames = (replace(own, poses={"1": own.poses.get("ball")}) for own in scene.frames[:2])
    scene = replace(scene, objects=objects, frames=tuple(frames))
    quiet = SequencePictures(no_picture, lambda *_: {})
    options = ConvertOptions(unit="mm", object_id=1)
    export_sequence("bop", scene, tmp_path / "bop", options, quiet)
    pixels = load_photo(tmp_path / "bop" / "rgb" / "000001.png").pixels
    np.testing.assert_array_equal(pixels, show_frame(scene, 1).views[0].photo.pixels)
    assert np.any(pixels != load_photo(scene.frames[1].file.location).pixels)


@pytest.mark.parametrize("ending", ["mp4", "avi"])
def test_a_video_shows_every_frame_with_its_overlay(scene, tmp_path, ending):
    out = tmp_path / f"o.{ending}"
    path = saved(scene, tmp_path)
    assert run("convert", str(path), str(out), "--to", "video") == 0
    capture = cv2.VideoCapture(str(out), cv2.CAP_FFMPEG)
    assert round(capture.get(cv2.CAP_PROP_FPS)) == 30
    shown = []
    while (frame := capture.read())[0]:
        shown.append(frame[1][..., ::-1].astype(float))
    capture.release()
    assert len(shown) == 5
    plain = load_photo(scene.frames[0].file.location).pixels
    assert shown[0].shape == plain.shape
    off = [float(np.abs(picture - plain).mean()) for picture in shown]
    assert off[3] < 4.0  # as it is, but for the codec
    assert min(off[0], off[4]) > off[3] + 0.5
    assert not list(tmp_path.glob("*.part*"))


def test_what_is_no_sequence_or_has_no_pose_is_said(scene, tmp_path, capsys):
    bare = replace(scene, frames=tuple(replace(own, poses={}) for own in scene.frames))
    with pytest.raises(PoseFileError, match="No frame of the sequence has a pose; place"):
        export_sequence("csv", bare, tmp_path / "t.csv", ConvertOptions(), NOTHING)
    path = saved(replace(scene, frames=(), frame_index=0), tmp_path)
    line = f"convert {path} t.csv --from scene --to csv"
    assert "--to csv is for sequences, and" in refusal(capsys, line)
    path = saved(scene, tmp_path)
    line = f"convert {path} {tmp_path}/t.gif --from scene --to video"
    assert "cannot be written as '.gif'; name it .mp4 or .webm or .avi" in refusal(capsys, line)
    line = ("convert", str(path), str(tmp_path / "m.json"), "--from", "scene", "--to", "matrix")
    assert run(*line, "--object", "ball") == 0
    assert "note: Such a file is of one frame: that of f4.png." in capsys.readouterr().out
    assert len(load_scene(path).frames) == 5
