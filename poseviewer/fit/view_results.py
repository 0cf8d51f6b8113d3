"""Results of a search in each of its views alone."""

from collections.abc import Iterator
from dataclasses import dataclass

from poseviewer.confidence.verdict import Verdict
from poseviewer.fit.problem import pose_loss
from poseviewer.fit.progress import FitProgress
from poseviewer.geometry.camera import Pose
from poseviewer.losses.loss import LossScale
from poseviewer.render.attributes import Renderer
from poseviewer.scene.types import Scene, View


@dataclass(frozen=True, slots=True, eq=False)
class ViewResult:
    """Result of an object in one view alone."""

    view: View
    pose: Pose
    loss: float
    scale: LossScale
    verdict: Verdict | None
    visible_fraction: float | None
    """Fraction of the object's pixels that count; None: it is not known."""


def results_by_view(
    scene: Scene, object_index: int, end: FitProgress, renderer: Renderer
) -> Iterator[ViewResult]:
    """Evaluate the end of a search for an object in each compared view alone.

    Args:
        scene: scene with the object's result.
        object_index: index of the object.
        end: last progress of the search.
        renderer: renderer of the object.
    """
    for view in end.surveyed:  # all, while the search has compared some
        pose, seen = scene.pose(object_index, view.view_index), view.verdict.features.get("seen")
        known = view.loss, view.scale, view.verdict, seen
        yield ViewResult(scene.views[view.view_index], pose, *known)
    if end.surveyed:
        return
    result = scene.objects[object_index].result
    problems, verdicts = end.problem.by_view, () if end.verdict is None else end.verdict.views
    for problem, verdict in zip(problems, verdicts or [end.verdict] * len(problems), strict=True):
        view, pose = problem.views[0].view_index, problem.chart.to_pose(end.parameters)
        loss = pose_loss(problem, renderer, end.parameters)
        visible = result.seen[view] if result is not None and result.seen else None
        yield ViewResult(scene.views[view], pose, loss, problem.scale, verdict, visible)
