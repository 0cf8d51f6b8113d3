"""Which of several models a photo shows: each is fitted, all are compared on the same pixels."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any

from poseviewer.errors import SettingsError
from poseviewer.fit.compared import box_near
from poseviewer.fit.problem import make_problem
from poseviewer.fit.progress import FitProgress
from poseviewer.fit.stages import fit_pose
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.pool import processors
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene

Watch = Callable[[str, FitProgress], Any]


def identify(
    scenes: Sequence[Scene], settings: FitSettings, watch: Watch | None = None
) -> list[tuple[str, FitProgress]]:
    """Fit each model from its start; names and ends of the fits, that of least loss first.

    The scenes are of one photo, each of one model; all are compared on the same pixels, by
    ``shared_settings``. ``watch`` is called with the model's name at every evaluation; what it
    raises ends the search. Raises ``SettingsError``: there are fewer than two models, or the
    settings do not go with the photo or with several models.
    """
    if len(scenes) < 2:
        raise SettingsError("one model alone: name two or more, to be told apart.")
    shared = shared_settings(scenes, settings)
    ends = []
    for scene in scenes:
        model = scene.objects[0].model
        problem, _ = make_problem(scene.with_object(0, settings=shared))
        renderer = make_renderer(model.mesh, settings.renderer)
        progress: FitProgress | None = None
        for progress in fit_pose(problem, renderer, processors()):
            if watch is not None:
                watch(model.name, progress)
        assert progress is not None  # a fit yields at least once
        ends.append((model.name, progress))
    return sorted(ends, key=lambda end: end[1].loss)


def shared_settings(scenes: Sequence[Scene], settings: FitSettings) -> FitSettings:
    """Limit the settings' region to the box about all models at their starts."""
    if settings.pixels == "clip":
        raise SettingsError(
            "--pixels clip judges every model on pixels of its own, so their losses cannot be "
            "compared; use near or whole."
        )
    if settings.pixels == "whole":
        return settings
    box = reduce(Rectangle.union, (box_near(one.objects[0].mesh, one.pose(0)) for one in scenes))
    region = box if settings.region is None else box.intersection(settings.region)
    return replace(settings, pixels="whole", region=region)
