"""Small files as tools of the field write them, which were read wrong or refused once; their right
values are said in the README beside each, and were computed without us.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from poseviewer.cli.main import main
from poseviewer.files.file_set import sort_set
from poseviewer.files.mesh.load import load_mesh
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import face_normals_and_areas

LENS = "opencv, -0.3, 0.1, 0.001, -0.001"
CAMERAS = {
    "camera_forms/cam_K.txt": (510, "no distortion"),
    "camera_forms/kalibr.yaml": (510, LENS),
    "camera_forms/metashape.xml": (500, LENS),
    "camera_forms/nested.json": (510, LENS),
    "camera_forms/open3d.json": (510, "no distortion"),
    "camera_forms/realsense.json": (510, LENS),
    **{f"lens_dropped/{name}": (None, LENS) for name in (
        "dist_coef.json", "distortion.json", "distortion_coeffs.yaml", "flat_dist_coeffs.json",
        "flat_k1.json")},
    **{f"yaml_block_lists/{name}.yaml": (None, LENS) for name in (
        "camera_info_ros2", "date", "pyyaml", "ros_block_data")},
}  # fmt: skip
"""fy where the camera is of fx 500, cx 321, cy 239; None: of fx fy 500, cx 320, cy 240."""


@pytest.mark.parametrize("name", CAMERAS)
def test_cameras(shared_cases, name, capsys):
    path, (fy, lens) = shared_cases / name, CAMERAS[name]
    assert main(["info", str(path.with_name("photo.png")), "--calibration", str(path)]) == 0
    said = capsys.readouterr().out
    camera = f"fx 500, fy {fy}, cx 321, cy 239" if fy else "fx 500, fy 500, cx 320, cy 240"
    assert camera in said
    assert f"distortion:  {lens}" in said
    assert f"from {path.name}" in said  # and the keys


def test_lenses_of_instant_ngp_and_nerfstudio(shared_cases, tmp_path):
    for name, model, first in (
        ("transforms", "opencv-fisheye", [0.02, -0.01, 0.0, 0.0]),
        ("simple_radial", "opencv", [-0.05, 0.0, 0.0, 0.0]),
    ):
        path, out = shared_cases / "ingp_fisheye" / f"{name}.json", tmp_path / f"{name}.json"
        assert main(["convert", str(path), "--from", "nerfstudio", str(out)]) == 0
        distortion = json.loads(out.read_text())["distortion"]
        assert (distortion["model"], distortion["coefficients"][:4]) == (model, first)


def area(mesh: Mesh) -> float:
    return float(face_normals_and_areas(mesh.vertices, mesh.faces)[1].sum())


AREAS = {
    "concave_ngons/u_bracket.obj": 10.52,
    "concave_ngons/letter_e.obj": 4.984,
    "concave_ngons/l_plate.ply": 3.0,
    "concave_ngons/l_plate.off": 3.0,
    "ply_tristrips/tristrips.ply": 2.11237,
    "ply_tristrips/tristrips_bin.ply": 2.11237,
    "obj_tabs/box_tab.obj": 6.0,
}


@pytest.mark.parametrize("name", AREAS)
def test_areas(shared_cases, name):
    assert area(load_mesh(shared_cases / name)) == pytest.approx(AREAS[name], rel=1e-3)


@pytest.mark.parametrize(
    "name", ["obj_bom/m.obj", "obj_no_usemtl/m.obj", "obj_tabs/two_libraries.obj"]
)
def test_textures_of_obj(shared_cases, name):
    mesh = load_mesh(shared_cases / name)
    assert len(mesh.textures) == 1
    assert mesh.notes == ()
    assert np.all(mesh.face_texture == 0)


@pytest.mark.parametrize("folder", ["obj_bom", "obj_no_usemtl", "obj_tabs"])
def test_a_texture_that_comes_with_its_model_is_no_photo(shared_cases, folder):
    files = [path for path in (shared_cases / folder).iterdir() if path.name != "README"]
    model = "two_libraries.obj" if folder == "obj_tabs" else "m.obj"
    found = sort_set([path for path in files if path.suffix != ".obj" or path.name == model])
    assert found.photo is None
    assert "t.png" in found.models[0].named


QUARTERS = {(-1, 1): (230, 20, 20), (1, 1): (20, 200, 20),
            (-1, -1): (20, 20, 230), (1, -1): (230, 220, 20)}  # fmt: skip
GREEN = dict.fromkeys(QUARTERS, (20, 200, 20))


@pytest.mark.parametrize(
    ("name", "colours"),
    [("texture_transform", GREEN), ("gltfpack_like", QUARTERS), ("texcoord1", QUARTERS)],
)
def test_colours_of_gltf(shared_cases, name, colours):
    mesh = load_mesh(shared_cases / "gltf_silent" / f"{name}.glb")
    (texture,) = mesh.textures
    centres, uvs = mesh.vertices[mesh.faces].mean(axis=1), mesh.uvs[mesh.faces].mean(axis=1) % 1.0
    for (x, y), wanted in colours.items():
        nearest = np.argmin(np.linalg.norm(centres[:, :2] - (0.5 * x, 0.5 * y), axis=1))
        u, v = uvs[nearest]
        height, width = texture.shape[:2]
        shown = texture[int((1.0 - v) * height), int(u * width)]
        np.testing.assert_allclose(shown, wanted, atol=2)


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("sparse", (-1, -1, 0), (1, 1, 0.7)),
        ("skin", (-2, -2, 3), (2, 2, 3)),
        ("instancing", (-1, -1, 0), (7, 1, 0)),
        ("alpha_mask", (-1, -1, 0), (0, 1, 0)),
    ],
)
def test_shapes_of_gltf(shared_cases, name, least, most):
    mesh = load_mesh(shared_cases / "gltf_silent" / f"{name}.glb")
    np.testing.assert_allclose(mesh.bounds, (least, most), atol=1e-6)
    assert mesh.notes == ()


REFUSED = {
    "gltf_silent/basisu.glb": "KHR_texture_basisu",
    "raw_preview/photo.dng": "raw photo; develop it",
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_read_is_said(shared_cases, name, capsys):
    assert main(["info", str(shared_cases / name)]) == 2
    assert REFUSED[name] in capsys.readouterr().err


@pytest.mark.parametrize("name", ["swapped_header", "excel_de", "tab"])
def test_tables_of_pairs(shared_cases, name):
    from poseviewer.files.marks import load_pairs

    pairs = load_pairs(shared_cases / "pairs_tables" / f"{name}.csv")
    np.testing.assert_allclose(pairs.points[0], (-1.0662, 0.8640, 0.3216))
    np.testing.assert_allclose(pairs.pixels[0] - 0.5, (710.9613, 434.7302))
    assert len(pairs.points) == 8


def test_a_model_far_from_its_origin_stays_exact_in_gltf(shared_cases, tmp_path):
    folder, out = shared_cases / "far_from_origin", tmp_path / "scene.glb"
    files = ["--photo", str(folder / "photo.png"), "--model", str(folder / "box_utm.obj")]
    assert main(["convert", str(folder / "pose.json"), "--to", "gltf", str(out), *files]) == 0
    size = np.ptp(far_model(out), axis=0)
    np.testing.assert_allclose(size, (2.0, 0.6, 0.8), rtol=1e-5)


def far_model(path: Path) -> np.ndarray:
    """Vertices of the parts that are not the photo's plane."""
    mesh = load_mesh(path)
    names = [name for name in mesh.part_names if "photo" not in name]
    return np.concatenate([mesh.part_vertices(name) for name in names])
