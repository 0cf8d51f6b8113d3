"""Say what poseviewer understood of a photo, a model, a pose or a scene."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli.case import calibration_of
from poseviewer.cli.options import CAMERA, option
from poseviewer.cli.terminal import say
from poseviewer.errors import printable

if TYPE_CHECKING:
    from poseviewer.files.cameras import Calibration
    from poseviewer.geometry.image import Photo


OPTIONS = {"": (option("path PHOTO|MODEL|POSE|SCENE"),), **CAMERA}


def run(options: Namespace) -> int:
    """Print what was understood of a file, by its ending; with a calibration it is a photo."""
    from poseviewer.files.file_set import is_scene_file
    from poseviewer.files.mesh.load import READERS

    path, calibration = options.path, calibration_of(options)
    if calibration is None and path.suffix.lower() == ".json":
        if is_scene_file(path):
            _print_scene(path)
        else:
            _print_pose(path)
    elif calibration is None and path.suffix.lower() in READERS:
        _print_model(path)
    else:
        _print_photo(path, calibration)
    return 0


def print_camera(photo: Photo) -> None:
    """A photo's calibrated camera."""
    from poseviewer.geometry.frames import camera_as_integer_centres

    assert photo.camera is not None  # asked for calibrated photos alone
    camera, undistortion = camera_as_integer_centres(photo.camera), photo.undistortion
    whose, lens = "calibrated", "no distortion: the photo stays as taken"
    if undistortion is not None:
        whose, found = "of the undistorted photo", undistortion.lens
        lens = f"{found.model}, {', '.join(f'{value:.6g}' for value in found.coefficients)}"
    if photo.covered is not None:
        lens += f"; the undistorted photo is black in {1.0 - photo.covered.mean():.1%}"
    _print(
        camera=f"fx {camera.fx:.6g}, fy {camera.fy:.6g}, cx {camera.cx:.6g}, cy {camera.cy:.6g} px "
        f"(pixel centres at integers), {whose}",
        distortion=lens,
    )


def _print_photo(path: Path, calibration: Calibration | None) -> None:
    from poseviewer.files.photo import load_calibrated_photo

    photo = load_calibrated_photo(path, calibration)
    kind = "grey" if photo.pixels.shape[2] == 1 else "colour"
    size = f"{photo.width} x {photo.height} px, {kind}, {8 * photo.pixels.itemsize} bit"
    _print(photo=photo.name, size=size)
    if photo.camera is not None:
        print_camera(photo)
    else:
        source = "no focal length in the file: 50 degrees assumed"
        if photo.focal_length_35mm is not None:
            source = f"from EXIF: {photo.focal_length_35mm:g} mm on 35-mm film"
        focal = photo.default_camera().fx
        _print(camera=f"fx = fy = {focal:.1f} px, a first guess ({source})")
    _print(sha256=photo.sha256, note=photo.notes)


def _print_model(path: Path) -> None:
    from poseviewer.files.keypoints import load_keypoints
    from poseviewer.files.mesh.load import load_mesh
    from poseviewer.files.symmetry import load_symmetry

    mesh = load_mesh(path)
    keypoints = load_keypoints(path, mesh)
    low, high = mesh.bounds
    wheels = "none known: the free-body chart is used"
    if keypoints is not None:
        wheels = f"wheelbase {keypoints.left.wheelbase:.4g}: the vehicle chart is used"
    names = [name or "(unnamed)" for name in mesh.part_names]
    more = [f"... ({len(names) - 8} more)"] if len(names) > 8 else []
    reflectance = "colours of the file" if mesh.has_reflectance else "none: constant"
    if mesh.textures:
        reflectance = f"{len(mesh.textures)} texture(s)"
    symmetry = load_symmetry(path, mesh)
    _print(
        model=path.name,
        triangles=f"{len(mesh.faces):,} on {len(mesh.vertices):,} vertices",
        parts=f"{len(names)}: {', '.join(names[:8] + more)}",
        box=f"{_vector(low)} to {_vector(high)}, diagonal {mesh.diameter:.6g}",
        unit=mesh.unit or "not said in the file",
        reflectance=reflectance,
        wheels=wheels,
        symmetry=f"{symmetry.words} (from a file)" if symmetry.words else (),
        note=mesh.notes,
    )


def _print_scene(path: Path) -> None:
    from poseviewer.files.scene_file import load_scene

    scene = load_scene(path)
    for own in scene.views:
        size = f"{own.photo.width} x {own.photo.height} px"
        _print(scene=path.name, photo=f"{own.path.name}, {size}")
    for index, one in enumerate(scene.objects):
        record = scene.pose_record(index)
        place = record.pose.camera_from_model
        word = "not judged" if record.verdict is None else record.verdict.word
        at = f"{one.path.name} at {_vector(place.translation)}, {word}"
        _print(object=f"{one.id}: {at}" + (f" ({one.name})" if one.name else ""))
        if len(scene.views) > 1:
            rows = ", ".join(str([float(x) for x in row]) for row in one.place.similarity.matrix)
            unit = f" ({scene.unit})" if scene.unit else ""
            _print(world=f"the frame of the photos{unit}: x_in_world = [{rows}] @ x_in_model")
    _print(note=scene.warnings)


def _print_pose(path: Path) -> None:
    from poseviewer.files.pose import load_pose
    from poseviewer.files.scene_file import scene_of_pose
    from poseviewer.geometry.camera import Perspective
    from poseviewer.geometry.frames import camera_as_integer_centres

    record = load_pose(path)
    camera = camera_as_integer_centres(record.pose.camera)
    transform = record.pose.camera_from_model
    kind = "perspective" if isinstance(camera, Perspective) else "parallel"
    scales = ("fx", "fy") if isinstance(camera, Perspective) else ("scale",)
    scale = ", ".join(f"{name} {getattr(camera, name):.6g}" for name in scales)
    photo = (record.photo.file if record.photo else None) or "not said"
    if record.photo and record.photo.width and record.photo.height:
        photo += f", {record.photo.width} x {record.photo.height} px"
    distortion = "none: the camera is that of the photo as taken"
    if record.undistortion is not None:
        model = record.undistortion.lens.model
        distortion = f"{model}, undone: the camera is that of the undistorted photo"
    count, sure = len(scene_of_pose(path, record).views), record.covariance
    unexplained = "not said"
    if record.unexplained is not None:
        unexplained = f"{record.unexplained:.3f} (0: all explained, 1: nothing)"
    _print(
        pose=path.name,
        photo=photo,
        model=(record.model.file if record.model else None) or "not said",
        projection=kind,
        camera=f"{scale}, cx {camera.cx:.6g}, cy {camera.cy:.6g} px (pixel centres at integers)",
        distortion=distortion,
        rotation="; ".join(_vector(row) for row in transform.rotation) + " (camera_from_model)",
        translation=f"{_vector(transform.translation)} (camera_from_model)",
        unexplained=unexplained,
        verdict="not said" if record.verdict is None else record.verdict.word,
        sure=() if sure is None else sure.words(record.model and record.model.unit),
        mask=record.mask or (),
        without=record.without,
        set=f"one of {count} photos" if record.in_set else (),
        symmetry=record.symmetry.words or (),
        note=record.warnings,
    )


def _vector(values: Iterable[float]) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in values) + ")"


def _print(**entries: str | tuple[str, ...]) -> None:
    """``name: value``, a line each; a tuple gives a line for each of its texts."""
    for name, value in entries.items():
        for text in (value,) if isinstance(value, str) else value:
            say(f"{name + ':':13}{printable(text)}")
