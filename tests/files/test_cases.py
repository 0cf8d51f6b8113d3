"""Small files as tools of the field write them, which were read wrong or refused once; their right
values are said in the README beside each, and were computed without us.
"""

from typing import Any

import numpy as np
import pytest

from poseviewer.cli.main import main
from poseviewer.files.mesh.load import load_mesh
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
    assert (f"fx 500, fy {fy}, cx 321, cy 239" if fy else "fx 500, fy 500, cx 320, cy 240") in said
    assert f"distortion:  {lens}" in said
    assert f"from {path.name}" in said  # and the keys


MODELS: dict[str, dict[str, Any]] = {
    "concave_ngons/u_bracket.obj": {"area": 10.52},
    "concave_ngons/letter_e.obj": {"area": 4.984},
    "concave_ngons/l_plate.ply": {"area": 3.0},
    "concave_ngons/l_plate.off": {"area": 3.0},
    "ply_tristrips/tristrips.ply": {"area": 2.11237},
    "ply_tristrips/tristrips_bin.ply": {"area": 2.11237},
    "obj_tabs/box_tab.obj": {"area": 6.0},
    "obj_tabs/two_libraries.obj": {"textures": 1},
    "obj_bom/m.obj": {"textures": 1},
    "obj_no_usemtl/m.obj": {"textures": 1},
    "gltf_silent/sparse.glb": {"bounds": ((-1, -1, 0), (1, 1, 0.7))},
    "gltf_silent/skin.glb": {"bounds": ((-2, -2, 3), (2, 2, 3))},
    "gltf_silent/instancing.glb": {"bounds": ((-1, -1, 0), (7, 1, 0))},
    "gltf_silent/alpha_mask.glb": {"bounds": ((-1, -1, 0), (0, 1, 0)), "notes": "Invisible"},
    "public4/gltf-invisible/box.glb": {"area": 6.0, "notes": "Invisible triangles, left out: 12."},
    "public4/gltf-texture-wrap/clamp.glb": {"notes": "clamped or mirrored"},
    "public4/colours-just-above-one/cube.obj": {"mean": 0.5, "notes": "cut to 1: 7"},
    "public4/ply-colour-names/cube.ply": {"mean": 0.5},
    "public4/obj-colours-of-one-object/two.obj": {"mean": (0.5 + 0.8) / 2},
    "public4/obj-zbrush-colours/cube.obj": {"mean": 0.5},
    "public4/off-colours/cube.off": {"mean": 0.5},
    "public4/off-header/cube.off": {"area": 6 * 12.5**2},
    "public4/stl-words/upper.stl": {"area": 6 * 20.0**2},
    "public4/stl-words/end_solid.stl": {"area": 6 * 20.0**2},
}
"""What is right, and a part of the note, where one is right."""


@pytest.mark.parametrize("name", MODELS)
def test_models(shared_cases, name):
    mesh = load_mesh(shared_cases / name)
    areas = face_normals_and_areas(mesh.vertices, mesh.faces)[1]
    found = {"area": areas.sum(), "textures": len(mesh.textures), "bounds": mesh.bounds,
             "mean": mesh.colours.mean()}  # fmt: skip
    values = dict(MODELS[name])
    note = values.pop("notes", None)
    assert note in " ".join(mesh.notes) if note else mesh.notes == () or "area" in values
    for key, wanted in values.items():
        np.testing.assert_allclose(found[key], wanted, rtol=1e-3, atol=1e-6)


REFUSED = {
    "gltf_silent/basisu.glb": "KHR_texture_basisu",
    "raw_preview/photo.dng": "raw photo; develop it",
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_read_is_said(shared_cases, name, capsys):
    assert main(["info", str(shared_cases / name)]) == 2
    assert REFUSED[name] in capsys.readouterr().err
