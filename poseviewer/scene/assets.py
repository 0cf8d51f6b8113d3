"""Photo and model files: what is known of each, and its content, read when first asked for."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from poseviewer.errors import printable
from poseviewer.geometry.image import Photo
from poseviewer.geometry.lens import Undistortion
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.mesh_symmetry import find_symmetry
from poseviewer.geometry.symmetry_group import NO_SYMMETRY, Symmetry
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints


@dataclass(frozen=True)
class PhotoFile:
    """A photo's file. Two are equal by what is known of them, whether they were read or not."""

    path: Path | None
    """None: the photo is in no file."""
    name: str
    """Name to show: of the file, with its folder where two views would else share a name."""
    width: int = 0
    """px; 0, as the height: not known before the photo is read."""
    height: int = 0
    sha256: str | None = None
    undistortion: Undistortion | None = None
    """From the photo in the file to ``photo``; None: they are the same."""
    read: Callable[[], Photo] = field(kw_only=True, compare=False, repr=False)
    """Gives the same photo each time; raises ``PhotoFileError`` where the file cannot be used."""

    @classmethod
    def of(cls, photo: Photo, path: Path | None = None) -> "PhotoFile":
        """Wrap a photo that was read."""
        size = photo.width, photo.height
        return cls(path, photo.name, *size, photo.sha256, photo.undistortion, read=lambda: photo)

    @property
    def location(self) -> Path:
        """The photo's file; where there is none, a path of its name."""
        return self.path or Path(self.name)

    @cached_property
    def photo(self) -> Photo:
        """The photo, undistorted, read from its file when first asked for."""
        return self.read()

    @property
    def at_rest(self) -> "PhotoFile":
        """The file with its photo still to be read; hundreds of photos would fill the memory."""
        return replace(self) if "photo" in self.__dict__ else self


@dataclass(frozen=True, slots=True, eq=False)
class ModelContent:
    """Content of a model's files."""

    mesh: Mesh
    keypoints: VehicleKeypoints | None = None
    said_symmetry: Symmetry | None = None
    """Symmetry of the whole mesh, as a file says it; None: none does."""
    _parts: dict[frozenset[str], Mesh] = field(default_factory=dict, init=False, repr=False)

    def mesh_without(self, parts: tuple[str, ...]) -> Mesh:
        """Leave out parts, with the same result each time.

        Raises:
            SettingsError: there is no such part, or nothing would be left.
        """
        names = frozenset(parts)
        if names not in self._parts:
            self._parts[names] = self.mesh.without(parts)
        return self._parts[names]


@dataclass(frozen=True)
class ModelFile:
    """A model's file; many objects can share one. Two are equal by what is known of them."""

    path: Path | None
    """None: the model is in no file."""
    sha256: str | None = None
    unit: str | None = None
    """Length unit; None: not said."""
    shown_name: str = ""
    """Name to show; "": the file's."""
    read: Callable[[], ModelContent] = field(kw_only=True, compare=False, repr=False)
    """Gives the same content each time; raises ``MeshFileError`` where a file cannot be used."""

    @classmethod
    def of(
        cls, mesh: Mesh, path: Path | None = None, sha256: str | None = None, *, name: str = "",
        keypoints: VehicleKeypoints | None = None, symmetry: Symmetry | None = None,
    ) -> "ModelFile":  # fmt: skip
        """Wrap a model that was read, or is in no file.

        Args:
            mesh: the whole surface.
            path: the model's file.
            sha256: hash of the file's bytes, hexadecimal.
            name: name to show; by default the file's.
            keypoints: of a vehicle.
            symmetry: of the whole mesh; default: found from it.
        """
        content = ModelContent(mesh, keypoints, symmetry)
        return cls(path, sha256, mesh.unit, name, read=lambda: content)

    @cached_property
    def content(self) -> ModelContent:
        """Content of the model's files, read when first asked for."""
        return self.read()

    @property
    def name(self) -> str:
        """Name of the file, without its folder."""
        return self.shown_name or (printable(self.path.name) if self.path else "")

    @property
    def location(self) -> Path:
        """The model's file; where there is none, a path of its name."""
        return self.path or Path(self.name)

    @property
    def mesh(self) -> Mesh:
        """The whole surface."""
        return self.content.mesh

    @property
    def keypoints(self) -> VehicleKeypoints | None:
        """Key points of a vehicle; None: none are known."""
        return self.content.keypoints

    @property
    def symmetry(self) -> Symmetry:
        """Symmetry of the whole mesh, as a file says it, else as it is found from the mesh."""
        said = self.content.said_symmetry
        return self.symmetry_of(self.mesh) if said is None else said

    def symmetry_of(self, mesh: Mesh) -> Symmetry:
        """Find the symmetry of the mesh or of some of its parts; wheels tell front from rear."""
        return find_symmetry(mesh) if self.keypoints is None else NO_SYMMETRY

    def with_content(self, **changes: object) -> "ModelFile":
        """Change fields of the model's content."""
        content = replace(self.content, **changes)  # pyright: ignore[reportArgumentType]
        return replace(self, read=lambda: content)
