"""A start pose, and what one is found from."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from poseviewer.geometry.camera import Camera, Parallel, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene, View, scene_at
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints


@dataclass(frozen=True, slots=True)
class StartCamera:
    """Knowledge of the camera where no pose file says it."""

    parallel: bool = False
    focal_px: float | None = None
    """None: EXIF's; without that, the pairs' where they tell it, else a view of 50 degrees."""
    free_focal: bool = False
    """Find it from the pairs even where it is known."""

    def of(self, photo: Photo) -> Camera:
        """Return the camera, whose principal point is the photo's middle."""
        camera = photo.default_camera()
        if self.parallel:
            return Parallel(1.0, camera.cx, camera.cy, camera.width, camera.height)
        if self.focal_px is not None:
            camera = replace(camera, fx=self.focal_px, fy=self.focal_px)
        return camera

    def knows_focal(self, photo: Photo) -> bool:
        """Tell whether a focal length was given, or stands in the photo."""
        return self.focal_px is not None or photo.focal_length_35mm is not None


class Start(NamedTuple):
    """A start pose, and what is to be said about it."""

    pose: Pose
    notes: tuple[str, ...]
    others: tuple["Start", ...] = ()
    """Starts of further instances of the model."""
    doubt: str = ""
    """Sentence why the pose may be far off, so that no verdict is ``found``."""


@dataclass(frozen=True, slots=True, eq=False)
class StartInputs:
    """Photo and model that a start is found for."""

    photo: Photo
    mesh: Mesh
    keypoints: VehicleKeypoints | None
    mask: Mask | None = None
    """Weight of each pixel of the photo; None: all count."""
    settings: FitSettings = field(default_factory=FitSettings)

    def scene(self, start: Pose, settings: FitSettings) -> Scene:
        """Make the scene of a start pose, without the names of files."""
        view = View(PhotoFile.of(self.photo), start.camera, mask=self.mask)
        model = ModelFile.of(self.mesh.whole, keypoints=self.keypoints)
        return scene_at(view, model, start, settings=settings, without=self.mesh.left_out)


FindStart = Callable[[StartInputs], Start]
