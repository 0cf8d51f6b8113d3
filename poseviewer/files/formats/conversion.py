"""Formats: their functions, the options of a conversion, checks that all share, and the choice of
the photo that the numbers of a file belong to.

Where the photo was undistorted for the pose, a tool that has the photo's lens model gets camera and
lens of the photo as taken: the same polynomials under its own names. Every other gets the
undistorted photo, written beside its file, and the pinhole camera of that.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from msgspec import structs

from poseviewer.errors import PhotoFileError, PoseFileError, list_names, printable
from poseviewer.files import scene_json as s
from poseviewer.files.checks import Reading, checked_rotation
from poseviewer.files.photo import is_stored_turned, load_photo, save_photo
from poseviewer.files.structs import Transform, checked_camera
from poseviewer.files.writing import make_folder, write_whole
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV
from poseviewer.geometry.lens import CAMERA_TOLERANCE, LensModel
from poseviewer.geometry.transform import RigidTransform, Similarity

Entry = TypeVar("Entry")
Contents = Mapping[Path, str | bytes]
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
    calibration: Path | None = None
    """The file of the photo's camera, for files that do not say it."""
    opengl: bool = False
    """Whether a matrix's camera looks along -z, y up."""
    overwrite: bool = False

    def image_of(self, view: int) -> str | None:
        """Name or number of a view's image; numbers count on from the first view's."""
        if view == 0 or self.image is None:
            return self.image
        return str(int(self.image) + view) if self.image.isdecimal() else None

    def unit_of(self, scene: s.SceneRecord) -> str | None:
        """The models' unit: what the user says, else what the scene says."""
        return self.unit or next((o.model.unit for o in scene.objects if o.model.unit), None)

    def lengths_in(self, unit: str, scene: s.SceneRecord, tool: str) -> float:
        """The tool's ``unit``, in which its lengths are, in the models'; raises PoseFileError where
        theirs is not known.
        """
        own = self.unit_of(scene)
        if own is None:
            found = f"{tool} wants {unit}, and the model's unit is not known"
            raise PoseFileError(f"{found}; say it with --unit, on the page with Model's unit.")
        return metres_per_unit(own) / metres_per_unit(unit)

    def size_of(
        self, reading: Reading, width: Any, height: Any, photo: Path | None = None
    ) -> tuple[int, int]:
        """Width and height of the photo in px, as the file says (unchecked), else as the ``photo``
        has them, else as the user says.
        """
        if None in (width, height) and photo is not None and photo.is_file():
            opened = load_photo(photo)
            width, height = opened.width, opened.height
        if None in (width, height):
            width, height = self.photo_size or (None, None)
        width, height = reading.size(width, "the photo's width"), reading.size(height, "its height")
        if width is None or height is None:
            wanted = "add --photo-size WIDTHxHEIGHT"
            raise reading.error("it does not say how large the photo is", wanted)
        if self.photo_size not in (None, (width, height)):
            asked = "x".join(map(str, self.photo_size or ()))
            raise reading.error(f"it is for a photo of {width}x{height} px", f"not of {asked} px")
        return width, height

    def sized(self, reading: Reading, view: s.ViewRecord) -> s.ViewRecord:
        """The view with the size of its photo, by ``size_of``."""
        width, height = view.photo.width or None, view.photo.height or None
        return view.resized(*self.size_of(reading, width, height, view.path))

    def the_one(self, reading: Reading, kind: str, entries: Iterable[tuple[str, Entry]]) -> Entry:
        """The entry that ``image`` names, with or without folders, or the only one."""
        image, known = self.image, list(entries)
        chosen = [item for name, item in known if image is None or image in (name, Path(name).name)]
        if len(chosen) != 1:
            found = (
                f"{len(chosen)} of its {len(known)} {kind} are {repr(image) if image else 'meant'}"
            )
            names = printable(list_names([name for name, _ in known]))
            raise reading.error(found, f"wanted one, choose it with --image NAME ({names})")
        return chosen[0]

    def scene_of(
        self, reading: Reading, view: s.ViewRecord, unit: str | None = None
    ) -> s.SceneRecord:
        """The scene of a view whose world is the frame of the model, in the user's ``unit`` or that
        of the file.
        """
        checked_camera(reading, view.camera)
        model = s.ModelFile(str(Path()), unit=self.unit or unit)
        item = s.ObjectRecord(id="1", model=model, place=s.Place.of(view.place.rigid))
        view = structs.replace(view, place=Transform.of(RigidTransform.identity()))
        warnings = tuple(reading.warnings)
        return s.SceneRecord(views=(self.sized(reading, view),), objects=(item,), warnings=warnings)


Lenses = Sequence[tuple[str, LensModel, int]]
"""A format's lens models, the poorest first: its name for each, OpenCV's model, and how many of
that one's coefficients it has."""


@dataclass(frozen=True, slots=True)
class Format:
    """A tool's format."""

    write: Callable[[s.SceneRecord, Path, ConvertOptions, list[str]], Contents]
    """Gives what the files hold, of a scene, where to, and what else is known; adds notes."""
    read: Callable[[Path, ConvertOptions], s.SceneRecord]
    lenses: Lenses = ()
    several_photos: bool = True
    several_objects: bool = False
    """Whether it can say several objects, which all but our own do of one photo."""
    is_own: bool = False
    """Whether it is our own: it says which photo, undistorted or not, its numbers belong to."""
    is_upright: bool = False
    """Whether its photo is upright whatever its EXIF says."""
    appends: bool = False
    """Whether what is written keeps what was there."""
    photos_in: str | None = None
    """Folder, in the output, of undistorted photos; None: beside the file that is written."""

    def convert(
        self, scene: s.SceneRecord, out: Path, options: ConvertOptions
    ) -> tuple[list[Path], list[str]]:
        """Write a scene for the photos as taken, or else the undistorted photos as well.

        Returns the files that were written, and notes for the user.
        """
        views, notes, files, ready = scene.views, [], [], []
        several = len(scene.objects) > 1
        if several and not self.several_objects:
            wanted = "choose an object by --object ID, or convert all to bop, dope, gltf, meshlab"
            raise PoseFileError(f"Such a file holds one pose; {wanted}.")
        if len(views) > 1 and (not self.several_photos or (several and not self.is_own)):
            notes.append(f"It holds one photo: the other {len(views) - 1} of the set are left out.")
            views = views[:1]
        for number, view in enumerate(views):
            name = view.path.name or "the photo"
            if view.distortion is not None and not self.is_own:
                if taken := _as_taken(view, self.lenses):
                    notes.append(f"Camera and lens ({taken[1]}) are those of {name} as taken.")
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
                    files.append(path)
                    of_photo = f"{path.name}, the undistorted photo, which is written"
                    notes.append(
                        f"All numbers of {name} belong to {of_photo}; not to that as taken."
                    )
            ready.append(view)
        photo = ready[0].path
        if not (self.is_own or self.is_upright) and photo.is_file() and is_stored_turned(photo):
            found = (
                f"{photo.name} is stored turned (EXIF), and the pose is one in the upright photo"
            )
            notes.append(f"{found}; save it upright for tools that do not turn it.")
        written = self.write(structs.replace(scene, views=tuple(ready)), out, options, notes)
        for path in () if self.appends else written:
            if path.is_dir():
                raise PoseFileError(f"{path}: is a folder; name a file in it.")
            if path.exists() and not options.overwrite:
                found = "is there already and was not touched"
                raise PoseFileError(f"{path}: {found}; name another, or add --overwrite.")
        for path, content in written.items():
            if path.parent == out:
                make_folder(out)
            data = content if isinstance(content, bytes) else content.encode()
            write_whole(path, data, PoseFileError)
        return [*files, *written], notes


def _of_undistorted(view: s.ViewRecord, path: Path, options: ConvertOptions) -> s.ViewRecord:
    if not view.path.is_file():
        found = "The pose is one in the undistorted photo, and that as taken is not known"
        raise PoseFileError(f"{found}, of which it is made; add --photo FILE.")
    opened, differences = s.open_view(structs.replace(view, mask=None))
    if differences:
        found = f"{opened.name}: not the photo of the pose (the fingerprints differ)"
        raise PhotoFileError(f"{found}; name that one with --photo, or this one if you mean it.")
    is_taken = path.exists() and path.samefile(view.path)
    if not path.exists() or (options.overwrite and not is_taken):
        save_photo(path, opened.photo, is_own=True)
    elif is_taken or not np.array_equal(load_photo(path).pixels, opened.photo.pixels):
        wanted = "move it away: the undistorted photo is to be written there"
        raise PhotoFileError(f"{path}: is there already and was not touched; {wanted}.")
    return s.ViewRecord.of(path, view.camera, place=view.place.rigid)


def from_4x4(reading: Reading, values: Any, what: str) -> RigidTransform:
    """The rigid transform in 4 rows of 4 numbers (or 3, without the last), or all in one list."""
    numbers = reading.flat_numbers(values, what)
    if len(numbers) not in (12, 16):
        raise reading.error(f"{what} has {len(numbers)} numbers", "wanted 4 rows of 4, or 3 of 4")
    matrix, last = np.reshape(numbers, (-1, 4)), numbers[12:]
    if last and not np.allclose(last, (0.0, 0.0, 0.0, 1.0), rtol=0.0, atol=1e-9):
        raise reading.error(f"the last row of {what} is {last}", "wanted 0 0 0 1 (row-major)")
    return RigidTransform(checked_rotation(reading, matrix[:3, :3]), matrix[:3, 3])


def in_one_world(scene: s.SceneRecord) -> tuple[list[FloatArray], list[Pose]]:
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
        place = Similarity(OPENGL_FROM_OPENCV @ pose.camera_from_model, ratio).as_matrix()
        place[:2, 3] *= ratio
        places.append(place)
    return places, [Pose(camera, OPENGL_FROM_OPENCV.inverse())]


def perspective_of(camera: Camera, tool: str) -> Perspective:
    """The camera, unless it is one of parallel projection."""
    if isinstance(camera, Perspective):
        return camera
    found = f"The pose is one of parallel projection, which {tool} files cannot hold"
    raise PoseFileError(f"{found}; convert it to gltf, or fit it in perspective.")


def require_file(path: Path, what: str, tool: str) -> Path:
    """A photo or model that a format cannot do without."""
    if not path.name:
        raise PoseFileError(f"{tool} files name the {what}, and none is known; add --{what} FILE.")
    if not path.is_file():
        raise PoseFileError(f"{path}: no such file; name the {what} with --{what} FILE.")
    return path


def metres_per_unit(unit: str) -> float:
    """The size of a length unit; raises PoseFileError where it is none of ``METRES``."""
    if unit not in METRES:
        wanted = f"wanted one of {', '.join(METRES)}, say it with --unit"
        raise PoseFileError(f"The model's unit is {unit!r}; {wanted}.")
    return METRES[unit]


def cameras_as_taken(
    scene: s.SceneRecord, tool: str, lenses: Lenses
) -> Iterator[tuple[Path, RigidTransform, Perspective, str, tuple[float, ...]]]:
    """List for each photo as taken its path, ``camera_from_model`` of the only object, the camera
    (pixel centres at i + 0.5), and the tool's name of its lens and coefficients.
    """
    for index, view in enumerate(scene.views):
        perspective_of(view.camera, tool)
        taken = _as_taken(view, lenses)
        assert taken is not None  # of other views the undistorted photo is written
        yield view.path, scene.pose(0, index).camera_from_model, *taken


def _as_taken(
    view: s.ViewRecord, lenses: Lenses
) -> tuple[Perspective, str, tuple[float, ...]] | None:
    """Camera of a view's photo as taken, and name and coefficients of the first model that holds
    its lens; None where a format has no such model, or the camera is another by now.
    """
    camera, undistortion, model, k = view.camera, view.undistortion, "opencv", ()
    if not isinstance(camera, Perspective):
        return None
    if undistortion is not None:
        if not np.allclose(astuple(camera), astuple(undistortion.camera), rtol=CAMERA_TOLERANCE):
            return None
        lens, camera = undistortion.lens, undistortion.taken
        model, k = lens.model, lens.coefficients
    for name, known, count in lenses:
        if known == model and not any(k[count:]):
            return camera, name, (*k, *[0.0] * count)[:count]
    return None
