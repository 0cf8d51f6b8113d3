"""Starts that are searched for, of one or several instances of a model: each beside the others."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from poseviewer.errors import QuickStartError, SettingsError
from poseviewer.fit.visibility import NOTHING, depth_image, visibility
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.attributes import Renderer
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.types import PlacedModel
from poseviewer.starts.automatic import BeginThread, PoseHypothesis, StartQuery, best_start, propose
from poseviewer.starts.dino_features import PatchEncoder
from poseviewer.starts.start import Start, StartCamera, StartInputs

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
        renderer: renderer of the model.
        begin: called by each thread first.
        watch: called in each step; it may raise to stop the search.
    """
    hypotheses = propose(_without_placed(query, placed), renderer, begin, watch)
    return [hypothesis for hypothesis in hypotheses if _is_free(hypothesis.pose, placed)]


@dataclass(frozen=True, slots=True)
class AutoStart:
    """A start that is searched for in some seconds, as ``load`` does by ``start="auto"``."""

    box: tuple[int, int, int, int] | None = None
    """Rectangle (left, top, width, height) about the object, px; None: the settings' region, else
    the whole photo."""
    instances: int = 1
    """Number of instances of the model in the photo; each that is found becomes an object."""
    camera: StartCamera = field(default_factory=StartCamera)
    """Knowledge of the camera; by default EXIF's focal length, else a view of 50 degrees."""
    watch: Callable[[], object] = lambda: None
    """Called after every evaluation; an exception in it ends the search."""
    features: Path | None = None
    """Weights of a DINOv2 backbone, which proposes rectangles; not with a box or a region."""

    def __post_init__(self) -> None:
        """Check box and number.

        Raises:
            SettingsError: the box has not four numbers, or there are no instances.
        """
        if self.box is not None and len(self.box) != 4:
            raise SettingsError(f"box={self.box}: wanted (left, top, width, height), in px.")
        if self.instances < 1:
            raise SettingsError(f"instances={self.instances}: wanted a whole number of 1 or more.")

    def __call__(self, inputs: StartInputs) -> Start:
        """Find starts of the instances, the likeliest first.

        Raises:
            PoseViewerError: there are none.
        """
        settings = inputs.settings
        if self.instances > 1 and settings.has_free_camera:
            raise SettingsError(
                f"instances={self.instances} with a free focal length or principal point, and one "
                "camera shows all of them; leave one of the two out."
            )
        rectangle = settings.region if self.box is None else Rectangle(*self.box)
        if self.features is not None:
            if rectangle is not None:
                raise SettingsError(
                    f"features={self.features.name} with a box or a region, where they are not "
                    "used; leave one of the two out."
                )
            PatchEncoder.load(self.features)  # an error is told before the search
        camera = self.camera.of(inputs.photo)
        query = StartQuery(inputs, camera, rectangle, settings, self.features)
        first, *others = self._find(query, make_renderer(inputs.mesh))
        notes = [note for start in (first, *others) for note in start.notes]
        if (count := len(others) + 1) < self.instances:
            notes.append(f"{count} of {self.instances} instances: nothing else looks like one.")
        return first._replace(notes=tuple(notes), others=tuple(others))

    def _find(self, query: StartQuery, renderer: Renderer) -> list[Start]:
        watch, starts = self.watch, list[Start]()
        proposals = propose(query, renderer, watch=watch)
        while len(starts) < self.instances:
            placed = [PlacedModel(query.inputs.mesh, start.pose) for start in starts]
            left = [own for own in proposals if _is_free(own.pose, placed)]
            with suppress(QuickStartError):
                left = left or propose_beside(query, placed, renderer, watch=watch)
            start = (
                best_start(_without_placed(query, placed), left, renderer, watch) if left else None
            )
            if start is None or not _is_free(start.pose, placed):
                break
            starts.append(start)
        return starts


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
