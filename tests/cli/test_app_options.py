"""A folder or a zip that is named on the command line is opened in the app."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.state.document import Document
from poseviewer.errors import RendererUnavailableError
from poseviewer.files.pose import load_pose
from tests.commands import refusal, run
from tests.renderers import require_gpu
from tests.several import make_three
from tests.starts.backbone import save_random_backbone
from tests.videos import write_video


@pytest.fixture
def served(folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[Document]:
    opened: list[Document] = []
    (folder / "one").mkdir()
    for name in ("p.png", "m.ply", "start.json"):
        shutil.copy(name, "one")
    monkeypatch.setenv("POSEVIEWER_STATE", str(folder / "state"))
    serve = "poseviewer.app.serving.serve_app"
    monkeypatch.setattr(serve, lambda open_first, **_: opened.append(open_first()[0]))
    return opened


@pytest.mark.parametrize("name", ["one", "one.zip"])
def test_a_folder_or_a_zip_is_opened(served, name):
    shutil.make_archive("one", "zip", "one")
    assert run("app", name) == 0
    assert (served[0].photo.name, served[0].model.name) == ("p.png", "m.ply")
    wanted = load_pose(Path("start.json")).pose.camera_from_model.translation
    np.testing.assert_array_equal(served[0].pose.camera_from_model.translation, wanted)


def test_a_folder_with_a_set_of_photos_is_opened(folder, served):
    assert run("app set --method paper") == 0
    (folder / "set" / "start.json").rename(folder / "elsewhere.json")
    assert run("app set --pose elsewhere.json") == 0
    for opened in served:
        assert len(opened.scene.views) == 3
        assert opened.object.is_placed
    assert served[0].settings.searched_by == "simplex"
    assert run("app set --loss paper --search models") == 0
    assert [one.settings.loss for one in served] == ["paper", "default", "paper"]
    assert [one.settings.search for one in served] == ["auto", "auto", "models"]
    (folder / "set" / "m.ply").unlink()
    assert run("app set") == 2


def test_a_set_is_known_without_its_option_and_takes_no_mask(folder, served, capsys):
    assert run("app set/set.json set/m.ply --pose set/start.json") == 0
    assert len(served[0].scene.views) == 3
    assert run("app set --photos a,c") == 0
    assert [view.name for view in served[1].scene.views] == ["a.png", "c.png"]
    assert "--photos without a set of photos" in refusal(capsys, "app one --photos a,c")
    assert "--mask with a set of photos" in refusal(capsys, "app set --mask p.png")
    shutil.rmtree("one")
    (folder / "one").mkdir()
    make_three(folder / "one")
    assert "--mask with a scene" in refusal(capsys, "app one --mask p.png")


def test_frames_in_a_folder_or_of_a_video_are_a_sequence(folder, served, capsys):
    (folder / "frames").mkdir()
    for number in (1, 2, 10):
        shutil.copy("p.png", f"frames/f{number}.png")
    write_video(folder / "clip.mp4", 6)
    assert run("app frames m.ply --pose start.json") == 0
    assert run("app frames m.ply --every 2") == 0
    assert run("app clip.mp4 m.ply --every 4 --frames kept") == 0
    paths = [[frame.file.path for frame in opened.scene.frames] for opened in served]
    assert [[path.name for path in own] for own in paths] == [
        ["f1.png", "f2.png", "f10.png"], ["f1.png", "f10.png"], ["000000.jpg", "000004.jpg"],
    ]  # fmt: skip
    assert {path.parent for path in paths[2]} == {folder / "kept"}
    assert [bool(opened.scene.frames[0].poses) for opened in served] == [True, False, False]
    assert "--every without a video or a folder" in refusal(capsys, "app p.png m.ply --every 2")
    assert "frames: no model was found; name PHOTO and MODEL" in refusal(capsys, "app frames")
    assert "gone.mp4: no such file" in refusal(capsys, "app gone.mp4 m.ply")


def test_a_network_is_handed_on_or_refused(folder, monkeypatch, capsys):
    handed = list[Path | None]()
    serve = "poseviewer.app.serving.serve_app"
    monkeypatch.setattr(serve, lambda *_, features, **__: handed.append(features))
    save_random_backbone(folder / "model.safetensors")
    assert run("app p.png m.ply --features model.safetensors") == 0
    assert run("app p.png m.ply") == 0
    assert handed == [Path("model.safetensors"), None]
    assert "p.png: no safetensors file" in refusal(capsys, "app p.png m.ply --features p.png")


def test_a_gpu_is_used_or_refused(served, monkeypatch, capsys):
    assert run("app one --renderer opengl") == 2
    require_gpu(monkeypatch)
    assert run("app one --renderer gpu") == 0
    assert served[0].settings.renderer == "gpu"

    def refuse() -> None:
        raise RendererUnavailableError("No GPU here.")

    monkeypatch.setattr("poseviewer.render.gpu.device.gpu_device", refuse)
    capsys.readouterr()
    assert "No GPU here" in refusal(capsys, "app one --renderer gpu")


def test_a_folder_without_a_model_takes_one_by_name(folder, served, capsys):
    (folder / "one" / "m.ply").unlink()
    assert "one: no model was found; name PHOTO and MODEL" in refusal(capsys, "app one")
    assert run("app one m.ply") == 0
    assert served[0].model.path == Path("m.ply")
