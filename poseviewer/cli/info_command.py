"""Print what poseviewer understood of a photo, a video, a model, a pose or a scene."""

from __future__ import annotations

from argparse import Action, ArgumentParser, Namespace
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from poseviewer.cli import options as table
from poseviewer.cli.case import calibration_of
from poseviewer.cli.terminal import say
from poseviewer.errors import PhotoFileError, list_names, printable

if TYPE_CHECKING:
    from poseviewer.files.cameras import Calibration
    from poseviewer.geometry.camera import Camera
    from poseviewer.geometry.image import Photo


class _CamerasHelp(Action):
    """Print the help and the readable camera formats for ``--calibration`` without a file."""

    def __call__(
        self, parser: ArgumentParser, namespace: Namespace, values: Any, *_: object
    ) -> None:
        setattr(namespace, self.dest, values)
        if values is None:
            from poseviewer.files.camera_forms import READ

            parser.print_help()
            say("\nwhat is read of cameras:")
            for tools, files, keys in READ:
                say(f"  {tools} ({files}):\n    {keys}")
            parser.exit()


CALIBRATION = table.option("--calibration FILE", table.CAMERAS, action=_CamerasHelp, nargs="?")
OPTIONS = {
    "": (
        table.option(
            "path PHOTO|VIDEO|MODEL|POSE|SCENE", "file to describe, or a folder: what it holds"
        ),
    ),
    "the photo's camera": (CALIBRATION, *table.OF_CALIBRATION),
}
EXAMPLES = ("poseviewer info car.glb", "poseviewer info photo.jpg --calibration camera.yml")


def run(options: Namespace) -> int:
    """Print what was understood of a file, by its ending; with a calibration it is a photo."""
    from poseviewer.files.mesh.load import READERS
    from poseviewer.files.photo import ENDINGS, RAW_ENDINGS
    from poseviewer.files.video import VIDEOS
    from poseviewer.opening.sources import is_scene_file

    path, calibration = options.path, calibration_of(options)
    suffix = path.suffix.lower() if calibration is None else ""
    if path.is_dir():
        _print_folder(path)
    elif suffix == ".json":
        (_print_scene if is_scene_file(path) else _print_pose)(path)
    elif suffix in READERS:
        _print_model(path)
    elif suffix in VIDEOS:
        _print_video(path)
    else:
        try:
            _print_photo(path, calibration)
        except PhotoFileError:
            if suffix not in ("", *ENDINGS, *RAW_ENDINGS) and path.is_file():
                _print_model(path)  # its error says how to open a model of this kind
            raise
    return 0


def print_camera(photo: Photo) -> None:
    """Print a photo's calibrated camera."""
    assert photo.camera is not None  # callers pass calibrated photos
    whose, distortion = "calibrated", "no distortion: the photo stays as taken"
    if photo.undistortion is not None:
        whose, lens = "of the undistorted photo", photo.undistortion.lens
        distortion = f"{lens.model}, {', '.join(f'{value:.6g}' for value in lens.coefficients)}"
    if photo.covered is not None:
        distortion += f"; the undistorted photo is black in {1.0 - photo.covered.mean():.1%}"
    _print(camera=f"{_camera(photo.camera)}, {whose}", distortion=distortion)


def _print_photo(path: Path, calibration: Calibration | None) -> None:
    from poseviewer.files.photo import load_calibrated_photo, orientation_of

    photo = load_calibrated_photo(path, calibration)
    kind = "grey" if photo.pixels.shape[2] == 1 else "colour"
    size = f"{photo.width} x {photo.height} px, {kind}, {8 * photo.pixels.itemsize} bit"
    _print(photo=photo.name, size=size)
    if photo.camera is not None and calibration is not None:
        from poseviewer.files.cameras import load_calibration

        size = photo.width, photo.height
        found, _ = load_calibration(calibration, photo.name, *size, orientation_of(path))
        _print(read=f"{found.read}, from {calibration.path.name}")
        print_camera(photo)
    else:
        source = "no focal length in the file: 50 degrees assumed"
        if photo.focal_length_35mm is not None:
            source = f"from EXIF: {photo.focal_length_35mm:g} mm on 35-mm film"
        focal = photo.default_camera().fx
        _print(camera=f"fx = fy = {focal:.1f} px, a first guess ({source})")
    _print(sha256=photo.sha256, note=photo.notes)


def _print_folder(path: Path) -> None:
    from poseviewer.opening.photo_sets import describe_folder

    if not (holds := describe_folder(path)):
        wanted = "wanted a photo, a video, a model, a COLMAP model, a BOP scene or images"
        raise PhotoFileError(f"{path}: a folder without them; {wanted}.")
    _print(folder=path.resolve().name, holds=holds)


def _print_video(path: Path) -> None:
    from poseviewer.files.video import describe_video

    _print(video=path.name, **describe_video(path))


def _print_model(path: Path) -> None:
    from poseviewer.files.keypoints import load_keypoints
    from poseviewer.files.mesh.load import load_mesh
    from poseviewer.files.mesh.size import size_words
    from poseviewer.files.symmetry import load_symmetry
    from poseviewer.scene.assets import ModelFile

    mesh = load_mesh(path)
    keypoints, said = load_keypoints(path, mesh), load_symmetry(path, mesh)
    symmetry = ModelFile.of(mesh, path, keypoints=keypoints, symmetry=said).symmetry
    source = "found from the mesh" if said is None else "from a file"
    wheels = "none known: the free-body chart is used"
    if keypoints is not None:
        wheels = f"wheelbase {keypoints.left.wheelbase:.4g}: the vehicle chart is used"
    names = [name or "(unnamed)" for name in mesh.part_names]
    reflectance = "colours of the file" if mesh.has_reflectance else "none: constant"
    if mesh.textures:
        reflectance = f"{len(mesh.textures)} texture(s)"
    _print(
        model=path.name,
        triangles=f"{len(mesh.faces):,} on {len(mesh.vertices):,} vertices",
        parts=f"{len(names)}: {list_names(names)}",
        box=f"{' to '.join(map(_vector, mesh.bounds))}, diagonal {mesh.diameter:.6g}",
        size=size_words(mesh),
        reflectance=reflectance,
        wheels=wheels,
        symmetry=f"{symmetry.words} ({source})" if symmetry.words else (),
        note=mesh.notes,
    )


def _print_scene(path: Path) -> None:
    from poseviewer.files.scene_json import load_scene

    scene = load_scene(path)
    for own in scene.views:
        size = f"{own.file.width} x {own.file.height} px"
        _print(scene=path.name, photo=f"{own.name}, {size}")
    for object_index, item in enumerate(scene.objects):
        place, result = scene.pose(object_index).camera_from_model, item.result
        word = "not judged" if not result or result.verdict is None else result.verdict.label
        at = f"{item.model.name} at {_vector(place.translation)}, {word}"
        _print(object=f"{item.id}: {at}" + (f" ({item.name})" if item.name else ""))
        if len(scene.views) > 1:
            rows = ", ".join(
                str([float(x) for x in row]) for row in item.world_from_model.as_matrix()
            )
            unit = f" ({scene.unit})" if scene.unit else ""
            _print(world=f"the frame of the photos{unit}: x_in_world = [{rows}] @ x_in_model")
    _print(note=scene.notes)


def _print_pose(path: Path) -> None:
    from poseviewer.files.pose import load_pose
    from poseviewer.files.structs import ModelReference, PhotoReference, projection_of

    record, unknown = load_pose(path), "not said"
    transform, sure = record.pose.camera_from_model, record.covariance
    photo, model = record.photo or PhotoReference(), record.model or ModelReference()
    size = f", {photo.width} x {photo.height} px" if photo.width and photo.height else ""
    distortion = "none: the camera is that of the photo as taken"
    if record.undistortion is not None:
        lens = record.undistortion.lens.model
        distortion = f"{lens}, undone: the camera is that of the undistorted photo"
    unexplained = f"{record.unexplained or 0.0:.3f} (0: all explained, 1: nothing)"
    _print(
        pose=path.name,
        photo=f"{photo.file or unknown}{size}",
        model=model.file or unknown,
        projection=projection_of(record.pose.camera),
        camera=_camera(record.pose.camera),
        distortion=distortion,
        rotation="; ".join(_vector(row) for row in transform.rotation) + " (camera_from_model)",
        translation=f"{_vector(transform.translation)} (camera_from_model)",
        unexplained=unknown if record.unexplained is None else unexplained,
        verdict=unknown if record.verdict is None else record.verdict.label,
        sure=() if sure is None else sure.words(model.unit),
        mask=record.mask or (),
        without=record.without,
        symmetry=record.turns.symmetry.words if record.turns else (),
        note=record.warnings,
    )


def _camera(camera: Camera) -> str:
    from poseviewer.files.structs import CameraNumbers

    numbers = msgspec.to_builtins(CameraNumbers.of(camera))
    shown = ", ".join(f"{name} {value:.6g}" for name, value in numbers.items())
    return f"{shown} px (pixel centres at integers)"


def _vector(values: Iterable[float]) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in values) + ")"


def _print(**entries: str | tuple[str, ...]) -> None:
    """Print ``name: value`` lines, a line for each text of a tuple."""
    for name, value in entries.items():
        for text in (value,) if isinstance(value, str) else value:
            say(f"{name + ':':13}{printable(text)}")
