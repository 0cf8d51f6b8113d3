"""JSON of our own formats as structs (msgspec), which give schema and errors.

In files, pixel centres are at integers, as in OpenCV; inside at i + 0.5 (``geometry.frames``).
"""

from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

import msgspec
import numpy as np
from msgspec import Meta, Struct

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.files.checks import MAX_PX, InputFile, Number, Pixels, Positive, Rows, Three
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.frames import camera_as_integer_centres, camera_from_integer_centres
from poseviewer.geometry.lens import COEFFICIENTS, Lens, LensModel, Undistortion
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_chart import SIZE

AnyCamera = TypeVar("AnyCamera", bound=Camera)
Focal = Annotated[float, Meta(ge=1.0 / MAX_PX, le=MAX_PX)]
PrincipalPoint = Annotated[float, Meta(ge=-MAX_PX, le=MAX_PX)]
Sha256 = Annotated[str, Meta(extra_json_schema={"pattern": "^[0-9a-fA-F]{64}$"})]
SCENE = "poseviewer-scene"
Projection = Literal["perspective", "parallel"]
NEEDED: dict[Projection, tuple[str, ...]] = {"perspective": ("fx", "fy"), "parallel": ("scale",)}
"""Numbers of a camera beside its principal point, by its projection."""
PROJECTIONS: Any = {
    "oneOf": [
        {"properties": {"projection": {"const": name}, "camera": {"required": list(keys)}}}
        for name, keys in NEEDED.items()
    ]
}
"""Schema of what a camera needs by its projection."""
LensName = Literal["opencv", "opencv-fisheye"]
MODELS: dict[LensName, LensModel] = {"opencv": "opencv", "opencv-fisheye": "fisheye"}
NOTE = (
    "The pose, its camera and its chart belong to the undistorted photo, not to the photo as taken."
)


class PhotoReference(Struct, frozen=True, omit_defaults=True):
    """The photo that a pose was found on."""

    file: str | None = None
    width: Pixels | None = None
    height: Pixels | None = None
    sha256: Sha256 | None = None


class ModelReference(Struct, frozen=True, omit_defaults=True):
    """The model that a pose places."""

    file: str | None = None
    sha256: Sha256 | None = None
    unit: str | None = None


class ChartJson(Struct, frozen=True):
    """The pose as the numbers of a chart, which were searched over."""

    name: str
    names: tuple[str, ...]
    parameters: tuple[Number, ...] = msgspec.field(name="numbers")

    def __post_init__(self) -> None:
        if len(self.names) != len(self.parameters):
            found = f".numbers has {len(self.parameters)} of them"
            raise ValueError(f"{found}; wanted as many as names, {len(self.names)}")


class CameraNumbers(Struct, frozen=True, omit_defaults=True, kw_only=True):
    """A camera in px, pixel centres at integers: focal lengths under perspective, px per unit of
    the model (of the world in a scene) under parallel projection; and the principal point.
    """

    fx: Focal | None = None
    fy: Focal | None = None
    scale: Positive | None = None
    cx: PrincipalPoint
    cy: PrincipalPoint

    @classmethod
    def of(cls, camera: Camera) -> Self:
        """The numbers of a camera (pixel centres at i + 0.5)."""
        shifted, names = camera_as_integer_centres(camera), NEEDED[projection_of(camera)]
        return cls(**{name: float(getattr(shifted, name)) for name in (*names, "cx", "cy")})

    def camera(self, projection: Projection, size: tuple[int, int], where: str = "camera") -> Any:
        """Return the camera, pixel centres at i + 0.5.

        Raises:
            ValueError: a number is missing.
        """
        numbers = {name: getattr(self, name) for name in (*NEEDED[projection], "cx", "cy")}
        if missing := [name for name, number in numbers.items() if number is None]:
            raise ValueError(f".{where}.{missing[0]} is missing; wanted a number above 0")
        kind = Perspective if projection == "perspective" else Parallel
        return camera_from_integer_centres(kind(**numbers, width=size[0], height=size[1]))


class Transform(Struct, frozen=True):
    """x_in_b = rotation @ x_in_a + translation; rotation: rows of an orthonormal matrix with
    determinant 1.
    """

    rotation: Rows
    translation: Three

    @classmethod
    def of(cls, rigid: RigidTransform, **more: Any) -> Self:
        """The transform as files say it; ``more``: what a kind of transform has besides."""
        rotation = tuple(map(tuple, rigid.rotation.tolist()))
        return cls(rotation, tuple(rigid.translation.tolist()), **more)

    @property
    def rigid(self) -> RigidTransform:
        """The transform as the program has it."""
        return RigidTransform(np.array(self.rotation), np.array(self.translation))


class Distortion(Struct, frozen=True):
    """Present where the photo was undistorted: the pose, its camera and its chart belong to the
    undistorted photo, not to the photo as taken. Remapping the photo from camera_as_taken with the
    coefficients (OpenCV's order: k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]], or the
    fisheye's k1 k2 k3 k4) to camera_undistorted, in the same size, gives the undistorted photo.
    """

    model: LensName
    coefficients: tuple[Number, ...]
    camera_as_taken: CameraNumbers
    camera_undistorted: CameraNumbers
    note: str = ""

    @classmethod
    def of(cls, undistortion: Undistortion) -> Self:
        """Return all that makes the undistorted photo of the one as taken."""
        lens = undistortion.lens
        name: LensName = "opencv-fisheye" if lens.model == "fisheye" else "opencv"
        taken, camera = map(CameraNumbers.of, (undistortion.taken, undistortion.camera))
        return cls(name, tuple(map(float, lens.coefficients)), taken, camera, NOTE)

    def __post_init__(self) -> None:
        known = COEFFICIENTS[MODELS[self.model]]
        if len(self.coefficients) not in known:
            found = f".coefficients is a list of {len(self.coefficients)}"
            raise ValueError(f"{found}; wanted {', '.join(map(str, known))} numbers")
        self.undistortion((1, 1))

    def undistortion(self, size: tuple[int, int]) -> Undistortion:
        """Return lens and cameras of a photo of a size (width, height)."""
        taken = self.camera_as_taken.camera("perspective", size, "camera_as_taken")
        camera = self.camera_undistorted.camera("perspective", size, "camera_undistorted")
        return Undistortion(Lens(MODELS[self.model], self.coefficients), taken, camera)


class CameraRecord(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The camera of a photo: of the undistorted one, where there is a distortion; and its mask."""

    projection: Projection
    numbers: CameraNumbers = msgspec.field(name="camera")
    distortion: Distortion | None = None
    mask: str | None = None

    def __post_init__(self) -> None:
        _ = self.camera

    size: ClassVar[Any]
    """Width and height of the photo in px."""

    @property
    def camera(self) -> Camera:
        """Camera of the undistorted photo, pixel centres at i + 0.5."""
        return self.numbers.camera(self.projection, self.size)

    @property
    def undistortion(self) -> Undistortion | None:
        """Lens and cameras of the undistorted photo; None: no lens."""
        return self.distortion and self.distortion.undistortion(self.size)


class Uncertainty(Struct, frozen=True, kw_only=True):
    """Normal distribution about the pose, if it is right. A deviation is a
    rotation vector (rad) and then a shift, both along the camera's axes (from the left, about the
    centre, a point in the model's frame):
    x_in_camera = exp(rotation) R (x - centre) + R centre + t + shift.

    covariance: rows, symmetric, 6x6, or 7x7 where the focal length was free, or the model's size in
    several photos, and two more where the principal point was free. names: rotation_x, rotation_y,
    rotation_z (rad), shift_x, shift_y, shift_z (the model's unit; under parallel projection
    log_scale stands for shift_z), and log_focal or log_size, and principal_x and principal_y (of
    the photo's width and height). deviations: standard deviations: depth of the centre along its
    line of sight and sideways across it, the way that is least sure (the model's unit); degrees,
    about the axis that is least sure; scale_percent under parallel projection; focal_px;
    size_percent; principal_px, the way that is least sure; px, root mean square over the model's
    outer points in the photo.
    """

    covariance: tuple[tuple[Number, ...], ...]
    names: tuple[str, ...] = ()
    centre: Three
    deviations: dict[str, Number] = {}

    def __post_init__(self) -> None:
        size = len(self.covariance)
        if size not in (6, 7, 8, 9) or any(len(row) != size for row in self.covariance):
            raise ValueError(
                ".covariance is no square matrix; wanted 6 rows of 6 numbers, or up to 9"
            )
        if not all(row[i] >= 0.0 for i, row in enumerate(self.covariance)):
            raise ValueError(".covariance has a variance below 0; wanted none")

    @classmethod
    def of(cls, covariance: PoseCovariance) -> Self:
        """A covariance, and what it says of single quantities."""
        rows, centre = map(tuple, covariance.matrix.tolist()), covariance.centre.tolist()
        names, deviations = covariance.names, covariance.deviations
        return cls(covariance=tuple(rows), names=names, centre=tuple(centre), deviations=deviations)

    def about(self, pose: Pose) -> PoseCovariance:
        """The covariance, which is one of a pose."""
        seventh = SIZE if SIZE in self.names else "log_focal"
        centre, matrix = np.array(self.centre), np.array(self.covariance, dtype=float)
        return PoseCovariance(pose, centre, matrix, self.deviations.get("px", 0.0), seventh)


def check_camera(file: InputFile, camera: AnyCamera) -> AnyCamera:
    """Return the camera, whose numbers a picture can hold.

    Raises:
        PoseViewerError: a picture cannot hold them; the file's kind of error.
    """
    file.decode(msgspec.to_builtins(CameraNumbers.of(camera)), CameraNumbers, "camera")
    return camera


def projection_of(camera: Camera) -> Projection:
    """The camera's projection, by its name in files."""
    return "parallel" if isinstance(camera, Parallel) else "perspective"
