"""Scenes from files, with a start that a file gives or that is found; and records to be saved."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np

from poseviewer.errors import (
    CalibrationFileError,
    PoseFileError,
    SettingsError,
    list_names,
    printable,
)
from poseviewer.files.cameras import Calibration
from poseviewer.files.formats.conversion import METRES
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.masks import load_mask, mask_beside, mask_text
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.mesh.size import distance_notes
from poseviewer.files.photo import load_calibrated_photo, undistorted
from poseviewer.files.photo_sets import (
    LoadedViews,
    SetChoice,
    load_views,
    with_names,
)
from poseviewer.files.pose import PoseRecord, check_against, load_pose
from poseviewer.files.scene_json import (
    InViewRecord,
    ModelFile,
    ObjectRecord,
    Result,
    SceneRecord,
    ViewRecord,
    load_scene,
    open_view,
    place_of,
    view_record,
)
from poseviewer.files.structs import CameraNumbers, ChartParameters, Distortion, Uncertainty
from poseviewer.files.symmetry import SymmetryTurns, load_symmetry
from poseviewer.files.writing import sha256_of
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.lens import same_undistortion
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.world_pose import View, scale_by_sight
from poseviewer.scene.settings import FitSettings, settings_as_json, settings_from_json
from poseviewer.scene.types import InView, LoadedModel, Scene, SceneObject, SearchResult, scene_at
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints

NOTABLE = 1e-3
"""Least relative difference of two cameras that a note tells of."""


@dataclass(frozen=True, slots=True)
class StartCamera:
    """Knowledge of the camera where no pose file says it."""

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


class Start(NamedTuple):
    """A start pose, and what is to be said about it."""

    pose: Pose
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class StartInputs:
    """Photo and model that a start is found for."""

    photo: Photo
    mesh: Mesh
    keypoints: VehicleKeypoints | None
    mask: Mask | None = None
    """Weight of each pixel of the photo; None: all count."""

    def scene(self, start: Pose, settings: FitSettings) -> Scene:
        """The scene from a start pose, without the names of files."""
        view = View(self.photo.name, self.photo, start.camera, mask=self.mask)
        return scene_at(view, LoadedModel(self.mesh, "", "", self.keypoints), start, settings)


FindStart = Callable[[StartInputs], Start]


def load_model(path: str | Path) -> LoadedModel:
    """A model, its key points and its symmetry."""
    mesh, name = load_mesh(path), printable(Path(path).name)
    keypoints, symmetry = load_keypoints(path, mesh), load_symmetry(path, mesh)
    return LoadedModel(mesh, name, sha256_of(path), keypoints, symmetry, Path(path))


def open_photo(
    photo: str | Path | Photo,
    model: str | Path | LoadedModel,
    start: str | Path | Pose | FindStart,
    settings: FitSettings | None = None,
    calibration: Calibration | None = None,
    mask: str | Path | Mask | None = None,
) -> Scene:
    """The scene of a model in a photo (files, or loaded ones), undistorted where there is a lens.

    ``start``: a pose file, a pose, or what finds one on the photo. Without a ``mask`` that of the
    pose file is used; parts that the settings or the pose file leave out are left out.

    Raises:
        PoseViewerError: a file cannot be used; no start is found, or one for another size.
    """
    settings = settings or FitSettings()
    is_loaded = isinstance(photo, Photo)
    opened = photo if is_loaded else load_calibrated_photo(photo, calibration)
    loaded = model_without(model, settings.without or ())
    notes: tuple[str, ...] = ()
    if isinstance(start, str | Path):
        record = load_pose(start, opened.width, opened.height)
        opened, record, of_camera = _matched(opened, record)
        checks = check_against(record.photo, opened.sha256)
        checks += check_against(record.model, loaded.sha256)
        loaded, of_parts = _as_recorded(loaded, record.without)
        notes = (*record.warnings, *checks, *of_camera, *of_parts)
        if mask is None:
            mask, of_mask = mask_beside(start, record, opened.width, opened.height)
            notes += of_mask
        start = record.pose
        notes += distance_notes(loaded.mesh, start)
    if mask is not None and not isinstance(mask, Mask):
        mask = load_mask(mask, opened.width, opened.height)
    if not isinstance(start, Pose):
        start, notes = start(StartInputs(opened, loaded.mesh, loaded.keypoints, mask))
    camera = start.camera
    if (camera.width, camera.height) != (opened.width, opened.height):
        raise SettingsError(
            f"a start for photos of {camera.width}x{camera.height} px, and {opened.name} has "
            f"{opened.width}x{opened.height}; use pose.rescale, if it is the same photo made "
            "smaller or larger."
        )
    view = View(opened.name, opened, camera, mask=mask, path=None if is_loaded else Path(photo))
    scene = scene_at(view, loaded, start, settings)
    notes = (*notes_of(opened), *notes_of(loaded), *notes)
    return replace(scene, name=opened.name, notes=notes)


def _matched(photo: Photo, start: PoseRecord) -> tuple[Photo, PoseRecord, tuple[str, ...]]:
    """Photo and start pose, both of the same picture; and what the user should know.

    A start of an undistorted photo undistorts the photo. A calibrated camera stands in for the
    start's own, unless the start was found on just this undistorted photo.
    """
    if photo.camera is None:
        if start.undistortion is None:
            return photo, start, ()
        return undistorted(photo, start.undistortion), start, ()
    if same_undistortion(photo.undistortion, start.undistortion) and start.undistortion is not None:
        return photo, start, ()
    now = start.pose.camera
    if not isinstance(now, Perspective):
        raise CalibrationFileError(
            f"{photo.name}: the start pose is under parallel projection, and the calibration is "
            "of a perspective camera; leave one of the two out."
        )
    lens = photo.undistortion and Distortion.of(photo.undistortion)
    pose = replace(start.pose, camera=photo.camera)
    start = start.with_pose(pose, distortion=lens, chart=None, loss=None, unexplained=None)
    if np.allclose(astuple(now), astuple(photo.camera), rtol=NOTABLE):
        return photo, start, ()
    note = (
        f"The calibrated camera ({_numbers(photo.camera)}) is used, not the start pose's "
        f"({_numbers(now)}); rotation and translation stay."
    )
    return photo, start, (note,)


def _numbers(camera: Perspective) -> str:
    said = CameraNumbers.of(camera)
    return f"fx {said.fx:.1f}, fy {said.fy:.1f}, cx {said.cx:.1f}, cy {said.cy:.1f} px"


def open_scene(scene: str | Path | SceneRecord, settings: FitSettings | None = None) -> Scene:
    """The scene of a file. ``settings``: of all objects, in place of the file's; parts ``without``,
    each as ``ID:PART``, are left out beside the file's own, and with them the last search's result.

    Raises:
        PoseViewerError: a file cannot be used, or not with the others; it has no objects, or not
            such an object or part; the models are in different units.
    """
    name = scene.views[0].path.name if isinstance(scene, SceneRecord) else Path(scene).name
    record = scene if isinstance(scene, SceneRecord) else load_scene(scene)
    if not record.objects:
        raise PoseFileError(f"{name}: it has no objects; name a model, and it with --views.")
    left_out = _parts_of_objects(record, settings.without or () if settings else ())
    views, notes, models, objects = [], [*record.warnings], dict[str, LoadedModel](), []
    for own in record.views:
        view, of_view = open_view(own)
        views.append(view)
        notes += [*of_view, *notes_of(view.photo)]
    for item in record.objects:
        if item.model.file not in models:
            models[item.model.file] = load_model(item.path)
            notes += notes_of(models[item.model.file])
    _require_one_unit(record, models)
    for index, item in enumerate(record.objects):
        model = model_without(models[item.model.file], left_out[item.id])
        model, of_parts = _as_recorded(model, item.without)
        known = record.pose_record(index).model
        notes += [*check_against(known, model.sha256), *of_parts]
        is_whole = set(model.mesh.left_out) <= set(item.without)
        own_settings = settings or settings_from_json(item.settings or {})
        in_views = tuple(map(_in_view, item.in_views, record.views))
        result = _search_result(record, index) if is_whole else None
        flags = item.hidden, item.locked, item.is_placed
        about = item.name, in_views, *flags, result, item.notes
        objects.append(SceneObject(item.id, model, item.place.similarity, own_settings, *about))
    told = tuple(dict.fromkeys(notes))
    return Scene(with_names(views), tuple(objects), name, record.unit, record.free_scale, told)


def open_views(
    views: str | Path | LoadedViews,
    model: str | Path | LoadedModel,
    start: str | Path | Pose,
    settings: FitSettings | None = None,
    view: str | None = None,
    scale: float | None = None,
    choice: SetChoice | None = None,
) -> Scene:
    """Open the scene of a model in several views, from its pose in the photo ``view``, else the
    pose file's, which comes first. ``scale``: lengths of the model's unit in one of the world's.

    Raises:
        PoseViewerError: the pose cannot be used with these photos; nothing tells in which it is, or
            the scale.
    """
    settings = settings or FitSettings()
    loaded = views if isinstance(views, LoadedViews) else load_views(views, choice)
    own = model_without(model, settings.without or ())
    record = PoseRecord.of(start) if isinstance(start, Pose) else load_pose(start)
    first, notes = _view_of(loaded, record, view), ()
    photo = loaded.views[first].photo
    if not isinstance(start, Pose):
        record = load_pose(start, photo.width, photo.height)
        notes = (*record.warnings, *check_against(record.photo, photo.sha256))
        notes += check_against(record.model, own.sha256)
    if not isinstance(record.pose.camera, Perspective):
        raise SettingsError(
            f"{photo.name}: a start under parallel projection, and the set's cameras are "
            "perspective; start from a perspective pose."
        )
    if record.undistortion is not None and photo.undistortion is None:
        raise SettingsError(
            f"{photo.name}: the start was found on the photo undistorted by a lens that the set "
            "does not have; give the set that lens, or start from a pose by the set's camera."
        )
    _, record, of_camera = _matched(photo, record)
    known = scale or known_scale(loaded, own.mesh)
    scale = known or scale_of_sight(loaded.views, first, own.mesh, record.pose, loaded.name)
    order = (first, *(i for i in range(len(loaded.views)) if i != first))
    ordered = tuple(loaded.views[i] for i in order)
    place = ordered[0].world_from_model(record.pose, 1.0 / scale)
    of_files = [note for file in (*(v.photo for v in ordered), own) for note in notes_of(file)]
    notes = tuple(dict.fromkeys([*of_files, *notes, *of_camera]))
    objects = (SceneObject("1", own, place, settings),)
    return Scene(ordered, objects, loaded.name, loaded.unit, known is None, notes)


def known_scale(views: LoadedViews, mesh: Mesh) -> float | None:
    """Lengths of the model's unit in one of the world's, by what both say; None: they do not."""
    unit = views.unit
    if views.scale is not None or unit is None:
        return views.scale
    if mesh.unit is None or mesh.unit == unit:
        return 1.0
    return METRES[unit] / METRES[mesh.unit] if {unit, mesh.unit} <= set(METRES) else None


def scale_of_sight(views: Sequence[View], index: int, mesh: Mesh, pose: Pose, name: str) -> float:
    """The scale by which the model, at a pose in view ``index``, is where the others look."""
    centre = pose.camera_from_model.apply(mesh.centre)
    scale = None
    if centre[2] > 0.0:
        scale = scale_by_sight(views, index, centre / centre[2], float(centre[2]))
    if scale is None:
        raise SettingsError(
            f"{name}: its scale is not known, and its cameras do not look at one place, which "
            "would tell it about; give --scale, lengths of the model's unit in one of the set's."
        )
    return scale


def record_of(scene: Scene, with_masks: bool = True, canonical: bool = True) -> SceneRecord:
    """Return the content of a scene file; ``canonical``: one of a symmetric model's equal poses."""
    views = scene.views if with_masks else [replace(view, mask=None) for view in scene.views]
    return SceneRecord(
        views=tuple(map(view_record, views)),
        objects=tuple(
            _object_record(scene, index, with_masks, canonical)
            for index in range(len(scene.objects))
        ),
        unit=scene.unit,
        free_scale=scene.free_scale,
        software={"name": "poseviewer", "version": version("poseviewer")},
    )


def pose_record(scene: Scene, index: int = 0, view: int = 0) -> PoseRecord:
    """Return the content of a pose file for an object in a view."""
    return record_of(scene, with_masks=False).pose_record(index, view)


def model_without(model: str | Path | LoadedModel, without: Sequence[str]) -> LoadedModel:
    """The model without these parts, and without those that it is without already."""
    model = model if isinstance(model, LoadedModel) else load_model(model)
    return replace(model, mesh=model.mesh.without([*model.mesh.left_out, *without]))


def notes_of(file: Photo | LoadedModel) -> tuple[str, ...]:
    """Sentences for the user on how a file was read."""
    notes = file.notes if isinstance(file, Photo) else file.mesh.notes
    return tuple(f"{file.name}: {note}" for note in notes)


def _as_recorded(model: LoadedModel, without: Sequence[str]) -> tuple[LoadedModel, tuple[str, ...]]:
    """The model without the parts that its pose leaves out; and sentences on what it has not."""
    known = [name for name in without if name in model.mesh.whole.part_names]
    notes = (
        f"The pose file leaves out the part {name!r}, which {model.name} has not."
        for name in without
        if name not in known
    )
    return model_without(model, known), tuple(notes)


def _parts_of_objects(scene: SceneRecord, without: Sequence[str]) -> dict[str, list[str]]:
    """The parts that are said of each object of a scene, by the objects' ids."""
    parts: dict[str, list[str]] = {item.id: [] for item in scene.objects}
    for text in without:
        owner = max((key for key in parts if text.startswith(f"{key}:")), key=len, default=None)
        if owner is None:
            raise SettingsError(
                f"the part {text!r} of a scene: say of which object, as ID:PART; the objects are "
                f"{', '.join(parts)}."
            )
        parts[owner].append(text[len(owner) + 1 :])
    return parts


def _require_one_unit(scene: SceneRecord, models: Mapping[str, LoadedModel]) -> None:
    """Refuse models in different units: which is in front could not be told from their poses."""
    known: dict[str, str] = {}
    for item in scene.objects:
        unit = item.model.unit or models[item.model.file].mesh.unit
        if unit is not None:
            known.setdefault(unit, item.label)
    if len(known) > 1:
        (first, its), (second, other) = list(known.items())[:2]
        raise PoseFileError(
            f"{its} is in {first} and {other} in {second}; the models of a scene have to be in one "
            "unit, scale one of the files."
        )


def _in_view(own: InViewRecord, view: ViewRecord) -> InView:
    size = view.photo.width, view.photo.height
    mask = None if own.mask is None else load_mask(own.mask, *size)
    region = None if own.region is None else Rectangle(*own.region)
    return InView(mask, region, own.is_compared)


def _search_result(record: SceneRecord, index: int) -> SearchResult | None:
    said = record.objects[index].result
    if said is None:
        return None
    view, chart = min(said.view, len(record.views) - 1), said.chart or ChartParameters("", (), ())
    numbers = chart.parameters, chart.name, chart.names, said.settings or {}, said.seen
    covariance = said.uncertainty and said.uncertainty.about(record.pose(index, view))
    about = {"notes": said.notes, "view": view, "covariance": covariance}
    return SearchResult(said.verdict, said.loss, said.unexplained, *numbers, **about)


def _object_record(scene: Scene, index: int, with_masks: bool, canonical: bool) -> ObjectRecord:
    item = scene.objects[index]
    model, place, result = item.model, item.world_from_model, item.result
    at = 0 if result is None else result.view
    pose = scene.pose(index, at)
    equal = model.symmetry.canonical(pose) if canonical else pose
    if equal is not pose:
        place = scene.views[at].world_from_model(equal, place.scale)
    in_views = []
    for number, own in enumerate(item.in_views or [InView()] * len(scene.views)):
        mask, hidden = own.mask, result.hidden[number] if result and result.hidden else None
        if hidden is not None:
            mask = Mask.of(~hidden if mask is None else mask.weights * ~hidden)
        text = mask_text(mask) if with_masks else None
        region = None if own.region is None else tuple(map(float, own.region))
        in_views.append(InViewRecord(text, region, own.is_compared))
    has_own = any(own != InViewRecord() for own in in_views)
    return ObjectRecord(
        id=item.id,
        name=item.name,
        model=ModelFile(str(model.path or model.name), model.sha256, model.mesh.unit),
        place=place_of(place),
        settings=settings_as_json(item.settings),
        in_views=tuple(in_views) if has_own else (),
        locked=item.locked,
        hidden=item.hidden,
        is_placed=item.is_placed,
        without=model.mesh.left_out,
        turns=SymmetryTurns.of(model.symmetry),
        result=None if result is None else _recorded_result(result, pose, equal),
        notes=item.notes,
    )


def _recorded_result(result: SearchResult, pose: Pose, equal: Pose) -> Result:
    sure, chart = result.covariance, ChartParameters(result.chart, result.names, result.parameters)
    return Result(
        loss=result.loss,
        unexplained=result.unexplained,
        seen=result.seen,
        verdict=result.verdict,
        view=result.view,
        uncertainty=sure and Uncertainty.of(sure.at_equal_pose(equal)),
        chart=chart if equal is pose and result.names else None,
        settings=dict(result.settings),
        notes=result.notes,
    )


def _view_of(views: LoadedViews, record: PoseRecord, view: str | None) -> int:
    names = [known.name for known in views.views]
    wanted = view or (record.photo.file if record.photo else None)
    alike = [i for i, name in enumerate(names) if wanted in (name, Path(name).name)]
    if len(alike) == 1:
        return alike[0]
    problem = f"there is no photo {wanted}" if wanted else "the start does not say in which photo"
    raise PoseFileError(
        f"{views.name}: {problem}; name the photo that the start is a pose in with --view, one of "
        f"{list_names(names)}."
    )
