"""Formats say every camera of a pose in a set of photos."""

import json
from pathlib import Path

import numpy as np
import pytest

from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.known_formats import FORMATS
from poseviewer.files.scene_assets import model_file, view_of_file
from poseviewer.files.scene_json import save_scene
from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.geometry.transform import RigidTransform
from poseviewer.opening.photo_sets import SetChoice, load_views
from poseviewer.scene.types import Scene, SceneObject
from tests.commands import run
from tests.view_sets import CAMERA, CAMERAS_FROM_SET, MESH, NAMES, TRUTH, write_views

UNIT = 2.5
"""Lengths of the model's unit in one of the set's."""
SIZE = CAMERA.width, CAMERA.height
KINDS = {
    "colmap": ("model", NAMES),
    "nerfstudio": ("transforms.json", NAMES),
    "gltf": ("scene.glb", ("photo", *NAMES[1:])),
    "meshlab": ("project.mlp", NAMES),
    "bop": ("scene", ("7", "8", "9")),
}
"""Output of each format, and its names for the photos."""


def save(path: Path, lens: Lens | None = None) -> Path:
    """Save the true pose in all three photos as a scene; with a lens, in the undistorted ones."""
    undistortion = None if lens is None else Undistortion(lens, CAMERA, CAMERA)
    views = []
    for name, place in zip(NAMES, CAMERAS_FROM_SET, strict=True):
        place = RigidTransform(place.rotation, place.translation / UNIT)
        views.append(view_of_file(path.with_name(name), CAMERA, None, undistortion, place))
    place = views[0].world_from_model(TRUTH[0], 1.0 / UNIT)
    model = model_file(path.with_name("m.ply"), unit="m")
    one = SceneObject(id="1", model=model, world_from_model=place)
    save_scene(path, Scene(unit="m", views=tuple(views), objects=(one,)))
    return path


@pytest.fixture
def pose(tmp_path: Path) -> Path:
    for path in write_views(tmp_path)[::2]:
        path.unlink()
    return save(tmp_path / "three.json")


def convert(*words: object) -> int:
    return run("convert --from scene", *words)


@pytest.mark.parametrize("kind", KINDS)
def test_every_photo_reads_back(pose: Path, tmp_path: Path, kind: str) -> None:
    name, images = KINDS[kind]
    numbers = ("--image", 7, "--object", 5) if kind == "bop" else ()
    assert convert(pose, "--to", kind, tmp_path / name, *numbers) == 0
    for image, truth in zip(images, TRUTH, strict=True):
        asked = ConvertOptions(photo_size=SIZE, unit="m", image=image)
        found = FORMATS[kind].read(tmp_path / name, asked).pose(0)
        moved, wanted = (pose.camera_from_model.translation for pose in (found, truth))
        np.testing.assert_allclose(moved, wanted, atol=1e-9)
        drawn, wanted = (pose.project(MESH.vertices) for pose in (found, truth))
        np.testing.assert_allclose(drawn, wanted, atol=1e-6)


def test_what_is_written_is_a_set_again(pose: Path, tmp_path: Path) -> None:
    for kind in ("colmap", "nerfstudio"):
        name, _ = KINDS[kind]
        assert convert(pose, "--to", kind, tmp_path / name) == 0
        assert len(load_views(tmp_path / name).views) == 3
    data = json.loads((tmp_path / "transforms.json").read_text())
    assert [set(frame) for frame in data["frames"]] == [{"file_path", "transform_matrix"}] * 3
    assert len(load_views(tmp_path / "model", SetChoice(NAMES[:2])).views) == 2


def test_opencv_holds_the_first_photo_and_info_says_the_frame(pose, tmp_path, capsys):
    assert run("info", pose) == 0
    assert "the frame of the photos (m): x_in_world = [[" in capsys.readouterr().out
    assert convert(pose, "--to", "opencv", tmp_path / "cv.yml") == 0
    assert "the other 2 of the set are left out" in capsys.readouterr().out
    assert convert(pose, tmp_path / "own.json") == 0
    assert json.loads((tmp_path / "own.json").read_text())["photo"]["file"] == NAMES[0]


def test_photos_are_undistorted_for_formats_without_their_lens(pose: Path, tmp_path: Path) -> None:
    save(pose, Lens("opencv", (-0.1, 0.02, 0.0, 0.0)))
    assert convert(pose, "--to", "colmap", tmp_path / "model") == 0
    assert (tmp_path / "model" / "cameras.txt").read_text().count("OPENCV") == 1
    assert not list(tmp_path.glob("*undistorted*"))
    assert convert(pose, "--to", "meshlab", tmp_path / "out.mlp") == 0
    written = sorted(path.name for path in tmp_path.glob("*undistorted*"))
    assert written == ["a.undistorted.png", "b.undistorted.png", "c.undistorted.png"]
    text = (tmp_path / "out.mlp").read_text()
    assert [text.count(f'fileName="{name}"') for name in written] == [1, 1, 1]
