"""Workers for a sequence: they read the photo of the wanted frame, and propagate poses."""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

from poseviewer.app.state.edits import Edit
from poseviewer.app.state.frame_edits import frame_read, propagation_advanced
from poseviewer.app.state.results import PropagationRequest
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import renderer_of
from poseviewer.app.workers.worker import Worker
from poseviewer.fit.propagation import FrameStep, propagate
from poseviewer.render.pool import processors
from poseviewer.scene.assets import PhotoFile

MAX_PHOTOS = 8
"""Photos of frames that are kept in memory: one steps to and fro."""
FrameRequest = tuple[int, PhotoFile]
"""Index and photo of a frame."""


def frame_reading() -> Worker[FrameRequest, Edit]:
    """Read the photo of the wanted frame; while it is dragged to others, the newest is next."""

    @lru_cache(maxsize=MAX_PHOTOS)
    def read(file: PhotoFile) -> PhotoFile:
        photo = file.read()
        return replace(file, read=lambda: photo)

    def request_of(session: Session) -> FrameRequest | None:
        index, frames = session.wanted_frame, session.document.scene.frames
        return None if index is None or session.drag is not None else (index, frames[index].file)

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
    """Propagate the active object's poses."""
    start, steps = request.start, list[FrameStep]()
    renderers = {start.active: renderer_of(start.mesh, start.settings.renderer).clone()}
    ends = request.first, request.last, [start.active], processors()
    for step in propagate(start.scene, renderers, *ends):
        steps.append(step)
        yield propagation_advanced(request, steps)
    yield propagation_advanced(request, steps, is_over=True)
