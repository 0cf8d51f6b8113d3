"""What the app opens of a folder or a zip that is named on the command line."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.workers.opening import Opened
from poseviewer.cli.main import main
from poseviewer.files.pose import load_pose
from tests.scene import Scene, make_scene
from tests.view_sets import write_views


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    (tmp_path / "set").mkdir()
    made = make_scene(tmp_path / "set")
    made.truth.unlink()
    return made


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Opened]:
    opened: list[Opened] = []
    monkeypatch.setenv("POSEVIEWER_STATE", str(tmp_path / "state"))
    monkeypatch.setattr(
        "poseviewer.app.serving.serve_app",
        lambda open_first, **_: opened.append(open_first()[0]),
    )
    return opened


def zipped(folder: Path) -> Path:
    path = folder.with_suffix(".zip")
    with zipfile.ZipFile(path, "w") as archive:
        for file in folder.iterdir():
            archive.write(file, file.name)
    return path


@pytest.mark.parametrize("named", [lambda folder: folder, zipped])
def test_a_folder_or_a_zip_is_opened(
    scene: Scene, served: list[Opened], named: Callable[[Path], Path]
) -> None:
    assert main(["app", str(named(scene.photo.parent))]) == 0
    (opened,) = served
    document = opened.document
    assert document.photo.name == "p.png"
    assert document.model.name == "m.ply"
    start = load_pose(scene.start, 160, 120).pose
    np.testing.assert_array_equal(
        document.pose.camera_from_model.translation, start.camera_from_model.translation
    )


def test_a_folder_with_a_set_of_photos_opens_it(tmp_path: Path, served: list[Opened]) -> None:
    _, model, start = write_views(tmp_path)
    assert main(["app", str(tmp_path), "--method", "paper"]) == 0
    start.rename(tmp_path.with_suffix(".json"))
    assert main(["app", str(tmp_path), "--pose", str(tmp_path.with_suffix(".json"))]) == 0
    for opened in served:
        assert len(opened.document.scene.views) == 3
        assert opened.document.object.is_placed
    assert served[0].document.settings.method == "paper"
    model.unlink()
    assert main(["app", str(tmp_path)]) == 2


def test_a_folder_without_a_model_takes_one_by_name(
    scene: Scene, served: list[Opened], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = scene.model.rename(tmp_path / "m.ply")
    folder = scene.photo.parent
    assert main(["app", str(folder)]) == 2
    assert f"{folder}: no model was found; name PHOTO and MODEL" in capsys.readouterr().err
    assert main(["app", str(folder), str(model)]) == 0
    assert served[0].document.model.path == model


def test_a_damaged_scene_is_said_before_there_is_a_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("poseviewer.app.serving.serve_app", lambda *_, **__: pytest.fail("served"))
    path = tmp_path / "bad.json"
    path.write_text('{"format": "poseviewer-scene"}')
    assert main(["app", str(path)]) == 2
    assert "bad.json: " in capsys.readouterr().err
