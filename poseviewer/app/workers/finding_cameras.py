"""Task that finds the cameras of a sequence whose scene stands still."""

from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from poseviewer.app.state.document import Document
from poseviewer.app.state.session import Session
from poseviewer.app.state.standing import stand_still, still_document
from poseviewer.app.workers.tasks import QueuedTask, TaskResult, Tell
from poseviewer.errors import QuickStartError
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import Undistortion
from poseviewer.opening.photo_sets import open_calibrated

WORKING = "Finding the cameras ..."


@dataclass(frozen=True, slots=True)
class StillChoice:
    """Choice of how the cameras of a scene that stands still are found."""

    by: Literal["auto", "features", "markers", "object"] = "auto"
    marker_size: float | None = None
    """Side of the markers; None: not known."""
    unit: str | None = None
    """Its unit."""


def find_still_cameras(choice: StillChoice) -> QueuedTask:
    """Find the cameras of all frames, and make the frames the views of one scene."""

    def run(session: Session, _: Path, tell: Tell) -> TaskResult:
        from poseviewer.still.still_cameras import StillCameras, find_cameras
        from poseviewer.still.tracked_object import cameras_of_object

        document = session.document
        frames = document.scene.frames
        if not frames:
            raise QuickStartError("Cameras are found of a video or of frames; open one first.")
        found: StillCameras | None = None
        if choice.by == "object":
            found = cameras_of_object(document.scene, document.object.id)
        else:
            paths, known = [frame.file.location for frame in frames], known_camera(document)
            of_markers = {"marker_size": choice.marker_size, "unit": choice.unit}
            finding: Any = find_cameras(paths, choice.by, camera=known, **of_markers)
            with closing(finding) as steps:
                for step in steps:
                    if isinstance(step, StillCameras):
                        found = step
                    else:
                        tell(0.0, 0, f"Finding the cameras: {step} ...")
        assert found is not None
        tell(0.0, 0, "Placing the objects in all frames ...")
        views = tuple(open_calibrated(view, len(found.views)) for view in found.views)
        found = replace(found, views=views)
        still = still_document(document, found)
        return TaskResult((stand_still(document, found, still),), still.scene.notes)

    return QueuedTask(run, WORKING)


def known_camera(document: Document) -> Perspective | Undistortion | None:
    """The calibrated camera of the frames, with its lens; None: there is none, as poses' cameras
    may be guesses.
    """
    return document.scene.views[0].file.undistortion or document.photo.camera
