"""Photos and models of a scene: read now, or when first asked for."""

from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from poseviewer.errors import PoseFileError, list_names, printable
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_header, load_photo, undistort_photo
from poseviewer.files.pose import check_against
from poseviewer.files.structs import PhotoReference
from poseviewer.files.symmetry import load_symmetry
from poseviewer.files.writing import sha256_of
from poseviewer.geometry.camera import Camera, Perspective
from poseviewer.geometry.image import Photo
from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh_symmetry import find_symmetry
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.world_pose import WORLD
from poseviewer.scene.assets import ModelContent, ModelFile, PhotoFile
from poseviewer.scene.types import Scene, View

MAX_NAMED = 5


def view_of_file(
    path: Path, camera: Camera, sha256: str | None = None, lens: Lens | Undistortion | None = None,
    camera_from_world: RigidTransform = WORLD, mask: Mask | None = None,
) -> View:  # fmt: skip
    """Make the view of a photo that is read when first asked for.

    Args:
        path: the photo's file.
        camera: its camera, pixel centres at i + 0.5; of 0x0 px, where the size is not known.
        sha256: hash of the file's bytes, hexadecimal, as far as it is known.
        lens: one of the photo as taken by that camera.
        camera_from_world: where the camera stands in the world.
        mask: weight of each pixel.
    """
    undone = lens if isinstance(lens, Undistortion) else None
    if isinstance(lens, Lens) and isinstance(camera, Perspective):
        undone = Undistortion.of(lens, camera)
    size = camera.width, camera.height
    read = cache(partial(_read, path, size, undone))
    file = PhotoFile(path, printable(path.name), *size, sha256, undone, read=read)
    return View(file, camera, camera_from_world, mask)


def frame_file(path: Path, view: View, sha256: str | None = None) -> PhotoFile:
    """Name another photo of a view's camera and lens; each handle of it reads the file anew."""
    size, undone = (view.camera.width, view.camera.height), view.file.undistortion
    read = partial(_read, path, size, undone)
    return PhotoFile(path, printable(path.name), *size, sha256, undone, read=read)


def check_frames(scene: Scene) -> tuple[str, ...]:
    """Compare the files of frames that have poses with their fingerprints; return a sentence on
    those that differ, or none.
    """
    frames = [frame for frame in scene.frames if frame.poses and frame.file.sha256]
    changed = [frame.file.name for frame in frames if not _is_unchanged(frame.file)]
    if not changed:
        return ()
    found = f"{len(changed):,} of {len(frames):,} frames are other pictures than their poses were"
    return (f"{found} made with (the fingerprints differ): {list_names(changed, MAX_NAMED)}.",)


def _is_unchanged(file: PhotoFile) -> bool:
    """Tell whether a file has its fingerprint; one that is gone will be said where it is read."""
    with suppress(OSError):
        return sha256_of(file.location) == str(file.sha256).lower()
    return True


def _read(path: Path, size: tuple[int, int], undone: Undistortion | None) -> Photo:
    photo = load_photo(path)
    _require_size(photo.name, (photo.width, photo.height), size)
    return photo if undone is None else undistort_photo(photo, undone)


def _require_size(name: str, found: tuple[int, int], wanted: tuple[int, int]) -> None:
    if wanted not in ((0, 0), found):
        said = "{}x{} px, and its camera is for {}x{} px".format(*found, *wanted)
        raise PoseFileError(f"{name}: {said}; name the photo that the camera was found with.")


def with_photo(view: View, path: Path, sha256: str | None = None) -> View:
    """Name another file of a view's photo."""
    where = view.camera_from_world, view.mask
    return view_of_file(path, view.camera, sha256, view.file.undistortion, *where)


def open_view(view: View) -> tuple[View, tuple[str, ...]]:
    """Read the photo of a view (of any size if the view is of 0x0 px); also return notes."""
    path = view.path
    if path is not None and not view.file.width:
        photo = load_photo(path)
        view = with_photo(view.resize_photo(photo.width, photo.height), path, view.file.sha256)
    photo = view.photo
    notes = check_against(PhotoReference(view.name, sha256=view.file.sha256), photo.sha256)
    return replace(view, file=PhotoFile.of(photo, path)), notes


def open_view_at_rest(view: View) -> tuple[View, tuple[str, ...]]:
    """Read header and fingerprint of a view's photo alone, as ``open_view``; each handle of the
    photo reads it anew.

    Raises:
        PhotoFileError: there is no such picture.
        PoseFileError: it has another size than the view.
    """
    path = view.path
    if path is None:
        return open_view(view)
    header, sha256 = load_header(path), sha256_of(path)
    if not view.file.width:
        view = view.resize_photo(header.width, header.height)
    size = view.file.width, view.file.height
    _require_size(view.name, (header.width, header.height), size)
    notes = check_against(PhotoReference(view.name, sha256=view.file.sha256), sha256)
    read = partial(_read, path, size, view.file.undistortion)
    return replace(view, file=replace(view.file, sha256=sha256, read=read)), notes


def load_model(path: str | Path) -> ModelFile:
    """Read a model, its key points and its symmetry."""
    path = Path(path)
    content = _content(path)
    return ModelFile(path, sha256_of(path), content.mesh.unit, read=lambda: content)


def model_file(path: Path, sha256: str | None = None, unit: str | None = None) -> ModelFile:
    """Name a model that is read when first asked for."""
    return ModelFile(path, sha256, unit, read=cache(lambda: _content(path)))


def _content(path: Path) -> ModelContent:
    mesh = load_mesh(path)
    keypoints, said = load_keypoints(path, mesh), load_symmetry(path, mesh)
    if keypoints is None and said is None:
        find_symmetry(mesh)  # cached: up to a second, in the thread that reads, not on the page
    return ModelContent(mesh, keypoints, said)
