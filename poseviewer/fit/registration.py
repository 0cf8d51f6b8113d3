"""What is open: a photo, a model, and where the model starts."""

from __future__ import annotations

from dataclasses import dataclass, replace

from poseviewer.errors import SettingsError
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.photo import Photo
from poseviewer.geometry.symmetry import NO_SYMMETRY, Symmetry
from poseviewer.vehicle.keypoints import VehicleKeypoints


@dataclass(frozen=True, slots=True, eq=False)
class LoadedModel:
    """A model file as it was read: many photos can share one."""

    mesh: Mesh
    name: str
    """The file's name, without its folder."""
    sha256: str
    keypoints: VehicleKeypoints | None
    whole_symmetry: Symmetry = NO_SYMMETRY
    """What maps it, with all its parts, onto itself, as far as a file says it."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedModel:
    """A model at a pose: another object of the photo, say."""

    mesh: Mesh
    pose: Pose


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """What is open: the photo, the model and where the model starts."""

    photo: Photo
    mesh: Mesh
    mesh_name: str
    mesh_sha256: str
    keypoints: VehicleKeypoints | None
    start: Pose
    warnings: tuple[str, ...]
    start_is_guess: bool = False
    """Nobody has said yet where the model is."""
    mask: Mask | None = None
    """How much each pixel of the photo counts; None: all do."""
    others: tuple[PlacedModel, ...] = ()
    """The other objects of the photo, by the same camera and in the same unit: pixels where one of
    them stands in front of this model do not count."""
    whole_symmetry: Symmetry = NO_SYMMETRY
    """What maps the model, with all its parts, onto itself."""

    def __post_init__(self) -> None:
        """Raises ``SettingsError`` where the mask is of another size than the photo."""
        photo, mask = self.photo, self.mask
        if mask is not None and (mask.width, mask.height) != (photo.width, photo.height):
            raise SettingsError(
                f"the mask has {mask.width}x{mask.height} px, the photo {photo.name} has "
                f"{photo.width}x{photo.height} px; make the mask in the photo's size."
            )

    @property
    def symmetry(self) -> Symmetry:
        """What maps the model as it is compared onto itself: poses that differ by it are one."""
        return NO_SYMMETRY if self.mesh.left_out else self.whole_symmetry

    def with_model(self, model: LoadedModel) -> Registration:
        """The registration of another model, at the same start."""
        return replace(
            self,
            mesh=model.mesh,
            mesh_name=model.name,
            mesh_sha256=model.sha256,
            keypoints=model.keypoints,
            whole_symmetry=model.whole_symmetry,
            warnings=(),
        )

    def compares_same(self, other: Registration) -> bool:
        """Whether both compare the same model with the same pixels."""
        same_pixels = self.photo is other.photo and self.mask is other.mask
        return same_pixels and self.mesh is other.mesh and self.others == other.others
