"""The registration problem on several photos whose cameras know their poses to one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from poseviewer.errors import SettingsError
from poseviewer.fit.problem import FitProblem, OtherView, compared_photos, free_numbers
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.fit.unexplained import LossScale
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_chart import ViewChart


def view_charts(
    views: Sequence[Registration], free_size: bool, scale: float = 1.0
) -> tuple[ViewChart, ...]:
    """The chart of each of several views, the reference first; ``scale``: of the set, by which
    their starts are one pose.

    Raises:
        SingularChartError: the model's centre is behind the reference camera.
    """
    first = views[0]
    reference = FreeBodyChart.near(first.mesh, first.start)
    charts = []
    for view in views:
        camera = view.start.camera
        assert isinstance(camera, Perspective)  # the views of a set are
        turn = view.start.camera_from_model @ first.start.camera_from_model.inverse()
        if view is first:
            turn = RigidTransform.identity()
        charts.append(ViewChart(reference, camera, turn, free_size, scale))
    return tuple(charts)


def make_set_problem(
    views: Sequence[Registration], settings: FitSettings, free_size: bool, scale: float = 1.0
) -> FitProblem:
    """The problem of fitting one model to all ``views``, the reference first: their starts are one
    pose in the set's frame, and so tell how the cameras stand. ``free_size``: how far apart they
    are, in the model's unit, is to be found as well; at the start they are by ``scale``.

    Raises:
        SettingsError: the settings do not go with a photo, or with several.
        SingularChartError: the model's centre is behind the reference camera.
    """
    if settings.free_focal or settings.chart == "vehicle":
        asked = "--free-focal" if settings.free_focal else "--chart vehicle"
        raise SettingsError(f"{asked} with several photos, whose cameras are known; leave it out.")
    if settings.pixels == "clip" and settings.method == "default":
        raise SettingsError(
            "--pixels clip with several photos; take near or whole, or leave it out."
        )
    charts = view_charts(views, free_size, scale)
    free = free_numbers(charts[0], settings)
    found = [compared_photos(view, settings) for view in views]
    if len({LossScale.of(photo) for photo, _, _ in found}) > 1:  # one is grey: then all are
        return make_set_problem(views, replace(settings, grey=True), free_size, scale)
    # Several photos tell the pose more exactly than one: a search of them ends with models of less
    # reach, as on finer photos, even where these are no finer.
    is_refined = found[0][0].structure is not None
    fine = [make() if is_refined else None for _, make, _ in found]
    others = zip(found[1:], fine[1:], charts[1:], strict=True)
    return FitProblem(
        found[0][0],
        charts[0],
        np.zeros(len(charts[0].names)),
        free,
        settings.options,
        settings.limits,
        settings.seed,
        settings.method,
        fine[0],
        symmetry=views[0].symmetry,
        others=tuple(OtherView(photo, finer, chart) for (photo, _, _), finer, chart in others),
        keep_start=settings.keep_start,
    )
