"""A sequence is opened by its first frame, and its other frames are read one by one."""

import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from poseviewer.api import load_frames
from poseviewer.errors import PoseViewerError, SettingsError
from poseviewer.files.cameras import Calibration
from poseviewer.files.image_sequence import load_sequence
from poseviewer.files.masks import save_pose_and_masks
from poseviewer.files.photo import load_photo, save_image
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_json import as_saved, load_scene, save_scene
from poseviewer.fit.problem import make_problem
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.mask import Mask
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from poseviewer.opening.uploads import copy_out
from poseviewer.scene.sequence import show_frame
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene as SceneOfViews
from tests.scene import Scene
from tests.writing import write


@pytest.fixture
def frames(scene: Scene, tmp_path: Path) -> Path:
    folder = tmp_path / "frames"
    folder.mkdir()
    for number in (1, 2, 10):
        save_image(folder / f"f{number}.png", load_photo(scene.photo).pixels // number)
    return folder


def open_frames(folder: Path, model: Path, start: Path, **more) -> SceneOfViews:
    return open_scene(Sources(frames=load_sequence(folder), model=model, start=start, **more))


def test_the_first_frame_has_the_key_and_others_the_same_camera(frames, scene, tmp_path):
    opened = open_frames(frames, scene.model, scene.truth)
    pose = load_pose(scene.truth).pose
    assert opened.views[0].camera == pose.camera
    assert [frame.file.name for frame in opened.frames] == ["f1.png", "f2.png", "f10.png"]
    assert [[*frame.poses] for frame in opened.frames] == [["1"], [], []]
    assert opened.name == "frames"
    last = show_frame(opened, 2)
    assert last.views[0].photo.pixels.max() < 30
    save_scene(tmp_path / "s.json", as_saved(last))
    again = open_scene(Sources(scene=tmp_path / "s.json"))
    assert (again.frame_index, again.views[0].name) == (2, "f10.png")
    assert show_frame(again, 0).views[0].photo.sha256 == load_photo(frames / "f1.png").sha256


def test_several_frames_have_keys_with_what_was_hidden_there(frames, scene, tmp_path):
    mask, found = np.ones((2, 120, 160))
    mask[:9], found[:, :9] = 0.0, 0.0
    record = load_pose(scene.truth)
    save_pose_and_masks(tmp_path / "b.json", record, Mask.of(mask), Mask.of(found))
    opened = open_frames(frames, scene.model, scene.truth, keys={2: tmp_path / "b.json"})
    sources = [[one.source for one in frame.poses.values()] for frame in opened.frames]
    assert sources == [["key"], [], ["key"]]
    assert opened.frame_index == 0
    hidden = [[frame.mask, *frame.masks, *frame.occluders] for frame in opened.frames]
    assert hidden == [[None], [None], [None, "1", "1"]]
    moved = record.pose.camera_from_model
    shift = replace(moved, translation=moved.translation * 1.1)
    poses = {1: replace(record.pose, camera_from_model=shift), 0: scene.truth}
    loaded = load_frames(frames, scene.model, poses)
    assert loaded.scene.frame_index == 0
    again = loaded.with_key(2, tmp_path / "b.json")
    for index, pose in ((0, record.pose), (1, poses[1]), (2, record.pose)):
        placed = show_frame(again.scene, index).pose(0)
        assert np.allclose(placed.camera_from_model.as_matrix(), pose.camera_from_model.as_matrix())
    assert [bool(frame.poses) for frame in loaded.scene.frames] == [True, True, False]


def test_a_key_that_does_not_go_with_the_sequence_is_refused(frames, scene):
    loaded = load_frames(frames, scene.model, {0: scene.truth})
    pose = load_pose(scene.truth).pose
    assert isinstance(pose.camera, Perspective)
    other = replace(pose, camera=replace(pose.camera, fx=2.0 * pose.camera.fx))
    with pytest.raises(PoseViewerError, match="the key's camera is another than that of"):
        loaded.with_key(1, other)
    with pytest.raises(SettingsError, match="`key=4`: frames has 3 frames; name one of them"):
        loaded.with_key(3, pose)
    with pytest.raises(SettingsError, match="no keys; wanted a pose"):
        load_frames(frames, scene.model, {})


def test_a_calibration_undistorts_every_frame(frames, scene, tmp_path):
    path = tmp_path / "camera.json"
    size = {"image_width": 160, "image_height": 120}
    matrix = [[300.0, 0.0, 83.0], [0.0, 300.0, 58.0], [0.0, 0.0, 1.0]]
    write(path, {"camera_matrix": matrix, "dist_coeff": [0.3, 0.0, 0.0, 0.0, 0.0], **size})
    opened = open_frames(frames, scene.model, scene.truth, calibration=Calibration(path))
    for index in range(3):
        shown = show_frame(opened, index).views[0]
        assert shown.photo.undistortion is not None
        assert shown.photo.camera == shown.camera
        taken = load_photo(opened.frames[index].file.location).pixels
        assert np.any(shown.photo.pixels != taken)


@pytest.mark.parametrize("all_frames", [False, True])
def test_what_was_found_in_front_belongs_to_the_key_and_a_mask_to_all_frames_if_said(
    frames, scene, tmp_path, all_frames
):
    mask, found = np.ones((2, 120, 160))
    mask[:9], found[:, :9] = 0.0, 0.0
    record = load_pose(scene.truth)
    save_pose_and_masks(tmp_path / "key.json", record, Mask.of(mask), Mask.of(found))
    how = {"key": 1, "mask_all_frames": all_frames, "settings": FitSettings(pixels="whole")}
    opened = open_frames(frames, scene.model, tmp_path / "key.json", **how)
    assert [[*frame.poses] for frame in opened.frames] == [[], ["1"], []]
    assert (opened.frame_index, opened.views[0].name) == (1, "f2.png")
    save_scene(tmp_path / "s.json", as_saved(opened))
    for now in (opened, open_scene(Sources(scene=tmp_path / "s.json"))):
        for index in range(3):
            photo = make_problem(show_frame(now, index))[0].views[0].photo
            weights = cv2.resize(photo.weights, (160, 120), interpolation=cv2.INTER_NEAREST)
            assert np.all(weights[:5] == 0.0) == (all_frames or index == 1)
            assert np.all(weights[:, :5] == 0.0) == (index == 1)
            assert np.any(weights[60:, 80:] > 0.0)
    said = [note for note in opened.notes if "alone, not those of all frames" in note]
    assert len(said) == (not all_frames)


def test_a_key_or_a_mask_that_is_not_there_is_said(frames, scene):
    with pytest.raises(SettingsError, match="`key=4`: frames has 3 frames"):
        open_frames(frames, scene.model, scene.truth, key=3)
    with pytest.raises(SettingsError, match="`mask_all_frames` without a mask"):
        open_frames(frames, scene.model, scene.truth, mask_all_frames=True)


def test_frames_are_not_kept_in_memory(frames, scene):
    os.link(frames / "f10.png", frames / "f11.png")
    opened = open_frames(frames, scene.model, scene.truth)
    for index in (1, 2, 3):
        assert show_frame(opened, index).views[0].photo is not opened.frames[index].file.read()
    (frames / "f10.png").write_bytes(b"torn")
    with pytest.raises(PoseViewerError, match=r"f10\.png: not a picture"):
        _ = show_frame(opened, 2).views[0].photo


def test_frames_of_an_upload_are_copied_beside_the_scene(frames, scene, tmp_path):
    opened = open_frames(frames, scene.model, scene.truth)
    out = tmp_path / "out"
    out.mkdir()
    for _ in range(2):
        saved = copy_out(out / "clip.scene.json", as_saved(opened), frames)
        save_scene(out / "clip.scene.json", saved)
    names = [path.name for path in sorted(out.rglob("*"))]
    assert names == ["clip.frames", "f1.png", "f10.png", "f2.png", "clip.scene.json"]
    again = load_scene(out / "clip.scene.json")
    assert again.views[0].path == again.frames[0].file.path == out / "clip.frames" / "f1.png"
