"""Which chart suits a model and a pose."""

from __future__ import annotations

from poseviewer.errors import SettingsError, SingularChartError
from poseviewer.fit.settings import ChartName
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import Chart
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.keypoints import VehicleKeypoints


def choose_chart(
    wanted: ChartName,
    mesh: Mesh,
    keypoints: VehicleKeypoints | None,
    pose: Pose,
    free_focal: bool = False,
) -> tuple[Chart, str]:
    """The chart about ``pose``, and why it is not the vehicle chart where it is not (or "").

    ``auto`` takes the vehicle chart where the model has key points and the pose is regular.

    Raises:
        SettingsError: the vehicle chart is wanted of a model without key points.
        SingularChartError: the wanted chart has no numbers at the pose.
    """
    reason = "the model has no wheels that poseviewer knows of"
    if wanted != "free-body" and keypoints is not None:
        try:
            return VehicleChart.near(keypoints, pose, free_focal), ""
        except SingularChartError as error:
            if wanted == "vehicle":
                raise SingularChartError(f"{error}; use --chart free-body") from error
            reason = str(error)
    elif wanted == "vehicle":
        raise SettingsError(
            f"{reason}; the vehicle chart needs MODEL.keypoints.json beside the model, or parts "
            f"named like wheels; or use --chart free-body"
        )
    chart = FreeBodyChart.near(mesh, pose, free_focal)
    return chart, "" if wanted == "free-body" else reason
