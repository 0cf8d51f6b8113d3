"""Results and files in words, for the command line."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.confidence.identify import Ranked
from poseviewer.files.camera.calibration import Calibration
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.mesh.load import READERS, load_mesh
from poseviewer.files.photo.calibrated import load_calibrated_photo
from poseviewer.files.pose.file import PoseRecord, load_pose, record_as_json
from poseviewer.fit.problem import FitProgress
from poseviewer.fit.verdict import Verdict
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.frames import camera_as_integer_centres
from poseviewer.geometry.photo import Photo


def fit_result(progress: FitProgress) -> str:
    """How a fit ended, in three lines, and the verdict."""
    text = (
        f"{progress.status.value}\n"
        f"loss: {progress.loss:.6f} (start {progress.start_loss:.6f})\n"
        f"{progress.evaluations} evaluations, {progress.restart} restarts, "
        f"{progress.seconds:.1f} s"
    )
    return text if progress.verdict is None else f"{text}\n{verdict(progress.verdict)}"


def verdict(found: Verdict) -> str:
    """The verdict, and its reasons, a line each."""
    lines = [f"verdict: {found.word} ({found.probability:.0%} of such fits are right)"]
    return "\n".join([*lines, *(f"  {reason}" for reason in found.reasons)])


def batch_result(rows: int, failed: Sequence[bool], stopped: bool) -> str:
    """How a batch of so many ``rows`` ended; ``failed`` says it of each that came to an end."""
    count = sum(failed)
    text = f"{len(failed) - count} of {rows} rows fitted, {count} failed"
    return f"{text}; stopped, run it again to go on" if stopped else text


def ranking(ranked: Sequence[Ranked]) -> str:
    """Models in their order, a line each, and how clear the first one's place is."""
    width = max(len(one.candidate.name) for one in ranked)
    lines = [f"{'':3}{'model':{width}}  {'loss':>8}  {'margin':>8}  {'start':>8}"]
    for one in ranked:
        found = one.candidate
        margin = "" if one.margin is None else f"{one.margin:+.4f}"
        lines.append(
            f"{one.rank:<3}{found.name:{width}}  {found.loss:8.5f}  {margin:>8}  "
            f"{found.start_loss:8.5f}"
        )
    lines.append("margin: how much greater the next model's loss is, over the same pixels")
    return "\n".join(lines)


def ranking_as_json(ranked: Sequence[Ranked]) -> list[dict[str, Any]]:
    """Rank, name, losses, margin and pose (OpenCV axes) of each model."""
    return [
        {
            "rank": one.rank,
            "model": one.candidate.name,
            "loss": one.candidate.loss,
            "start_loss": one.candidate.start_loss,
            "margin": one.margin,
            "status": one.candidate.status,
            **_placing(record_as_json(PoseRecord(one.candidate.pose))),
        }
        for one in ranked
    ]


def _placing(pose: dict[str, Any]) -> dict[str, Any]:
    return {key: pose[key] for key in ("projection", "camera", "camera_from_model")}


def file(path: Path, calibration: Calibration | None = None) -> str:
    """What was understood of a photo, a model or a pose file, told apart by its ending; of a photo
    with a calibration, what it is undistorted.

    Raises:
        PoseViewerError: it cannot be used as what its ending says.
    """
    if calibration is not None:
        return _photo_file(path, calibration)
    if path.suffix.lower() == ".json":
        return _pose_file(path)
    if path.suffix.lower() in READERS:
        return _model_file(path)
    return _photo_file(path)


def camera_of(photo: Photo) -> str:
    """A photo's calibrated camera, in a line or two.

    Raises:
        ValueError: it has none.
    """
    if photo.camera is None:
        raise ValueError("no calibrated camera")
    undistortion = photo.undistortion
    lens = "no distortion: the photo stays as taken"
    if undistortion is not None:
        found = undistortion.lens
        lens = f"{found.model}, {', '.join(f'{value:.6g}' for value in found.coefficients)}"
    if photo.covered is not None:
        lens += f"; the undistorted photo is black in {1.0 - photo.covered.mean():.1%}"
    of = "calibrated" if undistortion is None else "of the undistorted photo"
    return _lines(camera=f"{_intrinsics(photo.camera)}, {of}", distortion=lens)


def _intrinsics(camera: Perspective) -> str:
    shifted = camera_as_integer_centres(camera)
    return (
        f"fx {shifted.fx:.6g}, fy {shifted.fy:.6g}, cx {shifted.cx:.6g}, cy {shifted.cy:.6g} px "
        "(pixel centres at integers)"
    )


def _photo_file(path: Path, calibration: Calibration | None = None) -> str:
    photo = load_calibrated_photo(path, calibration)
    camera = photo.default_camera()
    source = "no focal length in the file: 50 degrees assumed"
    if photo.focal_length_35mm is not None:
        source = f"from EXIF: {photo.focal_length_35mm:g} mm on 35-mm film"
    kind = "grey" if photo.pixels.shape[2] == 1 else "colour"
    size = f"{photo.width} x {photo.height} px, {kind}, {8 * photo.pixels.itemsize} bit"
    guess = _lines(camera=f"fx = fy = {camera.fx:.1f} px, a first guess ({source})")
    seen_by = guess if photo.camera is None else camera_of(photo)
    head = _lines(photo=photo.name, size=size)
    rest = _lines(
        sha256=photo.sha256,
        note=photo.notes,
    )
    return f"{head}\n{seen_by}\n{rest}"


def _model_file(path: Path) -> str:
    mesh = load_mesh(path)
    keypoints = load_keypoints(path, mesh)
    low, high = mesh.bounds
    wheels = "none known: the free-body chart is used"
    if keypoints is not None:
        wheels = f"wheelbase {keypoints.left.wheelbase:.4g}: the vehicle chart is used"
    if mesh.textures:
        reflectance = f"{len(mesh.textures)} texture(s)"
    else:
        reflectance = "colours of the file" if mesh.has_reflectance else "none: constant"
    return _lines(
        model=path.name,
        triangles=f"{len(mesh.faces):,} on {len(mesh.vertices):,} vertices",
        parts=f"{len(mesh.part_names)}: {_some(mesh.part_names)}",
        box=f"{_vector(low)} to {_vector(high)}, diagonal {mesh.diameter:.6g}",
        unit=mesh.unit or "not said in the file",
        reflectance=reflectance,
        wheels=wheels,
        note=mesh.notes,
    )


def _pose_file(path: Path) -> str:
    size = _recorded_size(path)
    record = load_pose(path, *(size or (1, 1)))
    camera = camera_as_integer_centres(record.pose.camera)
    transform = record.pose.camera_from_model
    perspective = isinstance(camera, Perspective)
    lens = f"fx {camera.fx:.6g}, fy {camera.fy:.6g}" if perspective else f"scale {camera.scale:.6g}"
    return _lines(
        pose=path.name,
        photo=_photo_of(record),
        model=(record.model.file if record.model else None) or "not said",
        projection="perspective" if perspective else "parallel",
        camera=f"{lens}, cx {camera.cx:.6g}, cy {camera.cy:.6g} px (pixel centres at integers)",
        distortion=_distortion_of(record),
        rotation="; ".join(_vector(row) for row in transform.rotation) + " (camera_from_model)",
        translation=f"{_vector(transform.translation)} (camera_from_model)",
        chart=_chart_of(record),
        loss="not said" if record.loss is None else f"{record.loss:.6f}",
        verdict="not said" if record.verdict is None else record.verdict.word,
        note=record.warnings,
    )


def _recorded_size(path: Path) -> tuple[int, int] | None:
    """Width and height if the file says them rightly; what is wrong, ``load_pose`` says."""
    try:
        photo = json.loads(path.read_bytes())["photo"]
        width, height = photo["width"], photo["height"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return (width, height) if isinstance(width, int) and isinstance(height, int) else None


def _photo_of(record: PoseRecord) -> str:
    photo = record.photo
    if photo is None:
        return "not said"
    size = f", {photo.width} x {photo.height} px" if photo.width and photo.height else ""
    return (photo.file or "not said") + size


def _distortion_of(record: PoseRecord) -> str:
    if record.undistortion is None:
        return "none: the camera is that of the photo as taken"
    lens = record.undistortion.lens
    return f"{lens.model}, undone: the camera is that of the undistorted photo"


def _chart_of(record: PoseRecord) -> str:
    if record.chart is None:
        return "not said"
    pairs = zip(record.chart.names, record.chart.parameters, strict=True)
    return f"{record.chart.name}: " + ", ".join(f"{name} {value:.5f}" for name, value in pairs)


def _some(names: tuple[str, ...], most: int = 8) -> str:
    shown = ", ".join(name or "(unnamed)" for name in names[:most])
    return shown + (f", ... ({len(names) - most} more)" if len(names) > most else "")


def _vector(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in values) + ")"


def _lines(**entries: str | tuple[str, ...]) -> str:
    """``name: value``, a line each; a tuple gives a line for each of its texts."""
    pairs = [
        (name, text)
        for name, value in entries.items()
        for text in ((value,) if isinstance(value, str) else value)
    ]
    return "\n".join(f"{name + ':':13}{text}" for name, text in pairs)
