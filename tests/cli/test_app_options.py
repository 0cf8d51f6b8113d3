"""A folder or a zip that is named on the command line is opened in the app."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.state.document import Document
from poseviewer.errors import RendererUnavailableError
from poseviewer.files.pose import load_pose
from tests.commands import run
from tests.renderers import require_gpu


@pytest.fixture
def served(folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[Document]:
    opened: list[Document] = []
    (folder / "one").mkdir()
    for name in ("p.png", "m.ply", "start.json"):
        shutil.copy(name, "one")
    monkeypatch.setenv("POSEVIEWER_STATE", str(folder / "state"))
    monkeypatch.setattr(
        "poseviewer.app.serving.serve_app",
        lambda open_first, **_: opened.append(open_first()[0]),
    )
    return opened


@pytest.mark.parametrize("name", ["one", "one.zip"])
def test_a_folder_or_a_zip_is_opened(served: list[Document], name: str) -> None:
    shutil.make_archive("one", "zip", "one")
    assert run("app", name) == 0
    document = served[0]
    assert (document.photo.name, document.model.name) == ("p.png", "m.ply")
    start, found = load_pose(Path("start.json")).pose, document.pose
    np.testing.assert_array_equal(
        found.camera_from_model.translation, start.camera_from_model.translation
    )


def test_a_folder_with_a_set_of_photos_is_opened(folder: Path, served: list[Document]) -> None:
    assert run("app", "set", "--method", "paper") == 0
    (folder / "set" / "start.json").rename(folder / "elsewhere.json")
    assert run("app", "set", "--pose", "elsewhere.json") == 0
    for opened in served:
        assert len(opened.scene.views) == 3
        assert opened.object.is_placed
    assert served[0].settings.searched_by == "simplex"
    assert run("app", "set", "--loss", "paper", "--search", "models") == 0
    assert [one.settings.loss for one in served] == ["paper", "default", "paper"]
    assert [one.settings.search for one in served] == ["auto", "auto", "models"]
    (folder / "set" / "m.ply").unlink()
    assert run("app", "set") == 2


def test_a_gpu_is_used_or_refused(served, monkeypatch, capsys) -> None:
    assert run("app", "one", "--renderer", "opengl") == 2
    require_gpu(monkeypatch)
    assert run("app", "one", "--renderer", "gpu") == 0
    assert served[0].settings.renderer == "gpu"

    def refuse() -> None:
        raise RendererUnavailableError("No GPU here.")

    monkeypatch.setattr("poseviewer.render.gpu.device.gpu_device", refuse)
    assert run("app", "one", "--renderer", "gpu") == 2
    assert "No GPU here" in capsys.readouterr().err


def test_a_folder_without_a_model_takes_one_by_name(folder: Path, served, capsys) -> None:
    (folder / "one" / "m.ply").unlink()
    assert run("app", "one") == 2
    assert "one: no model was found; name PHOTO and MODEL" in capsys.readouterr().err
    assert run("app", "one", "m.ply") == 0
    assert served[0].model.path == Path("m.ply")
