"""``poseviewer fit --views``."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import poseviewer
from poseviewer.cli.main import main
from poseviewer.fit.scene import LoadedModel
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.transform import RigidTransform
from tests.schemas import json_schema
from tests.view_sets import (
    DISTANCE,
    MESH,
    SET_FROM_MODEL,
    START,
    TRUTH,
    make_views,
    write_views,
)


@pytest.fixture
def files(tmp_path) -> tuple[str, str, str]:
    views, model, start = write_views(tmp_path)
    return str(views), str(model), str(start)


@pytest.mark.slow
def test_a_set_is_fitted_and_its_file_says_the_pose_in_the_set_and_in_each_photo(files, capsys):
    views, model, start = files
    folder = Path(views).parent
    out, overlay = folder / "pose.json", folder / "o.png"
    command = ["fit", "--views", views, model, "--pose", start, "--out", str(out), "--quiet"]
    assert main([*command, "--overlay", str(overlay), "--lock", "rotation_z"]) == 0
    said = capsys.readouterr().out
    assert "b.png: unexplained" in said
    assert "By each of the 3 photos alone it is" in said
    data = json.loads(out.read_text())
    jsonschema.validate(data, json_schema("scene"))
    assert [(folder / f"o.{name}.png").is_file() for name in "abc"] == [True] * 3
    place = data["objects"][0]["world_from_model"]
    centre = np.array(place["rotation"]) @ MESH.centre + place["translation"]
    assert np.linalg.norm(centre - SET_FROM_MODEL.apply(MESH.centre)) < 0.1
    words = [view["word"] for view in data["objects"][0]["result"]["verdict"]["views"]]
    assert len(words) == 3
    assert set(words) <= {"found", "doubtful", "lost"}


@pytest.mark.slow
def test_a_camera_that_contradicts_the_others_is_named_and_does_no_harm():
    good = make_views()
    turn = RigidTransform.from_rotation_vector([0.0, np.radians(3.0), 0.0], np.zeros(3))
    wrong = replace(good.views[2], camera_from_world=turn @ good.views[2].camera_from_world)
    views = replace(good, views=(*good.views[:2], wrong))
    model = LoadedModel(MESH, "m.ply", "0" * 64, None)
    settings = FitSettings(limits=Limits(1500))
    found = poseviewer.load(
        views=views, model=model, start=START, settings=settings, view="a.png"
    ).fit()
    assert found.verdict is not None
    assert found.verdict.word != "found"
    assert found.end_notes[0].startswith("c.png goes least with the others")
    assert found.record.notes == found.end_notes  # as the file and the page have it
    at, true = (p.camera_from_model.apply(MESH.centre) for p in (found.pose, TRUTH[0]))
    assert np.abs(at - true).max() < 0.003 * DISTANCE


def test_a_set_is_drawn_and_mapped(files):
    views, model, start = files
    folder = Path(views).parent
    command = ["--views", views, model, "--pose", start, "--quiet", "--out"]
    assert main(["overlay", *command, str(folder / "o.png")]) == 0
    assert (folder / "o.c.png").is_file()
    more = ["--size", "3", "--lock", "rotation_x,rotation_y,shift_x,shift_y"]
    assert main(["landscape", *command, str(folder / "maps"), *more]) == 0
    assert (folder / "maps" / "landscape.png").is_file()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--views", "SET", "a.png", "MODEL", "--pose", "START"], "wants MODEL alone"),
        (["--views", "SET", "MODEL", "--start", "auto"], "wants a start with --pose"),
        (["--views", "SET", "MODEL", "--pose", "START", "--view", "z.png"], "no photo z.png"),
        (["a.png", "MODEL", "--pose", "START", "--scale", "2"], "--scale without --views"),
    ],
)
def test_what_does_not_go_together_is_one_sentence(files, capsys, more, said):
    named = dict(zip(("SET", "MODEL", "START"), files, strict=True))
    words = [named.get(word, word) for word in more]
    out = Path(files[0]).parent / "o.json"
    assert main(["fit", *words, "--out", str(out)]) == 2
    found = capsys.readouterr().err.strip()
    assert said in found
    assert "\n" not in found.split("poseviewer: ")[-1]
    assert not out.exists()
