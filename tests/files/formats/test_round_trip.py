"""Files read back; poses that a format cannot say are refused; nothing is overwritten."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from poseviewer.errors import PoseFileError, PoseViewerError
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.known_formats import FORMATS
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.pose import PoseRecord
from poseviewer.files.scene_assets import model_file
from poseviewer.files.scene_json import scene_of_pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.types import Scene
from tests.files.formats import cases
from tests.files.formats.cases import HEIGHT, WIDTH, perspective_record, write_files

ENDINGS = {
    "poseviewer": "json", "nerfstudio": "json", "gltf": "glb", "meshlab": "mlp", "bop": "scene",
    "colmap": "model", "scene": "scene.json", "dope": "dope.json",
}  # fmt: skip
PARALLEL = ("poseviewer", "gltf", "scene")
HEADINGS = ("format", "OUT", "pose", "camera axes", "handed", "unit", "centre", "parallel", "lens")
OUTS = [(name, f"out.{ending}") for name, ending in ENDINGS.items()]
OUTS += [("opencv", "out.yml"), ("opencv", "out.yaml"), ("opencv", "out.json")]


def assert_same(scene: Scene, wanted: PoseRecord, depth_counts: bool = True) -> None:
    poses = scene.pose(0), wanted.pose
    assert type(poses[0].camera) is type(poses[1].camera)
    cameras = [[getattr(pose.camera, name) for name in pose.camera.__slots__] for pose in poses]
    np.testing.assert_allclose(cameras[0], cameras[1], rtol=0.0, atol=1e-9)
    places = [pose.camera_from_model for pose in poses]
    np.testing.assert_allclose(places[0].rotation, places[1].rotation, rtol=0.0, atol=1e-9)
    shifts = [place.translation[: 3 if depth_counts else 2] for place in places]
    np.testing.assert_allclose(*shifts, rtol=0.0, atol=1e-9)


def write(name: str, path: Path, record: PoseRecord, **options: Any) -> ConvertOptions:
    """Write model, photo and pose; returns the options that were used."""
    _, request = write_files(path.parent)
    request = replace(request, **options)
    FORMATS[name].convert(scene_of_pose(path.parent, record), path, request)
    return request


@pytest.mark.parametrize(("name", "out"), OUTS)
@pytest.mark.parametrize(
    ("turn", "unit"), [((0.4, -2.3, 0.7), "m"), ((0.0, np.pi, 0.0), "mm"), ((0.0, 0.0, 0.0), "mm")]
)
def test_a_pose_reads_back(tmp_path, name, out, turn, unit):
    record = perspective_record(unit)
    place = RigidTransform.from_rotation_vector(turn, [0.15, -0.1, 6.0])
    record = record.with_pose(replace(record.pose, camera_from_model=place))
    request = replace(write(name, tmp_path / out, record), unit=unit)
    found = FORMATS[name].read(tmp_path / out, replace(request, photo_size=(WIDTH, HEIGHT)))
    assert_same(found, record)
    if name != "scene":
        with pytest.raises(PoseFileError, match="200x150"):
            FORMATS[name].read(tmp_path / out, replace(request, photo_size=(100, 75)))


@pytest.mark.parametrize(("name", "out"), OUTS)
def test_parallel_projection_reads_back_or_is_refused(tmp_path, name, out):
    if name in PARALLEL:
        request = write(name, tmp_path / out, cases.parallel_record(), unit="m")
        found = FORMATS[name].read(tmp_path / out, request)
        assert_same(found, cases.parallel_record(), depth_counts=name != "gltf")
    else:
        with pytest.raises(PoseFileError, match="parallel projection"):
            write(name, tmp_path / out, cases.parallel_record())
        assert not (tmp_path / out).exists()


@pytest.mark.parametrize(("name", "out"), [(n, o) for n, o in OUTS if n != "bop"])
def test_nothing_is_overwritten_unasked(tmp_path, name, out):
    record = perspective_record()
    write(name, tmp_path / out, record)
    before = contents(tmp_path)
    place = RigidTransform(np.eye(3), np.array([0.0, 0.0, 7.0]))
    moved = record.with_pose(replace(record.pose, camera_from_model=place))
    with pytest.raises(PoseFileError, match="`overwrite`"):
        write(name, tmp_path / out, moved)
    assert contents(tmp_path) == before
    write(name, tmp_path / out, moved, overwrite=True)
    assert contents(tmp_path) != before


@pytest.mark.parametrize("unit", [None, "m", "mm"])
@pytest.mark.parametrize(
    "away", [(0, 0, 0), (300, 0, 0), (-4e5, 0, 0), (4e5, 5.4e6, 200), (0, 0, 1e7), (-9e8, 1, 1)]
)
def test_a_model_stays_exact_in_gltf_wherever_it_lies(tmp_path, away, unit):
    mesh, request = write_files(tmp_path)
    obj = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in (mesh.vertices + away).tolist())
    obj += "".join(f"f {a} {b} {c}\n" for a, b, c in (mesh.faces + 1).tolist())
    (tmp_path / "m.obj").write_text(obj)
    request = replace(request, model=tmp_path / "m.obj", unit=unit)
    scene = scene_of_pose(tmp_path, perspective_record(unit))
    model = model_file(tmp_path / "m.obj", unit=scene.objects[0].model.unit)
    scene = scene.with_object(0, model=model)
    FORMATS["gltf"].convert(scene, tmp_path / "out.glb", request)
    found, size = load_mesh(tmp_path / "out.glb"), 0.001 if unit == "mm" else 1.0
    name = next(name for name in found.part_names if "photo" not in name)
    wanted = np.ptp(mesh.vertices + away, axis=0) * size
    np.testing.assert_allclose(np.ptp(found.part_vertices(name), axis=0), wanted, rtol=3e-5)


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


GARBAGE = [
    b"", b"{", b"\0\1\2", b"[]", b"{}", b"%YAML:1.0\n---\nR: 3\n", b"<a></a>", b"1 2\n3 4\n",
    b'{"3": 3}', b'{"nodes": [[]]}', b'{"nodes": [{"camera": 0}]}', b'{"frames": [3]}',
    b'{"frames": [{"transform_matrix": [[1, 0, 0, NaN]]}], "fl_x": 1, "cx": 1, "cy": 2}',
    b'{"opencv": 3}', b"[" * 5000,
    b'{"camera_matrix": {"data": ["a"]}}', b'{"K": [1, [2, "x"]]}',
]  # fmt: skip


@pytest.mark.parametrize(("name", "out"), OUTS)
def test_garbage_is_one_clear_sentence(tmp_path, name, out):
    path = tmp_path / out
    names = {"bop": ("scene_gt.json", "scene_camera.json"), "colmap": ("images.txt", "cameras.txt")}
    if name in names:
        path.mkdir()
    _, request = write_files(tmp_path)
    for content in GARBAGE:
        for file in [path / file for file in names[name]] if name in names else [path]:
            file.write_bytes(content)
        with pytest.raises(PoseViewerError) as caught:
            FORMATS[name].read(path, replace(request, photo_size=(WIDTH, HEIGHT)))
        assert len(str(caught.value).splitlines()) == 1, content


@pytest.mark.parametrize(("name", "out"), OUTS)
def test_a_file_that_is_not_there_is_said(tmp_path, name, out):
    _, request = write_files(tmp_path)
    with pytest.raises(PoseFileError, match=r"[nN]o such"):
        FORMATS[name].read(tmp_path / "none" / out, request)


def test_the_documentation_has_the_table():
    page = Path(__file__).resolve().parents[3] / "assets" / "docs" / "formats.md"
    lines = [line.strip("| ").split(" | ") for line in page.read_text("utf-8").splitlines()]
    full = [dict(zip(HEADINGS, row, strict=True)) for row in lines if len(row) > 8]
    rows = {row["format"].strip("`"): row for row in full}
    assert [name for name in rows if name in FORMATS] == list(FORMATS)
    for name, known in FORMATS.items():
        said = {key: value != "no" and value != "none" for key, value in rows[name].items()}
        assert said["parallel"] == (name in PARALLEL), name
        assert said["lens"] == bool(known.lenses or known.is_own), name
