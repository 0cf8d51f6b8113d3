"""Open files as documents, away from the main loop."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from poseviewer.app.state.document import Document, with_camera, with_files
from poseviewer.app.state.dragging import move_to
from poseviewer.app.state.objects import with_added
from poseviewer.errors import PoseFileError, QuickStartError
from poseviewer.files.cameras import Calibration, load_calibration
from poseviewer.files.demo import PLACES
from poseviewer.files.image_sequence import sort_frames
from poseviewer.files.photo import load_calibrated_photo, load_photo, orientation_of
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_assets import load_model
from poseviewer.files.state.session_file import AutosavedSession
from poseviewer.geometry.camera import Camera, Parallel, Pose
from poseviewer.geometry.lens import LensModel, same_undistortion
from poseviewer.geometry.transform import RigidTransform
from poseviewer.opening.photo_sets import LoadedViews, SetChoice
from poseviewer.opening.scenes import CORNER, known_scale, notes_of, open_scene
from poseviewer.opening.sources import ModelFiles, Sources
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.sequence import as_still
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import InView, View
from poseviewer.starts.sides import look_from


def open_sources(sources: Sources) -> Document:
    """Open sources as a document, whose objects have default settings unless a scene says them;
    further models become objects, still to be placed. Many views are in the order of their names.
    """
    scene = open_scene(sources)
    shown = scene.views[0]
    if sources.scene is None:
        scene = scene.with_object(0, settings=FitSettings())
        if scene.has_many_views:
            by_path = {view.file.location: view for view in scene.views}
            scene = replace(scene, views=tuple(by_path[path] for path in sort_frames([*by_path])))
    document = with_notes(Document.of(scene), sources.notes)
    document = document.with_view(scene.views.index(shown))
    return with_models(document, [model.path for model in sources.models[1:]])


def open_file_set(
    now: Document,
    files: Sources,
    models: Sequence[Path],
    inside: Path | None = None,
    lens_model: LensModel | None = None,
) -> Document:
    """Open files that came together, in place of what is open.

    Args:
        now: the open document; what the files do not replace stays.
        files: the sorted files.
        models: models with the files that they need; the first replaces the active object's model,
            the others become objects.
        inside: folder that must contain all files that a scene names.
        lens_model: OpenCV's lens model, if the file of cameras does not name one.
    """
    calibration = files.calibration and replace(files.calibration, lens_model=lens_model)
    if files.scene is not None or files.views is not None or files.frames:
        model = models[0] if models else now.model.path
        if model is None and isinstance(files.views, Path):
            raise QuickStartError(
                f"{files.views.name}: a set of photos without a model; drop both together."
            )
        if model is None and files.frames:
            raise QuickStartError("A sequence without a model; drop both together.")
        named = tuple(map(ModelFiles, models))
        return open_sources(
            replace(files, model=model, models=named, calibration=calibration, inside=inside)
        )
    document = replace(now, scene=replace(now.scene, notes=files.notes))
    photo = files.photo if calibration is None or files.photo else now.view.path
    if isinstance(photo, Path):
        if files.photo is None and now.scene.frames:
            wanted = "drop its frames, the model and this file together"
            raise QuickStartError(f"{photo.name} is a frame of a sequence of one camera; {wanted}.")
        document = open_photo(document, photo, calibration)
        if calibration is not None:
            document = with_notes(document, [_camera_note(document, calibration)])
    if models:
        is_same = files.models[0].path == now.model.path
        document = (complete_model if is_same else open_model)(document, models[0])
    if isinstance(files.start, Path):
        document = open_pose(document, files.start)
    return with_models(document, models[1:])


def _camera_note(document: Document, calibration: Calibration) -> str:
    """Sentence on the camera that was read, and what to do next."""
    photo, path = document.photo, document.view.path
    assert path is not None
    size, name = (photo.width, photo.height), calibration.path.name
    read = load_calibration(calibration, photo.name, *size, orientation_of(path))[0].read
    again = "; the pose was found by another camera: search again" * document.object.is_placed
    return f"{name}: the photo's camera was read from {read}{again}."


def with_notes(document: Document, notes: Sequence[str]) -> Document:
    """Add notes for the user on the opened files."""
    return replace(document, scene=replace(document.scene, notes=(*document.scene.notes, *notes)))


def with_models(document: Document, paths: Sequence[Path]) -> Document:
    """Add objects of the models in files, still to be placed."""
    for path in paths:
        model = load_model(path)
        document = with_notes(with_added(document, model), notes_of(model))
    return document


def open_photo(now: Document, path: Path, calibration: Calibration | None = None) -> Document:
    """Open another photo, where the active object is seen from a corner and the others keep their
    places beside it; or calibrate the open photo, in which all objects keep their pixels.
    """
    photo, before = load_calibrated_photo(path, calibration), now.view
    camera, is_same = photo.default_camera(), path == before.path
    centre = now.mesh.centre
    poses = (_corner_view(now.model, camera), now.pose)
    new_centre, old_centre = (pose.camera_from_model.apply(centre) for pose in poses)
    same_pixels = photo.sha256 == before.photo.sha256 and same_undistortion(
        photo.undistortion, before.photo.undistortion
    )
    shown = as_still(now.scene)
    mask = shown.views[now.view_index].mask if same_pixels else None
    view = View(PhotoFile.of(photo, path), camera, mask=mask)
    objects = []
    for index, item in enumerate(now.scene.objects):
        old, own = now.scene.pose(index, now.view_index), shown.in_view(index, now.view_index)
        if is_same:
            pose = with_camera(old, camera, item.mesh.centre)
        else:
            motion = old.camera_from_model
            translation = motion.translation + new_centre - old_centre
            pose = Pose(camera, RigidTransform(motion.rotation, translation))
        scale = item.world_from_model.scale / now.object.world_from_model.scale
        scale = 1.0 if isinstance(old.camera, Parallel) else scale
        world_from_model = view.world_from_model(pose, scale)
        start = {"start": world_from_model, "start_cameras": (camera,)}
        own = InView(mask=own.mask, occluders=own.occluders) if same_pixels else InView()
        item = replace(item, in_views=(own,), is_placed=is_same and item.is_placed, result=None)
        objects.append(replace(item, world_from_model=world_from_model, **start))
    states = tuple(replace(state, marks={}) for state in now.states)
    scene = replace(shown, views=(view,), objects=tuple(objects), free_scale=False)
    notes = notes_of(photo)
    if before.photo.undistortion is not None and calibration is None:
        distorted = "shown as taken, with its distortion; drop it with its file of cameras."
        notes = (*notes, f"{photo.name}: {distorted}")
    return with_notes(Document(scene, states, now.active), notes)


def has_demo_model(document: Document) -> bool:
    """Whether the demo's model is open with a photo that is not the demo's."""
    files = document.model.path, document.view.path
    return [path is not None and path.parent in PLACES for path in files] == [True, False]


def complete_model(now: Document, path: Path) -> Document:
    """Read the open model again, with files that it missed; pose and marks stay."""
    model = load_model(path)
    left_out = [name for name in now.mesh.left_out if name in model.mesh.part_names]
    document = now.with_object(model=model).without_parts(left_out)
    return with_notes(document, notes_of(model))


def open_model(now: Document, path: Path) -> Document:
    """Open another model for the active object, seen from a corner."""
    model = load_model(path)
    pose = _corner_view(model, now.pose.camera)
    views = LoadedViews(now.scene.name, now.scene.views, now.scene.unit)
    scale = known_scale(views, model.unit)
    scale = 1.0 / scale if scale else None
    settings = FitSettings(seed=now.settings.seed)
    document = now.with_object(model=model, settings=settings, without=())
    document = document.with_object(name="", hidden=False, locked=False)
    document = document.with_state(pins=(), marks={}).at_pose(pose, scale=scale)
    document = move_to(document, pose).with_start_here.with_object(is_placed=False)
    return with_notes(document, notes_of(model))


def open_pose(now: Document, path: Path) -> Document:
    """Open a pose file as the active object's start, with its masks and parts left out; the view
    that it belongs to becomes the large one.
    """
    photo = now.photo
    scale = None
    settings = FitSettings(without=now.object.without)
    sources = Sources(model=now.model, start=path, settings=settings)
    if len(now.scene.views) > 1:
        views = LoadedViews(now.scene.name, now.scene.views, now.scene.unit)
        scale = None if now.scene.free_scale else 1.0 / now.object.world_from_model.scale
        opened = open_scene(replace(sources, views=views, choice=SetChoice(scale=scale)))
        scale = opened.objects[0].world_from_model.scale
    else:
        lens = load_pose(path).undistortion
        if lens and not same_undistortion(lens, photo.undistortion) and now.view.path is not None:
            photo = replace(load_photo(now.view.path), name=photo.name)
        opened = open_scene(replace(sources, photo=photo))
    document, names = now, [view.name for view in now.scene.views]
    for view in opened.views:
        document = document.with_view(names.index(view.name))
        if view.photo is not document.photo:
            file = PhotoFile.of(view.photo, document.view.path)
            shown = replace(document.view, file=file, mask=None)
            document = replace(document, scene=replace(now.scene, views=(shown,)))
            document = document.with_mask(None, "object").with_mask(None, "found")
        if view.mask is not None:
            kind = "object" if len(now.scene.objects) > 1 else "photo"
            document = document.with_mask(view.mask, kind)
        for found in opened.earlier_occluders(0, opened.views.index(view)):
            document = document.with_mask(found, "found")
    without = opened.objects[0].without
    document = document if without == now.object.without else document.without_parts(without)
    document = document.with_view(names.index(opened.views[0].name))
    document = document.at_pose(opened.pose(0), scale=scale).with_start_here
    new_texts = {name: text for name, text in opened.objects[0].texts.items() if text}
    document = document.with_object(**now.object.texts | new_texts)
    files = (*(view.photo for view in opened.views), now.model)
    old_notes = {note for file in files for note in notes_of(file)}
    return with_notes(document, [note for note in opened.notes if note not in old_notes])


def _corner_view(model: ModelFile, camera: Camera) -> Pose:
    return look_from(CORNER, model.mesh, model.keypoints, camera)


def open_autosaved(autosave: AutosavedSession) -> Document:
    """Open the session of an earlier run, with its notes and those on models that are gone.

    Raises:
        PoseViewerError: a photo or the active object's model is gone, or cannot be used.
    """
    scene, notes = autosave.scene, list(autosave.notes)
    names = autosave.photo_names or tuple(view.name for view in scene.views)
    for view, name in zip(scene.views, names, strict=True):
        _require_there(view.file.location, name)
    for item in scene.objects:
        try:
            _require_there(item.model.location, item.model.name)
        except PoseFileError as error:
            if item.id == autosave.active_object:
                raise
            notes.append(str(error))
    objects = tuple(item for item in scene.objects if item.model.location.is_file())
    scene = open_scene(Sources(scene=replace(scene, objects=objects)))
    files = [
        replace(view.file, name=name)
        if scene.has_many_views
        else PhotoFile.of(replace(view.photo, name=name), view.path)
        for view, name in zip(scene.views, names, strict=True)
    ]
    document = Document.of(with_files(scene, files))
    document = replace(
        document, active=scene.index(autosave.active_object), view_index=autosave.active_view
    )
    return with_notes(document, notes)


def _require_there(path: Path, name: str) -> None:
    if not path.is_file():
        raise PoseFileError(
            f"{name}: is not where the earlier session had it; open it, and its pose by hand"
        )
