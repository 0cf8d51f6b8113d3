"""Sets of photos, read from four kinds of files."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from poseviewer.errors import PoseFileError, PoseViewerError
from poseviewer.opening.photo_sets import SetChoice, describe_folder, load_views
from poseviewer.opening.sources import is_scene_file
from tests import view_sets
from tests.commands import run
from tests.view_sets import CAMERA, CAMERAS_FROM_SET, NAMES, write_colmap, write_frames
from tests.writing import edit, write


@pytest.fixture
def folder(tmp_path) -> Path:
    view_sets.write_views(tmp_path)
    return tmp_path


def require_same_cameras(found, names=NAMES) -> None:
    assert [view.name for view in found.views] == list(names)
    first = found.views[0].camera_from_world
    for view, truth in zip(found.views, view_sets.make_views().views, strict=True):
        moved = view.camera_from_world @ first.inverse()
        true = truth.camera_from_world @ CAMERAS_FROM_SET[0].inverse()
        np.testing.assert_allclose(moved.rotation, true.rotation, atol=1e-9)
        np.testing.assert_allclose(moved.translation, true.translation, atol=1e-9)
        assert (view.camera.fx, view.camera.cx) == pytest.approx((CAMERA.fx, CAMERA.cx))


def test_our_own_file_is_read(folder):
    found = load_views(folder / "set.json")
    require_same_cameras(found)
    assert not is_scene_file(folder / "set.json")
    assert found.scale == 1.0
    assert load_views(view_sets.write_set(folder, unit="mm")).scale is None
    assert load_views(view_sets.write_set(folder, free_scale=True)).scale is None
    chosen = load_views(folder / "set.json", SetChoice(("a", "c")))
    assert [view.name for view in chosen.views] == ["a.png", "c.png"]


def test_a_colmap_project_is_read_and_its_scale_is_not_known(folder):
    write_colmap(folder / "sparse" / "0")
    found = load_views(folder)
    require_same_cameras(found)
    assert found.scale is None
    require_same_cameras(load_views(folder / "sparse" / "0"))


def test_photos_that_are_stored_turned_turn_their_cameras(folder):
    exif = Image.Exif()
    exif[0x0112] = 3
    for name in NAMES:
        with Image.open(folder / name) as photo:
            photo.transpose(Image.Transpose.ROTATE_180).save(folder / name, exif=exif)
    shared = {"fl_x": 600.0, "fl_y": 600.0, "cx": 159.5, "cy": 119.5, "w": 320, "h": 240}
    view, stored = load_views(write_frames(folder, **shared)).views[1], CAMERAS_FROM_SET[1]
    assert (view.camera.cx, view.camera.cy) == (160.5, 120.5)
    turned = np.diag([-1.0, -1.0, 1.0]) @ stored.rotation
    np.testing.assert_allclose(view.camera_from_world.rotation, turned, atol=1e-9)
    assert "turned with it" in view.photo.notes[0]


def test_names_of_photos_may_be_written_on_windows(folder):
    (folder / "images").mkdir()
    for name in NAMES:
        (folder / name).rename(folder / "images" / name)
    written = [f"images\\{name}" for name in NAMES]
    frames = write_frames(folder, fl_x=600.0, cx=160.5, cy=120.5, w=320, h=240)

    def rename(data):
        for frame, name in zip(data["frames"], written, strict=True):
            frame["file_path"] = name

    require_same_cameras(load_views(edit(frames, rename), SetChoice(NAMES)))
    write_colmap(folder / "sparse", written)
    require_same_cameras(load_views(folder))


def test_frames_of_nerfstudio_and_of_nerf_are_read(folder):
    shared = {"fl_x": 600.0, "fl_y": 600.0, "cx": 160.5, "cy": 120.5, "w": 320, "h": 240}
    require_same_cameras(load_views(write_frames(folder, **shared)))
    angle = 2.0 * np.arctan(0.5 * 320 / 600.0)
    found = load_views(write_frames(folder, camera_angle_x=angle))
    assert found.views[1].photo.default_camera().fx == pytest.approx(600.0)
    assert found.views[1].camera.cx == 160.0
    (folder / "b.png").unlink()
    found = load_views(write_frames(folder, camera_angle_x=angle), SetChoice(("a", "c")))
    assert [view.name for view in found.views] == ["a.png", "c.png"]


def test_a_bop_scene_is_read_by_its_world_or_by_an_object(folder):
    scene = view_sets.write_bop(folder, with_world=True)
    names = [f"{number:06d}.png" for number in range(3)]
    found = load_views(scene)
    require_same_cameras(found, names)
    assert found.unit == "mm"
    shutil.rmtree(scene)
    scene = view_sets.write_bop(folder, with_world=False)
    require_same_cameras(load_views(scene, SetChoice(rig_object=5)), names)
    with pytest.raises(PoseFileError, match="`rig_object`"):
        load_views(scene)


def test_every_photo_has_its_own_lens(folder):
    models = ("opencv", "opencv-fisheye", None)

    def mix(data):
        for view, model in zip(data["views"], models, strict=True):
            if model is not None:
                cameras = dict.fromkeys(("camera_as_taken", "camera_undistorted"), view["camera"])
                lens = {"model": model, "coefficients": [-0.1, 0.02, 0.0, 0.0]}
                view["distortion"] = lens | cameras

    views = load_views(edit(folder / "set.json", mix)).views
    known = [view.photo.undistortion for view in views]
    assert [one and one.lens.model for one in known] == ["opencv", "fisheye", None]
    for view, one in zip(views, known, strict=True):
        assert view.camera == (CAMERA if one is None else one.camera)


@pytest.mark.parametrize(("change", "said"), [
    (lambda data: data.update(views=data["views"][:1]), "1 photo; a set has two or more"),
    (lambda data: data["views"][1]["photo"].update(file="a.png"), "a.png and a.png are one"),
    (lambda data: data["views"][1].pop("camera"), "camera is missing"),
    (lambda data: data["views"][0]["camera"].update(fx=1e29), r"camera\.fx is 1e\+29"),
    (lambda data: data.update(free_scale=-1), "free_scale is -1"),
    (lambda data: data.update(format="x"), "format is 'x'"),
    (lambda data: data["views"][2].update(distortion={
        "model": "opencv", "coefficients": [0.1, 0.2],
        "camera_as_taken": data["views"][2]["camera"],
        "camera_undistorted": data["views"][2]["camera"],
    }), r"views\[2\].distortion.coefficients is a list of 2"),
])  # fmt: skip
def test_what_is_wrong_is_said_in_a_sentence(folder, change, said):
    with pytest.raises(PoseViewerError, match=said):
        load_views(edit(folder / "set.json", change))


def test_names_that_no_file_can_have_are_those_of_photos_that_are_not_there(folder):
    path = folder / "set.json"
    with pytest.raises(PoseViewerError, match=r"no such file|cannot be read"):
        load_views(edit(path, lambda data: data["views"][1]["photo"].update(file="x" * 9_999)))
    with pytest.raises(PoseViewerError, match="1 of the 3 photos"):
        load_views(write_colmap(folder / "model", (NAMES[0], "x" * 10_000, NAMES[2])))


def test_colmap_photos_that_are_not_there_are_said(folder):
    model = write_colmap(folder / "sparse" / "0")
    (folder / "b.png").unlink()
    with pytest.raises(PoseFileError, match=r"1 of the 3 photos .* such as b\.png.*`folder`"):
        load_views(model)
    assert len(load_views(model, SetChoice(("a", "c"))).views) == 2
    with pytest.raises(PoseFileError, match="no photo z"):
        load_views(model, SetChoice(("a", "z")))


def test_photos_are_chosen_by_their_names_in_folders(folder):
    for name in NAMES:
        (folder / name[0]).mkdir()
        (folder / name).rename(folder / name[0] / "photo.png")
    names = [f"{name[0]}/photo.png" for name in NAMES]
    found = load_views(write_colmap(folder / "sparse" / "0", names), SetChoice(tuple(names[:2])))
    assert [view.name for view in found.views] == names[:2]


def test_a_folder_is_described_by_what_it_holds(tmp_path):
    assert describe_folder(tmp_path) == ""
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"f{i}.png"), np.zeros((4, 4), np.uint8))
    assert describe_folder(tmp_path) == "3 images, f0.png to f2.png: a sequence or a set"
    write(tmp_path / "scene_camera.json", {"1": {"cam_K": [5, 0, 2, 0, 5, 2, 0, 0, 1]}})
    assert describe_folder(tmp_path) == "a BOP scene of 1 images with cameras"
    write(
        tmp_path / "sparse/0/images.txt", "1 1 0 0 0 0 0 2 1 a.png\n\n2 1 0 0 0 0 0 2 1 b.png\n\n"
    )
    assert describe_folder(tmp_path) == "a COLMAP model of 2 images, images.txt"
    assert run("info", tmp_path) == 0
