"""From files to a registration: photo, model, and a start pose that a file gives, or that is found
on the photo.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from poseviewer.errors import PoseFileError, SettingsError, printable
from poseviewer.files.cameras import Calibration
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.masks import load_mask, mask_beside
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import (
    load_calibrated_photo,
    load_photo,
    matched,
    undistorted,
)
from poseviewer.files.pose import PoseRecord, check_against, load_pose
from poseviewer.files.scene import SceneRecord
from poseviewer.files.symmetry import load_symmetry
from poseviewer.files.writing import sha256_of
from poseviewer.fit.registration import LoadedModel, PlacedModel, Registration
from poseviewer.geometry.camera import Camera, Parallel, Pose
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.photo import Photo
from poseviewer.vehicle.keypoints import VehicleKeypoints


@dataclass(frozen=True, slots=True)
class StartCamera:
    """What is known of the camera where no pose file says it."""

    parallel: bool = False
    focal_px: float | None = None
    """None: EXIF's; without that, the pairs' where they tell it, else a view of 50 degrees."""
    free_focal: bool = False
    """Find it from the pairs even where it is known."""

    def of(self, photo: Photo) -> Camera:
        """The camera: its principal point is the photo's middle."""
        camera = photo.default_camera()
        if self.parallel:
            return Parallel(1.0, camera.cx, camera.cy, camera.width, camera.height)
        if self.focal_px is not None:
            camera = replace(camera, fx=self.focal_px, fy=self.focal_px)
        return camera

    def knows_focal(self, photo: Photo) -> bool:
        """Whether a focal length was given, or stands in the photo."""
        return self.focal_px is not None or photo.focal_length_35mm is not None


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """A start pose, and what is to be said about it."""

    pose: Pose
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class StartInputs:
    """What a start is found for."""

    photo: Photo
    mesh: Mesh
    keypoints: VehicleKeypoints | None
    mask: Mask | None = None
    """How much each pixel of the photo counts; None: all do."""

    def at(self, start: Pose) -> Registration:
        """The registration from a start pose, without the names of files."""
        nameless = (self.photo, self.mesh, "", "", self.keypoints, start, ())
        return Registration(*nameless, mask=self.mask)


FindStart = Callable[[StartInputs], Start]


def load_model(path: str | Path) -> LoadedModel:
    """A model, its key points and its symmetry.

    Raises:
        PoseViewerError: one of them cannot be used.
    """
    mesh, name = load_mesh(path), printable(Path(path).name)
    keypoints = load_keypoints(path, mesh)
    return LoadedModel(mesh, name, sha256_of(path), keypoints, load_symmetry(path, mesh))


def load_registration(
    photo_path: str | Path,
    model: str | Path | LoadedModel,
    pose_path: str | Path,
    calibration: Calibration | None = None,
    mask: str | Path | Mask | None = None,
    without: Sequence[str] = (),
) -> Registration:
    """Photo, model (a file, or one that is loaded) and start, checked against one another; the
    photo undistorted, where a calibration or the pose file says by which lens it was taken. Where
    no ``mask`` is given that of the pose file is used; of the model, the parts ``without`` and
    those that the pose file leaves out are not.

    Raises:
        PoseViewerError: one of them cannot be used.
    """
    photo = load_calibrated_photo(photo_path, calibration)
    photo, record, notes = matched(photo, load_pose(pose_path, photo.width, photo.height))
    model = _model_of(model, without)
    notes = (*record.warnings, *check_against(record, photo.sha256, model.sha256), *notes)
    model, of_parts = _as_recorded(model, record)
    notes += of_parts
    if mask is None:
        mask, of_mask = mask_beside(pose_path, record, photo.width, photo.height)
        notes = (*notes, *of_mask)
    return registered(photo, model, record.pose, notes, _mask_of(photo, mask))


def load_with_start(
    photo_path: str | Path,
    model: str | Path | LoadedModel,
    find: FindStart,
    calibration: Calibration | None = None,
    mask: str | Path | Mask | None = None,
    without: Sequence[str] = (),
) -> Registration:
    """The same with a start that ``find`` finds on the photo; its notes are last.

    Raises:
        PoseViewerError: a file cannot be used, or no start is found, or one for a photo of another
            size.
    """
    photo = load_calibrated_photo(photo_path, calibration)
    model = _model_of(model, without)
    mask = _mask_of(photo, mask)
    start = find(StartInputs(photo, model.mesh, model.keypoints, mask))
    camera = start.pose.camera
    if (camera.width, camera.height) != (photo.width, photo.height):
        raise SettingsError(
            f"a start for photos of {camera.width}x{camera.height} px, and {photo.name} has "
            f"{photo.width}x{photo.height}; use pose.scaled, if it is the same photo made smaller "
            "or larger."
        )
    return registered(photo, model, start.pose, start.notes, mask)


def _model_of(model: str | Path | LoadedModel, without: Sequence[str]) -> LoadedModel:
    """The model without these parts, and without those that it is without already."""
    model = model if isinstance(model, LoadedModel) else load_model(model)
    return replace(model, mesh=model.mesh.without([*model.mesh.left_out, *without]))


def _as_recorded(model: LoadedModel, record: PoseRecord) -> tuple[LoadedModel, tuple[str, ...]]:
    """The model without the parts that its pose leaves out; and sentences on what it has not."""
    known = [name for name in record.without if name in model.mesh.whole.part_names]
    notes = (
        f"The pose file leaves out the part {name!r}, which {model.name} has not."
        for name in record.without
        if name not in known
    )
    return _model_of(model, known), tuple(notes)


def _mask_of(photo: Photo, mask: str | Path | Mask | None) -> Mask | None:
    if mask is None or isinstance(mask, Mask):
        return mask
    return load_mask(mask, photo.width, photo.height)


def load_scene_registrations(
    scene: SceneRecord, without: Sequence[str] = ()
) -> tuple[SceneRecord, tuple[Registration, ...]]:
    """One for each object of a scene, in its order: from its pose, among the others at theirs.
    ``without`` names parts that are left out beside the scene's own, each as ``ID:PART``; first
    comes the scene without them: how a search ended is not said of an object that has lost some.

    Raises:
        PoseViewerError: a file cannot be used; the photo or a mask has another size than the scene
            says; the models are in different units; there is no such object or part.
    """
    left_out = _parts_of_objects(scene, without)
    photo = load_photo(scene.photo)
    wanted = scene.camera.width, scene.camera.height
    if (photo.width, photo.height) != wanted:
        raise PoseFileError(
            f"{photo.name}: {photo.width}x{photo.height} px, and the scene is one for "
            f"{wanted[0]}x{wanted[1]} px; name the photo that it was made with."
        )
    if scene.undistortion is not None:
        photo = undistorted(photo, scene.undistortion)
    models: dict[Path, LoadedModel] = {}
    for one in scene.objects:
        if one.model not in models:
            models[one.model] = load_model(one.model)
    _require_one_unit(scene, models)
    alone = []
    for one in scene.objects:
        model = _model_of(models[one.model], left_out[one.id])
        model, of_parts = _as_recorded(model, one.record)
        checks = check_against(one.record, photo.sha256, model.sha256)
        notes = (*one.record.warnings, *checks, *of_parts)
        own = registered(photo, model, one.record.pose, notes, _mask_of(photo, one.mask))
        alone.append(own)
    records = []
    for one, own in zip(scene.objects, alone, strict=True):
        record, left = one.record, own.mesh.left_out
        if not set(left) <= set(record.without):
            record = PoseRecord(record.pose, record.photo, record.model, without=left)
        records.append(record)
    return scene.with_records(records), among_others(alone)


def _parts_of_objects(scene: SceneRecord, without: Sequence[str]) -> dict[str, list[str]]:
    """The parts that are said of each object of a scene, by the objects' ids."""
    found: dict[str, list[str]] = {one.id: [] for one in scene.objects}
    for text in without:
        owner = max((one for one in found if text.startswith(f"{one}:")), key=len, default=None)
        if owner is None:
            raise SettingsError(
                f"the part {text!r} of a scene: say of which object, as ID:PART; the objects are "
                f"{', '.join(found)}."
            )
        found[owner].append(text[len(owner) + 1 :])
    return found


def among_others(registrations: Sequence[Registration]) -> tuple[Registration, ...]:
    """The same of one photo, that of the first, each with all others where they start."""
    placed = [PlacedModel(one.mesh, one.start) for one in registrations]
    return tuple(
        replace(one, photo=registrations[0].photo, others=(*placed[:index], *placed[index + 1 :]))
        for index, one in enumerate(registrations)
    )


def _require_one_unit(scene: SceneRecord, models: Mapping[Path, LoadedModel]) -> None:
    """Refuse models in different units: which is in front could not be told from their poses."""
    known: dict[str, str] = {}
    for one in scene.objects:
        said = one.record.model.unit if one.record.model else None
        unit = said or models[one.model].mesh.unit
        if unit is not None:
            known.setdefault(unit, one.label)
    if len(known) > 1:
        (first, its), (second, other) = list(known.items())[:2]
        raise PoseFileError(
            f"{its} is in {first} and {other} in {second}; the models of a scene have to be in one "
            "unit, scale one of the files."
        )


def registered(
    photo: Photo, model: LoadedModel, start: Pose, notes: tuple[str, ...], mask: Mask | None
) -> Registration:
    """Photo, model and start, with ``notes`` behind those of the files."""
    of_files = [(photo.name, note) for note in photo.notes]
    of_files += [(model.name, note) for note in model.mesh.notes]
    warnings = (*(f"{name}: {note}" for name, note in of_files), *notes)
    return Registration(
        photo,
        model.mesh,
        model.name,
        model.sha256,
        model.keypoints,
        start,
        warnings,
        mask=mask,
        whole_symmetry=model.whole_symmetry,
    )
