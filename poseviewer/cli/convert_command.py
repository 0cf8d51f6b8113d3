"""Write a pose for another tool, or read one from it. Axes, units and pixel centres of each format:
assets/docs/formats.md.
"""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import structs

from poseviewer.cli import options as table
from poseviewer.cli.terminal import say
from poseviewer.errors import PoseFileError
from poseviewer.files.formats.conversion import METRES, ConvertOptions
from poseviewer.files.formats.known_formats import FORMATS

if TYPE_CHECKING:
    from poseviewer.files.scene_json import SceneRecord

SCENE = "scene"
"""Name of the format of scene files."""
_NAMES = tuple(FORMATS)
OPTIONS = {
    "": (
        table.option("source POSE|SCENE"),
        table.option("out OUT", is_output=True),
        table.option("--from FORMAT", None, _NAMES, dest="source_format", default=_NAMES[0]),
        table.option(
            "--to FORMAT", ", ".join(_NAMES), _NAMES, dest="out_format", default=_NAMES[0]
        ),
        table.option("--photo PHOTO", "(the one beside POSE that it names)"),
        table.option(
            "--model MODEL",
            "(the one beside POSE that it names; from bop: the folder of the models)",
        ),
        table.option("--photo-size WIDTHxHEIGHT", "in px, where POSE does not say it"),
        table.option("--unit", "of the model, where POSE does not say it", tuple(METRES)),
        table.option("--image NAME|NUMBER", "which image of a file with several; BOP: its number"),
        table.option("--object ID|NUMBER", "which object of a scene; BOP: its number"),
        table.option("--calibration FILE", "the camera, where POSE does not say it: a matrix"),
        table.option("--opengl", "a matrix is of a camera that looks along -z, y up"),
        table.option("--overwrite", "replace OUT if it is there"),
    )
}


def run(options: Namespace) -> int:
    """Read, write, and say what was written."""
    scene, request = _source(options, _request(options))
    scene = _with_named(scene, request)
    for warning in scene.warnings:
        say(f"note: {warning}")
    files, notes = FORMATS[options.out_format].convert(scene, options.out, request)
    if options.out_format == "bop" and len(scene.objects) > 1:
        from poseviewer.figures.object_maps import pictures_of_objects, save_pictures
        from poseviewer.files.formats.bop import image_number

        first = structs.replace(scene, views=scene.views[:1])
        pictures = pictures_of_objects(first, image_number(scene, request), masks_alone=True)
        save_pictures(options.out, pictures, overwrite=True)
    for note in notes:
        say(f"note: {note}")
    for path in files:
        say(f"{options.out_format}: {path}")
    return 0


def _request(options: Namespace) -> ConvertOptions:
    """Options of the conversion, but for the object; the files that are named are there."""
    from poseviewer.files.formats.conversion import require_file
    from poseviewer.files.photo import load_photo

    if options.photo is not None:
        require_file(options.photo, "photo", "Converted")
    if options.model is not None and not options.model.is_dir():  # that of a BOP scene's models
        require_file(options.model, "model", "Converted")
    request = table.made(ConvertOptions, options)
    if options.photo is None or options.photo_size is not None:
        return request
    photo = load_photo(options.photo)
    return replace(request, photo_size=(photo.width, photo.height))


def _source(options: Namespace, request: ConvertOptions) -> tuple[SceneRecord, ConvertOptions]:
    """The scene to be written, of the objects that are asked for."""
    scene = _read(options, request) if options.source_format == SCENE else None
    if scene is not None and options.object:
        ids = [item.id for item in scene.objects]
        if options.object in ids or len(ids) > 1:
            chosen = scene.objects[scene.index(options.object)]
            return structs.replace(scene, objects=(chosen,)), request
    if options.object:
        if not options.object.isdecimal():
            raise PoseFileError(f"--object {options.object}: wanted the object's number in BOP.")
        request = replace(request, object_id=int(options.object))
    return scene or _read(options, request), request


def _read(options: Namespace, request: ConvertOptions) -> SceneRecord:
    from poseviewer.files.checks import Reading

    with Reading(options.source, kind=f"{options.source_format} file").naming_errors():
        return FORMATS[options.source_format].read(options.source, request)


def _with_named(scene: SceneRecord, request: ConvertOptions) -> SceneRecord:
    """The scene with the files that the user names in place of those that it was made with."""
    (view, *others), objects = scene.views, scene.objects
    photo = _named(view.photo, view.path, request.photo)
    if len(objects) == 1:
        named = None if request.model and request.model.is_dir() else request.model
        model = _named(objects[0].model, objects[0].path, named)
        model = structs.replace(model, unit=request.unit or model.unit)
        objects = (structs.replace(objects[0], model=model),)
    views = (structs.replace(view, photo=photo), *others)
    return structs.replace(scene, views=views, objects=objects)


def _named(reference: Any, path: Path, named: Path | None) -> Any:
    """The reference to a file that the user names, whose content is known if its name is."""
    if named is None:
        return reference
    sha256 = reference.sha256 if named.name == path.name else None
    return structs.replace(reference, file=str(named), sha256=sha256)
