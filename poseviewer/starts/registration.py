"""Photo, model and start pose from files, checked against one another."""

from __future__ import annotations

from pathlib import Path

from poseviewer.files.camera.calibration import Calibration
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo.calibrated import load_calibrated_photo, matched
from poseviewer.files.pose.file import (
    check_against,
    load_pose,
)
from poseviewer.files.writing import sha256_of
from poseviewer.fit.registration import LoadedModel, Registration


def load_model(path: str | Path) -> LoadedModel:
    """A model and its key points.

    Raises:
        PoseViewerError: one of them cannot be used.
    """
    mesh = load_mesh(path)
    return LoadedModel(mesh, Path(path).name, sha256_of(path), load_keypoints(path, mesh))


def load_registration(
    photo_path: str | Path,
    model: str | Path | LoadedModel,
    pose_path: str | Path,
    calibration: Calibration | None = None,
) -> Registration:
    """Photo, model (a file, or one that is loaded) and start, checked against one another; the
    photo undistorted, where a calibration or the pose file says by which lens it was taken.

    Raises:
        PoseViewerError: one of them cannot be used.
    """
    photo = load_calibrated_photo(photo_path, calibration)
    photo, record, notes = matched(photo, load_pose(pose_path, photo.width, photo.height))
    model = model if isinstance(model, LoadedModel) else load_model(model)
    warnings = (
        *(f"{photo.name}: {note}" for note in photo.notes),
        *(f"{model.name}: {note}" for note in model.mesh.notes),
        *record.warnings,
        *check_against(record, photo.sha256, model.sha256),
        *notes,
    )
    return Registration(
        photo, model.mesh, model.name, model.sha256, model.keypoints, record.pose, warnings
    )
