"""A pose in all views of a large set, one after the other.

Each view alone has a minimum of its loss beside the pose, and a curvature there. Of the sum of
these quadratic models the minimum is the pose by all views. How far from it the minimum of a view
lies, in its photo, is the view's residual, which tells a wrong camera, a rolling shutter or blur.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace

import numpy as np
from msgspec import structs

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.confidence.verdict import LABELS, Features, Verdict, judge
from poseviewer.errors import PoseViewerError, list_names
from poseviewer.fit.covariance import find_covariance
from poseviewer.fit.judge import gather_features
from poseviewer.fit.probing import Probe
from poseviewer.fit.problem import make_problem, pose_loss
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.mesh import hull_points
from poseviewer.losses.loss import LossScale
from poseviewer.render.attributes import Renderer
from poseviewer.render.pool import RendererPool
from poseviewer.scene.types import Scene

ROBUST_ROUNDS = 10
"""Rounds of robust weights: they hardly change after five."""
APART_SHARE = 0.02
"""Residual, by the model's size in the photo, from which a view may not go with the others: poses
as far off are wrong."""
APART_FACTOR = 3.0
"""Residual over the views' median from which it does not: others share what the model lacks."""
WHY_APART = (
    "something may hide it there, its camera may be wrong, or something moved while it was taken"
)
PINV = 1e-12
"""Share of the largest eigenvalue below which one stands for none: along equal poses."""


@dataclass(frozen=True, slots=True, eq=False)
class SurveyedView:
    """Result of a pose in a view alone."""

    view_index: int
    loss: float
    """Loss of the pose in this view."""
    scale: LossScale
    verdict: Verdict
    covariance: PoseCovariance | None
    """Distribution of poses by this view, in it, about the minimum of its loss; None: not known."""
    residual_px: float | None = None
    """Root mean square distance of the model's outer points in the photo, px, at the minimum from
    those at the pose by all views; None: not known."""


def survey(
    scene: Scene,
    object_index: int,
    view_indices: Sequence[int],
    probed: Features | None,
    renderer: Renderer,
    threads: int = 1,
) -> Iterator[SurveyedView]:
    """Look at the pose of an object in views, whose photos are read and forgotten one by one.

    Args:
        scene: scene with the object at the pose.
        object_index: index of the object.
        view_indices: indices of the views.
        probed: features of the pose by some views together, for the losses of poses elsewhere.
        renderer: renderer of the object.
        threads: number of threads, which look at a photo each, unless a GPU renders.
    """

    def look(own: Renderer, index: int) -> SurveyedView:
        one = _alone(scene, object_index, index)
        problem, pose = make_problem(one, object_index)[0], one.pose(object_index)
        loss, covariance = pose_loss(problem, own, problem.start), None
        with closing(Probe(problem, own, pose)) as probe:
            features, _ = gather_features(probe, probed)
        unknown = PoseViewerError, OutsideChartError, np.linalg.LinAlgError
        if features is not None:
            with suppress(*unknown), closing(Probe(problem, own, pose, is_fine=True)) as probe:
                covariance = find_covariance(probe, features.seen, is_at_minimum=True)
        return SurveyedView(index, loss, problem.scale, judge(features), covariance)

    def look_or_none(own: Renderer, index: int) -> SurveyedView | None:
        with suppress(PoseViewerError):  # hidden there by others, or the photo cannot be read
            return look(own, index)
        return None

    if renderer.callers:  # a GPU takes the poses of one photo at once
        looks = (look_or_none(renderer, index) for index in view_indices)
        yield from filter(None, looks)
        return
    with RendererPool(renderer, threads) as pool:  # photos, not their poses, are shared out
        yield from filter(None, pool.map(look_or_none, view_indices, at_a_time=1))


def _alone(scene: Scene, object_index: int, view_index: int) -> Scene:
    """The scene of one view, whose photo is not kept."""
    view, objects = scene.views[view_index], []
    for number, item in enumerate(scene.objects):
        settings = item.settings
        if number == object_index:
            settings = replace(settings, free_focal=False, free_principal_point=False, lock=())
        own = scene.in_view(number, view_index)
        objects.append(replace(item, settings=settings, in_views=(own,)))
    views = (replace(view, file=replace(view.file)),)
    return replace(scene, views=views, objects=tuple(objects), free_scale=False)


def join(
    scene: Scene, object_index: int, views: Sequence[SurveyedView], first: int
) -> tuple[Pose, float]:
    """Find the pose of an object by all views: the minimum of the sum of their quadratic models.

    Views count by Cauchy's weights, so that wrong cameras hardly do.

    Args:
        scene: scene with the object at the pose that was surveyed.
        object_index: index of the object.
        views: what each view says.
        first: index of the view that the pose is returned in.

    Returns:
        The pose in that view, and the length of the model's unit in the world's.
    """
    item, world_from_first = scene.objects[object_index], scene.views[first].camera_from_world
    world_from_first, scale = world_from_first.inverse(), item.world_from_model.scale
    size, terms = 7 if scene.free_scale else 6, []
    for view in views:
        if view.covariance is None:
            continue
        here = _at(scene, object_index, view.view_index)
        motion = scene.views[view.view_index].camera_from_world @ world_from_first
        jacobian = np.zeros((6, size))
        jacobian[:3, :3] = jacobian[3:, 3:6] = motion.rotation
        if scene.free_scale:  # a larger model is nearer to this camera
            jacobian[3:, 6] = -motion.translation / scale
        units = here.scales
        inverse = np.linalg.pinv(view.covariance.matrix / np.outer(units, units), PINV)
        off = here.deviation(view.covariance.pose) / units
        terms.append((jacobian / units[:, None], inverse, off))
    step, origin = np.zeros(size), _at(scene, object_index, first)
    units = np.append(origin.scales, np.ones(size - 6))
    for _ in range(ROBUST_ROUNDS if terms else 0):
        left = [off - jacobian @ step for jacobian, _, off in terms]
        squares = np.array(
            [d @ inverse @ d for d, (_, inverse, _) in zip(left, terms, strict=True)]
        )
        weights = 1.0 / (1.0 + squares / max(float(np.median(squares)), PINV))
        both = [
            (w * j.T @ inverse, j, off) for w, (j, inverse, off) in zip(weights, terms, strict=True)
        ]
        total = sum(half @ j for half, j, _ in both) * np.outer(units, units)
        step = units * (
            np.linalg.pinv(total, PINV) @ (units * sum(half @ off for half, _, off in both))
        )
    longer = math.exp(step[6]) if scene.free_scale else 1.0
    return origin.pose_at(step[:6]), scale * longer


def with_residuals(
    scene: Scene, object_index: int, views: Sequence[SurveyedView]
) -> list[SurveyedView]:
    """Add each view's residual at the pose by all views, the ``scene``'s. A view that lies far off,
    and farther than the others, is at most doubtful.
    """
    points, sizes, residuals = hull_points(scene.objects[object_index].mesh), [], []
    for view in views:
        here = scene.pose(object_index, view.view_index).project(points)
        own = np.nan if view.covariance is None else view.covariance.pose.project(points)
        residuals.append(float(np.sqrt(np.mean(np.sum((own - here) ** 2, axis=1)))))
        sizes.append(float(np.linalg.norm(np.ptp(here, axis=0))))
    typical = float(np.nanmedian([*residuals, np.inf]))
    judged = list[SurveyedView]()
    for view, residual, size in zip(views, residuals, sizes, strict=True):
        verdict = view.verdict
        if residual > max(APART_SHARE * size, APART_FACTOR * typical):
            reason = f"By this photo alone it would be {residual:.0f} px off: {WHY_APART}."
            label = min("doubtful", verdict.label, key=LABELS.index)
            verdict = structs.replace(verdict, label=label, reasons=(reason, *verdict.reasons))
        px = residual if math.isfinite(residual) else None
        judged.append(replace(view, verdict=verdict, residual_px=px))
    return judged


def apart_note(scene: Scene, views: Sequence[SurveyedView]) -> str:
    """Name the views that do not go with the others; "": all do."""
    names = [
        f"{scene.views[view.view_index].name} ({view.residual_px:.0f} px)"
        for view in sorted(views, key=lambda view: -(view.residual_px or 0.0))
        if view.verdict.reasons and WHY_APART in view.verdict.reasons[0]
    ]
    do = "does" if len(names) == 1 else "do"
    count = f"{len(names)} of {len(views)} photos {do} not go with the others"
    return f"{count}: {list_names(names)}; {WHY_APART}." if names else ""


def _at(scene: Scene, object_index: int, view_index: int) -> PoseCovariance:
    """A distribution of no extent about an object's pose in a view."""
    centre = scene.objects[object_index].mesh.centre
    return PoseCovariance(scene.pose(object_index, view_index), centre, np.zeros((6, 6)))
