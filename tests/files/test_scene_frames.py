"""Scene files of sequences: frames come back to the last digit, and what is wrong is said."""

import json
import os
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import PoseViewerError
from poseviewer.files.masks import mask_as_png
from poseviewer.files.scene_assets import frame_file
from poseviewer.files.scene_json import as_saved, form_of, load_scene, save_scene
from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.sequence import as_still, show_frame, store_key, with_frames
from poseviewer.scene.types import Frame, FramePose, Scene, SearchResult
from tests.schemas import load_valid
from tests.several import CAMERA, make_three
from tests.writing import edit


def sequence(path: Path, count: int = 3) -> Scene:
    """Hard links of one photo as frames, whose first object has a key and then turns."""
    scene, frames = load_scene(path), []
    names = [path.with_name(f"f{index}.png") for index in range(count)]
    for index, name in enumerate(names):
        os.link(path.with_name("three.png"), name)
        frames.append(Frame(file=frame_file(name, scene.views[0]), time_s=index / 30.0))
    scene = store_key(with_frames(replace(scene, frames=()), frames), 0)
    verdict = Verdict("found", 0.9, ("It is seen.",), {"outline": 0.75})
    place, moved = scene.objects[0].world_from_model, list(scene.frames)
    for index in range(1, count):
        turned = RigidTransform.from_rotation_vector([0.0, 0.01 * index, 0.1 / 3.0], np.zeros(3))
        own = replace(place, rigid=place.rigid @ turned)
        sure = PoseCovariance(scene.views[0].pose(own), np.ones(3), np.eye(6) / 7.0, 0.5)
        result = SearchResult(loss=0.1 / 3.0, verdict=verdict, covariance=sure, seen=(0.9,))
        known = FramePose(
            world_from_model=own, source="propagated", result=result, is_stale=index == 1
        )
        moved[index] = replace(moved[index], poses={scene.objects[0].id: known})
    return show_frame(replace(scene, frames=tuple(moved)), 1)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return make_three(tmp_path)


def test_frames_are_read_to_the_last_digit(path, tmp_path):
    scene = as_saved(sequence(path))
    (tmp_path / "below").mkdir()
    save_scene(tmp_path / "below" / "s.json", scene)
    data = load_valid(tmp_path / "below" / "s.json", "scene")
    assert data["frame_index"] == 1
    assert [frame["photo"]["file"] for frame in data["frames"]] == [
        f"../f{index}.png" for index in range(3)
    ]
    assert data["frames"][1]["poses"]["ball"]["stale"] is True
    again = load_scene(tmp_path / "below" / "s.json")
    sure = again.frames[2].poses["ball"].result.covariance
    assert np.array_equal(
        sure.pose.camera_from_model.rotation,
        again.frames[2].poses["ball"].world_from_model.rigid.rotation,
    )
    forms = [msgspec.to_builtins(form_of(Scene).encode(one).frames) for one in (scene, again)]
    for frames in forms:
        for frame in frames:
            frame["photo"]["file"] = Path(frame["photo"]["file"]).name
    assert forms[0] == forms[1]
    assert again.frames[0].file.photo.width == CAMERA.width


def test_a_frame_has_the_lens_of_the_view(path, tmp_path):
    scene = sequence(path)
    undone = Undistortion.of(Lens("opencv", (0.1, 0.0, 0.0, 0.0)), CAMERA)
    view = replace(scene.views[0], file=replace(scene.views[0].file, undistortion=undone))
    view = replace(view, camera=undone.camera)
    save_scene(tmp_path / "s.json", as_saved(replace(scene, views=(view,))))
    again = load_scene(tmp_path / "s.json")
    photo = show_frame(again, 2).views[0].photo
    assert photo.undistortion is not None
    assert np.any(photo.pixels != load_scene(path).views[0].photo.pixels)


def test_poses_of_a_sequence_are_saved_as_they_are(path):
    scene = sequence(path)
    item = scene.objects[0]
    saved = as_saved(scene)
    assert saved.objects[0].world_from_model is item.world_from_model
    assert not saved.objects[0].in_views
    assert saved.frames == scene.frames
    without = as_saved(replace(scene, objects=scene.objects[1:]))
    assert not any(frame.poses for frame in without.frames)


def masked(path: Path) -> Scene:
    """The sequence with two masks in its first frame, and in its second one what a search found in
    front.
    """
    scene, masks = sequence(path), {"ball": Mask.of(np.tri(240, 320, -3))}
    hidden = (np.tri(240, 320, -9, bool),)
    first, second, *others = scene.frames
    first = replace(first, mask=Mask.of(np.tri(240, 320)), masks=masks)
    result = SearchResult(hidden=hidden)
    pose = replace(second.poses["ball"], source="key", result=result)
    frames = (first, replace(second, poses={"ball": pose}), *others)
    return show_frame(replace(scene, frames=frames), 1)


def test_masks_and_occluders_belong_to_their_frames(path, tmp_path):
    scene = masked(path)
    (tmp_path / "o\u200bdd").mkdir()
    saved = as_saved(scene)
    save_scene(tmp_path / "o\u200bdd" / "o\u200bdd.json", saved)
    load_valid(tmp_path / "o\u200bdd" / "o\u200bdd.json", "scene")
    assert as_saved(scene).frames[1] is saved.frames[1]  # an autosave need not write it again
    again = load_scene(tmp_path / "o\u200bdd" / "o\u200bdd.json")
    counts = [[len(show_frame(one, i).masks(0)) for i in range(3)] for one in (scene, again)]
    assert counts == [[2, 0, 0]] * 2
    known = show_frame(scene, 0).mask(0), scene.occluders(0)
    for i, mask in enumerate((show_frame(again, 0).mask(0), show_frame(again, 1).occluders(0))):
        assert np.array_equal(mask.weights, known[i].weights)
    assert show_frame(again, 0).mask(1).weights.sum() > show_frame(again, 0).mask(0).weights.sum()
    assert show_frame(again, 2).occluders(0) is None
    without = as_saved(replace(scene, objects=scene.objects[1:])).frames
    assert not any(frame.masks or frame.occluders for frame in without)
    assert without[0].mask is scene.frames[0].mask


def test_a_frame_alone_keeps_its_masks(path):
    scene = masked(path)
    for index in range(3):
        shown = show_frame(scene, index)
        still = as_still(shown)
        assert not still.frames
        for number in range(3):
            for kind in (Scene.mask, Scene.occluders):
                one, other = (kind(each, number) for each in (still, shown))
                assert (one is None) == (other is None)
                assert one is None or np.array_equal(one.weights, other.weights)


@pytest.mark.parametrize(("change", "words"), [
    (lambda d: d.update(frame_index=3), "frame_index is 3; wanted one view, and one of its 3"),
    (lambda d: d["views"].append(d["views"][0]), "2 views, and frame_index is 1; wanted one view"),
    (lambda d: d["frames"][1]["photo"].update(file="gone.png"),
     r"frames\[1\].photo.file is gone.png, and there is no"),
    (lambda d: d["frames"][1]["photo"].update(width=64), r"frames\[1\].photo is 64x240 px; wanted"),
    (lambda d: d["frames"][1]["poses"].update(car=d["frames"][1]["poses"]["ball"]),
     r"frames\[1\].poses has 'car'; wanted the id of an object, one of ball, front, apart"),
    (lambda d: d["frames"][1]["poses"]["ball"].update(source="x"), "source is 'x'; wanted one of"),
    (lambda d: d["frames"][1].update(masks={"car": "f0.png"}),
     r"frames\[1\].masks has 'car'; wanted the id of an object"),
    (lambda d: d["frames"][1].update(occluders={"ball": "gone.png"}), "gone.png, and there is no"),
    (lambda d: d["frames"][1].update(masks={"ball": 5}), r"frames\[1\].masks\[...\] is 5; wanted"),
    (lambda d: d["frames"][1].update(mask="small.png"), "the mask has 8x8 px, the photo f1.png"),
])  # fmt: skip
def test_what_is_wrong_with_frames_is_said(path, change, words):
    save_scene(path, as_saved(sequence(path)))
    path.with_name("small.png").write_bytes(mask_as_png(Mask.of(np.ones((8, 8)))))
    edit(path, change)
    with pytest.raises(PoseViewerError, match=words):
        load_scene(path)


@pytest.mark.slow
def test_very_many_frames_are_saved_and_no_photo_is_read(path, tmp_path):
    scene = as_saved(sequence(path, 2_000))
    for frame in scene.frames[::199]:
        frame.file.path.write_bytes(b"no picture")
    save_scene(tmp_path / "s.json", scene)
    assert len((tmp_path / "s.json").read_text().splitlines()) < 2_400
    again = load_scene(tmp_path / "s.json")
    assert len(again.frames) == 2_000
    assert again.frames[-1].time_s == 1999 / 30.0
    assert json.loads((tmp_path / "s.json").read_text())["frames"][1999]["poses"]
