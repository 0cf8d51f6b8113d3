"""Rectangles by a network's features, where a trained network is there, and their parts."""

import re
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import platformdirs
import pytest

from poseviewer.cli.main import main
from poseviewer.errors import SettingsError
from poseviewer.evaluation.cases import load_cases
from poseviewer.files.photo import load_photo
from poseviewer.files.scene_assets import load_model
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.renderers import make_renderer
from poseviewer.starts import automatic, learned
from poseviewer.starts.automatic import StartQuery, outermost_points, outline_box, propose
from poseviewer.starts.dino_features import PatchEncoder
from poseviewer.starts.instances import AutoStart
from poseviewer.starts.learned import compare_with_photo, propose_rectangles
from poseviewer.starts.start import StartInputs
from tests.measure.real import is_right
from tests.meshes import make_bumpy
from tests.scene import Scene
from tests.several import coloured
from tests.starts.backbone import save_random_backbone, trained_backbone


@pytest.fixture(autouse=True)
def own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))


def overlap(a: Rectangle, b: Rectangle) -> float:
    """Intersection over union."""
    common = a.intersection(b).area
    return common / (a.area + b.area - common)


@pytest.mark.slow
def test_an_untextured_model_is_found_in_the_full_image(shared_data: Path, tmp_path: Path):
    """Neither texture features nor wheels find it."""
    path, _ = trained_backbone(tmp_path)
    (case,) = load_cases(shared_data / "clutter", "clutter-1-duck")
    model = load_model(case.mesh)
    inputs = StartInputs(load_photo(case.photo), model.mesh, model.keypoints)
    encoder = PatchEncoder.load(path)
    boxes = propose_rectangles(inputs, encoder)
    true = outline_box(case.truth, outermost_points(model.mesh))
    assert max(overlap(box, true) for box in boxes) > 0.5
    found = propose(StartQuery(inputs, case.truth.camera, features=path))
    assert is_right(pose_error(model.mesh, found[0].pose, case.truth))
    beside = RigidTransform(np.eye(3), np.array([model.mesh.diameter, 0.0, 0.0]))
    wrong = replace(case.truth, camera_from_model=beside @ case.truth.camera_from_model)
    cosines = compare_with_photo(inputs, encoder, [case.truth, wrong])
    assert cosines[0] > 0.6 > 0.5 > cosines[1]


def test_features_of_views_are_kept_until_the_model_changes(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda *_, **__: tmp_path / "cache")
    save_random_backbone(tmp_path / "model.safetensors")
    encoder = PatchEncoder.load(tmp_path / "model.safetensors")
    inputs = StartInputs(load_photo(scene.photo), load_model(scene.model).mesh, None)
    other = replace(inputs, mesh=replace(inputs.mesh, colours=inputs.mesh.colours / 2.0))
    counts, boxes = list[int](), list[list[Rectangle]]()
    for given in (inputs, inputs, other):
        steps = count()
        boxes.append(propose_rectangles(given, encoder, lambda steps=steps: next(steps)))
        counts.append(next(steps))
    assert boxes[1] == boxes[0]
    assert counts[0] - counts[1] == 42  # pictures of views
    assert counts[2] == counts[0]
    names = [path.relative_to(tmp_path).as_posix() for path in (tmp_path / "cache").rglob("*.*")]
    assert len(names) == 2
    assert all(re.fullmatch(r"cache/views/[0-9a-f]{32}\.npy", name) for name in names)


def test_a_drawn_model_is_nearest_to_its_own_picture(tmp_path: Path):
    """Also by random weights, and where the model is in part, or wholly, outside of the photo."""
    save_random_backbone(tmp_path / "model.safetensors")
    mesh = coloured(make_bumpy(3), (1.0, 0.8, 0.6))
    pose = Pose(
        Perspective(300.0, 300.0, 160.0, 120.0, 320, 240),
        RigidTransform.from_rotation_vector([0.4, -0.3, 0.2], [0.2, 0.1, 7.0]),
    )
    image = make_renderer(mesh).render(pose)
    lit = image.reflectance * (0.5 + 0.5 * np.abs(image.normals[..., 2:]))
    pixels = np.uint8(255.0 * np.where(image.mask[..., None], lit, 0.5))
    inputs = StartInputs(Photo(np.asarray(pixels), "photo.png", "0"), mesh, None)
    shifts = [0.0, 1.0, 3.0, -3.5, -20.0]
    moved = [RigidTransform(np.eye(3), np.array([x, 0.0, 0.0])) for x in shifts]
    poses = [replace(pose, camera_from_model=by @ pose.camera_from_model) for by in moved]
    encoder = PatchEncoder.load(tmp_path / "model.safetensors")
    cosines = compare_with_photo(inputs, encoder, poses)
    assert cosines[0] > 0.97
    assert max(cosines[1:]) < cosines[0] - 0.05
    assert min(cosines) >= -1.0


@pytest.mark.parametrize(
    ("name", "more", "words"),
    [
        ("network.onnx", (), "network.onnx: no safetensors file"),
        ("gone.onnx", (), "gone.onnx: no such file"),
        ("network.onnx", ("--box", "9,9,90,90"), "--features with --box or --region"),
        ("network.onnx", ("--region", "9,9,90,90"), "--features with --box or --region"),
    ],
)
def test_the_command_line_refuses_what_it_would_not_use(
    scene: Scene, tmp_path: Path, capsys, name: str, more: tuple[str, ...], words: str
):
    (tmp_path / "network.onnx").write_bytes(b"an ONNX file")
    line = ["fit", str(scene.photo), str(scene.model), "--start", "auto", "--quiet"]
    line += ["--features", str(tmp_path / name), "--out", str(tmp_path / "pose.json"), *more]
    assert main(line) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "pose.json").exists()


def test_a_network_is_refused_with_a_box_or_a_region(scene: Scene):
    model = load_model(scene.model)
    inputs = StartInputs(load_photo(scene.photo), model.mesh, model.keypoints)
    region = replace(inputs, settings=replace(inputs.settings, region=(9, 9, 90, 90)))
    network = Path("model.safetensors")
    for start, given in (
        (AutoStart((9, 9, 90, 90), features=network), inputs),
        (AutoStart(features=network), region),
    ):
        with pytest.raises(SettingsError, match="with a box or a region"):
            start(given)


def test_a_start_that_the_network_hardly_believes_in_is_doubtful():
    camera = Perspective(300.0, 300.0, 160.0, 120.0, 320, 240)
    pose = Pose(camera, RigidTransform.identity())
    sure, unsure = (automatic._by_network(pose, odds) for odds in (7.0 / 3.0, 2.0))
    assert not sure.doubt
    assert (
        "gives the start a probability of 67 %, and of starts below 70 % most are" in unsure.doubt
    )


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
