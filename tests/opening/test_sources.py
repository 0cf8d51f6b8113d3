"""Files that came together are told apart; two of one kind are refused, and nothing guessed."""

import re
from pathlib import Path

import pytest
from PIL import ExifTags, Image

from poseviewer.errors import FileSetError
from poseviewer.files.cameras import Calibration
from poseviewer.files.mesh.load import load_mesh
from poseviewer.opening.photo_sets import load_views
from poseviewer.opening.sources import Sources, files_below, model_files, sort_set
from poseviewer.opening.uploads import gather
from tests.textured import write_gltf, write_obj, write_ply
from tests.view_sets import write_bop, write_colmap, write_frames, write_views
from tests.writing import write

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


def sort(root: Path, **more) -> Sources:
    return sort_set(files_below(root), **more)


@pytest.mark.parametrize("write_model", [write_obj, write_ply, write_gltf])
@pytest.mark.parametrize("folders", [("", ""), ("source", "textures"), ("a/b", "c/d e")])
def test_a_picture_that_a_model_names_is_its_texture(tmp_path: Path, write_model, folders) -> None:
    root = tmp_path / "set"
    (root / folders[0]).mkdir(parents=True)
    name = "C:\\me\\WOOD.png" if write_model is not write_gltf else "../x/wood.png"
    write_model(root / folders[0], name)
    wood = picture(root / folders[1] / "wood.png")
    files = sort(root)
    (model,) = files.models
    assert wood in model.named.values()
    assert files == Sources(models=(model,))
    mesh = load_mesh(gather(tmp_path / "state", model))
    assert len(mesh.textures) == 1
    assert not mesh.notes


def test_of_two_pictures_of_one_name_the_nearer_is_taken(tmp_path: Path) -> None:
    path = write_obj(tmp_path, "red/wood.png")
    places = [picture(tmp_path / folder / "wood.png") for folder in ("x/blue", "x/red", "y")]
    assert model_files(path, [path.with_suffix(".mtl"), *places]).named["red/wood.png"] == places[1]


def test_of_very_many_pictures_of_a_model_so_many_are_looked_for_as_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr("poseviewer.opening.sources.MAX_TEXTURES", 2)
    names = [f"{number}.png" for number in range(3)]
    images = "".join(f"<image><init_from>{name}</init_from></image>" for name in names)
    path, *pictures = (write(tmp_path / name, images) for name in ("m.dae", *names))
    assert [*model_files(path, pictures).named] == names[:2]


def test_photo_model_camera_and_pose_are_told_apart_by_what_they_hold(tmp_path: Path) -> None:
    photo = picture(tmp_path / "street.png")
    model = write(tmp_path / "car.obj", PLAIN)
    write(tmp_path / "car.keypoints.json", KEYPOINTS)
    pose = write(tmp_path / "1.json", {**POSE, "mask": "m.png"})
    picture(tmp_path / "m.png")
    camera = write(tmp_path / "2.json", CAMERA)
    other, broken = write(tmp_path / "3.json", {"notes": 1}), write(tmp_path / "4.json", "[1, 2")
    text = write(tmp_path / "readme.txt", "of a car")
    files = sort(tmp_path)
    (of_model,) = files.models
    assert (of_model.path, list(of_model.named)) == (model, ["car.keypoints.json"])
    assert (files.photo, files.calibration, files.start) == (photo, Calibration(camera), pose)
    assert files.unused == (other, broken, text)
    assert files.notes == ("Not used: 3.json, 4.json, readme.txt.",)


def test_beside_textures_only_a_camera_s_picture_is_the_photo(tmp_path: Path) -> None:
    write_obj(tmp_path, "wood.png")
    picture(tmp_path / "wood.png")
    rough = picture(tmp_path / "rough.png")
    files = sort(tmp_path)
    assert (files.photo, files.unused) == (None, (rough,))
    assert files.notes == ("Not used: rough.png. A picture alone is opened as the photo.",)
    street = picture(tmp_path / "street.jpg", camera="Canon")
    files = sort(tmp_path)
    assert (files.photo, files.unused) == (street, (rough,))


def test_what_the_user_calls_the_files_counts(tmp_path: Path) -> None:
    write_obj(tmp_path, "wood.png")
    rough = picture(tmp_path / "rough.png", camera="Canon")
    assert sort(tmp_path, kind="photo").photo == rough
    assert sort(tmp_path, kind="model").photo is None
    (tmp_path / "quad.obj").unlink()
    any_json = write(tmp_path / "any.json", [1])
    files = sort(tmp_path, kind="pose")
    assert (files.start, files.photo) == (any_json, None)
    assert sort_set([any_json]) == Sources(start=any_json)  # a sole file's fault can be said


def test_several_models_are_several_objects_and_the_pose_of_none(tmp_path: Path) -> None:
    for name in ("a.obj", "b.obj", "c.obj"):
        write(tmp_path / name, PLAIN)
    pose = write(tmp_path / "p.json", POSE)
    files = sort(tmp_path)
    assert [model.path.name for model in files.models] == ["a.obj", "b.obj", "c.obj"]
    assert (files.start, files.unused) == (None, (pose,))


def test_what_the_model_at_hand_misses_may_come_later(tmp_path: Path) -> None:
    first, later = tmp_path / "first", tmp_path / "later"
    first.mkdir()
    path = write_obj(first, "wood.png")
    (first / "quad.mtl").rename(tmp_path / "quad.mtl")
    wood = picture(later / "wood.png")
    assert sort(later, at_hand=path).photo == wood  # nothing names it yet
    (tmp_path / "quad.mtl").rename(later / "quad.mtl")
    files = sort(later, at_hand=path)
    (model,) = files.models
    assert (model.path, files.photo) == (path, None)
    assert len(load_mesh(gather(tmp_path / "state", model)).textures) == 1
    picture(first / "wood.png")
    write_obj(first, "wood.png")
    assert not sort(later, at_hand=path).models  # it misses nothing


@pytest.mark.parametrize(("names", "content", "sentence"), [
    ([f"{i}/{i:04d}.jpg" for i in range(1000)], "",
     "1,000 photos: 0/0000.jpg, 1/0001.jpg, 10/0010.jpg, 100/0100.jpg, 101/0101.jpg and 995 more; "
     "wanted one (or with them the file that says where their cameras stood; or frames of a "
     "sequence, numbered, in one folder), nothing was opened."),
    (["bark.jpg", "wood.jpg"], "", "2 photos: bark.jpg, wood.jpg; wanted one (or with them"),
    (["a.mp4", "b.mov"], "", "2 videos: a.mp4, b.mov; wanted one, nothing was opened."),
    (["a/p.json", "b/p.json"], POSE,
     "2 pose files: a/p.json, b/p.json; wanted one, nothing was opened."),
    (["1.json", "2.json"], CAMERA, "2 files of cameras: 1.json, 2.json; wanted one, nothing"),
    (["1.json", "2.json"], {"format": "poseviewer-scene"}, "2 scene files: 1.json, 2.json;"),
    (["1.json", "2.json"], {"frames": []}, "2 sets of photos: 1.json, 2.json"),
    (["notes.txt"], "x", "notes.txt: not the name of a photo, a model or a pose file; wanted "),
    (["car.mtl"], "x", "car.mtl: of a model that did not come along; drop them together."),
    (["a.txt", "b.doc"], "x", "2 files: none is a photo, a model or a pose file; wanted one "),
])  # fmt: skip
def test_what_cannot_be_opened_is_said_in_one_sentence(tmp_path: Path, names, content, sentence):
    for name in names:
        write(tmp_path / name, content)
    with pytest.raises(FileSetError, match=f"^{re.escape(sentence)}"):
        sort(tmp_path)


def test_of_a_folder_systems_own_files_are_left_out_and_too_many_are_refused(tmp_path, monkeypatch):
    for name in (".DS_Store", "__MACOSX/._a.obj", "Thumbs.db", ".git/a.obj", "desktop.ini"):
        write(tmp_path / name, PLAIN)
    path = write(tmp_path / "a.obj", PLAIN)
    assert files_below(tmp_path) == (path,)
    write(tmp_path / "b.obj", PLAIN)
    monkeypatch.setattr("poseviewer.opening.sources.MAX_BELOW", 1)
    with pytest.raises(FileSetError, match="more than 1 files; name a folder inside it"):
        files_below(tmp_path)


def test_several_photos_or_a_video_are_a_sequence(tmp_path: Path) -> None:
    frames = [picture(tmp_path / f"f{number}.png") for number in (10, 9)]
    model, record = write(tmp_path / "m.ply", b"x"), write(tmp_path / "frames.json", {})
    files = sort(tmp_path)
    assert (files.frames, files.photo, files.unused) == (tuple(frames[::-1]), None, ())
    assert [one.path for one in files.models] == [model]
    assert not sort_set([*frames, model], kind="model").frames
    clip = write(tmp_path / "clip.mp4", b"x")
    assert sort_set([clip, model, frames[0]]).frames == (clip,)
    assert sort_set([clip, model, frames[0]]).unused == (frames[0],)
    assert not sort_set([clip, model], kind="model").frames
    write_frames(tmp_path, camera_angle_x=0.5)
    assert not sort_set([*frames, record, tmp_path / "transforms.json"]).frames


@pytest.mark.parametrize("write_cameras", [
    lambda folder: folder / "set.json",
    lambda folder: write_colmap(folder / "sparse" / "0"),
    lambda folder: write_frames(folder, camera_angle_x=0.5),
    lambda folder: write_bop(folder, with_world=True),
])  # fmt: skip
def test_a_set_of_photos_comes_with_its_model_and_start(tmp_path: Path, write_cameras) -> None:
    _, model, start = write_views(tmp_path)
    views = write_cameras(tmp_path)
    if views.name != "set.json":
        (tmp_path / "set.json").unlink()
    files = sort(tmp_path)
    assert (files.views, files.start, files.photo) == (views, start, None)
    assert [one.path for one in files.models] == [model]
    assert files.unused == ()
    assert len(load_views(views).views) == 3
    write(tmp_path / "b.obj", PLAIN)
    with pytest.raises(FileSetError, match=r"2 models of one set of photos: b\.obj, m"):
        sort(tmp_path)


def test_the_cameras_of_a_reconstruction_are_those_of_one_photo(tmp_path: Path) -> None:
    photo = picture(tmp_path / "a.png")
    model = write_colmap(tmp_path / "sparse")
    files = sort(tmp_path)
    assert (files.photo, files.calibration, files.views) == (
        photo,
        Calibration(model / "cameras.txt"),
        None,
    )


@pytest.mark.parametrize(("name", "kind"), [("a.dng", "photo"), ("a.fbx", "model")])
def test_what_is_to_be_converted_first_is_left_to_its_reader_alone(tmp_path, name, kind):
    """Beside others, as downloads have them, it is passed over."""
    path, model = (write(tmp_path / name, b"x") for name in (name, "m.ply"))
    found = sort_set([path])
    assert (found.photo or found.models[0].path) == path
    assert bool(found.photo) == (kind == "photo")
    assert sort_set([path, model]).unused == (path,)


def test_more_models_than_can_be_opened_are_refused_before_they_are_read(tmp_path: Path) -> None:
    paths = [tmp_path / f"{number}.obj" for number in range(201)]
    with pytest.raises(FileSetError, match=r"201 models: .* wanted one to 200"):
        sort_set(paths)
