"""Which of several models a photo shows: each is fitted, all are scored on the same pixels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise, zip_longest
from typing import Any

from poseviewer.errors import SettingsError
from poseviewer.fit.problem import box_near, make_problem
from poseviewer.fit.progress import FitProgress
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.fit.stages import fit_pose
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.pool import processors
from poseviewer.render.renderers import make_renderer
from poseviewer.render.types import Renderer

Watch = Callable[[str, FitProgress], Any]


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A model, fitted to the photo."""

    index: int
    """Its place among the models as they were given, from 0."""
    name: str
    fit: FitProgress
    """Where its search ended; the losses are over the pixels that all candidates share."""


@dataclass(frozen=True, slots=True)
class Ranked:
    """A candidate in its place."""

    rank: int
    """From 1: the least loss."""
    candidate: Candidate
    margin: float | None
    """How much more the next candidate leaves unexplained; None for the last."""


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """How far models are told apart."""

    ranked: tuple[Ranked, ...]
    """Those that are fitted, the likeliest first."""
    at: int | None = None
    """The model that is being fitted, by its index; None at the end."""
    progress: FitProgress | None = None
    """How far that one is."""


def identify(
    registrations: Sequence[Registration],
    settings: FitSettings,
    watch: Watch | None = None,
) -> list[Ranked]:
    """As ``identifying``, to its end; ``watch`` is called with the model's name at every
    evaluation, and whatever it raises ends it.
    """
    found = Identification(())
    for found in identifying(registrations, settings):
        if watch is not None and found.at is not None and found.progress is not None:
            watch(registrations[found.at].mesh_name, found.progress)
    return list(found.ranked)


def identifying(
    registrations: Sequence[Registration],
    settings: FitSettings,
    renderer_of: Callable[[Mesh], Renderer] | None = None,
) -> Iterator[Identification]:
    """Fit each model from its start, one after the other, and rank them by their losses: how far
    it is after every evaluation, and at last the whole. To stop it, stop asking.

    The registrations are of one photo. The pixels P are the same for all: the box about all
    models at their starts, within the settings' region. So a model is not the better for looking
    at fewer pixels, and what it leaves of the photo beside it counts against it.
    ``renderer_of`` gives what draws a model (by default it is made).

    Raises:
        SettingsError: there are fewer than two models; the pixels are those that each model
            covers, which no two share; the settings do not go with the photo.
    """
    if len(registrations) < 2:
        raise SettingsError("one model alone: name two or more, to be told apart.")
    shared = shared_settings(registrations, settings)
    draw = renderer_of or (lambda mesh: make_renderer(mesh, settings.renderer))
    ranked: tuple[Ranked, ...] = ()
    for index, registration in enumerate(registrations):
        problem, _ = make_problem(registration, shared)
        renderer = draw(registration.mesh)
        progress: FitProgress | None = None
        for progress in fit_pose(problem, renderer, processors()):
            yield Identification(ranked, index, progress)
        assert progress is not None  # a fit yields at least once
        fitted = Candidate(index, registration.mesh_name, progress)
        ranked = rank([*(one.candidate for one in ranked), fitted])
    yield Identification(ranked)


def shared_settings(registrations: Sequence[Registration], settings: FitSettings) -> FitSettings:
    """The same settings over pixels that all models share.

    Raises:
        SettingsError: the settings want the pixels that each model covers.
    """
    if settings.pixels == "clip":
        raise SettingsError(
            "--pixels clip judges every model on pixels of its own, so their losses cannot be "
            "compared; use near or whole."
        )
    if settings.pixels == "whole":
        return settings
    box = union_box([(found.mesh, found.start) for found in registrations])
    region = box if settings.region is None else box.intersection(settings.region)
    return replace(settings, pixels="whole", region=region)


def union_box(placed: Iterable[tuple[Mesh, Pose]]) -> Rectangle:
    """The box about all models, with the margin of a fit, px."""
    return reduce(Rectangle.union, (box_near(mesh, pose) for mesh, pose in placed))


def rank(candidates: Iterable[Candidate]) -> tuple[Ranked, ...]:
    """In order of their losses, the least first."""
    ordered = sorted(candidates, key=lambda candidate: candidate.fit.loss)
    margins = [after.fit.unexplained - found.fit.unexplained for found, after in pairwise(ordered)]
    places = zip_longest(ordered, margins)  # the last one has no margin
    return tuple(Ranked(place, *found) for place, found in enumerate(places, 1))
