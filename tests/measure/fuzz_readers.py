"""What is fuzzed: every reader of a file or of a page's words, and good ones of its inputs."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import trimesh
from PIL import ExifTags, Image
from trimesh.visual import TextureVisuals

from poseviewer.app.below_viser.client_script import _parsed
from poseviewer.app.page.reports import request_of
from poseviewer.app.state.commands import Command
from poseviewer.app.state.document import Document
from poseviewer.app.state.requests import Report
from poseviewer.app.state.session import Session
from poseviewer.app.state.update import update
from poseviewer.batch.table import load_jobs
from poseviewer.files.cameras import load_cameras
from poseviewer.files.file_set import files_below, sort_set
from poseviewer.files.formats.bop import load_bop_images
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.table import FORMATS
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.marks import load_pairs, load_wheels
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import PhotoReference, PoseRecord, load_pose, record_as_json, set_frame
from poseviewer.files.scene import load_scene
from poseviewer.files.state.autosave import AutosavedSession, load_autosave, save_autosave
from poseviewer.files.state.uploads import keep_set, pack
from poseviewer.files.symmetry import load_symmetry
from poseviewer.files.view_set import load_view_set, set_as_json
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.pose_covariance import PoseCovariance
from poseviewer.geometry.symmetry import NO_SYMMETRY
from poseviewer.starts.registration import load_registration
from tests.files.formats.cases import perspective_record
from tests.scene import make_scene
from tests.several import make_three
from tests.view_sets import (
    CAMERA,
    MESH,
    NAMES,
    TRUTH,
    make_views,
    write_bop,
    write_colmap,
    write_frames,
    write_views,
)

Files = dict[str, bytes]
"""By their paths; the first is mutated, the others lie beside it."""
CUBE = trimesh.creation.box()
CALIBRATION = """%YAML:1.0
---
image_width: 160
image_height: 120
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 300., 0., 83., 0., 290., 58., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.1, 0.02, 0.001, 0.002, 0. ]
"""
REPORTS = (
    {"kind": "press", "u": 80.0, "v": 60.5, "zoom": 1.5, "shift": True},
    {"kind": "drag", "u": 90, "v": 61.25},
    {"kind": "release"},
    {"kind": "double", "u": 80.0, "v": 60.5, "zoom": 2},
    {"kind": "pick", "first": 0, "second": 1, "u": 0.5, "v": 0.25},
    {"kind": "enlarge", "first": 2, "second": 3},
    {"kind": "key", "code": "ArrowLeft", "shift": True},
    {"kind": "unfit", "name": "photo.jpg", "size": 300000000, "count": 1},
)


@dataclass(frozen=True)
class Reader:
    """One of them."""

    read: Callable[[Path], object]
    """The first of the files."""
    seeds: tuple[Files, ...]


def make_readers(folder: Path) -> dict[str, Reader]:
    """All by name; ``folder`` is for the good inputs that are made of files."""
    scene = make_scene(folder)
    pose, photo = scene.start.read_bytes(), scene.photo.read_bytes()
    registration = load_registration(scene.photo, scene.model, scene.start)
    session = Session(Document(registration, registration.start))
    mesh = registration.mesh

    def use_report(path: Path) -> None:
        report = _parsed(path.read_bytes().decode("utf-8", "replace"))
        request = None if report is None else request_of(Report(report, 1), session)
        if isinstance(request, Command):
            update(session, request)

    def use_upload(path: Path) -> None:
        sort_set(files_below(keep_set(path.parent / "kept", path.read_bytes(), kept=1)))

    def use_known_cameras(path: Path) -> None:
        for known in sort_set(files_below(path.parent)).known_cameras:
            load_view_set(known.path, known.choice(next(iter(known.rigs), None)))

    def pair(file: str, data: bytes, **others: bytes) -> Files:
        return {file: data, **others}

    return {
        **_models(),
        **_pictures(registration.photo.pixels),
        **_formats(folder, scene.model),
        "pose": Reader(lambda path: load_pose(path, 160, 120), ({"p.json": pose},)),
        "scene": Reader(load_scene, _scenes(folder)),
        "views": Reader(load_view_set, _views(folder)),
        "pose in a set": Reader(
            lambda path: set_frame(load_pose(path, 320, 240)), ({"p.json": _pose_in_set()},)
        ),
        "known cameras": Reader(use_known_cameras, _known_cameras(folder)),
        "cameras": Reader(load_cameras, _cameras()),
        "keypoints": Reader(
            lambda path: load_keypoints(path.with_name("m.glb"), mesh),
            (pair("m.keypoints.json", _keypoints()),),
        ),
        "symmetry": Reader(
            lambda path: load_symmetry(path.with_name("m.glb"), mesh),
            (pair("m.symmetry.json", SYMMETRY),),
        ),
        "pairs": Reader(
            load_pairs,
            (
                pair("p.csv", b"x,y,z,u,v\n0,0,0,1,2\n1.5,0,-2,30,4\n# a\n0;1;2;3;4\n"),
                pair("p.json", b'{"pairs": [{"model": [1, 2, 3], "photo": [4, 5]}, [1,2,3,4,5]]}'),
            ),
        ),
        "wheels": Reader(
            lambda path: load_wheels(str(path)),
            (
                pair(
                    "w.json",
                    b'{"rear": {"cx": 7, "cy": 4, "a": 5, "b": 3.5, "angle": 90}, "front": '
                    b"[40, 47, 6, 5, 0]}",
                ),
            ),
        ),
        "jobs": Reader(
            lambda path: load_jobs(path, FitSettings()),
            (
                pair(
                    "j.csv",
                    b"photo,model,start,box\np.png,m.ply,s.json,\np.png,m.ply,last,1 2 3 4\n",
                ),
            ),
        ),
        "autosave": Reader(load_autosave, ({"s.json": _autosave(folder)},)),
        "upload": Reader(
            use_upload,
            (
                pair("set", pack([("a/p.png", photo), ("a/p.json", pose)])),
                pair("set", pack([("a.zip", _zip({"x/m.obj": b"v 0 0 0\n", "p.json": pose}))])),
            ),
        ),
        "page": Reader(
            use_report, tuple({"r.json": json.dumps(report).encode()} for report in REPORTS)
        ),
    }


def _export(kind: str, **options: Any) -> bytes:
    data = CUBE.export(file_type=kind, **options)
    return data.encode() if isinstance(data, str) else bytes(data)


def _models() -> Mapping[str, Reader]:
    obj = (
        b"mtllib m.mtl\no body\n" + b"".join(b"v %d %d %d\n" % tuple(v) for v in CUBE.vertices * 2)
        + b"vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nusemtl red\n"
        + b"".join(b"f %d/1/1 %d/2/1 %d/3/1\n" % tuple(f + 1) for f in CUBE.faces[:6])
        + b"g wheel\nusemtl wood\n" + b"f 1 2 3 4\nf -1 -2 -3\n"
    )  # fmt: skip
    mtl = b"newmtl red\nKd 1 0 0\nmap_Kd -s 1 1 1 w.png\nnewmtl wood\nKd .5 .5 .5\n"
    png = _picture("PNG", np.full((4, 4, 3), 90, np.uint8))
    textured = trimesh.Trimesh(CUBE.vertices, CUBE.faces, process=False)
    textured.visual = TextureVisuals(
        np.random.default_rng(0).random((len(CUBE.vertices), 2)),
        image=Image.open(BytesIO(png)),
    )
    glb: Any = textured.export(file_type="glb")
    length = struct.unpack("<I", glb[12:16])[0]
    document, binary = json.loads(glb[20 : 20 + length]), glb[28 + length :]
    document["buffers"][0]["uri"] = "m.bin"
    ply = (
        b"ply\nformat ascii 1.0\ncomment TextureFile w.png\nelement vertex 4\nproperty float x\n"
        b"property float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty "
        b"uchar blue\nelement face 2\nproperty list uchar int vertex_indices\nproperty list uchar "
        b"float texcoord\nend_header\n0 0 0 1 2 3\n1 0 0 1 2 3\n0 1 0 1 2 3\n0 0 1 9 9 9\n"
        b"3 0 1 2 6 0 0 1 0 1 1\n3 0 1 3 6 0 0 1 0 1 1\n"
    )
    return {
        "obj": Reader(load_mesh, ({"m.obj": obj, "m.mtl": mtl, "w.png": png},)),
        "mtl": Reader(
            lambda path: load_mesh(path.with_suffix(".obj")),
            ({"m.mtl": mtl, "m.obj": obj, "w.png": png},),
        ),
        "ply": Reader(load_mesh, ({"m.ply": _export("ply")}, {"m.ply": ply, "w.png": png})),
        "stl": Reader(load_mesh, ({"m.stl": _export("stl")}, {"m.stl": _export("stl_ascii")})),
        "off": Reader(load_mesh, ({"m.off": _export("off")},)),
        "glb": Reader(load_mesh, ({"m.glb": glb},)),
        "gltf": Reader(load_mesh, ({"m.gltf": json.dumps(document).encode(), "m.bin": binary},)),
        "3ds": Reader(load_mesh, ({"m.3ds": _3ds()},)),
    }


def _3ds() -> bytes:
    def chunk(kind: int, body: bytes) -> bytes:
        return struct.pack("<HI", kind, 6 + len(body)) + body

    points = np.asarray(CUBE.vertices, "<f4")
    faces = np.column_stack([CUBE.faces, np.zeros(len(CUBE.faces))]).astype("<u2")
    mesh = chunk(0x4110, struct.pack("<H", len(points)) + points.tobytes())
    mesh += chunk(0x4120, struct.pack("<H", len(faces)) + faces.tobytes())
    return chunk(0x4D4D, chunk(0x3D3D, chunk(0x4000, b"cube\0" + chunk(0x4100, mesh))))


def _picture(kind: str, pixels: np.ndarray, **options: Any) -> bytes:
    memory = BytesIO()
    Image.fromarray(pixels).save(memory, kind, **options)
    return memory.getvalue()


def _pictures(pixels: np.ndarray) -> Mapping[str, Reader]:
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 28
    small = pixels[:48, :64]
    made = {
        "jpg": (_picture("JPEG", small, exif=exif), _picture("JPEG", small, progressive=True)),
        "png": (_picture("PNG", small), _picture("PNG", small[..., 0])),
        "tif": (_picture("TIFF", small), _picture("TIFF", small, compression="tiff_lzw")),
        "webp": (_picture("WEBP", small, exif=exif), _picture("WEBP", small, lossless=True)),
        "bmp": (_picture("BMP", small),),
    }
    try:
        import pillow_heif
    except ImportError:
        pass
    else:
        memory = BytesIO()
        picture = pillow_heif.from_bytes("RGB", (64, 48), np.ascontiguousarray(small).tobytes())
        picture.save(memory, exif=exif.tobytes())
        made["heic"] = (memory.getvalue(),)
    return {
        ending: Reader(load_photo, tuple({f"p.{ending}": data} for data in all_of_it))
        for ending, all_of_it in made.items()
    }


def _views(folder: Path) -> tuple[Files, ...]:
    """Our own set, with a lens and a mask; and nerfstudio's and NeRF's frames."""
    own = folder / "views"
    own.mkdir()
    data = json.loads(write_views(own)[0].read_text())
    beside = {path.name: path.read_bytes() for path in own.iterdir() if path.suffix == ".png"}
    lens = {"model": "opencv", "coefficients": [-0.1, 0.02, 0.0, 0.0]}
    data["views"][1] |= {"distortion": lens, "mask": "c.png"}
    matrix = [
        [1.0, 0.0, 0.0, 0.5],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 7.0],
        [0.0, 0.0, 0.0, 1.0],
    ]
    frames = [{"file_path": name, "transform_matrix": matrix} for name in beside]
    whole = {"fl_x": 600.0, "fl_y": 600.0, "cx": 160.5, "cy": 120.5, "w": 320, "h": 240, "k1": 0.01}
    angle = {"camera_angle_x": 0.5, "frames": frames}
    found = (data, {**whole, "frames": frames}, angle)
    return tuple({"s.json": json.dumps(one).encode(), **beside} for one in found)


def _pose_in_set() -> bytes:
    views, records = make_views(2.0, None), [PoseRecord(pose) for pose in TRUTH]
    records = [
        replace(record, photo=PhotoReference(name, CAMERA.width, CAMERA.height))
        for record, name in zip(records, NAMES, strict=True)
    ]
    sure = PoseCovariance(TRUTH[0], MESH.centre, 1e-4 * np.eye(7), 0.5, "log_size")
    in_set = set_as_json(views, records, 2.0, True, NO_SYMMETRY)
    return json.dumps(record_as_json(replace(records[0], in_set=in_set, covariance=sure))).encode()


def _known_cameras(folder: Path) -> tuple[Files, ...]:
    """Photos with a COLMAP model, a BOP scene with a world and without, a file of frames."""
    found = []
    for number, write in enumerate(
        (
            write_colmap,
            lambda folder: write_bop(folder, with_world=True),
            lambda folder: write_bop(folder, with_world=False),
            lambda folder: write_frames(folder, camera_angle_x=0.5),
        )
    ):
        own = folder / f"known-{number}"
        own.mkdir()
        pictures = {path.name: path.read_bytes() for path in _pictures_of(own)}
        place = write(own / "x" if write is write_colmap else own)
        place = place.parent if place.is_file() else place
        files = {
            path.relative_to(place).as_posix(): path.read_bytes()
            for path in sorted(place.rglob("*.*"))
        }
        files = pictures | files
        texts = [name for name in files if name.endswith((".txt", ".json"))]
        found += [{first: files[first], **files} for first in texts]
    return tuple(found)


def _pictures_of(folder: Path) -> list[Path]:
    """Photos of the set, alone in the folder."""
    for path in write_views(folder):
        path.unlink()
    return list(folder.glob("*.png"))


def _scenes(folder: Path) -> tuple[Files, ...]:
    """Of three objects; and of one whose pose is a file, with a mask."""
    own = folder / "several"
    own.mkdir()
    data = json.loads(make_three(own).read_text())
    beside = {path.name: path.read_bytes() for path in own.iterdir() if path.suffix != ".json"}
    first = data["objects"][0]
    pose = {key: data[key] for key in ("projection", "camera")} | first["pose"]
    one = {**data, "objects": [{**first, "pose": "p.json", "mask": "three.png"}]}
    return (
        {"s.json": json.dumps(data).encode(), **beside},
        {"s.json": json.dumps(one).encode(), "p.json": json.dumps(pose).encode(), **beside},
    )


def _cameras() -> tuple[Files, ...]:
    row = b"1 OPENCV 160 120 300 290 83 58 -0.1 0.02 0.001 0.002\n2 PINHOLE 160 120 300 290 83 58\n"
    images = b"1 1 0 0 0 0 0 5 1 p.png\n1 2 -1\n2 1 0 0 0 0 0 5 2 q.png\n\n"
    binary = struct.pack("<QIiQQ8d", 1, 1, 4, 160, 120, 300, 290, 83, 58, -0.1, 0.02, 0.001, 0.002)
    matrix = [300, 0, 83, 0, 290, 58, 0, 0, 1]
    xml = (
        '<?xml version="1.0"?>\n<opencv_storage>\n<camera_matrix type_id="opencv-matrix"><rows>3'
        "</rows><cols>3</cols><dt>d</dt><data>300. 0. 83. 0. 290. 58. 0. 0. 1.</data>"
        "</camera_matrix>\n<image_width>160</image_width><image_height>120</image_height>\n"
        "</opencv_storage>\n"
    )
    return (
        {"c.yml": CALIBRATION.encode()},
        {"c.xml": xml.encode()},
        {"c.json": json.dumps({"K": matrix, "dist": [0.1, 0, 0, 0], "size": [9, 9]}).encode()},
        {"c.json": json.dumps({"1": {"cam_K": matrix, "depth_scale": 1}}).encode()},
        {"c.json": b'{"fx": 300, "fy": 290, "cx": 83, "cy": 58, "width": 160, "height": 120}'},
        {"cameras.txt": row, "images.txt": images},
        {"images.txt": images, "cameras.txt": row},
        {"cameras.bin": binary},
    )


def _formats(folder: Path, model: Path) -> Mapping[str, Reader]:
    record, found = perspective_record(), {}
    request = ConvertOptions(model=model, photo_size=None, image="3", object_id=5)
    outs = {
        "opencv": "o.yml", "matrices": "o.json", "nerfstudio": "o.json", "colmap": "", "bop": "",
        "gltf": "o.glb", "meshlab": "o.mlp",
    }  # fmt: skip
    for name, out in outs.items():
        place = folder / name
        place.mkdir()
        photo = replace(request, photo=folder / "p.png") if name == "meshlab" else request
        FORMATS[name].write(record, place / out, photo)
        files = {p.name: p.read_bytes() for p in sorted(place.iterdir())}
        asked = ConvertOptions(photo_size=(200, 150)) if name in ("bop",) else ConvertOptions()
        found[f"{name} pose"] = Reader(
            _reading_of(name, asked, bool(out)),
            tuple(
                {first: files[first], **{k: v for k, v in files.items() if k != first}}
                for first in files
            ),
        )
    return found


def _reading_of(name: str, request: ConvertOptions, is_file: bool) -> Callable[[Path], object]:
    read = FORMATS[name].read
    assert read is not None
    from poseviewer.files.checks import Reading

    def run(path: Path) -> None:
        with Reading(path, kind=f"{name} file").naming_errors():  # as `poseviewer convert` does
            read(path if is_file else path.parent, request)
        if name == "bop":
            load_bop_images(path.parent)

    return run


SYMMETRY = (
    b'{"format": "poseviewer-symmetry", "version": 1, "centre": [0, 0, 0], '
    b'"turns": [{"axis": [0, 0, 1], "fold": "any"}, {"axis": [1, 0, 0], "fold": 2}]}'
)


def _keypoints() -> bytes:
    side = {"rear_wheel": [1, 1, 0], "front_wheel": [1, -1, 0], "axle": [1, 0, 0]}
    other = {"rear_wheel": [-1, 1, 0], "front_wheel": [-1, -1, 0], "axle": [-1, 0, 0]}
    data = {"format": "poseviewer-keypoints", "version": 1, "left": side, "right": other}
    return json.dumps(data).encode()


def _autosave(folder: Path) -> bytes:
    record = PoseRecord(perspective_record().pose)
    path = save_autosave(
        folder / "sessions",
        AutosavedSession(
            Path("p.png"), "p.png", None, Path("m.ply"), "m.ply", None, record, record, {}, True,
            1.0, 1,
        ),
    )  # fmt: skip
    return path.read_bytes()


def _zip(files: Files) -> bytes:
    memory = BytesIO()
    with ZipFile(memory, "w", ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return memory.getvalue()
