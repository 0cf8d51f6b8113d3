"""The photos of a set in a document: which one is large, and what belongs to each of them alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.files.view_set import SetChoice
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.photo import Photo
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.view_set import ViewSet

if TYPE_CHECKING:
    from poseviewer.app.state.document import Marks, SearchEnd

FEWEST_COMPARED = 2
"""Photos: one alone is no set."""


@dataclass(frozen=True, slots=True, eq=False)
class OwnOfPhoto:
    """What belongs to one photo of a set alone."""

    mask: Mask | None
    region: Rectangle | None
    marks: Marks
    end: SearchEnd | None = None
    """The last search, as this photo has it."""


@dataclass(frozen=True, slots=True, eq=False)
class PhotoSet:
    """The photos of a set, and where the model is in each. One is large: all else of its document
    is about that one.
    """

    views: ViewSet
    source: Path
    """The set's file or folder."""
    choice: SetChoice
    own: tuple[OwnOfPhoto, ...]
    """In the order of the views. That of the large one is out of date: its document has it."""
    compared: tuple[bool, ...]
    """Which of the photos are, where they see the model."""
    at: int
    """The large one."""
    scale: float
    """At the pose: how many lengths of the model's unit one of the set's is."""
    free_size: bool
    """Whether nothing says that scale: then it is searched for."""
    start_scale: float = 1.0
    """At the start pose."""
    poses: tuple[Pose, ...] = ()
    """In each photo."""
    starts: tuple[Pose, ...] = ()
    """The start pose in each photo."""

    def following(self, pose: Pose, start: Pose) -> PhotoSet:
        """With pose and start as the large photo has them; the same where it has."""
        same_pose = bool(self.poses) and self.poses[self.at] is pose
        same_start = bool(self.starts) and self.starts[self.at] is start
        if same_pose and same_start:
            return self
        poses = self.poses if same_pose else self.views.posed(self.at, pose, self.scale)
        if same_start:
            return replace(self, poses=poses)
        starts = poses if start is pose else self.views.posed(self.at, start, self.scale)
        return replace(self, poses=poses, starts=starts, start_scale=self.scale)

    def rescaled(self, scale: float) -> PhotoSet:
        """With another scale, and the pose as the large photo has it."""
        return self if scale == self.scale else replace(self, scale=scale, poses=())

    def index_of(self, photo: Photo) -> int:
        """Which of the photos it is.

        Raises:
            ValueError: none of them.
        """
        return [id(view.photo) for view in self.views.views].index(id(photo))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the photos."""
        return tuple(view.name for view in self.views.views)
