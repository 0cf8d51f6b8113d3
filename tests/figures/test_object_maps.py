"""Maps of two spheres, whose silhouettes, depths and normals follow from geometry alone."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from poseviewer.cli.main import main
from tests.renderers import require_opengl

WIDTH, HEIGHT, F, CX, CY = 160, 120, 150.0, 70.0, 65.0
"""px; the principal point counts from pixel centres."""
CENTRES, RADIUS = np.array([[0.0, 0.0, 6.0], [0.7, 0.2, 9.0]]), 1.0
TURN, _ = cv2.Rodrigues(np.array([0.3, -0.8, 0.5]))


def sphere_seen(
    centre: np.ndarray, beyond: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where a sphere is seen, its depths, and its normals towards the camera, by its equation;
    ``beyond``: px of a margin about the photo.
    """
    v, u = np.mgrid[-beyond : HEIGHT + beyond, -beyond : WIDTH + beyond]
    rays = np.stack([(u - CX) / F, (v - CY) / F, np.ones_like(u)], axis=-1)
    a, b = np.sum(rays**2, axis=-1), rays @ centre
    root = b**2 - a * (centre @ centre - RADIUS**2)
    depth = (b - np.sqrt(np.maximum(root, 0.0))) / a
    return root > 0.0, depth, (depth[..., None] * rays - centre) / RADIUS


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("maps")
    ball = trimesh.creation.icosphere(subdivisions=6, radius=RADIUS)
    ball.export(folder / "ball.ply")
    cv2.imwrite(str(folder / "p.png"), np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    objects = [
        {"id": f"{i}", "model": {"file": "ball.ply", "unit": "cm"},
         "world_from_model": {"rotation": TURN.tolist(), "translation": centre.tolist()}}
        for i, centre in enumerate(CENTRES)
    ]  # fmt: skip
    camera = {"fx": F, "fy": F, "cx": CX, "cy": CY}
    view = {"photo": {"file": "p.png", "width": WIDTH, "height": HEIGHT},
            "projection": "perspective", "camera": camera}  # fmt: skip
    scene = {"format": "poseviewer-scene", "version": 2, "views": [view], "objects": objects}
    (folder / "s.scene.json").write_text(json.dumps(scene))
    assert main(["render", str(folder / "s.scene.json"), "--out", str(folder / "out")]) == 0
    return folder


def load(written: Path, name: str) -> np.ndarray:
    picture = cv2.imread(str(written / "out" / name), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    return picture if picture.ndim == 2 else picture[..., ::-1]


def inner(mask: np.ndarray) -> np.ndarray:
    """A mask without its outer two pixels, where triangles are not the sphere."""
    return cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0


@pytest.mark.parametrize("index", [0, 1])
def test_masks_are_those_of_the_spheres(written, index):
    seen, depth, _ = sphere_seen(CENTRES[index])
    drawn = load(written, f"mask/000000_{index:06d}.png")
    assert set(np.unique(drawn)) == {0, 255}
    assert np.count_nonzero((drawn > 0) != seen) <= 0.01 * seen.sum()
    other_seen, other_depth, _ = sphere_seen(CENTRES[1 - index])
    visible = seen & ~(other_seen & (other_depth < depth))
    shown = load(written, f"mask_visib/000000_{index:06d}.png") > 0
    assert np.count_nonzero(shown != visible) <= 0.01 * seen.sum()
    assert not np.any(shown & (drawn == 0))


def box_of(seen: np.ndarray, beyond: int) -> list[Any]:
    """BOP's box of a mask with a margin."""
    y, x = np.nonzero(seen)
    return [x.min() - beyond, y.min() - beyond, np.ptp(x), np.ptp(y)]


def require_info(said: dict, whole: np.ndarray, visible: np.ndarray, beyond: int = 0) -> None:
    assert said["px_count_all"] == pytest.approx(whole.sum(), rel=0.01)
    assert said["px_count_visib"] == pytest.approx(visible.sum(), rel=0.01)
    assert said["visib_fract"] == said["px_count_visib"] / said["px_count_all"]
    np.testing.assert_allclose(said["bbox_obj"], box_of(whole, beyond), atol=1)
    np.testing.assert_allclose(said["bbox_visib"], box_of(visible, 0), atol=1)


def test_shares_and_boxes_are_those_of_the_spheres(written):
    said = json.loads((written / "out" / "scene_gt_info.json").read_text())["0"]
    (near, near_depth, _), (far, far_depth, _) = map(sphere_seen, CENTRES)
    require_info(said[0], near, near)
    require_info(said[1], far, far & ~(near & (near_depth < far_depth)))
    assert said[1]["px_count_valid"] > said[1]["px_count_visib"]


def write_pose(folder: Path, centre: list[float], **more: Any) -> Path:
    """A pose file of the three fields that are needed, and ``more``."""
    place = {"rotation": np.eye(3).tolist(), "translation": centre}
    camera = {"fx": F, "fy": F, "cx": CX, "cy": CY}
    pose = {"projection": "perspective", "camera": camera, "camera_from_model": place, **more}
    (folder / "pose.json").write_text(json.dumps(pose))
    return folder / "pose.json"


def test_a_silhouette_is_whole_beyond_the_photo(written, tmp_path, capsys):
    pose = write_pose(tmp_path, [3.6, 0.0, 6.0], photo={"width": WIDTH, "height": HEIGHT})
    model = ["--model", str(written / "ball.ply"), "--image", "4", "--object", "2", "--unit", "mm"]
    line = ["convert", str(pose), "--to", "bop", str(tmp_path / "bop"), *model]
    assert main(line) == 0
    (said,) = json.loads((tmp_path / "bop" / "scene_gt_info.json").read_text())["4"]
    centre = np.array([3.6, 0.0, 6.0])
    whole, inside = sphere_seen(centre, 60)[0], sphere_seen(centre)[0]
    assert 0 < inside.sum() < 0.5 * whole.sum()
    require_info(said, whole, inside, 60)
    pose.write_text(pose.read_text().replace("3.6", "-3.6"))
    assert main(line) == 0  # a second object in the image
    assert "has other objects" in capsys.readouterr().out
    assert json.loads((tmp_path / "bop" / "scene_gt_info.json").read_text()) == {"4": [said]}


def test_what_shows_nothing_is_said(written, tmp_path, capsys):
    pose, out = write_pose(tmp_path, [60.0, 60.0, 6000.0]), str(tmp_path / "out")
    line = ["render", str(pose), "--model", str(written / "ball.ply"), "--out", out]
    assert main(line) == 2
    assert "how large the photo is; add --photo-size" in capsys.readouterr().err
    assert main([*line, "--photo-size", f"{WIDTH}x{HEIGHT}"]) == 0
    said = capsys.readouterr().out
    assert "ball.ply is seen in no photo, and its masks are empty" in said
    assert "are the pose and the model in one unit?" in said


def test_depth_is_in_steps_of_depth_scale_in_millimetres(written):
    camera = json.loads((written / "out" / "scene_camera.json").read_text())["0"]
    assert camera["cam_K"] == [F, 0.0, CX, 0.0, F, CY, 0.0, 0.0, 1.0]
    depth = load(written, "depth/000000.png").astype(float) * camera["depth_scale"]
    wanted = np.full(depth.shape, np.inf)
    for centre in CENTRES[::-1]:
        seen, own, _ = sphere_seen(centre)
        wanted = np.where(seen & (own < wanted), 10.0 * own, wanted)  # cm to mm
    inside = inner(np.isfinite(wanted)) & ~cv2.Canny((wanted < 70).astype(np.uint8), 0, 1).astype(
        bool
    )
    assert np.mean(np.abs(depth - wanted)[inside] < 0.05) > 0.98
    assert np.all(depth[~np.isfinite(wanted) & inner(~np.isfinite(wanted))] == 0.0)


@pytest.mark.parametrize("index", [0, 1])
def test_normals_and_object_coordinates(written, index):
    seen, _, normals = sphere_seen(CENTRES[index])
    inside = inner(seen)
    shown = load(written, f"normal/000000_{index:06d}.png") / 65535.0 * 2.0 - 1.0
    assert np.abs(shown - normals)[inside].max() < 0.05
    in_model = normals @ TURN  # RADIUS 1, about the sphere's middle
    wanted = in_model / (2.0 * np.sqrt(3.0)) + 0.5  # the box's diagonal
    nocs = load(written, f"nocs/000000_{index:06d}.png") / 65535.0
    assert np.abs(nocs - wanted)[inside].max() < 0.01
    assert np.all(nocs[~seen & inner(~seen)] == 0.0)


def test_masks_depth_and_coordinates_are_those_of_pyrender(written):
    """Its depth by OpenGL, of both balls alone and together, to a pixel at their rims."""
    require_opengl()
    import pyrender

    gl, ball = pyrender.OffscreenRenderer(WIDTH, HEIGHT), trimesh.load_mesh(written / "ball.ply")
    camera = pyrender.IntrinsicsCamera(F, F, CX + 0.5, CY + 0.5, znear=1.0, zfar=20.0)
    flip, alone = np.diag([1.0, -1.0, -1.0, 1.0]), []
    for centre in CENTRES:
        place = np.eye(4)
        place[:3, :3], place[:3, 3] = TURN, centre
        scene = pyrender.Scene()
        scene.add(pyrender.Mesh.from_trimesh(ball), pose=flip @ place)
        scene.add(camera)
        alone.append(gl.render(scene, flags=pyrender.RenderFlags.DEPTH_ONLY))
    gl.delete()
    depth = np.min([np.where(d > 0.0, d, np.inf) for d in alone], axis=0)
    step = json.loads((written / "out" / "scene_camera.json").read_text())["0"]["depth_scale"]
    ours = load(written, "depth/000000.png") * step / 10.0
    for index, own in enumerate(alone):
        mask = load(written, f"mask/000000_{index:06d}.png") > 0
        visible = load(written, f"mask_visib/000000_{index:06d}.png") > 0
        for ours_shown, theirs in ((mask, own > 0.0), (visible, (own > 0.0) & (own == depth))):
            wide, narrow = cv2.dilate(theirs.astype(np.uint8), np.ones((3, 3))), inner(theirs)
            assert np.all(wide[ours_shown] > 0)
            assert np.all(ours_shown[narrow])
    both = inner(alone[0] > 0.0) | inner((alone[1] > 0.0) & (alone[0] == 0.0))
    assert np.abs(ours - depth)[both].max() < 0.1
    assert np.abs(ours - depth)[both].mean() < 0.01


def test_nothing_is_overwritten_unasked(written, capsys):
    arguments = ["render", str(written / "s.scene.json"), "--out", str(written / "out")]
    assert main(arguments) == 2
    assert "overwrite" in capsys.readouterr().err
    assert main([*arguments, "--overwrite"]) == 0
