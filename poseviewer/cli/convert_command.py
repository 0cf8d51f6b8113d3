"""Write a pose for another tool, or read one from it. Axes, units and pixel centres of each format:
assets/docs/formats.md.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import structs

from poseviewer.cli.options import made, option
from poseviewer.cli.terminal import say
from poseviewer.errors import PoseFileError
from poseviewer.files.formats.conversion import METRES, ConvertOptions
from poseviewer.files.formats.known_formats import FORMATS, OF_SCENES

if TYPE_CHECKING:
    from poseviewer.files.pose import PoseRecord
    from poseviewer.files.scene_file import SceneRecord

SCENE = "scene"
"""A scene file: read from BOP; written as BOP, any of ``OF_SCENES`` or, an object of it, all."""
UPRIGHT = ("poseviewer", "gltf")
"""Formats whose photo is upright whatever its EXIF says."""


_NAMES = (*FORMATS, SCENE)
_FORM: dict[str, Any] = {"choices": _NAMES, "default": "poseviewer"}
OPTIONS = {
    "": (
        option("source POSE|SCENE"),
        option("out OUT"),
        option("--from FORMAT", dest="source_format", **_FORM),
        option("--to FORMAT", ", ".join(_NAMES), dest="out_format", **_FORM),
        option("--photo PHOTO", "(the one beside POSE that it names)"),
        option(
            "--model MODEL",
            "(the one beside POSE that it names; from bop to scene: the folder of the models)",
        ),
        option("--photo-size WIDTHxHEIGHT", "in px, where POSE does not say it"),
        option("--unit", "of the model, where POSE does not say it", tuple(METRES)),
        option("--image NAME|NUMBER", "which image of a file with several; BOP: its number"),
        option("--object ID|NUMBER", "which object of a scene; BOP: its number"),
        option("--overwrite", "replace OUT if it is there"),
    )
}


def run(options: Namespace) -> int:
    """Read, write, and say what was written."""
    from poseviewer.files.checks import Reading
    from poseviewer.files.photo import is_stored_turned
    from poseviewer.files.scene_file import scene_of_set

    one = None if options.source_format != SCENE else _object_of_scene(options)
    if options.out_format == SCENE or (options.source_format == SCENE and one is None):
        return _convert_scene(options)
    if one is not None:
        record, request = one
    else:
        request = _request(options)
        with Reading(options.source, kind=f"{options.source_format} file").naming_errors():
            record = FORMATS[options.source_format].read(options.source, request)
        record, request = _with_files(record, request, options.source)
        others = _others(scene_of_set(options.source, record), 0, request)
        request = replace(request, others=others)
    for warning in record.warnings:
        say(f"note: {warning}")
    written = FORMATS[options.out_format].convert(record, options.out, request)
    if written.photo and options.out_format not in UPRIGHT and is_stored_turned(written.photo):
        say(
            f"note: {written.photo.name} is stored turned (EXIF), and the pose is one in the "
            "upright photo; save it upright for tools that do not turn it."
        )
    for note in written.notes:
        say(f"note: {note}")
    return _tell(written.files, options)


def _convert_scene(options: Namespace) -> int:
    """Read or write all objects of a photo at once, and say what was written."""
    from poseviewer.files.formats.bop import read_bop_image, save_masks, write_bop_image
    from poseviewer.files.formats.conversion import refuse_existing
    from poseviewer.files.mesh.load import load_mesh
    from poseviewer.files.scene_file import load_scene, save_scene
    from poseviewer.fit.scene import PlacedModel
    from poseviewer.fit.visibility import visibility

    request = _request(options)
    if options.source_format == SCENE:
        scene = load_scene(options.source)
    elif options.source_format == "bop":
        scene = read_bop_image(options.source, request)
    else:
        raise PoseFileError(
            f"{options.source_format} files hold one pose, and a scene is of several; convert from "
            "bop, or write the scene's file by hand."
        )
    for warning in scene.warnings:
        say(f"note: {warning}")
    files, count, first = (options.out,), len(scene.views), scene.views[0].path.name
    if scene.views[0].undistortion is not None and options.out_format != SCENE:
        raise PoseFileError(
            "The scene is one in an undistorted photo; undo the lens first (poseviewer undistort), "
            "or convert its objects one by one with --object ID."
        )
    if options.out_format == SCENE:
        refuse_existing(request, options.out)
        save_scene(options.out, scene)
        return _tell(files, options)
    if options.out_format == "bop":
        image, written = write_bop_image(scene, options.out, request)
        files = written.files
        meshes = {path: load_mesh(path) for path in {one.path for one in scene.objects}}
        models = [
            PlacedModel(meshes[one.path], scene.pose(index))
            for index, one in enumerate(scene.objects)
        ]
        seen = visibility(models)
        visible = [seen.seen(index) for index in range(len(models))]
        save_masks(options.out, image, seen.drawn, visible)
    elif options.out_format in OF_SCENES:
        files = OF_SCENES[options.out_format](scene, options.out, request).files
    else:
        raise PoseFileError(
            f"{options.out_format} files hold one pose; choose an object of the scene with "
            f"--object ID, or convert all to bop, {', '.join(OF_SCENES)}."
        )
    if count > 1:
        say(f"note: {first}, the first of {count} photos, is written; --object ID writes all.")
    return _tell(files, options)


def _tell(files: Iterable[Path], options: Namespace) -> int:
    for path in files:
        say(f"{options.out_format}: {path}")
    return 0


def _object_of_scene(options: Namespace) -> tuple[PoseRecord, ConvertOptions] | None:
    """An object of a scene in all its photos, by default the only one; None: there are several."""
    from poseviewer.files.scene_file import load_scene

    scene = load_scene(options.source)
    is_only = len(scene.objects) == 1  # then --object may be its number in BOP
    if not (options.object or is_only):
        return None
    is_named = options.object in [one.id for one in scene.objects]
    index = scene.index(options.object) if is_named or not is_only else 0
    known = {"object_id": None} if is_named else {}
    request = replace(_request(options, **known), model=options.model or scene.objects[index].path)
    request = replace(request, photo=options.photo or scene.views[0].path)
    return scene.pose_record(index), replace(request, others=_others(scene, index, request))


def _others(
    scene: SceneRecord | None, index: int, request: ConvertOptions
) -> tuple[tuple[PoseRecord, ConvertOptions], ...]:
    """The pose of an object in the scene's other photos; images are numbered on."""
    found, image = [], request.image
    for number, own in enumerate(scene.views if scene else ()):
        if scene is None or number == 0:
            continue
        named = str(int(image) + number) if image and image.isdecimal() else None
        photo = own.path if own.path.is_file() else None
        record = replace(scene.pose_record(index, number), warnings=())
        found.append((record, replace(request, photo=photo, image=named)))
    return tuple(found)


def _request(options: Namespace, **more: Any) -> ConvertOptions:
    from poseviewer.files.formats.conversion import require_file
    from poseviewer.files.photo import load_photo

    of_scene = options.out_format == SCENE  # its --model is a folder
    for path, what in ((options.photo, "photo"), (options.model, "model")):
        if path is not None and not (of_scene and what == "model"):
            require_file(path, what, "Converted")
    if options.object and "object_id" not in more:
        if not options.object.isdecimal():
            raise PoseFileError(f"--object {options.object}: wanted the object's number in BOP.")
        more["object_id"] = int(options.object)
    request = made(ConvertOptions, options, **more)
    if options.photo is None or options.photo_size is not None:
        return request
    photo = load_photo(options.photo)
    return replace(request, photo_size=(photo.width, photo.height))


def _with_files(
    record: PoseRecord, request: ConvertOptions, source: Path
) -> tuple[PoseRecord, ConvertOptions]:
    """The photo and model that lie beside the pose, where the user names none; and their names."""
    from poseviewer.files.pose import ModelReference, PhotoReference

    camera = record.pose.camera
    photo = record.photo or PhotoReference(width=camera.width, height=camera.height)
    model = record.model or ModelReference()
    found_photo = request.photo or _beside(source, photo.file)
    found_model = request.model or _beside(source, model.file)
    # A file that the user names replaces the one that the pose file was made with.
    if request.photo is not None and request.photo.name != photo.file:
        photo = structs.replace(photo, file=request.photo.name, sha256=None)
    if request.model is not None and request.model.name != model.file:
        model = structs.replace(model, file=request.model.name, sha256=None)
    if request.unit is not None:
        model = structs.replace(model, unit=request.unit)
    known = model if model != ModelReference() else None
    return replace(record, photo=photo, model=known), replace(
        request, photo=found_photo, model=found_model
    )


def _beside(source: Path, name: str | None) -> Path | None:
    """The file of a name in the folder of the pose; a name is no path."""
    from poseviewer.files.checks import is_there

    if not name:
        return None
    path = (source if source.is_dir() else source.parent) / Path(name).name
    return path if is_there(path) else None
