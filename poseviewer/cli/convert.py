"""Write a pose for another tool, or read one from it. Axes, units and pixel centres of each format:
assets/docs/formats.md.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from poseviewer.cli.options import made, option, size
from poseviewer.cli.terminal import say
from poseviewer.errors import PoseFileError

if TYPE_CHECKING:
    from poseviewer.files.formats.conversion import ConvertOptions
    from poseviewer.files.pose import PoseRecord

SCENE = "scene"
"""A scene file: read from BOP; written as BOP, any of ``OF_SCENES`` or, an object of it, all."""
UPRIGHT = ("poseviewer", "gltf")
"""Formats whose photo is upright whatever its EXIF says."""


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer convert``."""
    from poseviewer.files.formats.conversion import METRES
    from poseviewer.files.formats.table import FORMATS

    names = (*FORMATS, SCENE)
    form = {"choices": names, "default": "poseviewer"}
    option(parser, "source POSE|SCENE", kind=Path)
    option(parser, "out OUT", kind=Path)
    option(parser, "--from FORMAT", dest="source_format", **form)
    option(parser, "--to FORMAT", ", ".join(names), dest="out_format", **form)
    option(parser, "--photo PHOTO", "(the one beside POSE that it names)", Path)
    beside = "(the one beside POSE that it names; from bop to scene: the folder of the models)"
    option(parser, "--model MODEL", beside, Path)
    option(parser, "--photo-size WxH", "in px, where POSE does not say it", size)
    option(parser, "--unit", "of the model, where POSE does not say it", choices=METRES)
    option(parser, "--image NAME|NUMBER", "which image of a file with several; BOP: its number")
    option(parser, "--object ID|NUMBER", "which object of a scene; BOP: its number")
    option(parser, "--overwrite", "replace OUT if it is there")


def run(options: Namespace) -> int:
    """Read, write, and say what was written."""
    from poseviewer.files.checks import Reading
    from poseviewer.files.formats.table import FORMATS
    from poseviewer.files.photo import is_stored_turned

    if options.out_format == SCENE or (options.source_format == SCENE and not options.object):
        return _convert_scene(options)
    if options.source_format == SCENE:
        record, request = _object_of_scene(options)
    else:
        request = _request(options)
        with Reading(options.source, kind=f"{options.source_format} file").naming_errors():
            record = FORMATS[options.source_format].read(options.source, request)
        record, request = _with_files(record, request, options.source)
        request = replace(request, others=_others(record, request, options.source))
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
    for path in written.files:
        say(f"{options.out_format}: {path}")
    return 0


def _convert_scene(options: Namespace) -> int:
    """Read or write all objects of a photo at once, and say what was written."""
    from poseviewer.files.formats.bop import read_bop_image, save_masks, write_bop_image
    from poseviewer.files.formats.conversion import refuse_existing
    from poseviewer.files.formats.table import OF_SCENES
    from poseviewer.files.mesh.load import load_mesh
    from poseviewer.files.scene import load_scene, save_scene
    from poseviewer.fit.registration import PlacedModel
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
    files = (options.out,)
    if scene.undistortion is not None and options.out_format != SCENE:
        raise PoseFileError(
            "The scene is one in an undistorted photo; undo the lens first (poseviewer undistort), "
            "or convert its objects one by one with --object ID."
        )
    if options.out_format == SCENE:
        refuse_existing(request, options.out)
        save_scene(options.out, scene)
    elif options.out_format == "bop":
        image, written = write_bop_image(scene, options.out, request)
        files = written.files
        meshes = {path: load_mesh(path) for path in {one.model for one in scene.objects}}
        models = [PlacedModel(meshes[one.model], one.record.pose) for one in scene.objects]
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
    for path in files:
        say(f"{options.out_format}: {path}")
    return 0


def _object_of_scene(options: Namespace) -> tuple[PoseRecord, ConvertOptions]:
    """The pose of one object of a scene."""
    from poseviewer.files.scene import load_scene

    scene = load_scene(options.source)
    one = scene.objects[scene.index(options.object)]
    request = replace(_request(options, object_id=None), photo=options.photo or scene.photo)
    request = replace(request, model=options.model or one.model)
    photo = replace(scene.photo_reference, file=scene.photo.name)
    return replace(one.record, photo=photo, warnings=scene.warnings), request


def _others(
    record: PoseRecord, request: ConvertOptions, source: Path
) -> tuple[tuple[PoseRecord, ConvertOptions], ...]:
    """The pose in the other photos of its set, which lie beside it; images are numbered on."""
    from poseviewer.files.pose import set_frame

    frame, found = set_frame(record), []
    for index, other in enumerate(() if frame is None else frame.others, 1):
        name, image = other.photo.file if other.photo else None, request.image
        number = str(int(image) + index) if image and image.isdecimal() else None
        photo = (request.photo and _beside(request.photo, name)) or _beside(source, name)
        found.append((other, replace(request, photo=photo, image=number)))
    return tuple(found)


def _request(options: Namespace, **more: Any) -> ConvertOptions:
    from poseviewer.files.formats.conversion import ConvertOptions, require_file
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
        photo = replace(photo, file=request.photo.name, sha256=None)
    if request.model is not None and request.model.name != model.file:
        model = replace(model, file=request.model.name, sha256=None)
    if request.unit is not None:
        model = replace(model, unit=request.unit)
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
