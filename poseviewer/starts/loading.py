"""Scenes from files, with a start that a file gives or that is found."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from poseviewer.errors import CalibrationFileError, PoseFileError, SettingsError, list_names
from poseviewer.files.cameras import Calibration
from poseviewer.files.image_sequence import ImageSequence, load_sequence
from poseviewer.files.masks import load_mask, masks_beside
from poseviewer.files.mesh.size import METRES, distance_notes
from poseviewer.files.photo import load_calibrated_photo, undistort_photo
from poseviewer.files.photo_sets import LoadedViews, SetChoice, load_views, with_names
from poseviewer.files.pose import PoseRecord, check_against, load_pose
from poseviewer.files.scene_assets import frame_file, load_model, open_view
from poseviewer.files.scene_json import load_scene
from poseviewer.files.structs import CameraNumbers, Distortion, ModelReference
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.lens import same_undistortion
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.world_pose import triangulate_scale
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.sequence import show_frame, store_key, with_frames
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Frame, InView, Scene, SceneObject, View, scene_at
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints

MIN_DIFFERENCE = 1e-3
"""Relative difference of two cameras from which a note tells of it."""


@dataclass(frozen=True, slots=True)
class StartCamera:
    """Knowledge of the camera where no pose file says it."""

    parallel: bool = False
    focal_px: float | None = None
    """None: EXIF's; without that, the pairs' where they tell it, else a view of 50 degrees."""
    free_focal: bool = False
    """Find it from the pairs even where it is known."""

    def of(self, photo: Photo) -> Camera:
        """Return the camera, whose principal point is the photo's middle."""
        camera = photo.default_camera()
        if self.parallel:
            return Parallel(1.0, camera.cx, camera.cy, camera.width, camera.height)
        if self.focal_px is not None:
            camera = replace(camera, fx=self.focal_px, fy=self.focal_px)
        return camera

    def knows_focal(self, photo: Photo) -> bool:
        """Tell whether a focal length was given, or stands in the photo."""
        return self.focal_px is not None or photo.focal_length_35mm is not None


class Start(NamedTuple):
    """A start pose, and what is to be said about it."""

    pose: Pose
    notes: tuple[str, ...]
    others: tuple["Start", ...] = ()
    """Starts of further instances of the model."""
    doubt: str = ""
    """Sentence why the pose may be far off, so that no verdict is ``found``."""


@dataclass(frozen=True, slots=True, eq=False)
class StartInputs:
    """Photo and model that a start is found for."""

    photo: Photo
    mesh: Mesh
    keypoints: VehicleKeypoints | None
    mask: Mask | None = None
    """Weight of each pixel of the photo; None: all count."""
    settings: FitSettings = field(default_factory=FitSettings)

    def scene(self, start: Pose, settings: FitSettings) -> Scene:
        """Make the scene of a start pose, without the names of files."""
        view = View(PhotoFile.of(self.photo), start.camera, mask=self.mask)
        model = ModelFile.of(self.mesh.whole, keypoints=self.keypoints)
        return scene_at(view, model, start, settings=settings, without=self.mesh.left_out)


FindStart = Callable[[StartInputs], Start]


def open_photo_scene(
    photo: str | Path | Photo, model: str | Path | ModelFile, start: str | Path | Pose | FindStart,
    settings: FitSettings | None = None, calibration: Calibration | str | Path | None = None,
    mask: str | Path | Mask | None = None,
) -> Scene:  # fmt: skip
    """Open the scene of a model in a photo, undistorted where there is a lens.

    Args:
        photo: file, or loaded photo.
        model: file, or loaded model; without the parts that settings or pose file leave out.
        start: pose file, pose, or what finds one on the photo, or those of several instances.
        settings: those of the object.
        calibration: camera and lens of the photo: a file, or a choice among its cameras.
        mask: weight of each pixel, or its picture; default: that of the pose file, with what was
            found in front.

    Raises:
        PoseViewerError: a file cannot be used; no start is found, or one for another size.
    """
    settings = settings or FitSettings()
    is_loaded = isinstance(photo, Photo)
    if isinstance(calibration, str | Path):
        calibration = Calibration(Path(calibration))
    opened = photo if is_loaded else load_calibrated_photo(photo, calibration)
    model = model if isinstance(model, ModelFile) else load_model(model)
    without, note = tuple(settings.without or ()), ""
    notes, others = tuple[str, ...](), tuple[Start, ...]()
    doubt, occluders = "", None
    if isinstance(start, str | Path):
        record = load_pose(start, opened.width, opened.height)
        opened, record, of_camera = _match_start(opened, record)
        checks = check_against(record.photo, opened.sha256)
        checks += check_against(record.model, model.sha256)
        model = replace(model, unit=(record.model and record.model.unit) or model.unit)
        known, of_parts = _known_parts(model, record.without)
        without += known
        notes = (*record.warnings, *checks, *of_camera, *of_parts)
        if mask is None:
            size = opened.width, opened.height
            mask, occluders, of_mask = masks_beside(start, record, size)
            notes += of_mask
        start, note = record.pose, record.note
        notes += distance_notes(model.content.mesh_without(without), start)
    if mask is not None and not isinstance(mask, Mask):
        settings = replace(settings, mask=Path(mask).name)
        mask = load_mask(mask, (opened.width, opened.height))
    if not isinstance(start, Pose):
        mesh = model.content.mesh_without(without)
        inputs = StartInputs(opened, mesh, model.keypoints, mask, settings)
        start, notes, others, doubt = start(inputs)
    camera = start.camera
    if (camera.width, camera.height) != (opened.width, opened.height):
        found = f"{camera.width}x{camera.height} px, and {opened.name} has {opened.width}x"
        wanted = "use pose.rescale, if it is the same photo made smaller or larger"
        raise SettingsError(f"a start for photos of {found}{opened.height}; {wanted}.")
    file = PhotoFile.of(opened, None if is_loaded else Path(photo))
    left_out = model.content.mesh_without(without).left_out
    in_views = (InView(occluders=occluders),) if occluders else ()
    fields = {"without": left_out, "note": note, "doubt": doubt, "in_views": in_views}
    scene = scene_at(View(file, camera, mask=mask), model, start, settings=settings, **fields)
    notes = (*notes_of(opened), *notes_of(model), *notes)
    return with_instances(replace(scene, name=opened.name, notes=notes), others)


def open_sequence(
    frames: str | Path | Sequence[Path] | ImageSequence, model: str | Path | ModelFile,
    start: str | Path | Pose | FindStart, every: int = 1, settings: FitSettings | None = None,
    calibration: Calibration | str | Path | None = None, mask: str | Path | Mask | None = None,
    key: int = 0, mask_all_frames: bool = False,
) -> Scene:  # fmt: skip
    """Open the scene of a model in the frames of a sequence, which shows the one of the start.

    Args:
        frames: folder of images, their files, or a video; or what ``load_sequence`` made of them.
        model: file, or loaded model.
        start: in the frame ``key``, as of ``open_photo_scene``; a given pose is a key there.
        every: take the first frame, and every N-th after it.
        settings: those of the object.
        calibration: camera and lens of all frames.
        mask: weight of each pixel in the frame ``key``, or its picture; default: the pose file's.
        key: index of the frame that the start and the mask are of.
        mask_all_frames: whether the mask holds for all frames; what a search found in front, as the
            pose file says it, belongs to the frame ``key`` in any case.

    Raises:
        SettingsError: there is no such frame, or no mask that could hold for all.
        PoseViewerError: as of ``load_sequence`` and ``open_photo_scene``.
    """
    sequence = frames if isinstance(frames, ImageSequence) else load_sequence(frames, every)
    is_given = isinstance(start, str | Path | Pose)
    if not 0 <= key < len(sequence.paths):
        found = f"key={key + 1}: {sequence.name} has {len(sequence.paths)} frames"
        raise SettingsError(f"{found}; name one of them.")
    scene = open_photo_scene(sequence.paths[key], model, start, settings, calibration, mask)
    view, found = scene.views[0], scene.earlier_occluders(0)
    named = zip(sequence.paths, sequence.sha256s, strict=True)
    files = [frame_file(path, view, sha256) for path, sha256 in named]
    files[key] = view.file
    times = zip(files, sequence.times_s, strict=True)
    shots = [Frame(file=file, time_s=time) for file, time in times]
    notes = (*scene.notes, *sequence.notes)
    if mask_all_frames and view.mask is None:
        raise SettingsError("mask_all_frames without a mask; leave it out, or name the mask.")
    if view.mask is not None and not mask_all_frames:
        shots[key] = replace(shots[key], mask=view.mask)
        view = replace(view, mask=None)
        notes += (f"The mask hides pixels of {view.name} alone, not those of all frames.",)
    if found:
        shots[key] = replace(shots[key], occluders={scene.objects[0].id: found[0]})
    scene = replace(scene.with_object(0, in_views=()), views=(view,), name=sequence.name)
    scene = show_frame(with_frames(replace(scene, notes=notes), shots), key)
    return store_key(scene, 0) if is_given else scene


def with_instances(scene: Scene, others: Sequence[Start]) -> Scene:
    """Add further instances of the only object: ``bottle`` is beside ``bottle 2``."""
    if not others:
        return scene
    first, stem = scene.objects[0], Path(scene.objects[0].model.name).stem
    names = stem, *(f"{stem} {number}" for number in range(2, len(others) + 2))
    objects = (replace(first, id=str(i), name=name) for i, name in enumerate(names, 1))
    scene = replace(scene, objects=tuple(objects))
    for index, start in enumerate(others, 1):
        scene = scene.with_pose(index, start.pose).with_object(index, doubt=start.doubt)
    return scene


def _match_start(photo: Photo, start: PoseRecord) -> tuple[Photo, PoseRecord, tuple[str, ...]]:
    """Match photo and start pose to one picture: undistort the photo, or change the camera."""
    if photo.camera is None:
        if start.undistortion is None:
            return photo, start, ()
        return undistort_photo(photo, start.undistortion), start, ()
    if same_undistortion(photo.undistortion, start.undistortion) and start.undistortion is not None:
        return photo, start, ()
    now = start.pose.camera
    if not isinstance(now, Perspective):
        found = "the start pose is under parallel projection, and the calibration is of a"
        wanted = "leave one of the two out"
        raise CalibrationFileError(f"{photo.name}: {found} perspective camera; {wanted}.")
    lens = photo.undistortion and Distortion.of(photo.undistortion)
    pose = replace(start.pose, camera=photo.camera)
    start = start.with_pose(pose, distortion=lens, chart=None, loss=None, unexplained=None)
    if np.allclose(astuple(now), astuple(photo.camera), rtol=MIN_DIFFERENCE):
        return photo, start, ()
    note = (
        f"The calibrated camera ({_numbers(photo.camera)}) is used, not the start pose's "
        f"({_numbers(now)}); rotation and translation stay."
    )
    return photo, start, (note,)


def _numbers(camera: Perspective) -> str:
    said = CameraNumbers.of(camera)
    return f"fx {said.fx:.1f}, fy {said.fy:.1f}, cx {said.cx:.1f}, cy {said.cy:.1f} px"


def open_scene_files(scene: str | Path | Scene, settings: FitSettings | None = None) -> Scene:
    """Read the photos and models of a scene, or of a scene file.

    Args:
        scene: a scene file, or a scene whose photos and models are not yet read.
        settings: those of all objects, in place of the scene's. Parts ``without``, each as
            ``ID:PART``, are left out beside the scene's own, and the results of searches with them.

    Raises:
        PoseViewerError: a file cannot be used, or not with the others; the scene has no objects, or
            not such an object or part; the models are in different units.
    """
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    if settings is not None and settings.has_free_camera:
        found = "a free focal length or principal point with objects that share one camera"
        raise SettingsError(f"{found}; leave it out, and find it with one of them alone.")
    if not scene.objects:
        name = scene.name or scene.views[0].name
        raise PoseFileError(f"{name}: it has no objects; name a model, and it with --views.")
    left_out = _parts_of_objects(scene, settings.without or () if settings else ())
    models = dict[Path | None, ModelFile]()
    notes = [*scene.notes]
    views, objects = [], []
    for unread in scene.views:
        view, of_view = open_view(unread)
        views.append(view)
        notes += [*of_view, *notes_of(view.photo)]
    for item in scene.objects:
        path = item.model.path
        if path is not None and path not in models:
            models[path] = load_model(path)
            notes += notes_of(models[path])
    _require_one_unit(scene, models)
    for item in scene.objects:
        model = models.get(item.model.path, item.model)
        model = replace(model, unit=item.model.unit or model.unit)
        known, of_parts = _known_parts(model, item.without)
        reference = ModelReference(model.name, item.model.sha256)
        notes += [*check_against(reference, model.sha256), *of_parts]
        without = model.content.mesh_without((*known, *left_out[item.id])).left_out
        result = item.result if set(without) <= set(item.without) else None
        own = settings or replace(item.settings)
        objects.append(replace(item, model=model, settings=own, without=without, result=result))
    told = tuple(dict.fromkeys(notes))
    return replace(scene, views=with_names(views), objects=tuple(objects), notes=told)


def open_views(
    views: str | Path | LoadedViews, model: str | Path | ModelFile, start: str | Path | Pose,
    settings: FitSettings | None = None, view: str | None = None, scale: float | None = None,
    choice: SetChoice | None = None,
) -> Scene:  # fmt: skip
    """Open the scene of a model in several views.

    Args:
        views: file or folder of the set, or its views.
        model: file, or loaded model.
        start: pose in one of the photos, or its file.
        settings: those of the object.
        view: name of that photo, which comes first; default: the pose file's.
        scale: lengths of the model's unit in one of the world's.
        choice: what the set's file leaves open.

    Raises:
        PoseViewerError: the pose cannot be used with these photos; nothing tells in which it is, or
            the scale.
    """
    settings = settings or FitSettings()
    loaded = views if isinstance(views, LoadedViews) else load_views(views, choice)
    own = model if isinstance(model, ModelFile) else load_model(model)
    mesh = own.content.mesh_without(tuple(settings.without or ()))
    record = PoseRecord.of(start) if isinstance(start, Pose) else load_pose(start)
    first, notes = _view_of(loaded, record, view), ()
    photo = loaded.views[first].photo
    if not isinstance(start, Pose):
        record = load_pose(start, photo.width, photo.height)
        notes = (*record.warnings, *check_against(record.photo, photo.sha256))
        notes += check_against(record.model, own.sha256)
    if not isinstance(record.pose.camera, Perspective):
        found = "a start under parallel projection, and the set's cameras are perspective"
        raise SettingsError(f"{photo.name}: {found}; start from a perspective pose.")
    if record.undistortion is not None and photo.undistortion is None:
        found = "the start was found on the photo undistorted by a lens that the set does not have"
        wanted = "give the set that lens, or start from a pose by the set's camera"
        raise SettingsError(f"{photo.name}: {found}; {wanted}.")
    _, record, of_camera = _match_start(photo, record)
    known = scale or known_scale(loaded, mesh)
    scale = known or scale_by_rays(loaded.views, first, mesh, record.pose, loaded.name)
    order = (first, *(i for i in range(len(loaded.views)) if i != first))
    ordered = tuple(loaded.views[i] for i in order)
    place = ordered[0].world_from_model(record.pose, 1.0 / scale)
    of_files = [note for file in (*(v.photo for v in ordered), own) for note in notes_of(file)]
    notes = tuple(dict.fromkeys([*of_files, *notes, *of_camera]))
    item = SceneObject(
        id="1", model=own, world_from_model=place, settings=settings, without=mesh.left_out,
        note=record.note,
    )  # fmt: skip
    return Scene(
        views=ordered, objects=(item,), name=loaded.name, unit=loaded.unit,
        free_scale=known is None, notes=notes,
    )  # fmt: skip


def known_scale(views: LoadedViews, mesh: Mesh) -> float | None:
    """Return lengths of the model's unit in one of the world's, or None if these are not said."""
    unit = views.unit
    if views.scale is not None or unit is None:
        return views.scale
    if mesh.unit is None or mesh.unit == unit:
        return 1.0
    return METRES[unit] / METRES[mesh.unit] if {unit, mesh.unit} <= set(METRES) else None


def scale_by_rays(views: Sequence[View], index: int, mesh: Mesh, pose: Pose, name: str) -> float:
    """Triangulate the scale by which the model is where the viewing rays of the others meet.

    Args:
        views: all views of the set.
        index: of the view that the pose is in.
        mesh: the model.
        pose: the model's, in its own unit.
        name: of the set, for the error.

    Raises:
        SettingsError: the rays do not meet.
    """
    centre = pose.camera_from_model.apply(mesh.centre)
    scale = None
    if centre[2] > 0.0:
        cameras = [(view.camera, view.camera_from_world) for view in views]
        scale = triangulate_scale(cameras, index, centre / centre[2], float(centre[2]))
    if scale is None:
        found = "its scale is not known, and its cameras do not look at one place, which would"
        wanted = "give --scale, lengths of the model's unit in one of the set's"
        raise SettingsError(f"{name}: {found} tell it about; {wanted}.")
    return scale


def notes_of(file: Photo | ModelFile) -> tuple[str, ...]:
    """Return sentences for the user on how a file was read."""
    notes = file.notes if isinstance(file, Photo) else file.mesh.notes
    return tuple(f"{file.name}: {note}" for note in notes)


def _known_parts(
    model: ModelFile, without: Sequence[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the parts of a model that a pose leaves out, and notes on those that it has not."""
    known = tuple(name for name in without if name in model.mesh.part_names)
    notes = (
        f"The pose file leaves out the part {name!r}, which {model.name} has not."
        for name in without
        if name not in known
    )
    return known, tuple(notes)


def _parts_of_objects(scene: Scene, without: Sequence[str]) -> dict[str, list[str]]:
    parts: dict[str, list[str]] = {item.id: [] for item in scene.objects}
    for text in without:
        owner = max((key for key in parts if text.startswith(f"{key}:")), key=len, default=None)
        if owner is None:
            found = f"the part {text!r} of a scene: say of which object, as ID:PART"
            raise SettingsError(f"{found}; the objects are {', '.join(parts)}.")
        parts[owner].append(text[len(owner) + 1 :])
    return parts


def _require_one_unit(scene: Scene, models: Mapping[Path | None, ModelFile]) -> None:
    known: dict[str, str] = {}
    for item in scene.objects:
        unit = item.model.unit or models.get(item.model.path, item.model).mesh.unit
        if unit is not None:
            known.setdefault(unit, item.label)
    if len(known) > 1:
        (first, its), (second, other) = list(known.items())[:2]
        wanted = "the models of a scene have to be in one unit, scale one of the files"
        raise PoseFileError(f"{its} is in {first} and {other} in {second}; {wanted}.")


def _view_of(views: LoadedViews, record: PoseRecord, view: str | None) -> int:
    names = [known.name for known in views.views]
    wanted = view or (record.photo.file if record.photo else None)
    alike = [i for i, name in enumerate(names) if wanted in (name, Path(name).name)]
    if wanted and not alike:  # a pose file may name folders above the photo
        alike = [i for i, name in enumerate(names) if Path(name).name == Path(wanted).name]
    if len(alike) == 1:
        return alike[0]
    problem = f"there is no photo {wanted}" if wanted else "the start does not say in which photo"
    wanted = "name the photo that the start is a pose in with --view, one of"
    raise PoseFileError(f"{views.name}: {problem}; {wanted} {list_names(names)}.")
