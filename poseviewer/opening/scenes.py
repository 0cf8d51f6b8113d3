"""Scenes from files, with a start that a file gives or that is found."""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import CalibrationFileError, PoseFileError, SettingsError, list_names
from poseviewer.files.image_sequence import load_sequence
from poseviewer.files.masks import load_mask, mask_note, masks_beside
from poseviewer.files.mesh.size import METRES, distance_notes
from poseviewer.files.photo import load_calibrated_photo, undistort_photo
from poseviewer.files.pose import PoseRecord, check_against, load_pose
from poseviewer.files.scene_assets import frame_file, load_model, open_view, open_view_at_rest
from poseviewer.files.scene_json import load_scene
from poseviewer.files.structs import CameraNumbers, Distortion, ModelReference
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.lens import same_undistortion
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh, hull_in_photo
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.world_pose import triangulate_scale
from poseviewer.opening.photo_sets import LoadedViews, SetChoice, load_views, with_names
from poseviewer.opening.sources import Sources
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.sequence import show_frame, store_key, with_frames
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import (
    MANY_VIEWS,
    Frame,
    InView,
    PlacedModel,
    Scene,
    SceneObject,
    View,
    scene_at,
)
from poseviewer.starts.depth_by_matches import depth_by_matches
from poseviewer.starts.sides import look_from
from poseviewer.starts.start import Start, StartInputs

CORNER = "three-quarter"
"""Side from which a model without a start is seen."""
MIN_DIFFERENCE = 1e-3
"""Relative difference of two cameras from which a note tells of it."""


def open_scene(sources: Sources) -> Scene:
    """Open the scene of a photo, of frames, of several photos, or of a scene file.

    Photos are undistorted where there is a lens. A sequence shows the frame of the start, and a
    given pose is a key there. A model without a start is seen from a corner, still to be placed.

    Raises:
        PoseViewerError: a file cannot be used, or not with the others; no start is found, or one
            for another size; nothing tells which photo of a set it is in, or the set's scale; the
            scene has no objects, or not such an object or part; the models are in different units;
            there is no such frame, or no mask that could hold for all.
    """
    if sources.scene is not None:
        return _open_saved(sources, sources.scene)
    if sources.views is not None:
        return _open_views(sources, sources.views)
    if sources.frames:
        return _open_frames(sources)
    return _open_photo(sources)


def _refuse(what: str, **given: object) -> None:
    if names := [f"{name}=" for name, value in given.items() if value is not None]:
        raise SettingsError(f"{names[0]} with {what}; leave it out.")


def _model_of(sources: Sources) -> ModelFile:
    model = sources.models[0].path if sources.model is None else sources.model
    return model if isinstance(model, ModelFile) else load_model(model)


def _open_photo(sources: Sources) -> Scene:
    photo, start, mask = sources.photo, sources.start, sources.mask
    assert photo is not None
    settings = sources.settings or FitSettings()
    is_loaded = isinstance(photo, Photo)
    opened = photo if is_loaded else load_calibrated_photo(photo, sources.calibration)
    model = _model_of(sources)
    without, texts = tuple(settings.without or ()), dict[str, Any]()
    notes, others, of_mask = tuple[str, ...](), tuple[Start, ...](), tuple[str, ...]()
    doubt, occluders = "", None
    if isinstance(start, Path):
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
        start, texts = record.pose, record.texts
        notes += distance_notes(model.content.mesh_without(without), start)
    if mask is not None and not isinstance(mask, Mask):
        settings, name = replace(settings, mask=mask.path.name), mask.path.name
        mask = load_mask(mask, (opened.width, opened.height), opened.name)
        of_mask = tuple(filter(None, [mask_note(mask, name)]))
    if not isinstance(start, Pose):
        mesh = model.content.mesh_without(without)
        if start is None:
            start = look_from(CORNER, mesh, model.keypoints, opened.default_camera())
        else:
            inputs = StartInputs(opened, mesh, model.keypoints, mask, settings)
            start, notes, others, doubt = start(inputs)
    camera = start.camera
    if (camera.width, camera.height) != (opened.width, opened.height):
        found = f"{camera.width}x{camera.height} px, and {opened.name} has {opened.width}x"
        wanted = "use pose.rescale, if it is the same photo made smaller or larger"
        raise SettingsError(f"a start for photos of {found}{opened.height}; {wanted}.")
    file = PhotoFile.of(opened, None if is_loaded else photo)
    left_out = model.content.mesh_without(without).left_out
    in_views = (InView(occluders=occluders),) if occluders else ()
    fields = {**texts, "without": left_out, "doubt": doubt, "in_views": in_views}
    fields["is_placed"] = sources.start is not None
    scene = scene_at(View(file, camera, mask=mask), model, start, settings=settings, **fields)
    notes = (*notes_of(opened), *notes_of(model), *of_mask, *notes)
    return _with_instances(replace(scene, name=opened.name, notes=notes), others)


def _open_frames(sources: Sources) -> Scene:
    sequence, key = load_sequence(sources.frames), sources.key
    further = dict(sources.keys)
    if sources.start is None and further:
        key = min(further)
        sources = replace(sources, start=further.pop(key))
    if not 0 <= key < len(sequence.paths):
        found = f"`key={key + 1}`: {sequence.name} has {len(sequence.paths)} frames"
        raise SettingsError(f"{found}; name one of them.")
    scene = _open_photo(replace(sources, photo=sequence.paths[key]))
    view, found = scene.views[0], scene.earlier_occluders(0)
    named = zip(sequence.paths, sequence.sha256s, strict=True)
    files = [frame_file(path, view, sha256) for path, sha256 in named]
    files[key] = view.file
    times = zip(files, sequence.times_s, strict=True)
    shots = [Frame(file=file, time_s=time) for file, time in times]
    notes = (*scene.notes, *sequence.notes)
    if sources.mask_all_frames and view.mask is None:
        raise SettingsError("`mask_all_frames` without a mask; leave it out, or name the mask.")
    if view.mask is not None and not sources.mask_all_frames:
        shots[key] = replace(shots[key], mask=view.mask)
        view = replace(view, mask=None)
        notes += (f"The mask hides pixels of {view.name} alone, not those of all frames.",)
    if found:
        shots[key] = replace(shots[key], occluders={scene.objects[0].id: found[0]})
    scene = replace(scene.with_object(0, in_views=()), views=(view,), name=sequence.name)
    scene = show_frame(with_frames(replace(scene, notes=notes), shots), key)
    scene = store_key(scene, 0) if isinstance(sources.start, Path | Pose) else scene
    for frame_index, start in further.items():
        scene = with_key(scene, frame_index, start)
    return show_frame(scene, key) if further else scene


def with_key(scene: Scene, frame_index: int, start: Path | Pose, object_index: int = 0) -> Scene:
    """Make a key of an object's pose in a frame of a sequence, which is shown then. A pose file's
    mask, and what was found in front, hold in that frame.

    Args:
        scene: the sequence, of one camera.
        frame_index: of the frame.
        start: pose file, or pose.
        object_index: of the object.

    Raises:
        SettingsError: there is no such frame.
        PoseViewerError: a file cannot be used, or the pose is by another camera.
    """
    if not 0 <= frame_index < len(scene.frames):
        found = f"`key={frame_index + 1}`: {scene.name} has {len(scene.frames)} frames"
        raise SettingsError(f"{found}; name one of them.")
    scene = show_frame(scene, frame_index)
    view, item = scene.views[0], scene.objects[object_index]
    photo, notes = view.photo, tuple[str, ...]()
    size, name = (photo.width, photo.height), view.name
    masks: Sequence[Mask | None] = (None, None)
    if isinstance(start, Path):
        record, name = load_pose(start, *size), start.name
        checks = check_against(record.photo, photo.sha256)
        checks += check_against(record.model, item.model.sha256)
        *masks, of_mask = masks_beside(start, record, size)
        notes = (*record.warnings, *checks, *of_mask)
    else:
        record = PoseRecord.of(start)
    if photo.camera is not None:
        photo, record, of_camera = _match_start(photo, record)
        notes += of_camera
    camera, known = record.pose.camera, view.camera
    is_same = type(camera) is type(known) and np.allclose(
        astuple(camera), astuple(known), rtol=MIN_DIFFERENCE
    )
    if not is_same or (record.undistortion is not None and photo.camera is None):
        found = f"{name}: the key's camera is another than that of the keys before it"
        raise PoseFileError(f"{found}; give poses by one camera, or `calibration`.")
    scene = scene.with_pose(object_index, replace(record.pose, camera=known))
    frames, frame = list(scene.frames), scene.frames[frame_index]
    of_masks = zip(("masks", "occluders"), masks, strict=True)
    found = {n: {**getattr(frame, n), item.id: one} for n, one in of_masks if one is not None}
    frames[frame_index] = replace(frame, **found)
    scene = replace(scene, frames=tuple(frames), notes=(*scene.notes, *notes))
    scene = scene.with_object(object_index, is_placed=True)
    return store_key(scene, object_index)


def _with_instances(scene: Scene, others: Sequence[Start]) -> Scene:
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


def _open_saved(sources: Sources, scene: Path | Scene) -> Scene:
    """Read the photos and models of a scene; parts that the settings leave out are left out beside
    its own, and the results of searches with them.
    """
    given = {"choice": sources.choice, "calibration": sources.calibration, "mask": sources.mask}
    _refuse("a scene file", **given)
    scene = scene if isinstance(scene, Scene) else load_scene(scene, sources.inside)
    settings = sources.settings
    if settings is not None and settings.has_free_camera:
        found = "a free focal length or principal point with objects that share one camera"
        raise SettingsError(f"{found}; leave it out, and find it with one of them alone.")
    if not scene.objects:
        name = scene.name or scene.views[0].name
        raise PoseFileError(f"{name}: it has no objects; open it as a set of photos, with a model.")
    left_out = _parts_of_objects(scene, settings.without or () if settings else ())
    models = dict[Path | None, ModelFile]()
    notes = [*scene.notes]
    views, objects = [], []
    for unread in scene.views:
        if scene.has_many_views:
            view, of_view = open_view_at_rest(unread)
        else:
            view, of_view = open_view(unread)
            of_view += notes_of(view.photo)
        views.append(view)
        notes += of_view
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


def _open_views(sources: Sources, views: Path | LoadedViews) -> Scene:
    _refuse("a set of photos", calibration=sources.calibration, mask=sources.mask)
    start = sources.start
    if callable(start):
        raise SettingsError("a start that is searched for with a set of photos; name a pose.")
    settings, choice = sources.settings or FitSettings(), sources.choice or SetChoice()
    loaded = views if isinstance(views, LoadedViews) else load_views(views, choice)
    own, view = _model_of(sources), choice.view
    mesh = own.content.mesh_without(tuple(settings.without or ()))
    if start is None:
        view, camera = loaded.views[0].name, loaded.views[0].camera
        start = look_from(CORNER, mesh, own.keypoints, camera)
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
    known = choice.scale or known_scale(loaded, mesh.unit)
    if choice.scale is None and loaded.scale is None and loaded.unit and mesh.unit is None:
        wanted = "if it is another, say with `scale` how many of its lengths are one of the set's"
        notes += (f"{own.name} says no unit: the set's, {loaded.unit}, is taken; {wanted}.",)
    scale = known or scale_of_views(loaded.views, first, mesh, record.pose, loaded.name)
    order = (first, *(i for i in range(len(loaded.views)) if i != first))
    ordered = tuple(loaded.views[i] for i in order)
    place = ordered[0].world_from_model(record.pose, 1.0 / scale)
    read = ordered[: 1 if len(ordered) > MANY_VIEWS else None]
    of_files = [note for file in (*(v.photo for v in read), own) for note in notes_of(file)]
    notes = tuple(dict.fromkeys([*of_files, *notes, *of_camera]))
    item = SceneObject(
        id="1", model=own, world_from_model=place, settings=settings, without=mesh.left_out,
        **record.texts, is_placed=sources.start is not None,
    )  # fmt: skip
    return Scene(
        views=ordered, objects=(item,), name=loaded.name, unit=loaded.unit,
        free_scale=known is None, notes=notes,
    )  # fmt: skip


def known_scale(views: LoadedViews, model_unit: str | None) -> float | None:
    """Return lengths of the model's unit in one of the world's, or None if these are not said."""
    unit = views.unit
    if views.scale is not None or unit is None:
        return views.scale
    if model_unit is None or model_unit == unit:
        return 1.0
    return METRES[unit] / METRES[model_unit] if {unit, model_unit} <= set(METRES) else None


def scale_of_views(views: Sequence[View], index: int, mesh: Mesh, pose: Pose, name: str) -> float:
    """Find the scale by features where the model is, or else as ``scale_by_rays``.

    Raises:
        SettingsError: nothing tells it.
    """
    if PlacedModel(mesh, pose).is_seen:
        outline = hull_in_photo(mesh, pose)
        box = Rectangle.from_corners(outline.min(axis=0), outline.max(axis=0))
        depth = depth_by_matches(views, index, box)
        if depth is not None:
            return float(pose.camera_from_model.apply(mesh.centre)[2]) / depth
    return scale_by_rays(views, index, mesh, pose, name)


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
        wanted = "say with `scale` how many of the model's lengths are one of the set's"
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
    wanted = "say with `view` in which photo the start is a pose, one of"
    raise PoseFileError(f"{views.name}: {problem}; {wanted} {list_names(names)}.")
