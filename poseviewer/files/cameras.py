"""Cameras in files, and the one that took a photo, chosen and scaled."""

import re
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from poseviewer.errors import CalibrationFileError, list_names
from poseviewer.files.camera_forms import FileCamera, cameras_in
from poseviewer.files.camera_trees import TREES, load_tree
from poseviewer.files.checks import InputFile
from poseviewer.files.colmap_model import colmap_cameras, colmap_images
from poseviewer.files.structs import check_camera
from poseviewer.geometry.lens import UPRIGHT, LensModel, rotate_camera, rotate_lens

KIND = "file of cameras"
MAX_HEAD_LETTERS = 2000
COLMAP_LIKE = re.compile(rb"^[^\S\n]*+\d++\s++[A-Z_]++\s++\d++\s++\d", re.MULTILINE)
"""A line of COLMAP's cameras: number, model, width and height."""
FAR_OFF = 0.3
"""Offset of a principal point, in the photo's sides, that lenses which shift do not reach."""
MIN_FOCAL = 0.02
"""Focal length in widths of the photo, which then shows 175 degrees."""


def load_cameras(
    path: str | Path, lens_model: LensModel | None = None, photo: tuple[int, int] = (0, 0),
    is_turned: bool = False,
) -> list[FileCamera]:  # fmt: skip
    """Load all cameras in a file, as ``cameras_in``.

    Args:
        path: file of one of the endings ``TREES``, or COLMAP's.
        lens_model: OpenCV's model of the lens where the file does not say it.
        photo: width and height of the pictures (px) where the file does not say them.
        is_turned: whether EXIF turns these by 90 degrees.
    """
    file = InputFile(Path(path), [], CalibrationFileError, KIND, numbers_as_text=True)
    ending = file.path.suffix.lower()
    with file.naming_errors():
        head = file.load_bytes()[:MAX_HEAD_LETTERS] if ending == ".txt" else b""
        is_named = bool(head) and file.path.stem == "cameras"
        if ending == ".bin" or is_named or COLMAP_LIKE.search(head):
            cameras = _colmap_cameras(file)
        elif ending in ("", *TREES):
            cameras = cameras_in(file, load_tree(file), lens_model, photo, is_turned)
        else:
            wanted = f"wanted {', '.join(TREES)} or .bin"
            if ending == ".xmp":
                wanted = "of RealityCapture export internal and external parameters as CSV"
            raise file.error(f"its ending is {ending or 'missing'}", wanted)
        return [replace(entry, camera=check_camera(file, entry.camera)) for entry in cameras]


def _colmap_cameras(file: InputFile) -> list[FileCamera]:
    """Cameras by their CAMERA_ID; the ``images`` file beside says which photos each took."""
    photos, beside = defaultdict[str, set[str]](set), file.path.with_stem("images")
    if beside.is_file():
        for name, key, _ in colmap_images(replace(file, path=beside)):
            photos[key].add(PurePosixPath(name).name)
    known, read = colmap_cameras(file).items(), "COLMAP's model"
    return [FileCamera(key, *camera, frozenset(photos[key]), read, True) for key, camera in known]


ROUNDING_PX = 1.0
"""By how much a picture's size may differ from an exact scaling: programs round and cut off."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """A file of cameras, and what the user says of it."""

    path: Path
    camera: str | None = None
    """Which camera of the file; None: the only one, or the one that took the photo."""
    lens_model: LensModel | None = None
    """OpenCV's model of the coefficients; None: as the file says, or their number."""


def load_calibration(
    choice: Calibration, photo: str, width: int, height: int, orientation: int = UPRIGHT
) -> tuple[FileCamera, tuple[str, ...]]:
    """Load the camera of an upright photo, turned and scaled if need be; notes say so.

    Args:
        choice: the file, and which of its cameras.
        photo: the photo's file name.
        width: px, of the upright photo.
        height: px, likewise.
        orientation: EXIF's, 1 to 8, of the photo as stored.

    Raises:
        PoseViewerError: the file cannot be used, or not with this photo.
    """
    file = InputFile(choice.path, error_type=CalibrationFileError)
    stored = (height, width) if orientation > 4 else (width, height)
    cameras = load_cameras(choice.path, choice.lens_model, stored, orientation > 4)
    chosen = _choose_camera(file, choice, cameras, photo, stored)
    notes = tuple[str, ...]()
    if orientation != UPRIGHT:
        taken, chosen = chosen, _upright(file, chosen, orientation, stored)
        turned = "belongs to the stored pixels and was turned with it"
        said = "is taken to be that of the upright photo" if chosen is taken else turned
        notes = (f"{choice.path.name}: {photo} is stored turned (EXIF), its camera {said}.",)
    camera = chosen.camera
    size = f"{camera.width}x{camera.height} px"
    if not (0.0 <= camera.cx <= camera.width and 0.0 <= camera.cy <= camera.height):
        said = f"its principal point, {camera.cx - 0.5:g}, {camera.cy - 0.5:g}, lies outside"
        raise file.error(f"{said} the photo's {size}", "calibrate on pictures of the photo's size")
    if camera.fx < MIN_FOCAL * camera.width:
        raise file.error(f"a focal length of {camera.fx:g} px", "wanted px, not sides of a photo")
    off = (abs(camera.cx / camera.width - 0.5), abs(camera.cy / camera.height - 0.5))
    if max(off) > FAR_OFF:
        found = f"its principal point, {camera.cx - 0.5:g}, {camera.cy - 0.5:g}, is far from"
        asked = "is the photo cut out of a larger one?"
        notes += (f"{choice.path.name}: {found} the middle of the photo's {size}; {asked}",)
    if (camera.width, camera.height) == (width, height):
        return chosen, notes
    said = f"the camera is for {size}, the photo has {width}x{height} px"
    sides = ((width, camera.width), (height, camera.height))
    least = max((side - ROUNDING_PX) / own for side, own in sides)
    if least > min((side + ROUNDING_PX) / own for side, own in sides):  # no one factor
        raise file.error(said, "calibrate on pictures of the photo's size and orientation")
    scaled = replace(chosen, camera=camera.resize(width, height))
    return scaled, (*notes, f"{choice.path.name}: {said}; it was scaled to the photo's size.")


def _upright(
    file: InputFile, taken: FileCamera, orientation: int, stored: tuple[int, int]
) -> FileCamera:
    own, is_of_stored = taken.camera, taken.is_of_stored
    if orientation > 4 and own.width != own.height:
        is_of_stored = (own.width > own.height) == (stored[0] > stored[1])
    if not is_of_stored:
        return taken
    try:
        lens = taken.lens and rotate_lens(taken.lens, orientation)
    except ValueError as error:
        found = f"{error}, and EXIF turns the photo"
        raise file.error(found, "save the photo upright, and calibrate anew") from None
    return replace(taken, camera=rotate_camera(own, orientation), lens=lens)


def _choose_camera(
    file: InputFile, choice: Calibration, cameras: list[FileCamera], photo: str,
    size: tuple[int, int],
) -> FileCamera:  # fmt: skip
    names = [repr(camera.name) if camera.name else "one without a name" for camera in cameras]
    known = list_names(names)
    if choice.camera is not None:
        named = [camera for camera in cameras if camera.name == choice.camera]
        if not named:
            raise file.error(f"no camera {choice.camera[:30]!r} in it", f"it has {known}")
        return named[0]
    if all((c.camera, c.lens) == (cameras[0].camera, cameras[0].lens) for c in cameras):
        return cameras[0]
    # BOP numbers its photos: 000017.png is the scene's 17.
    stem = Path(photo).stem
    number = str(int(stem)) if stem.isdecimal() else None
    named = [c for c in cameras if photo in c.photos] or [c for c in cameras if c.name == number]
    named = named or [c for c in cameras if (c.camera.width, c.camera.height) == size]
    if len(named) != 1:
        found = f"{len(cameras)} cameras, {known}, and none of them named after {photo}"
        raise file.error(found, "choose one with `Calibration.camera`")
    return named[0]
