"""Cameras in files: those of ``camera_forms``, and COLMAP's; and the one that took a photo, chosen
and scaled.
"""

from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from poseviewer.errors import CalibrationFileError, list_names
from poseviewer.files.camera_forms import TREES, FileCamera, cameras_in, is_matrix, load_tree
from poseviewer.files.checks import Reading
from poseviewer.files.colmap_model import colmap_cameras, colmap_images
from poseviewer.files.structs import checked_camera

KIND = "file of cameras"
LEAST_FOCAL = 0.02
"""Focal length in widths of the photo, which then shows 175 degrees."""


def load_cameras(
    path: str | Path, fisheye: bool = False, photo: tuple[int, int] = (0, 0)
) -> list[FileCamera]:
    """All cameras in a file, as ``cameras_in`` has them."""
    reading = Reading(Path(path), [], CalibrationFileError, KIND, numbers_as_text=True)
    ending = reading.path.suffix.lower()
    with reading.naming_errors():
        if ending == ".bin" or (ending == ".txt" and not is_matrix(reading)):
            cameras = _colmap_cameras(reading)
        elif ending in TREES:
            cameras = cameras_in(reading, load_tree(reading), fisheye, photo)
        else:
            wanted = f"wanted {', '.join(TREES)} or .bin"
            raise reading.error(f"its ending is {ending or 'missing'}", wanted)
        return [replace(entry, camera=checked_camera(reading, entry.camera)) for entry in cameras]


def _colmap_cameras(reading: Reading) -> list[FileCamera]:
    """Cameras by their CAMERA_ID; the ``images`` file beside says which photos each took."""
    photos, beside = defaultdict[str, set[str]](set), reading.path.with_stem("images")
    if beside.is_file():
        for name, key, _ in colmap_images(replace(reading, path=beside)):
            photos[key].add(PurePosixPath(name).name)
    known, read = colmap_cameras(reading).items(), "COLMAP's model"
    return [FileCamera(key, *camera, frozenset(photos[key]), read) for key, camera in known]


ROUNDING_PX = 1.0
"""By how much a picture's size may differ from an exact scaling: programs round and cut off."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """A file of cameras, and what the user says of it."""

    path: Path
    camera: str | None = None
    """Which camera of the file; None: the only one, or the one that took the photo."""
    fisheye: bool = False
    """The coefficients are of OpenCV's fisheye model, though the file does not say so."""


def load_calibration(
    choice: Calibration, photo: str, width: int, height: int
) -> tuple[FileCamera, tuple[str, ...]]:
    """Load the camera of a photo of this name and size, scaled if need be; notes say so."""
    reading = Reading(choice.path, error_type=CalibrationFileError)
    chosen = _chosen(
        reading, choice, load_cameras(choice.path, choice.fisheye, (width, height)), photo
    )
    camera = chosen.camera
    size = f"{camera.width}x{camera.height} px"
    if not (0.0 <= camera.cx <= camera.width and 0.0 <= camera.cy <= camera.height):
        said = f"its principal point, {camera.cx - 0.5:g}, {camera.cy - 0.5:g}, lies outside"
        wanted = "calibrate on pictures of the photo's size"
        raise reading.error(f"{said} the photo's {size}", wanted)
    if camera.fx < LEAST_FOCAL * camera.width:
        found = f"a focal length of {camera.fx:g} px"
        raise reading.error(found, "wanted px, not sides of a photo")
    if (camera.width, camera.height) == (width, height):
        return chosen, ()
    said = f"the camera is for {size}, the photo has {width}x{height} px"
    sides = ((width, camera.width), (height, camera.height))
    least = max((side - ROUNDING_PX) / own for side, own in sides)
    if least > min((side + ROUNDING_PX) / own for side, own in sides):  # no one factor
        wanted = "calibrate on pictures of the photo's size and orientation"
        raise reading.error(said, wanted)
    scaled = replace(chosen, camera=camera.resize(width, height))
    return scaled, (f"{choice.path.name}: {said}; it was scaled to the photo's size.",)


def _chosen(
    reading: Reading, choice: Calibration, cameras: list[FileCamera], photo: str
) -> FileCamera:
    names = [repr(camera.name) if camera.name else "one without a name" for camera in cameras]
    known = list_names(names)
    if choice.camera is not None:
        named = [camera for camera in cameras if camera.name == choice.camera]
        if not named:
            raise reading.error(f"no camera {choice.camera[:30]!r} in it", f"it has {known}")
        return named[0]
    # BOP numbers its photos: 000017.png is the scene's 17.
    stem = Path(photo).stem
    number = str(int(stem)) if stem.isdecimal() else None
    named = [c for c in cameras if photo in c.photos] or [c for c in cameras if c.name == number]
    if 1 not in (len(cameras), len(named)):
        found = f"{len(cameras)} cameras, {known}, and none of them named after {photo}"
        raise reading.error(found, "choose one by --calibration-camera NAME")
    return cameras[0] if len(cameras) == 1 else named[0]
