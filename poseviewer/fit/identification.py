"""Find which of several models a photo shows, by fitting each on the same pixels."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any

from poseviewer.errors import SettingsError
from poseviewer.fit.compared_pixels import box_near
from poseviewer.fit.problem import make_problem
from poseviewer.fit.progress import FitProgress
from poseviewer.fit.stages import fit_pose
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.pool import processors
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene

Watch = Callable[[str, FitProgress], Any]
"""Function called with the name of a model and its progress; its exception ends the search."""


def identify(
    scenes: Sequence[Scene], settings: FitSettings, watch: Watch | None = None
) -> list[tuple[str, FitProgress]]:
    """Fit each model from its start, on the same pixels.

    Args:
        scenes: scenes of one photo, each of one model.
        settings: settings of the fits.
        watch: called at every evaluation.

    Returns:
        Name of the model and end of its fit, that of least loss first.

    Raises:
        SettingsError: there are fewer than two models, or the settings do not go with the photo or
            with several models.
    """
    if len(scenes) < 2:
        raise SettingsError("one model alone: name two or more to choose from.")
    shared = settings_for_all(scenes, settings)
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


def settings_for_all(scenes: Sequence[Scene], settings: FitSettings) -> FitSettings:
    """Return settings limited to the box about all models at their starts."""
    if settings.pixels == "clip":
        raise SettingsError(
            '`pixels="clip"` judges every model on pixels of its own, so their losses cannot be '
            "compared; use near or whole."
        )
    if settings.pixels == "whole":
        return settings
    box = reduce(Rectangle.union, (box_near(one.objects[0].mesh, one.pose(0)) for one in scenes))
    region = box if settings.region is None else box.intersection(settings.region)
    return replace(settings, pixels="whole", region=region)
