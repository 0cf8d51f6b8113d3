"""Opening files for the app: read, check and make ready, away from the main loop."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from poseviewer.app.state.cameras import with_camera
from poseviewer.app.state.commands import put
from poseviewer.app.state.document import Document, Marks, SceneObject, SearchEnd
from poseviewer.app.state.objects import AddObject
from poseviewer.app.state.photo_set import OwnOfPhoto, PhotoSet
from poseviewer.errors import PoseFileError, PoseViewerError, QuickStartError
from poseviewer.files.cameras import Calibration
from poseviewer.files.file_set import FileSet
from poseviewer.files.masks import load_mask, mask_beside
from poseviewer.files.photo import (
    load_calibrated_photo,
    load_photo,
    matched,
    same_undistortion,
    undistorted,
)
from poseviewer.files.pose import check_against, load_pose
from poseviewer.files.scene import load_scene
from poseviewer.files.state.autosave import AutosavedSession, KeptSet
from poseviewer.files.view_set import SetChoice, load_view_set
from poseviewer.fit.registration import LoadedModel, Registration
from poseviewer.fit.settings import FitSettings, Method, settings_from_json
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Pose
from poseviewer.geometry.photo import Photo
from poseviewer.geometry.transform import RigidTransform
from poseviewer.starts.placing import look_from
from poseviewer.starts.registration import (
    load_model,
    load_registration,
    load_scene_registrations,
    registered,
)
from poseviewer.starts.view_set import known_scale, start_in_set

T = TypeVar("T", bound=SceneObject)


@dataclass(frozen=True, slots=True, eq=False)
class Opened:
    """A document that is ready."""

    document: Document
    warnings: tuple[str, ...]
    pose_alone: bool = False
    """A pose file was read; photo and model are the ones at hand."""
    restored: bool = False
    """It is what an earlier session left, unsaved."""
    objects: tuple[AddObject, ...] = ()
    """Further models that the photo shows, still without poses."""


def open_files(
    photo: Path,
    model: Path,
    pose: Path | None,
    calibration: Calibration | None = None,
    mask: Path | None = None,
    without: Sequence[str] = (),
    objects: Sequence[Path] = (),
) -> Opened:
    """Photo and model from their files, with a start pose from one, or seen from a corner; the
    photo undistorted, where there is a calibration; ``mask``: what of the photo counts,
    ``without``: parts of the model that are left out; ``objects``: models that the photo shows as
    well.
    """
    if pose is not None:
        registration = load_registration(photo, model, pose, calibration, mask, without)
    else:
        registration = _without_pose(load_calibrated_photo(photo, calibration), model)
        hidden = (
            load_mask(mask, registration.photo.width, registration.photo.height) if mask else None
        )
        registration = replace(registration, mask=hidden, mesh=registration.mesh.without(without))
    document = Document(registration, registration.start, photo_path=photo, model_path=model)
    added, notes = open_objects(objects)
    return Opened(document, (*registration.warnings, *notes), objects=added)


def open_set(
    path: Path,
    model: Path,
    pose: Path | None,
    choice: SetChoice | None = None,
    view: str | None = None,
    scale: float | None = None,
    without: Sequence[str] = (),
) -> Opened:
    """The photos of a set and a model, with a start pose in one of them from a file, else seen from
    a corner in the first; ``view`` and ``scale`` as of ``start_in_set``.
    """
    views, loaded = load_view_set(path, choice), load_model(model)
    loaded = replace(loaded, mesh=loaded.mesh.without(without))
    if pose is not None:
        start = start_in_set(views, loaded, pose, view, scale)
    else:
        camera = views.views[0].camera
        guess = look_from("three-quarter", loaded.mesh, loaded.keypoints, camera)
        start = start_in_set(views, loaded, guess, views.views[0].name, scale)
    masks = [start.masks.get(index, one.mask) for index, one in enumerate(views.views)]
    own = tuple(OwnOfPhoto(mask, None, Marks()) for mask in masks)
    photos = PhotoSet(
        views,
        path,
        choice or SetChoice(),
        own,
        (True,) * len(own),
        start.index,
        start.scale,
        start.free_size,
    )
    large = views.views[start.index]
    of_model = registered(large.photo, loaded, start.pose, (), own[start.index].mask)
    of_model = replace(of_model, start_is_guess=pose is None)
    document = Document(of_model, start.pose, model_path=model, photo_path=large.path, views=photos)
    of_photos = (f"{one.name}: {note}" for one in views.views for note in one.photo.notes)
    warnings = (*of_photos, *document.registration.warnings, *start.notes)
    return Opened(document, tuple(dict.fromkeys(warnings)))


def open_file_set(now: Document, files: FileSet, models: Sequence[Path]) -> Opened:
    """Files that came together, on what is at hand; ``models``: where the models lie with all that
    they name. The first becomes the model, the others are further objects.

    Raises:
        QuickStartError: a set of photos without a model.
    """
    if files.scene is not None:
        return open_scene(files.scene)
    if files.views is not None:
        model = models[0] if models else now.model_path
        if model is None:
            raise QuickStartError(
                f"{files.views.name}: a set of photos without a model; drop both together."
            )
        opened = open_set(files.views, model, files.pose)
        return replace(opened, warnings=(*opened.warnings, *files.notes))
    document, warnings, pose_alone = now, list(files.notes), False
    photo = now.photo_path if files.photo is None and files.camera is not None else files.photo
    if photo is not None:
        calibration = None if files.camera is None else Calibration(files.camera)
        opened = open_photo(document, photo, calibration)
        document, warnings = opened.document, [*warnings, *opened.warnings]
    if models:
        known = files.models[0].path == now.model_path
        opened = (completed if known else open_model)(document, models[0])
        document, warnings = opened.document, [*warnings, *opened.warnings]
    if files.pose is not None:
        (opened,) = open_pose(document, files.pose)
        pose_alone = opened.pose_alone and document is now
        document, warnings = opened.document, [*warnings, *opened.warnings]
    objects, notes = open_objects(models[1:])
    return Opened(document, (*warnings, *notes), pose_alone, objects=objects)


def open_objects(paths: Sequence[Path]) -> tuple[tuple[AddObject, ...], tuple[str, ...]]:
    """Commands that add the models of these files as further objects, and notes on the models."""
    models = [(load_model(path), path) for path in paths]
    notes = (f"{path.name}: {note}" for model, path in models for note in model.mesh.notes)
    return tuple(AddObject(model, path) for model, path in models), tuple(notes)


def open_scene(path: Path, without: Sequence[str] = ()) -> Opened:
    """All objects of a scene file, the first one picked; ``without`` further parts of them, each
    named as ``ID:PART``.
    """
    scene, registrations = load_scene_registrations(load_scene(path), without)
    objects = [
        SceneObject(
            registration,
            registration.start,
            model_path=one.model,
            number=number,
            name=one.name or ("" if one.id.isdecimal() else one.id),
            end=None if one.record.verdict is None else SearchEnd(one.record),
        )
        for number, (one, registration) in enumerate(
            zip(scene.objects, registrations, strict=True), 1
        )
    ]
    notes = (note for one in registrations for note in one.warnings)
    warnings = tuple(dict.fromkeys((*scene.warnings, *notes)))
    return Opened(Document.of(objects[0], scene.photo, tuple(objects[1:])), warnings)


def by_method(opened: Opened, method: Method) -> Opened:
    """Set the method of the search."""
    document = opened.document
    settings = document.settings.of_method(method)
    return replace(opened, document=replace(document, settings=settings))


def open_photo(now: Document, path: Path, calibration: Calibration | None = None) -> Opened:
    """Another photo under the model at hand, which keeps its view; or a calibrated camera for the
    photo at hand, in which the model keeps its place.
    """
    photo = load_calibrated_photo(path, calibration)
    camera = photo.default_camera()
    mesh, rotation = now.registration.mesh, now.pose.camera_from_model.rotation
    if path == now.photo_path:
        pose = with_camera(now.pose, camera, mesh.centre)
    else:
        keypoints = now.registration.keypoints
        placed = look_from("three-quarter", mesh, keypoints, camera).camera_from_model
        middle = placed.apply(mesh.centre)
        pose = Pose(camera, RigidTransform(rotation, middle - rotation @ mesh.centre))
    guess = path != now.photo_path or now.awaits_place
    before = now.registration.photo
    same_pixels = photo.sha256 == before.sha256
    same_pixels = same_pixels and same_undistortion(photo.undistortion, before.undistortion)
    registration = replace(
        now.registration,
        photo=photo,
        start=pose,
        warnings=(),
        start_is_guess=guess,
        mask=now.registration.mask if same_pixels else None,
    )
    settings = replace(now.settings, region=None)
    others = now.others
    if path != now.photo_path:
        moved = pose.camera_from_model.apply(mesh.centre) - now.pose.camera_from_model.apply(
            mesh.centre
        )
        others = tuple(_in_another_photo(one, camera, moved) for one in others)
    document = replace(
        now,
        registration=registration,
        pose=pose,
        photo_path=path,
        settings=settings,
        marks=Marks(),
        others=others,
    )
    warnings = [f"{photo.name}: {note}" for note in photo.notes]
    if now.registration.photo.undistortion is not None and calibration is None:
        warnings.append(
            f"{photo.name}: shown as taken, with its distortion; drop it with its file of cameras."
        )
    return Opened(document, tuple(warnings))


def _in_another_photo(one: SceneObject, camera: Camera, moved: FloatArray) -> SceneObject:
    """An object that goes where the picked one goes, ``moved`` (3,) by the camera's axes."""
    place = one.pose.camera_from_model
    pose = Pose(camera, RigidTransform(place.rotation, place.translation + moved))
    guess = replace(one.registration, start=pose, start_is_guess=True)
    settings = replace(one.settings, region=None)
    return replace(one, registration=guess, pose=pose, settings=settings, marks=Marks())


def completed(now: Document, path: Path) -> Opened:
    """The model at hand with files that it missed; its pose and all marks on it stay."""
    model = load_model(path)
    parts = model.mesh.part_names
    left_out = [name for name in now.registration.mesh.left_out if name in parts]
    model = replace(model, mesh=model.mesh.without(left_out))
    registration = now.registration.with_model(model)
    notes = tuple(f"{model.name}: {note}" for note in model.mesh.notes)
    return Opened(replace(now, registration=registration, model_path=path, end=None), notes)


def open_model(now: Document, path: Path) -> Opened:
    """Another model on the photo at hand, seen from a corner."""
    own = _without_pose(now.registration.photo, path, now.pose)
    own, views = replace(own, mask=now.registration.mask), now.views
    if views is not None:
        scale = known_scale(views.views, own.mesh) or views.scale
        kept = tuple(replace(one, marks=Marks(), end=None) for one in now.own_of_photos)
        views = replace(views, own=kept, scale=scale, poses=(), starts=())
    document = Document(
        own,
        own.start,
        FitSettings(region=now.settings.region, seed=now.settings.seed),
        model_path=path,
        number=now.number,
        photo_path=now.photo_path,
        others=now.others,
        views=views,
    )
    return Opened(document if views is None else put(document, own.start), own.warnings)


def open_pose(now: Document, path: Path) -> Iterator[Opened]:
    """A pose file for the photo and the model at hand: the start from now on; what it says is
    hidden, or left out, is.
    """
    if now.views is not None:
        yield _pose_in_set(now, now.views, path)
        return
    photo = now.registration.photo
    read = load_pose(path, photo.width, photo.height)
    checks = check_against(read, photo.sha256, now.registration.mesh_sha256)
    other = read.undistortion and not same_undistortion(read.undistortion, photo.undistortion)
    if other and now.photo_path is not None:
        photo = replace(load_photo(now.photo_path), name=photo.name)
    photo, record, notes = matched(photo, read)
    own = now.registration
    mask, of_mask = mask_beside(path, record, photo.width, photo.height)
    if mask is None and photo is own.photo:
        mask = own.mask
    known = [name for name in record.without if name in own.mesh.whole.part_names]
    mesh = own.mesh.without(known) if known else own.mesh
    changed = replace(own, photo=photo, mask=mask, mesh=mesh)
    document = replace(now, registration=changed).started_from(record.pose)
    same = changed.compares_same(own)
    yield Opened(document, (*record.warnings, *checks, *notes, *of_mask), pose_alone=same)


def _pose_in_set(now: Document, views: PhotoSet, path: Path) -> Opened:
    """A pose file for the set at hand: of one of its photos, which becomes the large one."""
    own = now.registration
    model = LoadedModel(own.mesh, own.mesh_name, own.mesh_sha256, own.keypoints)
    start = start_in_set(views.views, model, path)
    pairs = enumerate(now.own_of_photos)
    kept = tuple(replace(one, mask=start.masks.get(i, one.mask)) for i, one in pairs)
    views = replace(views, own=kept).rescaled(start.scale)
    own = replace(own, mask=kept[views.at].mask)
    document = replace(now, registration=own, views=views).looking_at(start.index)
    return Opened(document.unsearched.started_from(start.pose), start.notes)


def restore(kept: AutosavedSession) -> Iterator[Opened]:
    """Open the session that an earlier run left behind; models of further objects that are gone are
    named.
    """
    model = _require_there(kept.model, kept.model_name)
    if kept.views is not None:
        yield _restored_set(kept, kept.views, model)
        return
    opened = open_files(_require_there(kept.photo, kept.photo_name), model, None)
    photo = opened.document.registration.photo
    if kept.pose.undistortion is not None:
        photo = undistorted(photo, kept.pose.undistortion)
    photo = replace(photo, name=kept.photo_name)
    document = _restored(opened.document, kept, photo)
    warnings = opened.warnings
    known = {model: opened.document.registration}
    for other in kept.others:
        try:
            path = _require_there(other.model, other.model_name)
            own = known[path] = known.get(path) or _without_pose(photo, path)
        except PoseViewerError as error:
            warnings = (*warnings, str(error))
            continue
        one = _restored(SceneObject(own, own.start, model_path=path), other, photo)
        document = replace(document, others=(*document.others, one))
    yield replace(opened, document=document, restored=True, warnings=warnings)


def _restored_set(kept: AutosavedSession, views: KeptSet, model: Path) -> Opened:
    if not views.path.exists():
        _require_there(views.path, views.path.name)
    opened = open_set(views.path, model, None, views.choice, scale=views.scale)
    document, found = opened.document, opened.document.views
    assert found is not None  # it is a set
    shas = [view.photo.sha256 for view in found.views.views]
    if kept.photo_sha256 not in shas:
        raise PoseFileError(f"{views.path.name}: has {kept.photo_name} no more; open it anew")
    index = shas.index(kept.photo_sha256)
    view = found.views.views[index]
    pairs = zip(found.own, found.names, strict=True)
    own = tuple(replace(one, mask=views.masks.get(name)) for one, name in pairs)
    found = replace(
        found,
        own=own,
        compared=tuple(name not in views.left_out for name in found.names),
        at=index,
        scale=views.scale,
        free_size=views.free_size,
        starts=found.views.posed(index, kept.start.pose, views.start_scale),
        start_scale=views.start_scale,
        poses=(),
    )
    registration = replace(document.registration, photo=view.photo, start=found.starts[index])
    document = replace(
        document, registration=registration, pose=kept.pose.pose, photo_path=view.path, views=found
    )
    document = _restored(document, kept, view.photo)
    return replace(opened, document=document, restored=True)


def _require_there(path: Path | None, name: str) -> Path:
    if path is None or not path.is_file():
        raise PoseFileError(
            f"{name}: is not where the earlier session had it; open it, and its pose by hand"
        )
    return path


def _restored(one: T, kept: AutosavedSession, photo: Photo) -> T:
    """An object, just opened, as it was kept."""
    pose, mesh = kept.pose.pose, one.registration.mesh
    registration = replace(
        one.registration,
        photo=photo,
        mesh=mesh.without([name for name in kept.pose.without if name in mesh.part_names]),
        mesh_name=kept.model_name,
        start=kept.start.pose,
        start_is_guess=False,
        mask=kept.mask,
    )
    if not kept.pose.without:  # which may have had one, once they are back
        registration = replace(registration, whole_symmetry=kept.pose.symmetry)
    return replace(
        one,
        registration=registration,
        pose=pose,
        settings=settings_from_json(kept.settings),
        number=kept.number,
        name=kept.name,
        hidden=kept.hidden,
        locked=kept.locked,
        end=None if kept.pose.verdict is None else SearchEnd(kept.pose),
    )


def _without_pose(photo: Photo, model: Path, seen: Pose | None = None) -> Registration:
    loaded = load_model(model)
    camera = photo.default_camera() if seen is None else seen.camera
    pose = look_from("three-quarter", loaded.mesh, loaded.keypoints, camera)
    return replace(registered(photo, loaded, pose, (), None), start_is_guess=True)
