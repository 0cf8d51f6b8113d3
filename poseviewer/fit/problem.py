"""The registration problem: views, charts and a start; its loss; and how a scene gives it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import SettingsError, SingularChartError
from poseviewer.fit.compared_pixels import ComparedView, compared_view
from poseviewer.fit.loss import LossScale
from poseviewer.fit.visibility import Hiding, hiding
from poseviewer.geometry.arrays import FloatArray, freeze_array
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.charts import Chart, OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.symmetry_group import NO_SYMMETRY, Symmetry
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_chart import ViewChart
from poseviewer.render.types import PhotoAttributes, Renderer
from poseviewer.scene.settings import ChartName, FitSettings
from poseviewer.scene.types import Scene
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints

MIN_COVERED_FRACTION = 0.6
"""Share of the start's pixels that a pose covers: more than starts 16 % off lack."""


@dataclass(frozen=True, slots=True, eq=False)
class FitProblem:
    """The model, views, start and settings of a search: all that it needs but a renderer."""

    mesh: Mesh
    views: tuple[ComparedView, ...]
    """The loss is their mean; the first view's chart names the parameters."""
    start: FloatArray
    """(d,): the chart's parameters of the start pose."""
    settings: FitSettings = field(default_factory=FitSettings)
    symmetry: Symmetry = NO_SYMMETRY
    """Poses that differ by it show the same."""
    free_indices: NDArray[np.intp] = field(init=False, repr=False)
    """The indices of the parameters that the search may change."""

    def __post_init__(self) -> None:
        """Raises ``SettingsError``: the settings lock a parameter that there is not, or all."""
        names, lock = self.chart.names, self.settings.lock
        if unknown := sorted(set(lock) - set(names)):
            raise SettingsError(
                f"--lock {unknown[0]}: the {self.chart.name} chart has no such number; "
                f"it has {', '.join(names)}"
            )
        free = np.flatnonzero([name not in lock for name in names])
        if not len(free):
            raise SettingsError("--lock holds every number of the chart; leave one free at least")
        object.__setattr__(self, "start", freeze_array(self.start, (len(names),)))
        object.__setattr__(self, "free_indices", free)

    @property
    def photo(self) -> PhotoAttributes:
        """The first view's."""
        return self.views[0].photo

    @property
    def chart(self) -> Chart:
        """The first view's."""
        return self.views[0].chart

    @property
    def is_structured(self) -> bool:
        """Whether classes and edges are compared."""
        return self.photo.structure is not None

    @property
    def is_among_others(self) -> bool:
        """Whether other objects can hide the model."""
        return any(view.behind is not None for view in self.views)

    @property
    def alone(self) -> tuple[FitProblem, ...]:
        """The problem on each of its views alone; the parameters are those of all."""
        return tuple(replace(self, views=(view,)) for view in self.views)

    def on(self, photos: Sequence[PhotoAttributes]) -> FitProblem:
        """The problem on another pyramid level of each view's photo."""
        pairs = zip(self.views, photos, strict=True)
        return replace(self, views=tuple(replace(view, photo=photo) for view, photo in pairs))

    @property
    def worst_loss(self) -> float:
        """The loss of parameters that show nothing of the model, or stand for no pose."""
        return _mean([LossScale.of(view.photo).worst for view in self.views])

    @property
    def scale(self) -> LossScale:
        """The scale of its losses."""
        return LossScale.of(self.photo)

    def poses(self, parameters: FloatArray) -> tuple[Pose, ...]:
        """The poses that ``parameters`` (d,) stand for in each view; raises as the charts."""
        return tuple(view.chart.to_pose(parameters) for view in self.views)

    def complete(self, free_parameters: FloatArray) -> FloatArray:
        """(..., d): the start's parameters with the free ones replaced by (..., k)."""
        parameters = np.empty((*free_parameters.shape[:-1], len(self.start)))
        parameters[...] = self.start
        parameters[..., self.free_indices] = free_parameters
        return parameters


def pose_loss(
    problem: FitProblem, renderers: Renderer | tuple[Renderer, ...], parameters: FloatArray
) -> float:
    """The loss at ``parameters`` (d,), the mean over the problem's views; ``renderers``: one for
    each view, or one for all.
    """
    each = renderers if isinstance(renderers, tuple) else (renderers,) * len(problem.views)
    losses = []
    for view, renderer in zip(problem.views, each, strict=True):
        try:
            pose = view.chart.to_pose(parameters)
            moments = renderer.moments(pose, view.photo)
            is_shown = moments.pixels * view.photo.factor**2 >= view.fewest
            losses.append(view.loss(moments) if is_shown else LossScale.of(view.photo).worst)
        except OutsideChartError:
            losses.append(LossScale.of(view.photo).worst)
    return _mean(losses)


def guarded(problem: FitProblem, renderer: Renderer) -> FitProblem:
    """The problem where poses that cover much less than the start have the worst loss.

    On the pixels that a pose covers, few of one grey are explained better than all at the truth.
    """
    pairs = zip(problem.views, problem.poses(problem.start), strict=True)
    covered = ((view, renderer.moments(pose, view.photo).pixels) for view, pose in pairs)
    views = tuple(replace(view, fewest=MIN_COVERED_FRACTION * pixels) for view, pixels in covered)
    return replace(problem, views=views)


def _mean(losses: Sequence[float]) -> float:
    return sum(losses) / len(losses)


Hidings = Mapping[int, Hiding | None]
"""Pixels that others hide of an object, by the number of the view; None where there are none."""


def make_problem(
    scene: Scene, index: int = 0, view: int = 0, hidden: Hidings | None = None
) -> tuple[FitProblem, tuple[str, ...]]:
    """The problem of fitting an object of a scene, by the chart in one ``view``; and notes on the
    chart and on views left out. ``hidden``: by default as other objects hide it where it starts.

    Raises:
        SettingsError: the settings do not go with a photo, the model or several views; no view
            shows anything of it.
        SingularChartError: the wanted chart has no parameters at the start pose.
    """
    item = scene.objects[index]
    settings = item.settings
    hidden = hidings(scene, index, view) if hidden is None else hidden
    order = [number for number, behind in hidden.items() if behind is None or not behind.is_whole]
    if not order:
        raise SettingsError(
            "the model stands wholly behind other objects of the photo, so that nothing of it can "
            "be compared: move it or them, or leave these out"
        )
    notes = [
        f"{one.name} does not see the model where it starts, and is left out."
        for number, one in enumerate(scene.views)
        if number not in order and scene.in_view(index, number).is_compared
    ]
    if len(order) == 1:
        if scene.free_scale:
            raise SettingsError(
                f"{scene.name}: of {len(scene.views)} photos, {scene.views[order[0]].name} alone "
                "sees the model where it starts; bring the start nearer, or check the set's scale "
                "(--scale)."
            )
        pose, keypoints = scene.pose(index, order[0]), item.model.keypoints
        chart, note = choose_chart(settings.chart, item.mesh, keypoints, pose, settings.free_focal)
        charts, start = [chart], chart.from_pose(pose)
        notes += [f"the free-body chart is used: {note}."] if note else []
    else:
        charts = _view_charts(scene, index, order)
        start = np.zeros(len(charts[0].names))
    for chosen in (settings, replace(settings, grey=True)):  # if one photo is grey, then all are
        views = tuple(
            compared_view(scene, index, number, chosen, chart, hidden[number], len(order) == 1)
            for number, chart in zip(order, charts, strict=True)
        )
        if len({LossScale.of(view.photo) for view in views}) == 1:
            break
    return FitProblem(item.mesh, views, start, settings, item.symmetry), tuple(notes)


def numbers_of(chart: Chart, pose: Pose, scale: float = 1.0) -> FloatArray:
    """(d,): the numbers of a pose in a chart; ``scale``: lengths of the world's unit to one of the
    model's. Raises as the chart.
    """
    is_of_view = isinstance(chart, ViewChart)
    return chart.parameters_at(pose, 1.0 / scale) if is_of_view else chart.from_pose(pose)


def moved(scene: Scene, index: int, problem: FitProblem, parameters: FloatArray) -> Scene:
    """The scene with an object at ``parameters`` (d,) of its problem, without a result."""
    chart = problem.chart
    scale = 1.0 / chart.scale_at(parameters) if isinstance(chart, ViewChart) else None
    # The first view comes last, as it has the pose; others may have focal lengths of their own.
    for view, pose in zip(problem.views[::-1], problem.poses(parameters)[::-1], strict=True):
        scene = scene.with_pose(index, pose, view.index, scale)
    return scene


def hidings(scene: Scene, index: int, view: int = 0) -> dict[int, Hiding | None]:
    """Pixels that other objects hide of one, those that stand firm, in each view that shows it;
    ``view`` comes first, and is there in any case.
    """
    firm = [i for i, one in enumerate(scene.objects) if i != index and one.is_occluder]
    hidden: dict[int, Hiding | None] = {}
    for number in sorted(range(len(scene.views)), key=lambda number: number != view):
        placed, is_wanted = scene.model_at(index, number), scene.in_view(index, number).is_compared
        if number == view or (is_wanted and placed.is_seen):
            others = [scene.model_at(other, number) for other in firm]
            hidden[number] = hiding(placed, others) if others else None
    return hidden


def _view_charts(scene: Scene, index: int, order: Sequence[int]) -> list[ViewChart]:
    """The chart of each of several views, about the start in the first."""
    one, first = scene.objects[index], scene.views[order[0]]
    if one.settings.chart == "vehicle":
        raise SettingsError("--chart vehicle with several photos; leave it out.")
    if one.settings.pixels == "clip" and one.settings.loss == "default":
        raise SettingsError(
            "--pixels clip with several photos; take near or whole, or leave it out."
        )
    reference = FreeBodyChart.near(one.mesh, scene.pose(index, order[0]))
    scale, charts = 1.0 / one.world_from_model.scale, []
    cameras = list(dict.fromkeys(scene.views[number].camera for number in order))
    focals = len(cameras) if one.settings.free_focal else 0
    for number in order:
        view, turn = scene.views[number], RigidTransform.identity()
        if not isinstance(view.camera, Perspective):
            raise SettingsError(
                f"{view.name}: parallel projection with several photos; wanted perspective cameras."
            )
        if number != order[0]:
            motion = view.camera_from_world @ first.camera_from_world.inverse()
            turn = RigidTransform(motion.rotation, scale * motion.translation)
        known = scene.free_scale, scale, focals, cameras.index(view.camera)
        charts.append(ViewChart(reference, view.camera, turn, *known))
    return charts


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
        SingularChartError: the wanted chart has no parameters at the pose.
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
