"""Formats: their functions, the options of a conversion, checks that all share, and the choice of
the photo that the numbers of a file belong to.

Where the photo was undistorted for the pose, a tool that has the photo's lens model gets camera and
lens of the photo as taken: the same polynomials under its own names. Every other gets the
undistorted photo, written beside its file, and the pinhole camera of that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from msgspec import structs

from poseviewer.errors import PhotoFileError, PoseFileError
from poseviewer.files.checks import Reading, checked_rotation, kind_of
from poseviewer.files.photo import (
    SAME,
    is_stored_turned,
    load_photo,
    pixels_for,
    save_image,
    undistorted,
)
from poseviewer.files.pose import ModelReference, PhotoReference, PoseRecord
from poseviewer.files.scene_file import SceneRecord, ViewRecord, scene_of_pose
from poseviewer.files.structs import Distortion, checked_camera
from poseviewer.files.writing import make_folder, write_whole
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV
from poseviewer.geometry.image import Photo
from poseviewer.geometry.lens import Lens, LensModel, Undistortion
from poseviewer.geometry.transform import RigidTransform, Similarity

Entry = TypeVar("Entry")
METRES = {"km": 1000.0, "m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Length units by name, in metres."""


@dataclass(frozen=True, slots=True)
class ConvertOptions:
    """Options of a conversion: values that the source does not say, or that replace its own."""

    photo: Path | None = None
    """The photo's file, in place of the one that the source names."""
    model: Path | None = None
    """The model's file, likewise; or the folder of a BOP scene's models."""
    photo_size: tuple[int, int] | None = None
    """Width and height of the photo in px, for files that do not say it."""
    unit: str | None = None
    """The model's length unit, a key of ``METRES``."""
    image: str | None = None
    """Which image of a file with several: its name, or its number (BOP)."""
    object_id: int | None = None
    """Which object (BOP)."""
    overwrite: bool = False

    def image_of(self, view: int) -> str | None:
        """Name or number of a view's image; numbers count on from the first view's."""
        if view == 0 or self.image is None:
            return self.image
        return str(int(self.image) + view) if self.image.isdecimal() else None

    def unit_of(self, scene: SceneRecord) -> str | None:
        """The models' unit: what the user says, else what the scene says."""
        return self.unit or next((o.model.unit for o in scene.objects if o.model.unit), None)

    def size_of(self, reading: Reading, width: Any = None, height: Any = None) -> tuple[int, int]:
        """Width and height of the photo in px, as the file says (unchecked), else as the user."""
        found = reading.size(width, "the photo's width"), reading.size(height, "the photo's height")
        if found[0] is None or found[1] is None:
            if self.photo_size is None:
                wanted = "add --photo-size WIDTHxHEIGHT"
                raise reading.error("it does not say how large the photo is", wanted)
            return self.photo_size
        if self.photo_size not in (None, found):
            asked = "x".join(map(str, self.photo_size or ()))
            said = f"it is for a photo of {found[0]}x{found[1]} px"
            raise reading.error(said, f"not of {asked} px")
        return found[0], found[1]

    def the_one(self, reading: Reading, kind: str, entries: Iterable[tuple[str, Entry]]) -> Entry:
        """The entry that ``image`` names, with or without folders, or the only one."""
        image, known = self.image, list(entries)
        chosen = [one for name, one in known if image is None or image in (name, Path(name).name)]
        if len(chosen) != 1:
            found = (
                f"{len(chosen)} of its {len(known)} {kind} are {repr(image) if image else 'meant'}"
            )
            raise reading.error(found, "wanted one, choose it with --image NAME")
        return chosen[0]

    def refuse_existing(self, paths: Iterable[Path]) -> None:
        """Raise PoseFileError where a path is taken, unless the user wants it overwritten."""
        for path in paths:
            if path.is_dir():
                raise PoseFileError(f"{path}: is a folder; name a file in it.")
            if path.exists() and not self.overwrite:
                found = "is there already and was not touched"
                raise PoseFileError(f"{path}: {found}; name another, or add --overwrite.")

    def write(self, contents: Mapping[Path, str | bytes], *notes: str) -> Written:
        """Write files that are not there yet, or that the user wants overwritten; all or none."""
        self.refuse_existing(contents)
        for path, content in contents.items():
            data = content if isinstance(content, bytes) else content.encode()
            write_whole(path, data, PoseFileError)
        return Written(tuple(contents), notes)


@dataclass(frozen=True, slots=True)
class Written:
    """Files that a writer wrote."""

    files: tuple[Path, ...]
    notes: tuple[str, ...] = ()
    """Sentences for the user."""


Lenses = Sequence[tuple[str, LensModel, int]]
"""A format's lens models, the poorest first: its name for each, OpenCV's model, and how many of
that one's coefficients it has."""


def lens_in(lenses: Lenses, lens: Lens | None) -> tuple[str, tuple[float, ...]] | None:
    """The name of the first model that holds a lens (None: a pinhole), and its coefficients there.

    Returns None where a format has no such model.
    """
    k: tuple[float, ...] = () if lens is None else lens.coefficients
    for name, model, count in lenses:
        if model == (lens.model if lens else "opencv") and not any(k[count:]):
            return name, (*k, *[0.0] * count)[:count]
    return None


@dataclass(frozen=True, slots=True)
class Format:
    """A tool's format."""

    write: Callable[[SceneRecord, Path, ConvertOptions], Written]
    """Scene, where to, and what else is known."""
    read: Callable[[Path, ConvertOptions], SceneRecord]
    lenses: Lenses = ()
    several_photos: bool = True
    several_objects: bool = False
    """Whether it can say several objects, which all but our own do of one photo."""
    is_own: bool = False
    """Whether it is our own: it says which photo, undistorted or not, its numbers belong to."""
    is_upright: bool = False
    """Whether its photo is upright whatever its EXIF says."""
    photos_in: str | None = None
    """Folder, in the output, of undistorted photos; None: beside the file that is written."""

    def lens_name(self, view: ViewRecord) -> str | None:
        """The format's name for the lens of a view's undistorted photo; None where it has none."""
        undistortion, camera = view.undistortion, view.camera
        if undistortion is None or not isinstance(camera, Perspective):
            return None
        same = np.allclose(astuple(camera), astuple(undistortion.camera), rtol=SAME)
        known = lens_in(self.lenses, undistortion.lens) if same else None
        return None if known is None else known[0]

    def convert(self, scene: SceneRecord, out: Path, options: ConvertOptions) -> Written:
        """Write a scene for the photos as taken, or else the undistorted photos as well."""
        views, notes, new, ready = scene.views, [], [], []
        several = len(scene.objects) > 1
        if several and not self.several_objects:
            raise PoseFileError(
                "Such a file holds one pose; choose an object of the scene with --object ID, or "
                "convert all to bop, gltf or meshlab."
            )
        if len(views) > 1 and (not self.several_photos or (several and not self.is_own)):
            notes.append(f"It holds one photo: the other {len(views) - 1} of the set are left out.")
            views = views[:1]
        for number, view in enumerate(views):
            name = view.path.name or "the photo"
            if view.distortion is not None and not self.is_own:
                if (lens := self.lens_name(view)) is not None:
                    notes.append(f"Camera and lens ({lens}) are those of {name} as taken.")
                elif ready and not view.path.is_file():
                    notes.append(f"{name} is not there to be undistorted: left out.")
                    continue
                else:
                    stem = Path(options.image_of(number) or name).stem
                    path = out.parent / f"{stem}.undistorted.png"
                    if self.photos_in is not None:  # BOP numbers its images by their files' names
                        path = out / self.photos_in / f"{stem.zfill(6)}.png"
                        make_folder(path.parent)
                    view = _of_undistorted(view, path, options)
                    new.append(path)
                    notes.append(
                        f"All numbers of {name} belong to {path.name}, the undistorted photo, "
                        "which is written; not to the photo as taken."
                    )
            ready.append(view)
        photo = ready[0].path
        if not (self.is_own or self.is_upright) and photo.is_file() and is_stored_turned(photo):
            notes.append(
                f"{photo.name} is stored turned (EXIF), and the pose is one in the upright photo; "
                "save it upright for tools that do not turn it."
            )
        written = self.write(structs.replace(scene, views=tuple(ready)), out, options)
        return Written((*new, *written.files), (*notes, *written.notes))


def _of_undistorted(view: ViewRecord, path: Path, options: ConvertOptions) -> ViewRecord:
    """Write the undistorted photo of a view; returns the view of that photo."""
    if not view.path.is_file():
        raise PoseFileError(
            "The pose is one in the undistorted photo, which has to be written for it, and the "
            "photo as taken is not known; add --photo FILE."
        )
    taken, known = load_photo_of(view), view.photo.sha256
    if known and known.lower() != taken.sha256:
        raise PhotoFileError(
            f"{taken.name}: not the photo that the pose was found on (the fingerprints differ); "
            "name that one with --photo, or this one if you mean it."
        )
    assert view.undistortion is not None  # asked for such views alone
    picture = undistorted(taken, view.undistortion)
    is_taken = path.exists() and path.samefile(view.path)
    if not path.exists() or (options.overwrite and not is_taken):
        save_image(path, pixels_for(path, picture))
    elif is_taken or not np.array_equal(load_photo(path).pixels, picture.pixels):
        raise PhotoFileError(
            f"{path}: is there already and was not touched; move it away: the undistorted photo "
            "is to be written there."
        )
    return ViewRecord.of(path, view.camera, place=view.place.rigid)


def from_4x4(reading: Reading, rows: Any, what: str) -> RigidTransform:
    """The rigid transform in 4 rows of 4 numbers (or 3, without the last)."""
    if not isinstance(rows, list) or len(rows) not in (3, 4):
        raise reading.error(f"{what} is {kind_of(rows)}", "wanted 4 rows of 4 numbers")
    matrix = np.array([reading.numbers(row, f"{what}[{i}]", 4) for i, row in enumerate(rows)])
    if len(matrix) == 4 and not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), rtol=0.0, atol=1e-9):
        raise reading.error(f"the last row of {what} is {rows[3]}", "wanted 0 0 0 1 (row-major)")
    return RigidTransform(checked_rotation(reading, matrix[:3, :3]), matrix[:3, 3])


def in_one_world(scene: SceneRecord) -> tuple[list[FloatArray], list[Pose]]:
    """The objects and cameras of a scene in one frame: the model's, or, of several objects, the
    first camera's with OpenGL's axes; lengths in the models' unit.

    Returns world from model (4, 4) for each object, and each view's camera from the world.
    """
    if len(scene.objects) == 1:
        return [np.eye(4)], [scene.pose(0, view) for view in range(len(scene.views))]
    camera, places = scene.views[0].camera, []
    for index in range(len(scene.objects)):
        pose, ratio = scene.pose(index), 1.0
        if isinstance(pose.camera, Parallel) and isinstance(camera, Parallel):
            ratio = pose.camera.scale / camera.scale  # as large in the picture, and no farther
        place = Similarity(OPENGL_FROM_OPENCV @ pose.camera_from_model, ratio).matrix
        place[:2, 3] *= ratio
        places.append(place)
    return places, [Pose(camera, OPENGL_FROM_OPENCV.inverse())]


def perspective_of(camera: Camera, tool: str) -> Perspective:
    """The camera, unless it is one of parallel projection."""
    if isinstance(camera, Perspective):
        return camera
    raise PoseFileError(
        f"The pose is one of parallel projection, which {tool} files cannot hold; convert it to "
        "gltf, or fit it in perspective."
    )


def require_file(path: Path, what: str, tool: str) -> Path:
    """A photo or model that a format cannot do without."""
    if not path.name:
        raise PoseFileError(f"{tool} files name the {what}, and none is known; add --{what} FILE.")
    if not path.is_file():
        raise PoseFileError(f"{path}: no such file; name the {what} with --{what} FILE.")
    return path


def metres_per_unit(unit: str) -> float:
    """The size of a length unit; raises PoseFileError where it is unknown."""
    if unit not in METRES:
        raise PoseFileError(
            f"The model's unit is {unit!r}; wanted one of {', '.join(METRES)}, say it with --unit."
        )
    return METRES[unit]


def make_scene(
    reading: Reading,
    pose: Pose,
    photo: str | None = None,
    unit: str | None = None,
    lens: Lens | None = None,
) -> SceneRecord:
    """A pose from another tool's file; with a ``lens`` its camera is that of the photo as taken."""
    distortion = None
    pose = replace(pose, camera=checked_camera(reading, pose.camera))
    if lens is not None and isinstance(pose.camera, Perspective):
        undistortion = Undistortion.of(lens, pose.camera)
        pose, distortion = replace(pose, camera=undistortion.camera), Distortion.of(undistortion)
    record = PoseRecord.of(
        pose,
        PhotoReference(photo),
        model=ModelReference(unit=unit) if unit else None,
        distortion=distortion,
        warnings=tuple(reading.warnings),
    )
    return scene_of_pose(reading.path, record)


def cameras_as_taken(
    scene: SceneRecord, tool: str, lenses: Lenses
) -> Iterator[tuple[Path, RigidTransform, Perspective, str, tuple[float, ...]]]:
    """For each photo as taken its path, ``camera_from_model`` of the only object, the camera (pixel
    centres at i + 0.5), and the tool's name of its lens and coefficients.
    """
    for index, view in enumerate(scene.views):
        camera, undistortion = perspective_of(view.camera, tool), view.undistortion
        known = lens_in(lenses, undistortion and undistortion.lens)
        assert known is not None  # of such lenses the undistorted photo is written
        camera = undistortion.taken if undistortion else camera
        yield view.path, scene.pose(0, index).camera_from_model, camera, *known


def load_photo_of(view: ViewRecord) -> Photo:
    """The photo of a view."""
    photo, camera = load_photo(view.path), view.camera
    if (photo.width, photo.height) != (camera.width, camera.height):
        raise PhotoFileError(
            f"{photo.name}: {photo.width}x{photo.height} px, and the pose is one for "
            f"{camera.width}x{camera.height} px; name the photo of the pose with --photo."
        )
    return photo
