"""What is what among files that came together."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from poseviewer.errors import CalibrationFileError, FileSetError, PoseFileError
from poseviewer.files.cameras import load_cameras
from poseviewer.files.file_set import (
    FileSet,
    files_below,
    model_files,
    nothing_to_open,
    sort_set,
)
from poseviewer.files.formats.reconstructions import colmap_photos
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.set_questions import (
    ALL_OBJECTS,
    ANOTHER_OBJECT,
    Chosen,
    Question,
    choose,
)
from poseviewer.files.state.uploads import gathered
from poseviewer.files.view_set import load_view_set
from tests.textured import write_gltf, write_obj, write_ply
from tests.view_sets import TRUTH, write_bop, write_colmap, write_frames, write_views

POSE = {"projection": "perspective", "camera": {}, "camera_from_model": {}}
CAMERA = {"camera_matrix": [[300, 0, 80], [0, 300, 60], [0, 0, 1]], "image_size": [160, 120]}
KEYPOINTS = {"format": "poseviewer-keypoints", "left": {}, "right": {}}
PLAIN = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def picture(path: Path, camera: str = "") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    image, exif = Image.new("RGB", (8, 6), (200, 40, 30)), Image.Exif()
    if camera:
        exif[ExifTags.Base.Make] = camera
    image.save(path, exif=exif)
    return path


def write(path: Path, content: object) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def sort(root: Path, **more) -> FileSet:
    return sort_set(files_below(root), **more)


def answered(found: FileSet, *answers: str, placed: str = "") -> tuple[Chosen, list[Question]]:
    """What is chosen with these answers, and what was asked; all answers are taken."""
    choosing, questions = choose(found, placed), []
    left: list[str | None] = [None, *answers]
    try:
        while left:
            questions.append(choosing.send(left.pop(0)))
    except StopIteration as end:
        assert not left
        return end.value, questions
    raise AssertionError(questions[-1])


def names(paths: Iterable[Path | None]) -> list[str | None]:
    return [None if path is None else path.name for path in paths]


@pytest.mark.parametrize("write_model", [write_obj, write_ply, write_gltf])
@pytest.mark.parametrize("folders", [("", ""), ("source", "textures"), ("a/b", "c/d e")])
def test_a_picture_that_a_model_names_is_its_texture(
    tmp_path: Path, write_model: Callable[[Path, str], Path], folders: tuple[str, str]
) -> None:
    root = tmp_path / "set"
    place = root / folders[0]
    place.mkdir(parents=True)
    write_model(place, "C:\\me\\WOOD.png" if write_model is not write_gltf else "../x/wood.png")
    wood = picture(root / folders[1] / "wood.png")
    found = sort(root)
    (model,) = found.models
    assert wood in model.named.values()
    assert not model.missing
    assert found.photos == found.pictures == found.leftovers == ()
    chosen, questions = answered(found)
    assert chosen == Chosen(model=model)
    assert not questions
    mesh = load_mesh(gathered(tmp_path / "state", model))
    assert len(mesh.textures) == 1
    assert not mesh.notes


def test_a_buffer_elsewhere_in_the_set_is_found(tmp_path: Path) -> None:
    root = tmp_path / "set"
    (root / "a").mkdir(parents=True)
    path = write_gltf(root / "a", "wood.png")
    (root / "b").mkdir()
    path.with_name("quad.bin").rename(root / "b" / "quad.bin")
    picture(root / "b" / "wood.png")
    (model,) = sort(root).models
    assert model.scattered
    assert len(load_mesh(gathered(tmp_path / "state", model)).textures) == 1


def test_of_two_pictures_of_one_name_the_nearer_is_taken(tmp_path: Path) -> None:
    write_obj(tmp_path, "red/wood.png")
    for folder in ("x/blue", "x/red", "y"):
        picture(tmp_path / folder / "wood.png")
    (model,) = sort(tmp_path).models
    assert model.named["red/wood.png"] == tmp_path / "x/red/wood.png"


def test_a_photo_with_its_model_needs_no_question(tmp_path: Path) -> None:
    write(tmp_path / "car.obj", PLAIN)
    picture(tmp_path / "street.png")
    chosen, questions = answered(sort(tmp_path))
    assert names([chosen.photo]) == ["street.png"]
    assert chosen.model is not None
    assert not questions


def test_a_camera_s_picture_is_the_photo_beside_textures(tmp_path: Path) -> None:
    write_obj(tmp_path, "wood.png")
    picture(tmp_path / "wood.png")
    picture(tmp_path / "street.jpg", camera="Canon")
    chosen, questions = answered(sort(tmp_path))
    assert names([chosen.photo]) == ["street.jpg"]
    assert not questions


@pytest.mark.parametrize(
    ("answer", "photo"), [("rough.png", "rough.png"), ("none: the photo stays", None)]
)
def test_a_picture_that_nothing_names_is_asked_about(
    tmp_path: Path, answer: str, photo: str | None
) -> None:
    write_obj(tmp_path, "wood.png")
    picture(tmp_path / "wood.png")
    picture(tmp_path / "rough.png")
    chosen, questions = answered(sort(tmp_path), answer)
    assert questions == [
        Question(
            "No file names the picture rough.png. Is it the photo?",
            ("rough.png", "none: the photo stays"),
        )
    ]
    assert names([chosen.photo]) == [photo]
    assert chosen.model is not None


def test_a_missing_texture_may_be_there_under_another_name(tmp_path: Path) -> None:
    root = tmp_path / "set"
    root.mkdir()
    write_obj(root, "wood.png")
    picture(root / "wood (1).png")
    chosen, questions = answered(sort(root), "wood (1).png")
    assert questions[0].text == (
        "quad.obj names wood.png, which did not come with it. Is it one of these?"
    )
    assert chosen.photo is None
    assert chosen.model is not None
    mesh = load_mesh(gathered(tmp_path / "state", chosen.model))
    assert len(mesh.textures) == 1
    chosen, questions = answered(sort(root), "no", "wood (1).png")
    assert names([chosen.photo]) == ["wood (1).png"]
    assert chosen.model is not None
    assert chosen.model.missing == ("wood.png",)


def test_a_missing_texture_alone_asks_nothing(tmp_path: Path) -> None:
    path = write_obj(tmp_path, "wood.png")
    chosen, questions = answered(sort(tmp_path))
    assert not questions
    assert chosen.notes == ()
    assert chosen.model == model_files(path, [])
    # It is said once, by who reads the model, which opens grey.
    mesh = load_mesh(path)
    assert mesh.notes == ("Texture left out: wood.png is not there.",)
    assert not mesh.textures


def test_of_several_models_one_is_chosen_or_all(tmp_path: Path) -> None:
    for name in ("a.obj", "b.obj", "c.obj"):
        write(tmp_path / name, PLAIN)
    found = sort(tmp_path)
    chosen, (question,) = answered(found, "b.obj")
    assert question.text == "3 models came together. Which one is to be opened?"
    assert question.options == (
        "a.obj", "b.obj", "c.obj", ALL_OBJECTS, "none: the model stays",
    )  # fmt: skip
    assert chosen.model is not None
    assert chosen.model.path.name == "b.obj"
    chosen, _ = answered(found, ALL_OBJECTS)
    assert chosen.model is not None
    assert chosen.model.path.name == "a.obj"
    assert names([one.path for one in chosen.objects]) == ["b.obj", "c.obj"]
    assert chosen.others == ()
    # Beside one that is in its place, they are all further ones.
    chosen, _ = answered(found, ALL_OBJECTS, placed="car.glb")
    assert chosen.model is None
    assert names([one.path for one in chosen.objects]) == ["a.obj", "b.obj", "c.obj"]
    chosen, _ = answered(found, "none: the model stays")
    assert chosen == Chosen()


def test_a_model_beside_one_in_its_place_is_another_object_or_instead_of_it(tmp_path: Path) -> None:
    model = write(tmp_path / "a.obj", PLAIN)
    pose = write(tmp_path / "p.json", {"camera_from_model": {}})
    found = sort(tmp_path)
    chosen, (question,) = answered(found, ANOTHER_OBJECT, placed="car.glb")
    assert question.text.startswith("car.glb is in its place. Is a.obj another object")
    assert chosen.model is None
    assert names([one.path for one in chosen.objects]) == ["a.obj"]
    assert chosen.pose is None  # of which of them it is, it does not say
    assert chosen.notes == ("Not used: p.json.",)
    chosen, _ = answered(found, "in place of car.glb", placed="car.glb")
    assert chosen.model is not None
    assert (chosen.model.path, chosen.pose, chosen.objects) == (model, pose, ())
    chosen, _ = answered(found, "none: open no model", placed="car.glb")
    assert chosen.model is None
    assert chosen.objects == ()
    # With a photo of its own there is nothing to ask.
    picture(tmp_path / "photo.jpg", "camera")
    chosen, questions = answered(sort(tmp_path), placed="car.glb")
    assert not questions
    assert chosen.model is not None


def test_json_files_are_told_apart_by_what_they_hold(tmp_path: Path) -> None:
    write(tmp_path / "car.obj", PLAIN)
    write(tmp_path / "car.keypoints.json", KEYPOINTS)
    write(tmp_path / "1.json", POSE)
    write(tmp_path / "2.json", CAMERA)
    write(tmp_path / "3.json", {"notes": 1})
    write(tmp_path / "4.json", "[1, 2")
    write(tmp_path / "readme.txt", "of a car")
    found = sort(tmp_path)
    (model,) = found.models
    assert names(model.named.values()) == ["car.keypoints.json"]
    assert names(found.poses) == ["1.json"]
    assert names(found.cameras) == ["2.json"]
    chosen, questions = answered(found)
    assert not questions
    assert chosen.calibration is not None
    assert chosen.notes == ("Not used: 3.json, 4.json, readme.txt.",)


def test_key_points_of_another_name_are_asked_about(tmp_path: Path) -> None:
    root = tmp_path / "set"
    write(root / "car.obj", PLAIN)
    write(root / "points.json", KEYPOINTS)
    chosen, questions = answered(sort(root), "points.json")
    assert questions[0].text.endswith("Are they those of car.obj?")
    assert chosen.model is not None
    path = gathered(tmp_path / "state", chosen.model)
    assert path.with_name("car.keypoints.json").is_file()


def test_what_the_model_at_hand_misses_may_come_later(tmp_path: Path) -> None:
    first, later = tmp_path / "first", tmp_path / "later"
    first.mkdir()
    path = write_obj(first, "wood.png")
    (first / "quad.mtl").rename(tmp_path / "quad.mtl")
    later.mkdir()
    picture(later / "wood.png")
    assert names(sort(later, at_hand=path).photos) == ["wood.png"]  # nothing names it yet
    (tmp_path / "quad.mtl").rename(later / "quad.mtl")
    found = sort(later, at_hand=path)
    assert found.photos == found.pictures == ()
    (model,) = found.models
    assert model.path == path
    assert len(load_mesh(gathered(tmp_path / "state", model)).textures) == 1
    picture(first / "wood.png")
    write_obj(first, "wood.png")
    assert not sort(later, at_hand=path).models  # it misses nothing


def test_a_folder_of_a_thousand_photos_is_one_question(tmp_path: Path) -> None:
    for i in range(1000):
        (tmp_path / f"{i:04d}.jpg").touch()
    chosen, (question,) = answered(sort(tmp_path), "0123.jpg")
    assert question.text == "1,000 photos. Which one is to be opened?"
    assert len(question.options) == 1001
    assert names([chosen.photo]) == ["0123.jpg"]


def test_what_the_user_calls_the_files_counts(tmp_path: Path) -> None:
    write_obj(tmp_path, "wood.png")
    picture(tmp_path / "rough.png")
    assert names(sort(tmp_path, kind="photo").photos) == ["rough.png"]
    of_model = sort(tmp_path, kind="model")
    assert of_model.photos == of_model.pictures == ()
    chosen, (question,) = answered(of_model, "rough.png")  # it may be the texture that is missing
    assert "wood.png, which did not come" in question.text
    assert chosen.photo is None
    write(tmp_path / "any.json", [1])
    of_pose = sort(tmp_path, kind="pose")
    assert names(of_pose.poses) == ["any.json"]
    assert of_pose.models == of_pose.photos == ()


def test_systems_own_files_are_left_out(tmp_path: Path) -> None:
    for name in (".DS_Store", "__MACOSX/._a.obj", "Thumbs.db", ".git/a.obj", "desktop.ini"):
        write(tmp_path / name, PLAIN)
    write(tmp_path / "a.obj", PLAIN)
    assert names(files_below(tmp_path)) == ["a.obj"]


@pytest.mark.parametrize(
    ("files", "sentence"),
    [
        (["notes.txt"], "notes.txt: not the name of a photo, a model or a pose file; wanted one "),
        (["car.mtl"], "car.mtl: of a model that did not come along; drop them together."),
        (["a.txt", "b.mov"], "2 files: none is a photo, a model or a pose file; wanted one that"),
    ],
)
def test_what_opens_nothing_is_said_in_one_sentence(
    tmp_path: Path, files: Sequence[str], sentence: str
) -> None:
    for name in files:
        write(tmp_path / name, "x")
    found = sort(tmp_path)
    assert found.is_empty
    assert str(nothing_to_open(found)).startswith(sentence)


def test_a_sole_json_file_is_a_pose_so_that_its_fault_is_said(tmp_path: Path) -> None:
    write(tmp_path / "list.json", "[1, 2")
    assert names(sort(tmp_path).poses) == ["list.json"]


def bop_scene(folder: Path) -> None:
    matrix = [150.0, 0, 80, 0, 150.0, 60, 0, 0, 1]
    turn = [1, 0, 0, 0, 1, 0, 0, 0, 1]
    cameras = {str(i): {"cam_K": matrix, "depth_scale": 1.0} for i in (3, 7)}
    poses = {
        "3": [{"obj_id": 5, "cam_R_m2c": turn, "cam_t_m2c": [1, 2, 900]}],
        "7": [{"obj_id": i, "cam_R_m2c": turn, "cam_t_m2c": [0, 0, z]}
              for i, z in ((5, 700), (5, 800), (6, 600))],
    }  # fmt: skip
    write(folder / "scene_camera.json", cameras)
    write(folder / "scene_gt.json", poses)
    for i in (3, 7):
        picture(folder / f"rgb/{i:06d}.png")
        picture(folder / f"mask/{i:06d}_000000.png")


def test_a_bop_scene_gives_photo_camera_model_and_start(tmp_path: Path) -> None:
    bop_scene(tmp_path / "test/000002")
    for i in (1, 5, 6):
        write(tmp_path / f"models/obj_{i:06d}.obj", PLAIN)
    found = sort(tmp_path)
    photo = "test/000002/rgb/000003.png"
    chosen, questions = answered(found, photo)
    assert [len(question.options) for question in questions] == [3]
    assert names([chosen.photo]) == ["000003.png"]
    assert chosen.model is not None
    assert chosen.model.path.name == "obj_000005.obj"
    assert chosen.place is not None
    np.testing.assert_array_equal(chosen.place.translation, [1, 2, 900])
    assert chosen.calibration is not None
    assert chosen.calibration.path.name == "scene_camera.json"
    # Of two such objects the scene does not say which one is meant.
    chosen, questions = answered(found, photo.replace("3", "7"), "models/obj_000005.obj")
    assert [len(question.options) for question in questions] == [3, 4]
    assert chosen.place is None
    (tmp_path / "test/000002/scene_gt.json").write_text('{"3": 7}')
    with pytest.raises(PoseFileError, match="image 3 is not a list"):
        sort(tmp_path)


@pytest.mark.parametrize("kind", ["txt", "bin"])
def test_a_colmap_model_gives_photo_camera_and_start(tmp_path: Path, kind: str) -> None:
    if kind == "txt":
        write(tmp_path / "sparse/0/cameras.txt", "# x\n1 PINHOLE 160 120 150 150 80 60\n")
        images = "1 1 0 0 0 0.5 0 4 1 a/one.jpg\n\n2 1 0 0 0 0 0 5 1 b/one.jpg\n\n"
        write(tmp_path / "sparse/0/images.txt", images)
    else:
        write_binary_model(tmp_path / "sparse/0")
    write(tmp_path / f"sparse/0/points3D.{kind}", "")
    for folder in "ab":
        picture(tmp_path / f"images/{folder}/one.jpg")
    write(tmp_path / "meshed.obj", PLAIN)
    found = sort(tmp_path)
    assert found.leftovers == found.cameras == ()
    chosen, (question,) = answered(found, "images/b/one.jpg")
    in_all = "all 2 photos: one pose in all of them"
    assert question.options == (in_all, "images/a/one.jpg", "images/b/one.jpg", "none")
    assert chosen.place is not None
    np.testing.assert_array_equal(chosen.place.translation, [0, 0, 5])


def write_binary_model(folder: Path) -> None:
    """As COLMAP's ``Reconstruction::WriteBinary`` does: a pinhole, two images, some points."""
    folder.mkdir(parents=True)
    camera = struct.pack("<QIiQQ4d", 1, 1, 1, 160, 120, 150.0, 150.0, 80.0, 60.0)
    (folder / "cameras.bin").write_bytes(camera)
    images = struct.pack("<Q", 2)
    for number, shift, name, points in ((1, (0.5, 0, 4), b"a", 2), (2, (0, 0, 5), b"b", 1)):
        images += struct.pack("<I7dI", number, 1, 0, 0, 0, *shift, 1) + name + b"/one.jpg\0"
        images += struct.pack("<Q", points) + points * struct.pack("<ddQ", 1, 2, 3)
    (folder / "images.bin").write_bytes(images)


def test_a_colmap_model_that_is_cut_short_is_refused(tmp_path: Path) -> None:
    write_binary_model(tmp_path / "0")
    whole = (tmp_path / "0/images.bin").read_bytes()
    for cut in (5, 30, 76, 90, len(whole) - 30, len(whole) - 3):
        (tmp_path / "0/images.bin").write_bytes(whole[:cut])
        with pytest.raises(
            PoseFileError, match=r"images\.bin: is cut short; wanted a file of a COLMAP model"
        ):
            colmap_photos(tmp_path / "0")
    (tmp_path / "0/images.bin").write_bytes(whole)
    (tmp_path / "0/cameras.bin").write_bytes(struct.pack("<QIiQQ", 1, 1, 99, 160, 120))
    with pytest.raises(CalibrationFileError, match="camera 1 is of model 99; wanted one of COLMAP"):
        load_cameras(tmp_path / "0/cameras.bin")


def test_too_many_files_are_refused(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("poseviewer.files.file_set.MOST_FILES", 5)
    for i in range(20):
        (tmp_path / f"{i}.txt").touch()
    with pytest.raises(FileSetError, match="more than 5 files; name a folder inside it"):
        files_below(tmp_path)


def test_a_set_of_photos_comes_with_its_model_and_start(tmp_path: Path):
    of_set, model, start = write_views(tmp_path)
    found = sort_set(files_below(tmp_path))
    assert found.set_files == (of_set,)
    with pytest.raises(StopIteration) as end:
        choose(found).send(None)
    chosen = end.value.value
    assert (chosen.views, chosen.model.path, chosen.pose) == (of_set, model, start)


def test_all_photos_with_known_cameras_can_be_a_set(tmp_path: Path):
    """Of COLMAP, nerfstudio and BOP; without the file of the set itself."""
    in_all = "all 3 photos: one pose in all of them"
    for kind, write_cameras in (
        ("colmap", lambda folder: write_colmap(folder / "sparse" / "0")),
        ("nerfstudio", lambda folder: write_frames(folder, camera_angle_x=0.5)),
        ("bop", lambda folder: write_bop(folder, with_world=True)),
        ("rig", lambda folder: write_bop(folder, with_world=False)),
    ):
        folder = tmp_path / kind
        folder.mkdir()
        of_set, model, start = write_views(folder)
        for path in (of_set, start):
            path.unlink()
        cameras = write_cameras(folder)
        if kind in ("bop", "rig"):
            model = model.rename(folder / "obj_000005.ply")
        found = sort_set(files_below(folder))
        chosen, (question,) = answered(found, in_all)
        assert question.options[0] == in_all
        assert (chosen.views, chosen.model and chosen.model.path) == (cameras, model)
        assert chosen.choice.rig_object == (5 if kind == "rig" else None)
        views = load_view_set(cameras, chosen.choice).views
        assert len(views) == 3
        if kind in ("bop", "rig"):
            assert chosen.photo == views[0].path
            np.testing.assert_array_equal(
                chosen.place and chosen.place.translation, TRUTH[0].camera_from_model.translation
            )
        photo = question.options[2]
        chosen, _ = answered(found, photo)  # one photo, as before
        assert chosen.views is None
        assert chosen.photo == folder / photo


def test_of_several_objects_it_is_asked_which_one_tells_how_the_camera_moved(tmp_path: Path):
    write_views(tmp_path)
    (tmp_path / "set.json").unlink()
    scene = write_bop(tmp_path, with_world=False)
    poses = json.loads((scene / "scene_gt.json").read_text())
    for entries in list(poses.values())[1:]:
        entries.append(entries[0] | {"obj_id": 8})
    (scene / "scene_gt.json").write_text(json.dumps(poses))
    found = sort_set(files_below(scene))
    in_all = "all 3 photos: one pose in all of them"
    chosen, (_, question) = answered(found, in_all, "object 8, in 2 photos")
    assert question.options[:2] == ("object 5, in 3 photos", "object 8, in 2 photos")
    assert (chosen.choice.rig_object, len(chosen.choice.photos)) == (8, 2)
    chosen, _ = answered(found, in_all, "none: open no photo")
    assert chosen.views is chosen.photo is None
