"""The registration problem: its views, start and loss, and how it is made from a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import SettingsError, SingularChartError, list_names
from poseviewer.fit.compared_pixels import ViewResidual, make_view_term
from poseviewer.fit.view_choice import choose_views
from poseviewer.fit.visibility import Occlusion, make_occlusion
from poseviewer.geometry.arrays import FloatArray, freeze_array
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.charts import Chart, OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.symmetry_group import NO_SYMMETRY, Symmetry
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_chart import ViewChart
from poseviewer.losses.known_losses import LOSSES
from poseviewer.losses.loss import Loss, LossScale
from poseviewer.render.attributes import PhotoAttributes, Renderer
from poseviewer.scene.settings import ChartName, FitSettings
from poseviewer.scene.types import Scene
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints

MIN_COVERED_FRACTION = 0.6
"""Fraction of the start's pixels that a pose must cover: right poses 16 % away cover more."""


@dataclass(frozen=True, slots=True, eq=False)
class FitProblem:
    """The model, views, start and settings of a search: all that it needs but a renderer."""

    mesh: Mesh
    views: tuple[ViewResidual, ...]
    """Terms whose mean is the loss; the first view's chart names the parameters."""
    start: FloatArray
    """(d,): the chart's parameters of the start pose."""
    settings: FitSettings = field(default_factory=FitSettings)
    symmetry: Symmetry = NO_SYMMETRY
    """Poses that differ by it show the same."""
    doubt: str = ""
    """Sentence why the start may be far off, so that no verdict is ``found``."""
    free_indices: NDArray[np.intp] = field(init=False, repr=False)
    """The indices of the parameters that the search may change."""

    def __post_init__(self) -> None:
        """Check the locks.

        Raises:
            SettingsError: the settings lock an unknown parameter, or all of them.
        """
        names, lock = self.chart.names, self.settings.lock
        if unknown := sorted(set(lock) - set(names)):
            raise SettingsError(
                f"`lock={unknown[0]!r}`: the {self.chart.name} chart has no such parameter; "
                f"it has {', '.join(names)}"
            )
        free = np.flatnonzero([name not in lock for name in names])
        if not len(free):
            raise SettingsError("every parameter of the chart is locked; leave one out of `lock`")
        object.__setattr__(self, "start", freeze_array(self.start, (len(names),)))
        object.__setattr__(self, "free_indices", free)

    @property
    def photo(self) -> PhotoAttributes:
        """Attributes of the first view's photo."""
        return self.views[0].photo

    @property
    def chart(self) -> Chart:
        """Pose parameterisation in the first view."""
        return self.views[0].chart

    @property
    def loss(self) -> Loss:
        """Loss that is minimised."""
        return self.views[0].loss

    @property
    def has_occluders(self) -> bool:
        """Whether other objects can occlude the model."""
        return any(view.occlusion is not None for view in self.views)

    @property
    def by_view(self) -> tuple[FitProblem, ...]:
        """One problem for each view, with the parameters of the whole problem."""
        return tuple(replace(self, views=(view,)) for view in self.views)

    def on(self, photos: Sequence[PhotoAttributes]) -> FitProblem:
        """Return the problem on other pyramid levels, a photo for each view."""
        pairs = zip(self.views, photos, strict=True)
        return replace(self, views=tuple(replace(view, photo=photo) for view, photo in pairs))

    @property
    def worst_loss(self) -> float:
        """Loss of parameters that show nothing of the model, or give no pose."""
        return _mean([view.scale.worst for view in self.views])

    @property
    def scale(self) -> LossScale:
        """Scale of the losses."""
        return self.views[0].scale

    def poses(self, parameters: FloatArray) -> tuple[Pose, ...]:
        """Return the pose in each view at ``parameters`` (d,).

        Raises:
            OutsideChartError: they stand for no pose.
        """
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
    """Return the mean loss over the problem's views at ``parameters`` (d,).

    ``renderers`` are one for each view, or one for all.
    """
    each = renderers if isinstance(renderers, tuple) else (renderers,) * len(problem.views)
    losses = []
    for view, renderer in zip(problem.views, each, strict=True):
        try:
            pose = view.chart.to_pose(parameters)
            moments = renderer.moments(pose, view.photo)
            is_covered = moments.pixels * view.photo.factor**2 >= view.min_pixels
            losses.append(view.loss.of_moments(moments) if is_covered else view.scale.worst)
        except OutsideChartError:
            losses.append(view.scale.worst)
    return _mean(losses)


def with_min_coverage(problem: FitProblem, renderer: Renderer) -> FitProblem:
    """Give poses that cover much less than the start the worst loss.

    On the pixels that a pose covers, a few of one grey are explained better than all at the truth.
    """
    pairs = zip(problem.views, problem.poses(problem.start), strict=True)
    covered = ((view, renderer.moments(pose, view.photo).pixels) for view, pose in pairs)
    views = tuple(
        replace(view, min_pixels=MIN_COVERED_FRACTION * pixels) for view, pixels in covered
    )
    return replace(problem, views=views)


def _mean(losses: Sequence[float]) -> float:
    return sum(losses) / len(losses)


Occlusions = Mapping[int, Occlusion | None]
"""Occlusion of an object by others, by the index of the view; None where there are no others."""


def make_problem(
    scene: Scene, object_index: int = 0, view_index: int = 0, occluded: Occlusions | None = None
) -> tuple[FitProblem, tuple[str, ...]]:
    """Make the problem of fitting an object of a scene.

    Args:
        scene: scene with the object at its start.
        object_index: index of the object.
        view_index: index of the view whose chart is searched.
        occluded: occlusion in each view; by default by the other objects where they stand.

    Returns:
        The problem, and notes on the chart and on views left out.

    Raises:
        SettingsError: the settings do not go with a photo, the model or several views; no view
            shows anything of it.
        SingularChartError: the wanted chart has no parameters at the start pose.
    """
    item = scene.objects[object_index]
    settings = item.settings
    occluded = occlusions(scene, object_index, view_index) if occluded is None else occluded
    totally = [index for index, own in occluded.items() if own is not None and own.is_total]
    view_indices = [index for index in occluded if index not in totally]
    if not view_indices:
        raise SettingsError(
            "the model stands wholly behind other objects of the photo, so that nothing of it can "
            "be compared: move it or them, or leave these out"
        )
    seen = set(views_that_show(scene, object_index, view_index)) - set(totally)
    unseen = [
        view.name
        for index, view in enumerate(scene.views)
        if index not in seen and scene.in_view(object_index, index).is_compared
    ]
    notes = [f"{name} does not see the model where it starts, and is left out." for name in unseen]
    if len(unseen) > 1:
        many = f"{len(unseen)} photos do not see the model where it starts, and are left out"
        notes = [f"{many}: {list_names(unseen)}."]
    if len(view_indices) == 1:
        if scene.free_scale:
            raise SettingsError(
                f"{scene.name}: of {len(scene.views)} photos, "
                f"{scene.views[view_indices[0]].name} alone sees the model where it "
                "starts; bring the start nearer, or check the set's scale."
            )
        pose, keypoints = scene.pose(object_index, view_indices[0]), item.model.keypoints
        free = settings.free_focal, settings.free_principal_point
        chart, note = choose_chart(settings.chart, item.mesh, keypoints, pose, *free)
        charts, start = [chart], chart.from_pose(pose)
        notes += [f"the free-body chart is used: {note}."] if note else []
    else:
        charts = _view_charts(scene, object_index, view_indices)
        start = np.zeros(len(charts[0].names))
    for chosen in (settings, replace(settings, grey=True)):  # if one photo is grey, then all are
        views = tuple(
            make_view_term(
                scene, object_index, index, chosen, chart, occluded[index], len(view_indices) == 1
            )
            for index, chart in zip(view_indices, charts, strict=True)
        )
        if len({view.scale for view in views}) == 1:
            break
    problem = FitProblem(item.mesh, views, start, settings, item.symmetry, item.doubt)
    return problem, tuple(notes)


def pose_to_params(chart: Chart, pose: Pose, scale: float = 1.0) -> FloatArray:
    """Return the parameters (d,) of a pose in a chart.

    ``scale`` is the length of the model's unit in the world's.

    Raises:
        SingularChartError: the chart has none there.
    """
    is_of_view = isinstance(chart, ViewChart)
    return chart.parameters_at(pose, 1.0 / scale) if is_of_view else chart.from_pose(pose)


def with_params(
    scene: Scene, object_index: int, problem: FitProblem, parameters: FloatArray
) -> Scene:
    """Put an object of a scene at parameters of its problem, without a result.

    Args:
        scene: scene to change.
        object_index: index of the object.
        problem: problem of the object.
        parameters: (d,): parameters in the problem's chart.
    """
    chart = problem.chart
    scale = 1.0 / chart.scale_at(parameters) if isinstance(chart, ViewChart) else None
    # The first view comes last, as it has the pose; others may have focal lengths of their own.
    for view, pose in zip(problem.views[::-1], problem.poses(parameters)[::-1], strict=True):
        scene = scene.with_pose(object_index, pose, view.view_index, scale)
    return scene


def views_that_show(scene: Scene, object_index: int, view_index: int = 0) -> list[int]:
    """Return the indices of the views that are compared and show an object where it stands, of
    which ``view_index`` comes first, and is there in any case.
    """
    return [view_index] + [
        index
        for index in range(len(scene.views))
        if index != view_index
        and scene.in_view(object_index, index).is_compared
        and scene.model_at(object_index, index).is_seen
    ]


def occlusions(
    scene: Scene, object_index: int, view_index: int = 0, is_of_all: bool = False
) -> dict[int, Occlusion | None]:
    """Find the occlusion of an object by other trusted objects in each view that a search compares:
    of many that show it, in some (``choose_views``), unless it ``is_of_all``.

    The view ``view_index`` comes first, and is there in any case.
    """
    trusted = [i for i, one in enumerate(scene.objects) if i != object_index and one.is_occluder]
    shown = views_that_show(scene, object_index, view_index)
    by_view: dict[int, Occlusion | None] = {}
    for index in shown if is_of_all else choose_views(scene, object_index, shown):
        occluders = [scene.model_at(other, index) for other in trusted]
        placed = scene.model_at(object_index, index)
        by_view[index] = make_occlusion(placed, occluders) if occluders else None
    return by_view


def _view_charts(scene: Scene, object_index: int, view_indices: Sequence[int]) -> list[ViewChart]:
    """Make the chart of each of several views, about the start in the first."""
    one, first = scene.objects[object_index], scene.views[view_indices[0]]
    if one.settings.chart == "vehicle":
        raise SettingsError('`chart="vehicle"` with several photos; leave it out.')
    pixels = LOSSES[one.settings.loss].pixels
    if one.settings.pixels == "clip" != pixels[0]:
        wanted = " or ".join(name for name in pixels if name != "clip")
        raise SettingsError(f'`pixels="clip"` with several photos; take {wanted}, or leave it out.')
    reference = FreeBodyChart.near(one.mesh, scene.pose(object_index, view_indices[0]))
    scale, charts = 1.0 / one.world_from_model.scale, []
    cameras = list(dict.fromkeys(scene.views[index].camera for index in view_indices))
    focals = len(cameras) if one.settings.free_focal else 0
    principals = len(cameras) if one.settings.free_principal_point else 0
    for index in view_indices:
        view, view_from_first = scene.views[index], RigidTransform.identity()
        if not isinstance(view.camera, Perspective):
            raise SettingsError(
                f"{view.name}: parallel projection with several photos; wanted perspective cameras."
            )
        if index != view_indices[0]:
            motion = view.camera_from_world @ first.camera_from_world.inverse()
            view_from_first = RigidTransform(motion.rotation, scale * motion.translation)
        known = scene.free_scale, scale, focals, cameras.index(view.camera), principals
        charts.append(ViewChart(reference, view.camera, view_from_first, *known))
    return charts


def choose_chart(
    wanted: ChartName,
    mesh: Mesh,
    keypoints: VehicleKeypoints | None,
    pose: Pose,
    free_focal: bool = False,
    free_principal_point: bool = False,
) -> tuple[Chart, str]:
    """Choose the chart about a pose, and say why it is not the vehicle chart.

    Args:
        wanted: name of the chart; ``auto`` takes the vehicle chart where the model has key points
            and the pose is regular.
        mesh: the model.
        keypoints: wheels of the model; None: it has none.
        pose: the start pose.
        free_focal: whether the focal length is a parameter too.
        free_principal_point: whether the principal point is.

    Returns:
        The chart, and the reason; empty for the vehicle chart, and where another was wanted.

    Raises:
        SettingsError: the vehicle chart is wanted of a model without key points; the principal
            point is wanted of a parallel projection, or without the vehicle chart.
        SingularChartError: the wanted chart has no parameters at the pose.
    """
    if free_principal_point and isinstance(pose.camera, Parallel):
        raise SettingsError(
            "a parallel projection has no principal point to find; start from a perspective pose, "
            "or leave `free_principal_point` out."
        )
    reason = "the model has no wheels that poseviewer knows of"
    if wanted != "free-body" and keypoints is not None:
        try:
            return VehicleChart.near(keypoints, pose, free_focal, free_principal_point), ""
        except SingularChartError as error:
            if wanted == "vehicle":
                raise SingularChartError(f'{error}; use `chart="free-body"`') from error
            reason = str(error)
    elif wanted == "vehicle":
        raise SettingsError(
            f"{reason}; the vehicle chart needs MODEL.keypoints.json beside the model, or parts "
            'named like wheels; or use `chart="free-body"`'
        )
    if free_principal_point:
        raise SettingsError(
            "`free_principal_point` with one photo in the free-body chart: one photo of one object "
            "cannot tell it from the object's direction; take several photos, or a car's chart, or "
            "leave it out."
        )
    chart = FreeBodyChart.near(mesh, pose, free_focal)
    return chart, "" if wanted == "free-body" else reason
