"""Workers for a sequence: they read the photo of the wanted frame, or of one of many views, and
propagate poses.
"""

import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import lru_cache

from poseviewer.app.state.edits import Edit
from poseviewer.app.state.frame_edits import frame_read, propagation_advanced
from poseviewer.app.state.results import Pace, PropagationRequest
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import renderer_of
from poseviewer.app.workers.worker import Worker
from poseviewer.fit.propagation import chain_steps, find_chains, mend, propagate
from poseviewer.render.attributes import Renderer
from poseviewer.render.pool import processors
from poseviewer.scene.assets import PhotoFile
from poseviewer.scene.sequence import FrameStep, store_poses

MAX_PHOTOS = 8
"""Photos of frames that are kept in memory: one steps to and fro."""
FrameRequest = tuple[int, PhotoFile]
"""Index and photo of a frame."""


def frame_reading() -> Worker[FrameRequest, Edit]:
    """Read the photo of the wanted frame; while it is dragged to others, the newest is next."""

    @lru_cache(maxsize=MAX_PHOTOS)
    def read(file: PhotoFile) -> PhotoFile:
        handle = replace(file)
        _ = handle.photo  # which it keeps
        return handle

    def request_of(session: Session) -> FrameRequest | None:
        index, files = session.wanted_frame, session.document.stepped
        return None if index is None or session.drag is not None else (index, files[index])

    def make(request: FrameRequest) -> Iterator[Edit]:
        yield frame_read(request[0], read(request[1]))

    return Worker(
        "frames",
        request_of,
        make,
        failed=lambda request, _: frame_read(request[0], None),
        serves=lambda begun, request, busy: busy or begun == request,
    )


def tracking() -> Worker[PropagationRequest, Edit]:
    """Propagate poses once all is prepared; other threads go first."""

    def request_of(session: Session) -> PropagationRequest | None:
        is_wanted = session.is_propagating and session.preparation is None
        return session.propagation.request if session.propagation and is_wanted else None

    return Worker(
        "propagation",
        request_of,
        track_edits,
        failed=lambda request, _: propagation_advanced(request, (), is_over=True),
        low_priority=True,
    )


def track_edits(request: PropagationRequest) -> Iterator[Edit]:
    """Propagate poses of objects, or mend them; each edit has all steps so far."""
    start, steps = request.start, list[FrameStep]()
    chosen = request.object_indices
    objects = [start.scene.objects[index] for index in chosen]
    models = [renderer_of(item.compared_mesh, start.settings.renderer) for item in objects]
    renderers = {index: model.clone() for index, model in zip(chosen, models, strict=True)}
    frames, total = count_frames(request)
    for step in _steps_of(request, renderers):
        steps.append(step)
        done, of = (len(steps), None) if total is None else (frames * len(steps) / total, frames)
        if len(steps) == 1:  # it is searched for more widely, and says nothing of the others
            began, begun = time.monotonic(), done
        pace = Pace(done, of, time.monotonic() - began, begun)
        yield propagation_advanced(request, steps, pace=pace)
    yield propagation_advanced(request, steps, is_over=True)


def _steps_of(
    request: PropagationRequest, renderers: Mapping[int, Renderer]
) -> Iterator[FrameStep]:
    scene, chosen = request.start.scene, request.object_indices
    if request.key is None:
        how = {"object_indices": chosen, "threads": processors()}
        yield from propagate(scene, renderers, request.first, request.last, **how)
        return
    for index in chosen:
        for step in mend(scene, renderers, request.key, index, processors()):
            scene = store_poses(scene, {step.frame_index: step.poses})  # it hides the next object
            yield step


def count_frames(request: PropagationRequest) -> tuple[int, int | None]:
    """Count the frames that a propagation searches, and its steps, which go through frames between
    keys twice; None: not known, as of mending.
    """
    if request.key is not None:
        return 0, None
    scene, chosen = request.start.scene, request.object_indices
    chains = find_chains(scene, request.first, request.last, chosen)
    steps = [index for ends in chains for index in chain_steps(scene, ends, chosen)]
    return len(set(steps)), len(steps)
