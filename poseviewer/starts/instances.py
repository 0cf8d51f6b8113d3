"""Several instances of one model in a photo, each searched for beside those that are placed."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from poseviewer.errors import QuickStartError
from poseviewer.fit.visibility import NOTHING, depth_image, visibility
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mask import Mask
from poseviewer.render.types import Renderer
from poseviewer.scene.types import PlacedModel, Scene
from poseviewer.starts.automatic import (
    BeginThread,
    PoseHypothesis,
    StartQuery,
    best_start,
    propose,
)
from poseviewer.starts.loading import Start

MAX_SHARED_FRACTION = 0.3
"""Share of the smaller one's pixels that two instances may share: one may occlude another."""


def propose_beside(
    query: StartQuery,
    placed: Sequence[PlacedModel],
    renderer: Renderer,
    begin: BeginThread | None = None,
    watch: Callable[[], object] = lambda: None,
) -> list[PoseHypothesis]:
    """Propose starts as ``propose``, which may be none, where no ``placed`` instance is.

    Args:
        query: the photo, the model and where to search.
        placed: instances with their poses.
        renderer: of the model.
        begin: called by each thread first.
        watch: called in each step; it may raise to stop the search.
    """
    hypotheses = propose(_without_placed(query, placed), renderer, begin, watch)
    return [hypothesis for hypothesis in hypotheses if _is_free(hypothesis.pose, placed)]


def find_instances(
    query: StartQuery, count: int, renderer: Renderer, watch: Callable[[], object]
) -> list[Start]:
    """Find starts of up to ``count`` instances, the likeliest first; raises as ``propose``.

    Args:
        query: the photo, the model and where to search.
        count: of instances.
        renderer: of the model.
        watch: called in each step; it may raise to stop the search.
    """
    hypotheses, starts = propose(query, renderer, watch=watch), list[Start]()
    while len(starts) < count:
        placed = [PlacedModel(query.inputs.mesh, start.pose) for start in starts]
        rest = [hypothesis for hypothesis in hypotheses if _is_free(hypothesis.pose, placed)]
        with suppress(QuickStartError):
            rest = rest or propose_beside(query, placed, renderer, watch=watch)
        start = best_start(_without_placed(query, placed), rest, renderer, watch) if rest else None
        if start is None or not _is_free(start.pose, placed):
            break
        starts.append(start)
    return starts


def with_instances(scene: Scene, starts: Sequence[Start]) -> Scene:
    """Return the scene with more instances of its only object: ``bottle`` beside ``bottle 2``."""
    if not starts:
        return scene
    first, stem = scene.objects[0], Path(scene.objects[0].model.name).stem
    names = stem, *(f"{stem} {number}" for number in range(2, len(starts) + 2))
    objects = (replace(first, id=str(i), name=name) for i, name in enumerate(names, 1))
    notes = tuple(note for start in starts for note in start.notes)
    scene = replace(scene, objects=tuple(objects), notes=(*scene.notes, *notes))
    for index, start in enumerate(starts, 1):
        scene = scene.with_pose(index, start.pose)
    return scene


def _without_placed(query: StartQuery, placed: Sequence[PlacedModel]) -> StartQuery:
    """Return the query without the pixels that show placed models."""
    if not placed:
        return query
    free, mask = visibility(placed).nearest == NOTHING, query.inputs.mask
    weights = free if mask is None else free * mask.weights
    return replace(query, inputs=replace(query.inputs, mask=Mask.of(weights)))


def _is_free(pose: Pose, placed: Sequence[PlacedModel]) -> bool:
    """Tell whether an instance at a pose stands where none of the others does."""
    for other in placed:
        pair = replace(other, pose=pose), other
        a, b = (np.isfinite(depth_image(model)) for model in pair)
        if (a & b).sum() > MAX_SHARED_FRACTION * min(a.sum(), b.sum()):
            return False
    return True
