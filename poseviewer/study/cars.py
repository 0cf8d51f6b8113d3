"""Photos that are not drawn here, of cars with known poses: the bundled ones, or a folder's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from poseviewer.errors import SettingsError, SingularChartError
from poseviewer.files.demo import demo_case
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo.load import load_photo
from poseviewer.files.pose.file import load_pose
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.study.photos import Kind, StudyPhoto
from poseviewer.study.real_cases import RealCase, load_cases
from poseviewer.vehicle.chart import VehicleChart, visible_side
from poseviewer.vehicle.keypoints import VehicleKeypoints


def load_cars(kind: Kind, folder: Path | None) -> list[StudyPhoto]:
    """The photos of a kind: in a folder with ``cases.json``, those whose model is a vehicle.

    For ``photo-parallel``, those that a parallel camera can show as exactly as a fit is asked for.

    Raises:
        PoseViewerError: a file cannot be read.
        SettingsError: there is no such photo.
    """
    cases = [_bundled(kind)] if folder is None else load_cases(folder)
    found = list(_photos(kind, cases))
    if not found:
        raise SettingsError(
            f"{folder} holds no photo of a car for {kind}; leave that out of --kinds, or --cars"
        )
    return found


def _photos(kind: Kind, cases: Sequence[RealCase]) -> Iterator[StudyPhoto]:
    models: dict[Path, tuple[Mesh, VehicleKeypoints | None]] = {}
    for index, case in enumerate(cases):
        if case.mesh not in models:
            mesh = load_mesh(case.mesh)
            models[case.mesh] = mesh, load_keypoints(case.mesh, mesh)
        mesh, keypoints = models[case.mesh]
        centre = None if keypoints is None else _centre(kind, keypoints, case.truth)
        if centre is None:
            continue
        photo = StudyPhoto(
            kind, index, case.photo, case.mesh, case.truth, centre, case.accuracy_percent
        )
        error = pose_error(mesh, centre, case.truth)
        if photo.is_found(error.reprojection_px, error.percent):
            yield photo


def _centre(kind: Kind, keypoints: VehicleKeypoints, truth: Pose) -> Pose | None:
    """The true pose as the kind's camera shows it; None where the car is seen head-on, or the kind
    wants perspective, and there is none.
    """
    camera = truth.camera
    side = visible_side(keypoints, truth)
    try:
        if kind == "photo-perspective" or isinstance(camera, Parallel):
            VehicleChart.near(keypoints, truth)
            is_right = isinstance(camera, Perspective) == (kind == "photo-perspective")
            return truth if is_right else None
        depth = float(truth.camera_from_model.apply(side.rear_wheel)[2])
        flat = Parallel(1.0, camera.cx, camera.cy, camera.width, camera.height)
        chart = VehicleChart(side, flat, depth=depth)
        return chart.to_pose(chart.from_pose(truth))
    except (SingularChartError, OutsideChartError):
        return None


def _bundled(kind: Kind) -> RealCase:
    """One of the path-traced photos of the demo."""
    name = kind.removeprefix("photo-")
    case = demo_case(name)
    photo = load_photo(case.photo)
    truth = load_pose(case.truth, photo.width, photo.height).pose
    return RealCase(name, "demo", case.photo, case.model, truth, 0.0)
