"""``poseviewer paint`` and ``track --paint``."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from poseviewer.api import make_registration
from poseviewer.files.scene_json import load_scene
from tests.commands import refusal, run
from tests.moving import BALL, ball, box, off, sequence, write_sequence


def colours_of(path) -> dict[str, np.ndarray]:
    """Colours of the faces of each material, linear."""
    parts = trimesh.load_scene(path, process=False).geometry.values()
    return {p.visual.material.name: p.visual.vertex_attributes["color"][p.faces] for p in parts}


def test_the_keys_of_a_sequence_paint_each_object(tmp_path, capsys):
    scene = sequence({3: [ball(3), box(3)]}, drawn=(ball, box), count=4)
    path, out = write_sequence(tmp_path, scene), tmp_path / "painted.glb"
    assert run("paint", path, out) == 0
    said = capsys.readouterr().out
    assert "a: " in said
    assert "from 1 photo" in said
    warm, cold = (colours_of(tmp_path / f"painted.{name}.glb") for name in "ab")
    assert warm["painted"][..., 0].mean() > 1.2 * warm["painted"][..., 2].mean()
    assert cold["painted"][..., 2].mean() > 1.2 * cold["painted"][..., 0].mean()
    assert len(warm["unpainted"]) > 100
    # None is written where one is there already.
    (tmp_path / "painted.a.glb").unlink()
    (tmp_path / "painted.b.glb").write_text("mine")
    assert "painted.b.glb: is there already" in refusal(capsys, "paint", path, out)
    assert (tmp_path / "painted.b.glb").read_text() == "mine"
    assert not (tmp_path / "painted.a.glb").exists()
    assert run("paint", path, out, "--object", "b") == 0
    np.testing.assert_array_equal(colours_of(out)["painted"], cold["painted"])


def test_objects_of_like_names_have_files_of_their_own(tmp_path):
    scene = sequence({0: [ball(0), box(0)]}, drawn=(ball, box), count=1)
    scene = scene.with_object(0, id="a/b").with_object(1, id="A-b")
    files = make_registration(scene).painted_files(tmp_path / "painted.glb")
    assert len({file.name.casefold() for file in files}) == 2
    assert {file.parent for file in files} == {tmp_path}


def test_a_pose_file_paints_its_model(tmp_path, capsys):
    scene = sequence({0: [ball(0)]}, count=1)
    path = write_sequence(tmp_path, scene)
    assert run("convert", path, tmp_path / "poses", "--to", "poseviewer") == 0
    pose = tmp_path / "poses" / "0.pose.json"
    capsys.readouterr()
    out = tmp_path / "painted.glb"
    named = "--photo", tmp_path / "frames" / "0.png", "--model", tmp_path / "a.ply"
    assert run("paint", pose, out, *named) == 0
    assert "of the surface, from 1 photo" in capsys.readouterr().out
    assert set(colours_of(out)) == {"painted", "unpainted"}
    before = out.read_bytes()
    sentence = refusal(capsys, "paint", pose, out, *named)
    assert "was not touched" in sentence
    assert out.read_bytes() == before
    sentence = refusal(capsys, "paint", pose, tmp_path / "o.obj", *named)
    assert ".glb" in sentence
    assert "--model with scene.json" in refusal(capsys, "paint", path, out, "--overwrite", *named)


def without_keys(path: Path) -> Path:
    scene = json.loads(path.read_text())
    for frame in scene["frames"]:
        frame.pop("poses", None)
    path.write_text(json.dumps(scene))
    return path


def test_a_track_says_that_paint_may_help_a_model_without_colours(tmp_path, capsys):
    path = without_keys(write_sequence(tmp_path, sequence({0: [ball(0)]}, count=2)))
    words = "track", path, "--out", tmp_path / "out"
    assert "no colours" not in refusal(capsys, *words)
    trimesh.Trimesh(BALL.vertices, BALL.faces, process=False).export(tmp_path / "a.ply")
    for more, is_said in (((), True), (("--paint",), False)):
        assert run(*words, *more) == 2
        assert ("a.ply: no colours; painted from" in capsys.readouterr().err) is is_said


def test_what_no_photo_shows_is_refused_in_a_sentence(tmp_path, capsys):
    path = without_keys(write_sequence(tmp_path, sequence({0: [ball(0)]}, count=2)))
    assert "no key to paint it from" in refusal(capsys, "paint", path, tmp_path / "out.glb")


@pytest.mark.slow
@pytest.mark.long
def test_a_track_with_paint_finds_what_it_is_to_find_and_starts_chains_of_its_own(tmp_path, capsys):
    path, out = write_sequence(tmp_path, sequence({0: [ball(0)]}, count=3)), tmp_path / "out"
    words = "track", path, "--out", out, "--processes", 1
    assert run(*words, "--paint") == 0
    tracked = load_scene(out / "scene.json")
    assert all(off(tracked, index, ball(index)) < 1.0 for index in range(3))
    capsys.readouterr()
    assert run(*words, "--paint") == 0
    assert "1 of 1 chains were done before" in capsys.readouterr().err
    assert run(*words) == 0  # without paint it is another track
    assert "were done before" not in capsys.readouterr().err
