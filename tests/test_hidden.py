"""Masks and parts left out mean the same in library, command line and app, and in pose files."""

from pathlib import Path

import numpy as np
import pytest

from poseviewer.api import load
from poseviewer.app.workers.opening import open_sources
from poseviewer.confidence.verdict import Verdict
from poseviewer.files.masks import mask_as_png
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_assets import load_model, model_file, view_of_file
from poseviewer.files.scene_json import save_scene
from poseviewer.geometry.mask import Mask
from poseviewer.opening.sources import Sources
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.settings import FitSettings, Limits
from poseviewer.scene.types import Scene as SceneData
from poseviewer.scene.types import SceneObject, SearchResult
from tests.commands import run
from tests.scene import Scene
from tests.several import save_halves
from tests.writing import write

QUICK = FitSettings(limits=Limits(60))
HALF_HIDDEN = Mask.of(np.broadcast_to(np.arange(160) >= 70, (120, 160)))


@pytest.fixture
def halves(scene: Scene, tmp_path: Path) -> Path:
    """The scene's model in two parts, ``left`` and ``right``."""
    path = tmp_path / "halves.obj"
    save_halves(path, load_model(scene.model).mesh)
    return path


@pytest.fixture
def mask(tmp_path: Path) -> Path:
    path = tmp_path / "hidden.png"
    path.write_bytes(mask_as_png(HALF_HIDDEN))
    return path


def test_a_picture_an_array_and_a_pose_file_hide_alike(scene, mask, tmp_path):
    everything = load(scene.photo, scene.model, scene.start, QUICK)
    by_file = load(scene.photo, scene.model, scene.start, QUICK, mask=mask)
    by_array = load(scene.photo, scene.model, scene.start, QUICK, mask=HALF_HIDDEN)
    by_array.save(tmp_path / "a.pose.json")
    by_pose = load(scene.photo, scene.model, tmp_path / "a.pose.json", QUICK)
    for case in (by_file, by_pose):
        assert np.array_equal(case.problem.photo.weights, by_array.problem.photo.weights)
        assert case.loss == by_array.loss
    assert by_file.problem.photo.weights.sum() < 0.8 * everything.problem.photo.weights.sum()
    assert by_file.record.settings is not None
    assert by_file.record.settings["mask"] == "hidden.png"


def test_parts_are_left_out_by_name_and_by_the_pose_file(scene, halves, tmp_path):
    model = load_model(halves)
    renderer = SoftwareRenderer(model.mesh)
    more = {"without": ("left",), "renderer": renderer}  # which draws the whole model
    case = load(scene.photo, model, scene.start, QUICK, **more)
    assert case.mesh.part_names == ("right",)
    assert case.renderer.render_mask(case.pose).sum() < 0.8 * renderer.render_mask(case.pose).sum()
    case.save(tmp_path / "a.json")
    again = load(scene.photo, halves, tmp_path / "a.json", QUICK)
    assert again.mesh.left_out == ("left",)
    assert again.loss == case.loss
    # A model that has no such part is read all the same, and it is said.
    other = load(scene.photo, scene.model, tmp_path / "a.json", QUICK)
    assert any("leaves out the part 'left', which m.ply has not" in note for note in other.notes)


def test_the_command_line_leaves_out_hides_and_says_what_there_is(scene, halves, mask, capsys):
    out = halves.with_name("out.pose.json")
    line = ("fit", scene.photo, halves, "--pose", scene.start, "--out", out, "--quiet")
    assert run(*line, "--evaluations", 60, "--without", "left", "--mask", mask) == 0
    record = load_pose(out, 160, 120)
    assert (record.without, record.mask) == (("left",), "out.mask.png")
    assert out.with_name("out.mask.png").read_bytes() == mask.read_bytes()
    assert run(*line, "--without", "left", "--without", "right") == 2
    assert "nothing would be left of the model" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.long
def test_a_mask_hides_unless_the_command_line_says_that_nothing_does(scene, mask, tmp_path):
    out, losses = tmp_path / "out.pose.json", []
    line = ("fit", scene.photo, scene.model, "--pose", scene.start, "--out", out, "--quiet")
    for more in ((), ("--mask", mask), ("--mask", mask, "--in-front", "nothing")):
        assert run(*line, "--evaluations", 60, *more) == 0
        losses.append(load_pose(out, 160, 120).loss)
    assert losses[0] == losses[2] != losses[1]
    record = load_pose(out, 160, 120)
    assert record.settings is not None
    assert record.settings["in_front"] == "nothing"
    assert record.mask == "out.mask.png"  # what the user painted is kept


def test_the_command_line_chooses_an_object_of_an_annotation(scene, tmp_path, capsys):
    corners = [[30, 20], [130, 20], [130, 100]]
    shapes = [{"label": name, "points": corners} for name in ("car", "van")]
    content = {"shapes": shapes, "imageWidth": 160, "imageHeight": 120}
    mask, out = write(tmp_path / "mask.json", content), tmp_path / "out.pose.json"
    line = ("fit", scene.photo, scene.model, "--pose", scene.start, "--out", out, "--quiet")
    assert run(*line, "--mask", mask) == 2
    assert "(car, van); wanted one, name it by --mask-label" in capsys.readouterr().err
    assert run(*line, "--mask-label", "van") == 2
    assert "--mask-label without --mask" in capsys.readouterr().err
    assert run(*line, "--evaluations", 60, "--mask", mask, "--mask-label", "van") == 0
    assert load_pose(out, 160, 120).mask == "out.mask.png"


def test_parts_of_a_scene_s_objects_are_left_out_by_the_object_s_id(scene, halves, tmp_path):
    start = load_pose(scene.start, 160, 120)
    view, model = view_of_file(scene.photo, start.pose.camera), model_file(halves)
    place = view.world_from_model(start.pose)
    result = SearchResult(loss=0.2, verdict=Verdict("found", 0.99))
    objects = tuple(
        SceneObject(id=name, model=model, world_from_model=place, result=result)
        for name in ("a", "a:b")
    )
    path = tmp_path / "two.scene.json"
    save_scene(path, SceneData(views=(view,), objects=objects))
    opened = open_sources(
        Sources(scene=path, settings=FitSettings(without=("a:b:left",)))
    ).scene.objects
    assert [one.mesh.left_out for one in opened] == [(), ("left",)]
    assert [one.result is None for one in opened] == [False, True]  # found with all of its parts
