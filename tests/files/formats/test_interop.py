"""The other tools' own readers see the model where we see it."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from poseviewer.files.cameras import load_cameras
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.gltf_export import GLTF
from poseviewer.files.formats.meshlab import MESHLAB, read_meshlab
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.scene_json import load_scene, scene_of_pose
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import opencv_matrix
from poseviewer.render.software.software_renderer import SoftwareRenderer
from tests.commands import run
from tests.files.formats import cases
from tests.files.formats.cases import HEIGHT, WIDTH, perspective_record, write_files
from tests.files.formats.foreign import read_with
from tests.files.test_cameras import COLMAP
from tests.several import make_three

HALF_A_PIXEL_SHOWS = 0.1
"""px: a slip between conventions moves everything by 0.5."""


def test_meshlab_has_the_same_camera(tmp_path):
    """MeshLab's own words for it, Bundler's and Agisoft's, have six digits."""
    _, request = write_files(tmp_path)
    project = tmp_path / "project.mlp"
    MESHLAB.convert(scene_of_pose(tmp_path, perspective_record()), project, request)
    answer = read_with("pymeshlab", project, out=tmp_path / "out.json")
    assert answer["rasters"] == 1
    numbers = np.array(" ".join(answer["bundler"].splitlines()[2:7]).split(), float)
    focal = numbers[0]
    rotation = numbers[3:12].reshape(3, 3)
    translation = numbers[12:]
    lens = ElementTree.fromstring(answer["agisoft"]).find(".//calibration")
    fx, fy, cx, cy = (float(lens.findtext(name) or "nan") for name in ("fx", "fy", "cx", "cy"))
    some = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 3))
    points = some @ rotation.T + translation  # Bundler: x right, y up, z backward
    flat = -points[:, :2] / points[:, 2:]
    seen = np.column_stack([fx * flat[:, 0] + cx, (HEIGHT - cy) - fy * flat[:, 1]])
    np.testing.assert_allclose(seen, perspective_record().pose.project(some), atol=1e-3)
    assert focal == fx


def test_a_meshlab_project_holds_all_objects_of_a_scene(tmp_path):
    scene = load_scene(make_three(tmp_path))
    path = tmp_path / "all.mlp"
    assert run("convert --from scene --to meshlab", tmp_path / "three.scene.json", path) == 0
    project = ElementTree.parse(path).getroot()
    matrices = {}
    for mesh in project.iter("MLMesh"):
        (matrix,) = mesh.iter("MLMatrix44")
        matrices[mesh.get("label")] = np.array((matrix.text or "").split(), float).reshape(4, 4)
        matrix.text = None
        assert (tmp_path / str(mesh.get("filename"))).is_file()
    path.write_text(ElementTree.tostring(project, encoding="unicode"))
    camera = read_meshlab(path, ConvertOptions()).pose(0)  # from the project's world
    for index, one in enumerate(scene.objects):
        points = load_mesh(one.model.location).vertices
        placed = points @ matrices[one.id][:3, :3].T + matrices[one.id][:3, 3]
        wanted = scene.pose(index).project(points)
        np.testing.assert_allclose(camera.project(placed), wanted, atol=1e-9)


@pytest.mark.parametrize("make_record", [perspective_record, cases.parallel_record])
@pytest.mark.parametrize("unit", ["m", "cm"])
def test_blender_sees_the_same_through_gltf(tmp_path, make_record, unit):
    """glTF has no principal point off the middle: the view is wider, and the photo a part of it."""
    mesh, request = write_files(tmp_path)
    record = make_record()
    file = tmp_path / "scene.glb"
    picture = tmp_path / "drawn.png"
    GLTF.convert(scene_of_pose(tmp_path, record), file, replace(request, unit=unit))
    # cx = 112 of 200: the wider view is 224 px wide, and begins where the photo does;
    # cy = 66 of 150: it is 168 px high, and begins 18 px above the photo.
    camera, (width, height) = record.pose.camera, (224, 168)
    pixel = camera.fx / camera.fy if isinstance(camera, Perspective) else 1.0
    more = width, height, width / height / pixel, picture
    answer = read_with("bpy", file, *more, out=tmp_path / "out.json")
    drawn = cv2.imread(str(picture), cv2.IMREAD_UNCHANGED)
    drawn = np.asarray(drawn)[18:, :WIDTH, 3] > 127
    ours = SoftwareRenderer(mesh).render(record.pose).mask > 0
    assert (drawn & ours).sum() / (drawn | ours).sum() >= 0.99
    middles = [np.argwhere(mask).mean(axis=0) for mask in (drawn, ours)]
    np.testing.assert_allclose(middles[0], middles[1], rtol=0.0, atol=HALF_A_PIXEL_SHOWS)
    assert "photo plane" in answer["objects"]


def test_the_photo_covers_what_gltf_shows_of_it(tmp_path):
    """The plane's corners are seen at the photo's corners."""
    _, request = write_files(tmp_path)
    record = perspective_record(unit="cm")
    GLTF.convert(scene_of_pose(tmp_path, record), tmp_path / "scene.glb", request)
    scene = trimesh.load_scene(tmp_path / "scene.glb", process=False)
    plane = next(one for name, one in scene.geometry.items() if name.startswith("photo"))
    seen = record.pose.project(np.asarray(plane.vertices) * 100.0)
    np.testing.assert_allclose(seen, [[0, 0], [WIDTH, 0], [WIDTH, HEIGHT], [0, HEIGHT]], atol=0.01)
    # trimesh counts v upwards: the picture's upper left is at the plane's upper left.
    np.testing.assert_array_equal(plane.visual.uv, [[0, 1], [1, 1], [1, 0], [0, 0]])
    assert np.asarray(plane.visual.material.baseColorTexture)[40, 130, :2].tolist() == [130, 40]


def test_blender_has_the_same_shapes(shared_cases, tmp_path):
    """Sparse and quantised accessors, a skin, instances; and what we write far from the origin."""
    names = ("sparse", "gltfpack_like", "skin", "instancing", "texture_transform", "texcoord1")
    files = [shared_cases / "gltf_silent" / f"{name}.glb" for name in names]
    folder, far = shared_cases / "far_from_origin", tmp_path / "far.glb"
    with_files = ["--photo", folder / "photo.png", "--model", folder / "box_utm.obj"]
    assert run("convert --to gltf", folder / "pose.json", far, *with_files) == 0
    answer = read_with("bpy", *files, far, out=tmp_path / "out.json")
    for file in files:
        theirs, ours = np.array(answer[file.stem]["vertices"]), load_mesh(file).vertices
        for some, others in ((theirs, ours), (ours, theirs)):
            assert KDTree(others).query(some)[0].max() < 1e-5, file.stem
    sizes = np.array([size for name, size in answer["far"]["sizes"].items() if "photo" not in name])
    np.testing.assert_allclose(np.sort(sizes[0]), (0.6, 0.8, 2.0), rtol=1e-5)
    (name,) = (n for n in trimesh.load_scene(far).geometry if "photo" not in n)
    extents = trimesh.load_scene(far, process=False).geometry[name].extents
    np.testing.assert_allclose(np.sort(extents), (0.6, 0.8, 2.0), rtol=1e-5)


def test_colmap_sees_through_its_models_as_opencv_through_what_we_read(tmp_path):
    lines = list(COLMAP)
    cameras = "".join(f"{number} {line}\n" for number, line in enumerate(lines, 1))
    (tmp_path / "cameras.txt").write_text(cameras)
    for name in ("images", "points3D"):
        (tmp_path / f"{name}.txt").write_text("# none\n")
    points = np.random.default_rng(0).uniform((-0.2, -0.2, 1.0), (0.2, 0.2, 1.5), (20, 3))
    (tmp_path / "points.json").write_text(json.dumps(points.tolist()))
    seen = read_with("pycolmap", tmp_path, tmp_path / "points.json", out=tmp_path / "out.json")
    for number, found in enumerate(load_cameras(tmp_path / "cameras.txt"), 1):
        is_fisheye = found.lens is not None and found.lens.model == "fisheye"
        project = cv2.fisheye.projectPoints if is_fisheye else cv2.projectPoints
        k = np.zeros(5) if found.lens is None else found.lens.array
        still = np.zeros(3), np.zeros(3), opencv_matrix(found.camera), k
        ours = project(points[:, None], *still)[0][:, 0] + 0.5  # COLMAP's centres are at i + 0.5
        np.testing.assert_allclose(ours, seen[str(number)], atol=1e-6, err_msg=lines[number - 1])
