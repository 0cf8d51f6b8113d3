"""BOP's scenes: ``scene_gt.json`` and ``scene_camera.json``, single poses or all images at once.

``docs/bop_datasets_format.md`` of the BOP toolkit: translations in mm, rotations and K row-major,
OpenCV axes, pixel centres at integers.
"""

import json
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from poseviewer.errors import PoseFileError, PoseViewerError, list_names
from poseviewer.files.camera_forms import camera_of_matrix
from poseviewer.files.checks import MAX_DATA_BYTES, InputFile, repair_rotation
from poseviewer.files.formats import conversion as c
from poseviewer.files.scene_assets import model_file, view_of_file
from poseviewer.files.structs import check_camera
from poseviewer.files.writing import make_folder, write_whole
from poseviewer.geometry.camera import Camera, Perspective, Pose
from poseviewer.geometry.lens import opencv_matrix
from poseviewer.geometry.transform import RigidTransform, Similarity, rotation_angle
from poseviewer.scene.types import Scene, SceneObject, View

MAX_DIGITS = 18
"""Length of an image's number: what 64 bits hold."""
UNIT = "mm"
CAMERAS = "scene_camera.json"
POSES = "scene_gt.json"
INFO = "scene_gt_info.json"
"""File of visible fractions and boxes; many scenes do not have it."""
WORLD = ("cam_R_w2c", "cam_t_w2c")
"""BOP's names of the camera from the scene's world; many scenes do not have it."""
PHOTO_NAME = r"(\d+)\.\w+"
MODEL_NAME = r"obj_(\d+)\.\w+"
PHOTO_FOLDERS = ("gray", "rgb")
"""Folders of a scene's photos; of both, the second counts."""
PHOTO_ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
MODEL_FILE = "obj_{:06d}.ply"
MOVED = 0.02
"""Distance of an object's places in two images, by that from the camera, from which it moved."""
SAME = 1e-9
"""Relative and absolute: files round cameras in their last digit."""

SceneFile = dict[str, Any]
SAME_DEG = 1e-4
"""Angle of poses that are the same: an arc cosine loses half of the digits."""
ObjectNumber: Any = Annotated[int, Meta(ge=0)]
"""BOP counts from 1, others from 0."""


@dataclass(frozen=True, slots=True, eq=False)
class BopObject:
    """An object in an image."""

    object_id: int
    camera_from_model: RigidTransform
    """Pose of the model in the camera's frame; its translation is in mm."""

    def as_json(self) -> dict[str, Any]:
        """Return the pose for ``scene_gt.json``."""
        pose = self.camera_from_model
        rotation, shift = pose.rotation.reshape(-1).tolist(), pose.translation.tolist()
        return {"cam_R_m2c": rotation, "cam_t_m2c": shift, "obj_id": self.object_id}


@dataclass(frozen=True, slots=True, eq=False)
class BopImage:
    """One image of a scene."""

    number: int
    photo: str
    """Its file, from the scene's folder; where there is none, where it was looked for."""
    camera: Perspective
    """Pixel centres at i + 0.5; 0x0 px, since a scene does not say the size."""
    objects: tuple[BopObject, ...] = ()
    camera_from_world: RigidTransform | None = None
    """None: the scene does not say it."""


@dataclass(frozen=True, slots=True, eq=False)
class BopEntry:
    """A pose of a scene, read by itself: what is wrong with it spoils no other."""

    image: int
    photo: str
    """Photo's path, as in ``BopImage``."""
    object_id: int
    pose: Pose | None
    """None where there is a problem."""
    problem: str
    """Why there is no pose; or empty."""
    visible: float | None
    """Visible fraction of the object, in [0, 1]; None: the scene does not say it."""


def write_bop(scene: Scene, out: Path, options: c.ConvertOptions, *_: Any) -> c.Contents:
    """Append an object's poses to a scene folder; with several objects, write the whole image."""
    in_cameras, in_poses = (InputFile(out / name) for name in (CAMERAS, POSES))
    cameras, poses = (load_scene_file(file.path) for file in (in_cameras, in_poses))
    for index, view in enumerate(scene.views):
        number = image_number(scene, options, index)
        image, key = _key_of(poses, number), _key_of(cameras, number)
        camera = c.perspective_of(view.camera, "BOP")
        entries = [pose_entry(scene, i, index, options) for i in range(len(scene.objects))]
        if len(scene.objects) > 1:
            if image in poses and not options.overwrite:
                wanted = "name another with `image`, or replace it with `overwrite`"
                raise in_poses.error(f"image {image} is there already and was not touched", wanted)
            cameras.pop(key, None)
            poses.pop(image, None)
        new = camera_entry(camera) | _entry_of_world(scene, index, options)
        there = in_cameras.object(cameras.setdefault(key, new), f"image {image}")
        known = camera_of_matrix(in_cameras, there.get("cam_K"), f"{image}.cam_K")
        if not same_intrinsics(known, camera):
            wanted = "give the pose another with `image`, or convert it with that camera"
            raise in_cameras.error(f"image {image} is there with another camera", wanted)
        cameras[key] = new | there
        of_image = poses.setdefault(image, [])
        if not isinstance(of_image, list):
            raise in_poses.error(f"image {image} is not a list", "wanted a list of poses")
        of_image += [entry for entry in entries if entry not in of_image]
    return _scene_texts(out, cameras, poses)


def read_bop(path: Path, request: c.ConvertOptions) -> Scene:
    """Read the objects of an image, or of all images of a scene that says its world;
    ``request.model`` may be the folder of their models.
    """
    file = InputFile(path / POSES)
    stem = Path(request.image or "").stem
    images = load_bop_images(path, True, file.warnings)
    posed = [(f"{item.number}", item) for item in images if item.objects]
    by_number = replace(request, image=str(int(stem)) if stem.isdecimal() else request.image)
    if file.warnings and by_number.image not in (None, *dict(posed)):
        raise PoseFileError(file.warnings[0])
    is_whole = request.image is request.photo is None and len(posed) > 1
    if is_whole and all(image.camera_from_world for image in images):
        return _read_whole(file, images, request)
    image = by_number.the_one(file, "images", posed)
    view = view_of_file(request.photo or path / image.photo, image.camera)
    view = request.with_size(InputFile(path / CAMERAS), view)
    objects = _objects_in(image, RigidTransform.identity(), request)
    if not objects:
        found = f"image {image.number} has no pose of object {request.object_id}"
        raise file.error(found, "choose another with `object_id`")
    return Scene(views=(view,), objects=tuple(objects), notes=tuple(file.warnings))


def _read_whole(file: InputFile, images: Sequence[BopImage], request: c.ConvertOptions) -> Scene:
    """Read a scene that stands still: each object is where the first image has it."""
    folder, farthest, most = file.path.parent, 0.0, 0.0
    views, objects = list[View](), dict[str, SceneObject]()
    for image in images:
        assert image.camera_from_world is not None
        place = _in_unit(image.camera_from_world, request)
        view = view_of_file(folder / image.photo, image.camera, camera_from_world=place)
        views.append(request.with_size(InputFile(folder / CAMERAS), view))
        for item in _objects_in(image, place, request):
            first = objects.setdefault(item.id, item).world_from_model.rigid
            here = item.world_from_model.rigid
            depth = max(float(np.linalg.norm(place.apply(first.translation))), SAME)
            off = float(np.linalg.norm(here.translation - first.translation)) / depth
            if off > MOVED:
                found = (
                    f"object {item.id} stands elsewhere in image {image.number}, by {off:.0%} of"
                )
                raise file.error(f"{found} its distance", "choose one image with `image`")
            farthest = max(farthest, off)
            most = max(most, float(np.degrees(rotation_angle(here.rotation, first.rotation))))
    if not objects:
        raise file.error(
            f"no pose of object {request.object_id}", "choose another with `object_id`"
        )
    if farthest > SAME or most > SAME_DEG:
        said = f"poses of other images are up to {farthest:.2%} of the distance beside these"
        said += f", and turned by up to {most:.1f} degrees"
        file.warnings.append(f"Objects are where the first image has them; {said}.")
    unit = request.unit or UNIT
    return Scene(
        views=tuple(views), objects=tuple(objects.values()), unit=unit, notes=tuple(file.warnings)
    )


def _objects_in(
    image: BopImage, camera_from_world: RigidTransform, request: c.ConvertOptions
) -> list[SceneObject]:
    """Return the objects of an image that are asked for, in a world."""
    folder = request.model if request.model and request.model.is_dir() else Path()
    counts, objects, back = Counter[int](), list[SceneObject](), camera_from_world.inverse()
    for item in image.objects:
        number = item.object_id
        if request.object_id in (None, number):
            counts[number] += 1
            name = f"{number}-{counts[number]}" if counts[number] > 1 else f"{number}"
            model = model_file(model_path(folder, number), unit=request.unit or UNIT)
            place = Similarity(back @ _in_unit(item.camera_from_model, request))
            objects.append(SceneObject(id=name, model=model, world_from_model=place))
    return objects


def _in_unit(place: RigidTransform, request: c.ConvertOptions) -> RigidTransform:
    """Return a pose of BOP in the unit that is asked for."""
    factor = c.metres_per_unit(UNIT) / c.metres_per_unit(request.unit or UNIT)
    return replace(place, translation=place.translation * factor)


def model_path(folder: Path, number: int) -> Path:
    """The model of an object in a folder of models.

    Raises:
        PoseFileError: it is there in another format alone, and so in another unit.
    """
    path = folder / MODEL_FILE.format(number)
    others = [] if path.is_file() else sorted(folder.glob(f"{path.stem}.*"))
    if folder.name and others:
        wanted = f"export it as {path.name}, in mm"
        raise PoseFileError(f"{others[0].name}: a model of BOP has to be a PLY file; {wanted}.")
    return path


def load_bop_images(
    folder: Path, posed: bool = False, notes: list[str] | None = None
) -> tuple[BopImage, ...]:
    """All images of a scene that have a camera, by number.

    Args:
        folder: of the scene.
        posed: whether it has to have ``scene_gt.json``.
        notes: list for a note on images that have poses and no camera; None: they are refused.
    """
    file, objects = InputFile(folder / CAMERAS), InputFile(folder / POSES)
    cameras, poses = _by_number(file, True), _by_number(objects, posed)
    photos, images = _photos(folder), []
    if alone := [str(number) for number in sorted(poses) if number not in cameras]:
        found = f"no camera for {len(alone)} of the {len(poses)} images of {POSES}"
        error = file.error(f"{found} ({list_names(alone)})", "give each image its camera there")
        if notes is None:
            raise error
        notes.append(str(error))
    for number, entry in cameras.items():
        camera = _camera(file, cameras, number)
        entries = enumerate(_entries(objects, poses, number))
        there = tuple(_object(objects, own, f"pose {i} of image {number}") for i, own in entries)
        is_in_world = all(key in entry for key in WORLD)
        world = _transform(file, entry, "w2c", f"image {number}") if is_in_world else None
        images.append(BopImage(number, photos(number), camera, there, world))
    if not images:
        raise file.error("no image in it", "wanted a camera for each image")
    return tuple(sorted(images, key=lambda image: image.number))


def load_bop_entries(folder: Path) -> list[BopEntry]:
    """All poses of a scene, each by itself, in order of their images."""
    files = file, objects, said = [InputFile(folder / name) for name in (CAMERAS, POSES, INFO)]
    cameras, poses, infos = (_by_number(own, own is not said) for own in files)
    photos, loaded = _photos(folder), []
    for number in sorted(poses):
        entries = poses[number] if isinstance(poses[number], list) else [poses[number]]
        for i, entry in enumerate(entries):
            what, pose, visible, problem = f"pose {i} of image {number}", None, None, ""
            object_id = object_number(entry)
            try:
                camera, item = _camera(file, cameras, number), _object(objects, entry, what)
                object_id, pose = item.object_id, Pose(camera, item.camera_from_model)
                about = _entries(said, infos, number)[i : i + 1]
                if about:
                    share = said.object(about[0], what).get("visib_fract")
                    visible = None if share is None else said.number(share, f"{what}.visib_fract")
            except PoseViewerError as error:
                pose, problem = None, str(error)
            loaded.append(BopEntry(number, photos(number), object_id, pose, problem, visible))
    return loaded


def load_bop_camera(folder: Path, image: int) -> Perspective:
    """Load the camera of an image of a scene."""
    file = InputFile(folder / CAMERAS)
    return _camera(file, _by_number(file, is_needed=True), image)


def object_number(entry: Any) -> int:
    """Return the number of the object of a pose's entry; 0 where it has none."""
    number = entry.get("obj_id") if isinstance(entry, dict) else None
    return number if isinstance(number, int) else 0


def save_bop_images(
    folder: Path, cameras: Mapping[str, Any], poses: Mapping[int, Sequence[BopObject]]
) -> None:
    """Write a scene's ``cameras`` as they are, and the poses of each image by its number."""
    entries = {str(number): [o.as_json() for o in objects] for number, objects in poses.items()}
    save_scene_files(folder, dict(cameras), entries)


def save_scene_files(folder: Path, cameras: SceneFile, poses: SceneFile) -> None:
    """Write the files of a scene."""
    make_folder(folder)
    for path, text in _scene_texts(folder, cameras, poses).items():
        write_whole(path, text.encode(), PoseFileError)


def _scene_texts(folder: Path, cameras: SceneFile, poses: SceneFile) -> dict[Path, str]:
    return {folder / CAMERAS: scene_text(cameras), folder / POSES: scene_text(poses)}


def _key_of(content: SceneFile, number: int) -> str:
    """The key of an image in a scene's file, of which some tools write zeros before."""
    same = (key for key in content if key.isdecimal() and int(key) == number)
    return next(same, str(number))


def scene_text(content: SceneFile) -> str:
    """A file of a scene, an image a line, in order, as the toolkit does."""
    images = sorted(content, key=lambda image: (len(image), image))
    lines = (f"  {json.dumps(image)}: {json.dumps(content[image])}" for image in images)
    return "{\n" + ",\n".join(lines) + "\n}\n"


def load_scene_file(path: Path) -> SceneFile:
    """Content of a scene's file by image; empty where it is not there yet."""
    return InputFile(path, largest=MAX_DATA_BYTES).load_object() if path.exists() else {}


def same_intrinsics(one: Perspective, other: Perspective) -> bool:
    """Tell whether two cameras are one, up to the rounding of files."""
    numbers = [[own.fx, own.fy, own.cx, own.cy] for own in (one, other)]
    return bool(np.allclose(*numbers, rtol=SAME, atol=SAME))


def camera_entry(camera: Camera) -> dict[str, Any]:
    """Return the entry of an image in ``scene_camera.json``."""
    matrix = opencv_matrix(c.perspective_of(camera, "BOP"))
    return {"cam_K": matrix.reshape(-1).tolist(), "depth_scale": 1.0}


def _entry_of_world(scene: Scene, view: int, options: c.ConvertOptions) -> dict[str, Any]:
    """Return the place of one of several cameras in the world, for ``scene_camera.json``."""
    if len(scene.views) == 1:
        return {}
    # All models are in one unit, and so is their scale in the world.
    factor = options.lengths_in(UNIT, scene, "BOP") / scene.objects[0].world_from_model.scale
    place = scene.views[view].camera_from_world
    numbers = place.rotation.reshape(-1).tolist(), (factor * place.translation).tolist()
    return dict(zip(WORLD, numbers, strict=True))


def pose_entry(scene: Scene, index: int, view: int, options: c.ConvertOptions) -> dict[str, Any]:
    """Return the entry of an object's pose in ``scene_gt.json``.

    Args:
        scene: views and objects.
        index: of the object.
        view: index of the view.
        options: the object's number and the models' unit, where the scene does not say them.

    Raises:
        PoseFileError: neither says them.
    """
    factor = options.lengths_in(UNIT, scene, "BOP")
    place, number = scene.pose(index, view).camera_from_model, object_numbers(scene, options)[index]
    return BopObject(number, replace(place, translation=place.translation * factor)).as_json()


def object_numbers(scene: Scene, options: c.ConvertOptions) -> list[int]:
    """Return the objects' numbers: what the user says, else what the models' names say, else, of
    several objects, the id of the first one of that model.

    Raises:
        PoseFileError: one is not known, or two models have the same.
    """
    several, ids, owners = len(scene.objects) > 1, dict[str, int](), dict[int, SceneObject]()
    said, numbers = options.object_ids or (options.object_id,) * len(scene.objects), list[int]()
    for item, given in zip(scene.objects, said, strict=True):
        name = item.model.location.name
        if given is None and several and _is_number(item.id) and not re.fullmatch(MODEL_NAME, name):
            given = ids.setdefault(name, int(item.id))
        way = f'object_id="{item.id}=NUMBER"'
        numbers.append(number := _number(given, MODEL_NAME, name, "object", way, "obj_000005.ply"))
        owner = owners.setdefault(number, item)
        if len({one.model.sha256 or one.model.location for one in (owner, item)}) > 1:
            found = f"Objects {owner.id} ({owner.model.name}) and {item.id} ({item.model.name})"
            wanted = f"give each model a number of its own with `{way}`"
            raise PoseFileError(f"{found} have the number {number} in BOP; {wanted}.")
    return numbers


def require_numbers(scene: Scene, options: c.ConvertOptions) -> None:
    """Require the objects' numbers and the models' unit.

    Raises:
        PoseFileError: one is not known.
    """
    options.lengths_in(UNIT, scene, "BOP")
    object_numbers(scene, options)


def image_number(scene: Scene, options: c.ConvertOptions, view: int = 0) -> int:
    """Number of a view's image: what the user says, else by the photo's name."""
    name = scene.views[view].file.location.name
    return _number(options.number_of(scene, view), PHOTO_NAME, name, "image", "image", "000003.png")


def likely_numbers(scene: Scene) -> tuple[int | None, tuple[int, ...]]:
    """Guess the numbers of the first image, None unless the photos' names are numbers, and of all
    objects: that in the model's name, else the id of the first object of that model.
    """
    images = [re.fullmatch(PHOTO_NAME, view.file.location.name) for view in scene.views]
    image = images[0] if all(images) else None
    ids = dict[str, int]()
    for count, item in enumerate(scene.objects, 1):
        name = item.model.location.name
        named, own = re.fullmatch(MODEL_NAME, name), int(item.id) if _is_number(item.id) else count
        ids.setdefault(name, int(named[1]) if named else own)
    numbers = tuple(ids[item.model.location.name] for item in scene.objects)
    return int(image[1]) if image else None, numbers


def _is_number(text: str) -> bool:
    return text.isdecimal() and len(text) <= MAX_DIGITS


def _number(
    given: str | int | None, pattern: str, name: str, what: str, setting: str, example: str
) -> int:
    said = name if given is None else str(given)
    if match := re.fullmatch(rf"{pattern}|(\d+)", said):
        return int(match[1] or match[2])
    found = f"BOP wants the {what}'s number, and found {said or 'none'!r}"
    wanted = f"say it with `{setting}` (a file called like {example} says it by its name)"
    raise PoseFileError(f"{found}; {wanted}.")


def _by_number(file: InputFile, is_needed: bool) -> dict[int, Any]:
    """Content of a scene's file by the images' numbers, of which some tools write zeros before."""
    if is_needed and not file.path.is_file():
        found = f"no such file in {file.path.parent}"
        raise file.error(found, "name a BOP scene's folder, such as test/000002")
    content = load_scene_file(file.path)
    for name in content:
        if not (name.isdecimal() and len(name) <= MAX_DIGITS):
            raise file.error(f"image {name[:40]!r}", "wanted images' numbers")
    numbered = {int(name): own for name, own in content.items()}
    if len(numbered) < len(content):
        raise file.error("two images of one number", "wanted each number once")
    return numbered


def _photos(folder: Path) -> Callable[[int], str]:
    """A function that gives the photo of an image by its number."""
    known = {
        int(path.stem): f"{name}/{path.name}"
        for name in PHOTO_FOLDERS
        for path in sorted((folder / name).glob("*"))
        if path.stem.isdecimal() and path.suffix.lower() in PHOTO_ENDINGS
    }
    return lambda number: known.get(number, f"{PHOTO_FOLDERS[1]}/{number:06d}.png")


def _camera(file: InputFile, cameras: Mapping[int, Any], image: int) -> Perspective:
    if image not in cameras:
        raise file.error(f"image {image} has no camera", "wanted one for each image with poses")
    matrix = file.object(cameras[image], f"image {image}").get("cam_K")
    return check_camera(file, camera_of_matrix(file, matrix, f"cam_K of {image}"))


def _entries(file: InputFile, content: Mapping[int, Any], image: int) -> list[Any]:
    entries = content.get(image, [])
    if not isinstance(entries, list):
        raise file.error(f"image {image} is not a list", "wanted a list of poses")
    return entries


def _object(file: InputFile, entry: Any, what: str) -> BopObject:
    said = file.object(entry, what)
    place = _transform(file, said, "m2c", what)
    return BopObject(file.decode(said.get("obj_id"), ObjectNumber, f"{what}.obj_id"), place)


def _transform(file: InputFile, said: dict[str, Any], way: str, what: str) -> RigidTransform:
    rotation, shift = (f"cam_{letter}_{way}" for letter in "Rt")
    matrix = np.reshape(file.flat_numbers(said.get(rotation), f"{what}.{rotation}", 9), (3, 3))
    translation = np.array(file.flat_numbers(said.get(shift), f"{what}.{shift}", 3))
    return RigidTransform(repair_rotation(file, matrix), translation)


BOP = c.Format(
    write_bop,
    read_bop,
    several_objects=True,
    several_of_both=True,
    appends=True,
    photos_in="rgb",
    require=require_numbers,
)
