"""Sets of photos whose cameras know their poses: of COLMAP, nerfstudio, NeRF, BOP, our own."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePosixPath

from poseviewer.files import structs as s
from poseviewer.files.checks import InputFile, is_there, kind_of
from poseviewer.files.colmap_model import colmap_file, colmap_images
from poseviewer.files.formats.bop import CAMERAS, UNIT, WORLD, load_bop_images
from poseviewer.files.formats.conversion import ConvertOptions, as_shown
from poseviewer.files.formats.reconstructions import colmap_views, frame_view, with_slashes
from poseviewer.files.image_sequence import images_in
from poseviewer.files.scene_assets import open_view, open_view_at_rest, view_of_file, with_photo
from poseviewer.files.scene_json import load_scene
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.image import Photo
from poseviewer.scene.assets import PhotoFile
from poseviewer.scene.types import MANY_VIEWS, View

KIND = "set of photos"
SET = "set.json"
"""File in a folder that says the cameras of its photos, as ``poseviewer cameras`` writes it."""
COLMAP_FOLDERS = ("", "sparse/0", "sparse")
"""Folders of a project in which its model may lie."""
PHOTO_FOLDERS = ("", "images", "../images", "../../images", "..", "../..")
"""Folders of its photos, from the model's folder."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadedViews:
    """Views of one thing, before it is known what that is."""

    name: str
    views: tuple[View, ...]
    unit: str | None = None
    """Unit of the world; None: not said."""
    scale: float | None = None
    """Lengths of the model's unit in one of the world's; None: not known."""


@dataclass(frozen=True, slots=True)
class SetChoice:
    """Choices that a set's file leaves open, and how a model stands in the set."""

    photos: tuple[str, ...] = ()
    """Which of its photos, by their files' names, with or without ending; empty: all."""
    folder: Path | None = None
    """Folder of COLMAP's photos; None: looked for beside the model."""
    rig_object: int | None = None
    """Object of a BOP scene whose poses tell how the cameras moved."""
    view: str | None = None
    scale: float | None = None
    """Lengths of the model's unit in one of the set's; None: as the set says, or searched for."""


def load_views(path: str | Path, choice: SetChoice | None = None) -> LoadedViews:
    """Load the set in a file or a folder, with its photos, undistorted; of many, each photo is read
    when it is asked for.

    Raises:
        PoseViewerError: it is none, or of fewer than two photos; a photo or a mask is not there, is
            there twice, or has another size than its camera says.
    """
    path, choice = Path(path), choice or SetChoice()
    file = InputFile(path, kind=KIND)
    with file.naming_errors():
        records, unit, scale, is_of_stored = _views(file, choice)
        views, names = list[View](), dict[str | None, str]()
        chosen = [v for v in records if _is_chosen(str(v.file.location), choice.photos)]
        for unread in chosen:
            notes: list[str] = []
            shown = as_shown(unread, unread.file.location, notes) if is_of_stored else unread
            s.check_camera(file, shown.camera)
            view = open_calibrated(shown, len(chosen), notes)
            if other := names.get(view.file.sha256):  # before the next: a list may name one often
                found = f"{other} and {view.name} are one photo twice"
                wanted = "a set has each photo once, leave one of them out"
                raise file.error(found, wanted)
            names[view.file.sha256] = view.name
            views.append(view)
        for wanted in choice.photos:
            if not any(_is_chosen(str(view.path), [wanted]) for view in views):
                raise file.error(f"it has no photo {wanted}", "choose others with `photos`")
        if len(views) < 2:
            found = f"{len(views)} photo{'' if len(views) == 1 else 's'}"
            raise file.error(found, "a set has two or more; open one photo alone")
        return LoadedViews(path.resolve().name, with_names(views), unit, scale)


def open_calibrated(view: View, count: int, notes: Sequence[str] = ()) -> View:
    """Read the photo of one of ``count`` views whose cameras are known; of many, when it is asked
    for.
    """
    is_of_many = count > MANY_VIEWS
    view = (open_view_at_rest if is_of_many else open_view)(view)[0]
    read = partial(_read_calibrated, view, notes)
    file = replace(view.file, read=read) if is_of_many else PhotoFile.of(read(), view.path)
    return replace(view, file=file)


def _read_calibrated(view: View, notes: Sequence[str]) -> Photo:
    """Read the photo of a view anew, with its camera and notes on it."""
    photo = view.file.read()
    camera = view.camera if isinstance(view.camera, Perspective) else None
    return replace(photo, camera=camera, notes=(*photo.notes, *notes))


def describe_folder(path: Path) -> str:
    """Say what a folder holds: a set, a COLMAP model, a BOP scene, images; "": nothing known."""
    for name in COLMAP_FOLDERS:
        images = colmap_file(path / name, "images")
        if images.is_file():
            return (
                f"a COLMAP model of {len(colmap_images(InputFile(images)))} images, {images.name}"
            )
    if (path / CAMERAS).is_file():
        return f"a BOP scene of {len(load_bop_images(path, notes=[]))} images with cameras"
    if is_there(path / SET):
        return f"a set of {len(load_scene(path / SET).views)} photos with cameras, {SET}"
    images = images_in(path)
    if len(images) > 1:
        return f"{len(images)} images, {images[0].name} to {images[-1].name}: a sequence or a set"
    return ""


def with_names(views: Sequence[View]) -> tuple[View, ...]:
    """The views named by their files, with the folders where two would share a name."""
    paths = [view.file.location for view in views]
    names = [path.name for path in paths]
    if len(set(names)) < len(names):  # of folders, a camera each
        names = [f"{path.parent.name}/{path.name}" for path in paths]
    return tuple(
        replace(view, file=replace(view.file, name=name))
        for view, name in zip(views, names, strict=True)
    )


def _views(
    file: InputFile, choice: SetChoice
) -> tuple[Iterable[View], str | None, float | None, bool]:
    """Views, unit and scale of their world, and whether they are of pixels as stored."""
    path = file.path
    if path.is_dir():
        for name in COLMAP_FOLDERS:
            if colmap_file(path / name, "images").is_file():
                return _of_colmap(file, path / name, choice), None, None, True
        if (path / CAMERAS).is_file():
            return _of_bop(file, choice), UNIT, None, False
        if is_there(path / SET):
            return _of_scene(path / SET)
        known = f"a set ({SET}), COLMAP's model (images.bin or .txt) or a BOP scene ({CAMERAS})"
        raise file.error("a folder without a set of photos", f"wanted {known}")
    data = file.load_object()
    if isinstance(frames := data.get("frames"), list) and data.get("format") != s.SCENE:
        entries = (data | file.object(frame, "a frame") for frame in frames)
        chosen = (e for e in entries if _is_chosen(str(e.get("file_path")), choice.photos))
        return (frame_view(file, own, ConvertOptions()) for own in chosen), None, None, True
    if data.get("format") != s.SCENE:
        found = f"format is {kind_of(data.get('format'))}"
        raise file.error(found, f"wanted {s.SCENE!r}, or nerfstudio's frames")
    return _of_scene(path)


def _of_scene(path: Path) -> tuple[Iterable[View], str | None, float | None, bool]:
    scene = load_scene(path)
    return scene.views, scene.unit, None if scene.free_scale or scene.unit else 1.0, False


def _of_colmap(file: InputFile, model: Path, choice: SetChoice) -> list[View]:
    """Views of the chosen photos, which lie in the folder that has the most of them."""
    images = colmap_views(model, InputFile(colmap_file(model, "images")))
    images = [image for image in images if _is_chosen(image[0], choice.photos)]
    folders = [model / name for name in PHOTO_FOLDERS]
    folders = folders if choice.folder is None else [choice.folder]
    most = max(folders, key=lambda folder: sum(is_there(folder / name) for name, _ in images))
    missing = [name for name, _ in images if not is_there(most / name)]
    if missing:
        where = f"in {most}" if len(missing) < len(images) or choice.folder else "beside it"
        found = f"{len(missing)} of the {len(images)} photos that it names are not {where}"
        wanted = "give them with `folder`, or leave them out with `photos`"
        raise file.error(f"{found}, such as {missing[0]}", wanted)
    return [with_photo(view, most / name) for name, view in images]


def _of_bop(file: InputFile, choice: SetChoice) -> Iterator[View]:
    """Views by the scene's world; else by where the cameras see one of its objects."""
    own = replace(file, path=file.path / CAMERAS)
    rig, wanted = choice.rig_object, "name an object that stands still and is there once"
    notes = list[str]() if choice.photos else None
    for image in load_bop_images(file.path, notes=notes):
        if not _is_chosen(image.photo, choice.photos):
            continue
        place, found = image.camera_from_world, f"image {image.number} has no {WORLD[0]}"
        if rig is not None:
            poses = [pose.camera_from_model for pose in image.objects if pose.object_id == rig]
            if len(poses) != 1 and not choice.photos:
                continue  # it is hidden there, or there are several
            place = poses[0] if len(poses) == 1 else None
            found = f"image {image.number} has {len(poses)} poses of object {rig}"
        if place is None:
            raise own.error(found, f"{wanted}, with `rig_object`: its poses tell the cameras'")
        yield view_of_file(file.path / image.photo, image.camera, camera_from_world=place)


def _is_chosen(name: str, photos: Sequence[str]) -> bool:
    """Tell whether a photo is wanted, by name, end of its path, stem, or number (BOP)."""
    path = PurePosixPath(with_slashes(name))
    numbers = {str(int(path.stem))} if path.stem.isdecimal() else set()
    if not photos or not {path.stem, *numbers}.isdisjoint(photos):
        return True
    ends = tuple(PurePosixPath("/", wanted).as_posix() for wanted in photos)
    return any(f"/{whole}".endswith(ends) for whole in (path, path.with_suffix("")))
