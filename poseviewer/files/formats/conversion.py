"""Formats, the options of a conversion, and the photo that the numbers of a file belong to.

A tool that has the photo's lens model gets camera and lens of the photo as taken; every other gets
the undistorted photo, written beside its file, and the pinhole camera of that.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from poseviewer.errors import PhotoFileError, PoseFileError, list_names, printable
from poseviewer.files.checks import MAX_DATA_BYTES, InputFile, repair_rotation
from poseviewer.files.mesh.size import METRES
from poseviewer.files.photo import load_photo, orientation_of, save_photo
from poseviewer.files.scene_assets import model_file, open_view, view_of_file, with_photo
from poseviewer.files.structs import check_camera
from poseviewer.files.writing import make_folder, sha256_of, write_whole
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV
from poseviewer.geometry.image import ASSUMED_FOCAL
from poseviewer.geometry.lens import (
    CAMERA_TOLERANCE,
    MIRRORED,
    UPRIGHT,
    WAY_BACK,
    LensModel,
    Undistortion,
    rotate_camera,
    rotate_lens,
    turn_axes,
)
from poseviewer.geometry.transform import RigidTransform, Similarity
from poseviewer.geometry.world_pose import WORLD
from poseviewer.scene.types import Scene, SceneObject, View

Entry = TypeVar("Entry")
Contents = Mapping[Path, str | bytes]
MAX_NAMED = 10
TURNED = "stored turned (EXIF)"


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
    """The only object's number (BOP)."""
    object_ids: tuple[int | None, ...] = ()
    """Numbers of all objects, in their order, in place of those that names say; None: as these."""
    calibration: Path | None = None
    """The file of the photo's camera, for files that do not say it."""
    lens_model: LensModel | None = None
    """OpenCV's model of its lens, for files that do not say it."""
    opengl: bool = False
    """Whether a matrix's camera looks along -z, y up."""
    inverse: bool = False
    """Whether a matrix is that of the model from the camera."""
    overwrite: bool = False

    def number_of(self, scene: Scene, view: int) -> str | None:
        """Name or number of a view's image where images are numbered: of several photos whose names
        are no numbers, the place of the view.
        """
        stems = [own.file.location.stem for own in scene.views]
        is_numbered = all(map(str.isdecimal, stems)) and len(set(map(int, stems))) == len(stems)
        counts = self.image is None and len(stems) > 1 and not is_numbered
        return str(view) if counts else self.image_of(view)

    def image_of(self, view: int) -> str | None:
        """Name or number of a view's image; numbers count on from the first view's."""
        if view == 0 or self.image is None:
            return self.image
        return str(int(self.image) + view) if self.image.isdecimal() else None

    def unit_of(self, scene: Scene) -> str | None:
        """The models' unit: what the user says, else what the scene says."""
        return self.unit or next((o.model.unit for o in scene.objects if o.model.unit), None)

    def lengths_in(self, unit: str, scene: Scene, tool: str) -> float:
        """Return the tool's ``unit`` in the models'.

        Raises:
            PoseFileError: that is unknown.
        """
        own = self.unit_of(scene)
        if own is None and scene.unit in METRES and not scene.free_scale and scene.objects:
            # What several cameras say of their world.
            length = scene.objects[0].world_from_model.scale * metres_per_unit(scene.unit)
            return length / metres_per_unit(unit)
        if own is None:
            found = f"{tool} wants {unit}, and the model's unit is not known"
            raise PoseFileError(f"{found}; say it with `unit`.")
        return metres_per_unit(own) / metres_per_unit(unit)

    def size_of(
        self, file: InputFile, size: tuple[Any, Any], photo: Path | None = None
    ) -> tuple[int, int]:
        """Return the photo's size, px: as the file says, else the photo, else the user."""
        if None in size and photo is not None and photo.is_file():
            opened = load_photo(photo)
            size = opened.width, opened.height
        size = (self.photo_size or size) if None in size else size
        width, height = file.size(size[0], "the photo's width"), file.size(size[1], "its height")
        if width is None or height is None:
            wanted = "add `photo_size`"
            raise file.error("it does not say how large the photo is", wanted)
        if self.photo_size not in (None, (width, height)):
            asked = "x".join(map(str, self.photo_size or ()))
            raise file.error(f"it is for a photo of {width}x{height} px", f"not of {asked} px")
        return width, height

    def with_size(self, file: InputFile, view: View) -> View:
        """Give a view the size of its photo, by ``size_of``."""
        size = view.file.width or None, view.file.height or None
        return view.resize_photo(*self.size_of(file, size, view.file.location))

    def the_one(self, file: InputFile, kind: str, entries: Iterable[tuple[str, Entry]]) -> Entry:
        """The entry that ``image`` names, with or without folders, or the only one."""
        image, known = self.image, list(entries)
        chosen = [item for name, item in known if image is None or image in (name, Path(name).name)]
        if len(chosen) != 1:
            meant = repr(image) if image else "meant"
            found = f"{len(chosen)} of its {len(known)} {kind} are {meant}"
            names = printable(list_names([name for name, _ in known]))
            raise file.error(found, f"wanted one, choose it with `image` ({names})")
        return chosen[0]

    def scene_of(
        self, file: InputFile, view: View, unit: str | None = None, is_of_stored: bool = False
    ) -> Scene:
        """Make the scene of a view whose world is the model's frame.

        Args:
            file: the file that was read.
            view: its view.
            unit: the model's by the file; the user's own comes first.
            is_of_stored: whether the view is of pixels as stored, whatever EXIF says.
        """
        check_camera(file, view.camera)
        photo = self.photo or view.file.location
        if is_of_stored:
            said: list[str] = []
            view = as_shown(view, photo, said)
            file.warnings.extend(f"{photo.name}: {note}" for note in said)
        elif orientation_of(photo) != UPRIGHT:
            found = f"{photo.name} is {TURNED}"
            file.warnings.append(f"{found}; the pose is taken as one in the upright photo.")
        model = model_file(Path(), unit=self.unit or unit)
        item = SceneObject(id="1", model=model, world_from_model=Similarity(view.camera_from_world))
        view = replace(view, camera_from_world=WORLD)
        notes = tuple(file.warnings)
        return Scene(views=(self.with_size(file, view),), objects=(item,), notes=notes)


Lenses = Sequence[tuple[str, LensModel, int]]
"""A format's lens models, poorest first: its name, OpenCV's model, and count of coefficients."""


@dataclass(frozen=True, slots=True)
class Format:
    """A tool's format."""

    write: Callable[[Scene, Path, ConvertOptions, list[str]], Contents]
    """Gives what the files hold, of a scene, where to, and what else is known; adds notes."""
    read: Callable[[Path, ConvertOptions], Scene]
    ending: str = ""
    """Ending of the file that the app names; "": a folder."""
    lenses: Lenses = ()
    several_photos: bool = True
    several_objects: bool = False
    """Whether it can say several objects."""
    several_of_both: bool = False
    """Whether it can say several objects in each of several photos."""
    is_own: bool = False
    """Whether it is our own: it says which photo, undistorted or not, its numbers belong to."""
    is_upright: bool = False
    """Whether its photo is upright whatever its EXIF says."""
    is_of_stored: bool = False
    """Whether camera and pose are those of pixels as stored, whatever EXIF says."""
    appends: bool = False
    """Whether what is written keeps what was there."""
    photos_in: str | None = None
    """Folder, in the output, of undistorted photos, and of all of several; None: beside the file
    that is written.
    """
    require: Callable[[Scene, ConvertOptions], object] = lambda _scene, _options: None
    """Raises ``PoseFileError`` for what is not known, before any photo is written."""

    def convert(
        self, scene: Scene, out: Path, options: ConvertOptions
    ) -> tuple[list[Path], list[str]]:
        """Write a scene, and undistorted photos if need be; return all files, and notes."""
        self.require(scene, options)
        notes, photos, views = list[str](), list[Path](), list[View]()
        as_taken, undone = dict[str, list[str]](), list[str]()
        for number, view in enumerate(self._views_that_it_holds(scene, notes)):
            name = view.file.location.name or "the photo"
            is_undistorted = view.file.undistortion is not None and not self.is_own
            is_there = view.file.location.is_file()
            if is_undistorted and (taken := _as_taken(view, self.lenses)):
                as_taken.setdefault(taken[1], []).append(name)
            elif is_undistorted and views and not is_there:
                notes.append(f"{name} is not there to be undistorted: left out.")
                continue
            elif is_undistorted:
                path = self._path_of_photo(out, scene, number, options)
                view = _of_undistorted(view, path, options)
                photos.append(view.file.location)
                undone.append(name)
            elif self.photos_in and len(scene.views) > 1 and is_there:
                path = self._path_of_photo(out, scene, number, options)
                view = _copy_beside(view, path.with_suffix(""), options)
                photos.append(view.file.location)
            views.append(self._turned(view, name, notes, is_first=not views))
        for lens, names in as_taken.items():
            said = list_names(names, MAX_NAMED)
            notes.append(f"Camera and lens ({lens}) are those of {said} as taken.")
        if undone:
            other = (
                f"{photos[0].name}, the undistorted photo, which is written; not to that as taken"
            )
            if len(undone) > 1:
                other = "the undistorted photos, which are written; not to those as taken"
            notes.append(f"All numbers of {list_names(undone, MAX_NAMED)} belong to {other}.")
        if (assumed := focal_guess_note(scene)) and not self.is_own:
            notes.append(assumed)
        contents = self.write(replace(scene, views=tuple(views)), out, options, notes)
        if not self.appends:
            require_free(contents, options.overwrite)
        for path, content in contents.items():
            if path.parent == out:
                make_folder(out)
            data = content if isinstance(content, bytes) else content.encode()
            write_whole(path, data, PoseFileError)
        return [*photos, *contents], notes

    def _views_that_it_holds(self, scene: Scene, notes: list[str]) -> Sequence[View]:
        """Return all views, or the first where the format holds no more.

        Raises:
            PoseFileError: it does not hold so many objects.
        """
        several, others = len(scene.objects) > 1, len(scene.views) - 1
        if several and not self.several_objects:
            wanted = "choose an object with `object_id`, or convert all to bop, dope, gltf, meshlab"
            raise PoseFileError(f"Such a file holds one pose; {wanted}.")
        if self.several_photos and (self.several_of_both or not several):
            return scene.views
        if others:
            notes.append(f"It holds one photo: the other {others} of the set are left out.")
        return scene.views[:1]

    def _path_of_photo(self, out: Path, scene: Scene, view: int, options: ConvertOptions) -> Path:
        """Return the file of an undistorted photo."""
        name = scene.views[view].file.location.name or "the photo"
        if self.photos_in is None:
            stem = Path(options.image_of(view) or name).stem
            return out.parent / f"{stem}.undistorted.png"
        stem = Path(options.number_of(scene, view) or name).stem
        make_folder(out / self.photos_in)
        return out / self.photos_in / f"{stem.zfill(6)}.png"  # BOP numbers images by their names

    def _turned(self, view: View, name: str, notes: list[str], *, is_first: bool) -> View:
        """Return a view in the pixels that the tool takes: as stored, or upright."""
        orientation = orientation_of(view.file.location)
        if self.is_of_stored and orientation not in (UPRIGHT, *MIRRORED):
            notes.append(f"{name} is {TURNED}; camera and pose are of the stored pixels.")
            return turn_view(view, WAY_BACK[orientation])
        if is_first and orientation != UPRIGHT and not (self.is_own or self.is_upright):
            found = f"{name} is {TURNED}, and the pose is one in the upright photo"
            notes.append(f"{found}; save it upright for tools that do not turn it.")
        return view


def require_free(paths: Iterable[Path], may_replace: bool) -> None:
    """Refuse to write where there is a folder, or a file that is not to be replaced.

    Raises:
        PoseFileError: one of the paths is so.
    """
    for path in paths:
        if path.is_dir():
            raise PoseFileError(f"{path}: is a folder; name a file in it.")
        if path.exists() and not may_replace:
            wanted = "name another, or replace it with `overwrite`"
            raise PoseFileError(f"{path}: is there already and was not touched; {wanted}.")


def focal_guess_note(scene: Scene) -> str:
    """The results' note on a focal length that had to be assumed; "": none was."""
    results = (item.result for item in scene.objects if item.result is not None)
    notes = (note for result in results for note in result.notes)
    return next((note for note in notes if note.startswith(ASSUMED_FOCAL)), "")


def turn_view(view: View, orientation: int) -> View:
    """Turn a view by EXIF's orientation.

    Raises:
        PoseFileError: no camera sees that picture.
    """
    file, known = view.file, view.file.undistortion
    place = view.camera_from_world
    try:
        if orientation in MIRRORED:
            raise ValueError("a mirror image")
        if known is not None:
            cameras = (rotate_camera(one, orientation) for one in (known.taken, known.camera))
            known = Undistortion(rotate_lens(known.lens, orientation), *cameras)
    except ValueError as error:
        found = f"{view.name}: its EXIF turns it, and it has {error}"
        raise PoseFileError(f"{found}; save it upright, and find the pose anew.") from None
    axes, camera = turn_axes(orientation), rotate_camera(view.camera, orientation)
    place = RigidTransform(axes @ place.rotation, axes @ place.translation)
    return view_of_file(file.location, camera, file.sha256, known, place)


def as_shown(view: View, photo: Path, notes: list[str]) -> View:
    """The view of a tool that takes pixels as stored, in the ``photo`` as it is shown, upright."""
    if (orientation := orientation_of(photo)) == UPRIGHT:
        return view
    shown = load_photo(photo)
    stored = (shown.height, shown.width) if orientation > 4 else (shown.width, shown.height)
    size = (view.file.width, view.file.height) if view.file.width else stored
    if orientation > 4 and (size[0] > size[1]) != (stored[0] > stored[1]):
        return view  # made of the upright photo
    notes.append(f"It is {TURNED}; camera and pose, of the stored pixels, were turned with it.")
    return turn_view(view.resize_photo(*size), orientation)


def _of_undistorted(view: View, path: Path, options: ConvertOptions) -> View:
    if not view.file.location.is_file():
        found = "The pose is one in the undistorted photo, and that as taken is not known"
        raise PoseFileError(f"{found}, of which it is made; add `photo`.")
    opened, differences = open_view(replace(view, mask=None))
    if differences:
        found = f"{opened.name}: not the photo of the pose (the fingerprints differ)"
        raise PhotoFileError(f"{found}; name that one with `photo`, or this one if you mean it.")
    is_taken = path.exists() and path.samefile(view.file.location)
    if not path.exists() or (options.overwrite and not is_taken):
        save_photo(path, opened.photo, is_own=True)
    elif is_taken or not np.array_equal(load_photo(path).pixels, opened.photo.pixels):
        wanted = "move it away: the undistorted photo is to be written there"
        raise PhotoFileError(f"{path}: is there already and was not touched; {wanted}.")
    return view_of_file(path, view.camera, camera_from_world=view.camera_from_world)


def copy_photo(view: View, path: Path) -> Path:
    """Copy a view's photo to ``path`` and its ending; one that is distorted or stored turned as a
    PNG as it is shown.
    """
    taken = view.file.location
    if view.file.undistortion is not None or orientation_of(taken) != UPRIGHT:
        save_photo(path.with_suffix(".png"), view.file.read())  # which keeps nothing
        return path.with_suffix(".png")
    copied = path.with_suffix(taken.suffix.lower())
    photo = InputFile(taken, [], PhotoFileError, "photo", MAX_DATA_BYTES)
    write_whole(copied, photo.load_bytes(), PoseFileError)
    return copied


def _copy_beside(view: View, path: Path, options: ConvertOptions) -> View:
    """The view of a photo's copy; one that lies there, or in a folder beside, stays."""
    taken = view.file.location.resolve()
    if path.parent.parent.resolve() in taken.parents:
        return view
    there = [
        own for own in path.parent.glob(f"{path.name}.*") if sha256_of(own) != sha256_of(taken)
    ]
    if there and not options.overwrite:
        wanted = "move it away, or replace it with `overwrite`"
        raise PhotoFileError(f"{there[0]}: is another photo than {view.name}; {wanted}.")
    for own in there:
        own.unlink()
    return with_photo(view, copy_photo(view, path))


def from_4x4(file: InputFile, values: Any, what: str) -> RigidTransform:
    """The rigid transform in 4 rows of 4 numbers (or 3, without the last), or all in one list."""
    numbers = file.flat_numbers(values, what)
    if len(numbers) not in (12, 16):
        raise file.error(f"{what} has {len(numbers)} numbers", "wanted 4 rows of 4, or 3 of 4")
    matrix, last = np.reshape(numbers, (-1, 4)), numbers[12:]
    if last and not np.allclose(last, (0.0, 0.0, 0.0, 1.0), rtol=0.0, atol=1e-9):
        raise file.error(f"the last row of {what} is {last}", "wanted 0 0 0 1 (row-major)")
    return RigidTransform(repair_rotation(file, matrix[:3, :3]), matrix[:3, 3])


def in_one_world(scene: Scene, of_camera: bool = False) -> tuple[list[FloatArray], list[Pose]]:
    """Return world from model (4, 4) for each object, and each view's camera from the world.

    The world is the model's frame or, with several objects or ``of_camera``, the first camera's
    with OpenGL's axes; lengths are in the models' unit.
    """
    if len(scene.objects) == 1 and not of_camera:
        return [np.eye(4)], [scene.pose(0, view) for view in range(len(scene.views))]
    return places_by_camera(scene), [Pose(scene.views[0].camera, OPENGL_FROM_OPENCV.inverse())]


def places_by_camera(scene: Scene) -> list[FloatArray]:
    """Return each object's (4, 4) in the first camera's frame with OpenGL's axes."""
    camera, places = scene.views[0].camera, []
    for index in range(len(scene.objects)):
        pose, ratio = scene.pose(index), 1.0
        if isinstance(pose.camera, Parallel) and isinstance(camera, Parallel):
            ratio = pose.camera.scale / camera.scale  # as large in the picture, and no farther
        place = Similarity(OPENGL_FROM_OPENCV @ pose.camera_from_model, ratio).as_matrix()
        place[:2, 3] *= ratio
        places.append(place)
    return places


def perspective_of(camera: Camera, tool: str) -> Perspective:
    """The camera, unless it is one of parallel projection."""
    if isinstance(camera, Perspective):
        return camera
    found = f"The pose is one of parallel projection, which {tool} files cannot hold"
    raise PoseFileError(f"{found}; convert it to gltf, or fit it in perspective.")


def require_file(path: Path, what: str, tool: str) -> Path:
    """A photo or model that a format cannot do without."""
    if not path.name:
        raise PoseFileError(f"{tool} files name the {what}, and none is known; add `{what}`.")
    if not path.is_file():
        raise PoseFileError(f"{path}: no such file; name the {what} with `{what}`.")
    return path


def metres_per_unit(unit: str) -> float:
    """Return the size of a length unit.

    Raises:
        PoseFileError: it is none of ``METRES``.
    """
    if unit not in METRES:
        wanted = f"wanted one of {', '.join(METRES)}, say it with `unit`"
        raise PoseFileError(f"The model's unit is {unit!r}; {wanted}.")
    return METRES[unit]


def cameras_as_taken(
    scene: Scene, tool: str, lenses: Lenses
) -> Iterator[tuple[Path, RigidTransform, Perspective, str, tuple[float, ...]]]:
    """Iterate over photos as taken: path, camera_from_model, camera, lens model, coefficients."""
    for index, view in enumerate(scene.views):
        perspective_of(view.camera, tool)
        taken = _as_taken(view, lenses)
        assert taken is not None  # of other views the undistorted photo is written
        yield view.file.location, scene.pose(0, index).camera_from_model, *taken


def _as_taken(view: View, lenses: Lenses) -> tuple[Perspective, str, tuple[float, ...]] | None:
    """Return camera, lens model and coefficients of the photo as taken, if the format has it."""
    camera, undistortion = view.camera, view.file.undistortion
    model, k = "opencv", ()
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
