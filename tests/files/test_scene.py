"""Scene files: what is written is read back, and what is wrong is said in a sentence."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from assets.source.schemas import KINDS, schema
from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import PoseViewerError
from poseviewer.files.masks import mask_as_png
from poseviewer.files.scene_assets import view_of_file
from poseviewer.files.scene_json import as_saved, form_of, load_scene, save_scene
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.symmetry_group import Symmetry, SymmetryAxis
from poseviewer.geometry.transform import RigidTransform, Similarity
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from poseviewer.opening.uploads import copy_out
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import ChartParameters, InView, Scene, SceneObject, SearchResult
from tests.schemas import json_schema, load_valid
from tests.several import CAMERA, IDS, MESHES, make_three
from tests.writing import edit


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return make_three(tmp_path)


def told(path: Path) -> Scene:
    """A scene of two photos, and all that a file can say of an object."""
    turned = RigidTransform.from_rotation_vector([0.1, 0.2, 0.3], [1.0 / 3.0, 0.0, 0.1])
    shutil.copy(path.with_name("three.png"), path.with_name("again.png"))
    mask, scene = Mask.of(np.tri(240, 320)), load_scene(path)
    second = view_of_file(path.with_name("again.png"), CAMERA, "0" * 64, None, turned, mask)
    own = (InView(region=Rectangle(1.0, 2.0, 30.5, 40.0)), InView(mask=mask, is_compared=False))
    sure = PoseCovariance(scene.pose(0), MESHES[0].centre, np.diag(np.arange(1.0, 7.0)), 0.5)
    result = SearchResult(
        loss=0.1, unexplained=0.2, seen=(0.5, None), covariance=sure, settings={"seed": 1},
        verdict=Verdict("found", 0.9, ("It is seen.",), {"outline": 0.75}),
        chart=ChartParameters("free-body", ("x", "y"), (1.0, 2.0)), notes=("It was quick.",),
    )  # fmt: skip
    first = replace(
        scene.objects[0], in_views=own, start=Similarity(turned, 0.001),
        start_cameras=(replace(CAMERA, fx=500.0), CAMERA), settings=FitSettings(seed=1),
        locked=True, hidden=True, name="round", is_placed=False, without=("mirror",),
        said_symmetry=Symmetry.from_axes(np.zeros(3), [SymmetryAxis(np.array([0.0, 0.0, 1.0]), 2)]),
        result=result, notes=("It is round.",), note="the left one",
    )  # fmt: skip
    objects = (first, *scene.objects[1:])
    return replace(scene, views=(*scene.views, second), objects=objects, unit="m")


def test_what_is_written_is_read_to_the_last_digit(path, tmp_path):
    scene = told(path)
    (tmp_path / "below").mkdir()
    save_scene(tmp_path / "below" / "s.json", scene)
    data = load_valid(tmp_path / "below" / "s.json", "scene")
    assert set(data["objects"][0]) == set(form_of(SceneObject).kind.__struct_encode_fields__)
    assert data["objects"][0]["model"]["file"] == "../ball.ply"
    assert data["views"][1]["mask"] == "s.1.mask.png"
    again = load_scene(tmp_path / "below" / "s.json")
    for one, other in zip(again.objects, scene.objects, strict=True):
        assert one.model.location.resolve() == other.model.location
    save_scene(tmp_path / "below" / "t.json", again)
    written = (tmp_path / "below" / "t.json").read_text().replace("t.1.mask", "s.1.mask")
    assert json.loads(written.replace("t.2.mask", "s.2.mask")) == data


@pytest.mark.parametrize("kind", KINDS)
def test_the_schemas_are_those_of_the_structs(kind):
    assert json.loads(schema(kind)) == json_schema(kind)


def test_the_same_model_may_be_there_twice(path):
    edit(path, lambda data: data["objects"].append({**data["objects"][0], "id": "again"}))
    opened = open_scene(Sources(scene=path))
    assert opened.objects[3].mesh.whole is opened.objects[0].mesh.whole


@pytest.mark.parametrize(("change", "words"), [
    (lambda d: d["objects"][1]["model"].update(file="gone.ply"), "gone.ply, and there is no"),
    (lambda d: d["objects"][1]["model"].pop("file"), r"objects\[1\].model.file is missing"),
    (lambda d: d["objects"][1].update(id="ball"), "two objects have the id 'ball'"),
    (lambda d: d["objects"][1].update(in_views=[{"mask": "gone.png"}]), "gone.png, and there"),
    (lambda d: d["objects"][1].update(in_views=[{}, {}]), r"\[1\].in_views is a list of 2"),
    (lambda d: d.update(free_scale=True), "its scale is not known, and it has 3 objects"),
    (lambda d: d.update(format="poseviewer-pose"), "wanted 'poseviewer-scene'"),
    (lambda d: d.update(version=1), "version is 1; this poseviewer reads version 2"),
    (lambda d: d["views"].clear(), "views is a list of 0; wanted a list of"),
    (lambda d: d["views"][0]["photo"].pop("width"), r"views\[0\].photo.width is missing"),
    (lambda d: d["views"][0]["camera"].update(fx=1e9), r"views\[0\].camera.fx is 1000000000"),
    (lambda d: d["views"][0].update(projection="x"), r"projection is 'x'; wanted one of"),
])  # fmt: skip
def test_what_is_wrong_is_said(path, change, words):
    edit(path, change)
    with pytest.raises(PoseViewerError, match=words):
        load_scene(path)


def test_another_size_or_unit_is_said(path):
    scene = load_scene(path)
    edit(path, lambda data: data["views"][0]["photo"].update(width=100))
    with pytest.raises(PoseViewerError, match="320x240 px, and its camera is for 100x240"):
        open_scene(Sources(scene=path))
    save_scene(path, scene)

    def set_units(data) -> None:
        data["objects"][0]["model"]["unit"] = "mm"
        data["objects"][2]["model"]["unit"] = "m"

    with pytest.raises(PoseViewerError, match="ball is in mm and apart in m"):
        open_scene(Sources(scene=edit(path, set_units)))


def test_a_mask_of_another_size_is_said(path, tmp_path):
    scene = load_scene(path)
    save_scene(path, scene.with_object(0, in_views=(InView(mask=Mask.of(np.ones((240, 320)))),)))
    (tmp_path / "three.scene.1.mask.png").write_bytes(mask_as_png(Mask.of(np.ones((10, 20)))))
    with pytest.raises(PoseViewerError, match=r"20x10 px, the photo three\.png has 320x240"):
        open_scene(Sources(scene=path))


def test_a_scene_with_masks_is_saved_over_itself(path):
    mask = Mask.of(np.tri(240, 320))
    hidden = (~np.tri(240, 320, 5, bool),)
    scene = load_scene(path)
    scene = scene.with_object(0, in_views=(InView(mask=mask),), result=SearchResult(hidden=hidden))
    save_scene(path, as_saved(scene))
    for _ in range(2):
        again = load_scene(path)
        assert np.array_equal(again.mask(0).weights, mask.weights)
        (found,) = again.earlier_occluders(0)
        assert np.array_equal(found.weights == 0.0, hidden[0])
        save_scene(path, as_saved(again))


def test_files_are_sought_where_they_may_lie(path, tmp_path):
    (tmp_path / "drop").mkdir()
    path = Path(shutil.move(path, tmp_path / "drop"))
    with pytest.raises(PoseViewerError, match=r"three\.png, and there is no such file"):
        load_scene(path)
    edit(path, lambda data: data["views"][0]["photo"].update(file="../three.png"))
    for name in IDS:
        shutil.copy(tmp_path / f"{name}.ply", tmp_path / "drop")
    assert load_scene(path).views[0].file.location.is_file()
    with pytest.raises(PoseViewerError, match=r"three\.png, outside of the folder that was"):
        load_scene(path, inside=tmp_path / "drop")
    assert load_scene(path, inside=tmp_path)


def test_what_lies_in_a_private_folder_is_copied_beside_the_scene(path, tmp_path):
    private, out = tmp_path / "uploads" / "00ff", tmp_path / "out"
    private.mkdir(parents=True)
    out.mkdir()
    (out / "front.ply").write_text("another one\n")
    for name in ("ball.ply", "front.ply", "three.png"):
        shutil.move(tmp_path / name, private / name)
    (private / "ball.symmetry.json").write_text("{}")

    def move(data) -> None:
        for one in (data["views"][0]["photo"], *(one["model"] for one in data["objects"][:2])):
            one["file"] = f"uploads/00ff/{one['file']}"

    scene = load_scene(edit(path, move))
    for _ in range(2):
        save_scene(out / "s.json", copy_out(out / "s.json", scene, tmp_path / "uploads"))
    data = json.loads((out / "s.json").read_text())
    names = ["ball.ply", "s.2/front.ply", "../apart.ply"]
    assert [one["model"]["file"] for one in data["objects"]] == names
    assert sorted(one.name for one in out.iterdir()) == [
        *("ball.ply", "ball.symmetry.json", "front.ply", "s.2", "s.json", "three.png")
    ]
    shutil.rmtree(tmp_path / "uploads")
    assert load_scene(out / "s.json").views[0].path == out / "three.png"


def test_files_that_are_not_there_are_not_written(path, tmp_path):
    scene = load_scene(path)
    (tmp_path / "ball.ply").unlink()
    with pytest.raises(PoseViewerError, match=r"objects\[0\].model.file is ball.ply, and there is"):
        save_scene(tmp_path / "new.json", scene)
    assert not (tmp_path / "new.json").exists()
