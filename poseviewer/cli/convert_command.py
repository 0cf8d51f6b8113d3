"""Write a pose for another tool, or read one from it. Axes, units and pixel centres of each format:
assets/docs/formats.md.
"""

from __future__ import annotations

import re
from argparse import Namespace
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from poseviewer.cli import options as table
from poseviewer.cli.terminal import say
from poseviewer.errors import PoseFileError
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.known_formats import FORMATS
from poseviewer.files.formats.sequence_export import SEQUENCE_FORMATS
from poseviewer.files.mesh.size import METRES
from poseviewer.scene.sequence import as_still, stale_notes

if TYPE_CHECKING:
    from pathlib import Path

    from poseviewer.render.overlay.styles import Picture
    from poseviewer.scene.types import Scene

SCENE = "scene"
"""Name of the format of scene files."""
_NAMES = tuple(FORMATS)
_OF_SEQUENCES = tuple(name for name in SEQUENCE_FORMATS if name not in FORMATS)
_WRITTEN = (*_NAMES, *_OF_SEQUENCES)
MATRIX_OPTIONS = (
    table.option("--opengl", "take matrices as OpenGL's, whose camera looks along -z, y up"),
    table.option("--inverse", "take matrices as those of the model from the camera"),
)
_READ = "read this format, one of those of --to (default: %(default)s, or scene, by the file)"
_WRITE = (
    f"write this format: {', '.join(_NAMES)}, or of a sequence {', '.join(_OF_SEQUENCES)} "
    "(default: %(default)s)"
)
_OBJECT = "choose this object of several, and say its number in BOP; repeat for more (default: all)"
NUMBERED = re.compile(r"(.+)=([0-9]{1,18})")
"""Object's id and its number in BOP."""
OPTIONS = {
    "": (
        table.option("source POSE|SCENE", "pose or scene, of this or another tool"),
        table.option("out OUT", "file or folder to write", is_output=True),
        table.option("--from FORMAT", _READ, _NAMES, dest="source_format", default=_NAMES[0]),
        table.option("--to FORMAT", _WRITE, _WRITTEN, dest="out_format", default=_NAMES[0]),
        table.option("--photo PHOTO", "use this photo (default: the one in POSE)"),
        table.option("--model MODEL", "use this, or BOP's folder of models (default: POSE's)"),
        table.option("--photo-size WIDTHxHEIGHT", "set this size, in px (default: --photo's)"),
        table.option("--unit", "set the model's length unit (default: POSE's)", tuple(METRES)),
        table.option("--image NAME|NUMBER", "choose this image of several (default: the only one)"),
        table.option("--object ID|NUMBER|ID=NUMBER", _OBJECT, action="append", dest="object_id"),
        table.option("--calibration FILE", "read a bare matrix's camera here (default: none)"),
        table.LENS_MODEL,
        *MATRIX_OPTIONS,
        table.LOOK,
        table.option("--overwrite", "replace OUT if it exists"),
    )
}
EXAMPLES = (
    "poseviewer convert pose.json car.glb --to gltf",
    "poseviewer convert pose.yml pose.json --from opencv --photo photo.jpg --model car.glb",
)


def run(options: Namespace) -> int:
    """Read, write, and say what was written."""
    scene, request = _source(options, _request(options))
    scene = _with_named_files(scene, request)
    for note in scene.notes:
        say(f"note: {table.in_options(note, OPTIONS)}")
    name = options.out_format
    if scene.frames and name in SEQUENCE_FORMATS:
        files, notes = _convert_sequence(scene, options, request)
    elif name not in FORMATS:
        raise PoseFileError(f"--to {name} is for sequences, and {options.source} has no frames.")
    else:
        if scene.frames and name != SCENE:
            say(f"note: Such a file is of one frame: that of {scene.views[0].name}.")
            for note in stale_notes(scene, [scene.frame_index]):
                say(f"note: {note}")
            scene = as_still(scene)
        files, notes = FORMATS[name].convert(scene, options.out, request)
        if name == "bop":
            from poseviewer.figures.object_maps import write_masks

            notes += write_masks(scene, options.out, request)
    for note in notes:
        say(f"note: {table.in_options(note, OPTIONS)}")
    for path in files:
        say(f"{name}: {path}")
    return 0


def _convert_sequence(
    scene: Scene, options: Namespace, request: ConvertOptions
) -> tuple[list[Path], list[str]]:
    from poseviewer.api import Registration
    from poseviewer.figures.object_maps import pictures_of_objects
    from poseviewer.files.formats.sequence_export import SequencePictures, export_sequence
    from poseviewer.render.renderers import make_renderer

    renderers = {}

    def draw(shown: Scene) -> Picture:
        for item in shown.objects:
            if item.mesh not in renderers:
                renderers[item.mesh] = make_renderer(item.mesh, item.settings.renderer)
        return Registration(shown, renderers).whole.picture(options.look)

    pictures = SequencePictures(draw, partial(pictures_of_objects, masks_alone=True))
    return export_sequence(options.out_format, scene, options.out, request, pictures)


def _request(options: Namespace) -> ConvertOptions:
    """Make the options of the conversion, without the object; refuse missing files."""
    from poseviewer.files.formats.conversion import require_file
    from poseviewer.files.photo import load_photo
    from poseviewer.opening.sources import is_scene_file

    if options.source_format == _NAMES[0] and is_scene_file(options.source):
        options.source_format = SCENE
    if "matrix" not in (options.source_format, options.out_format):
        table.refuse(options, MATRIX_OPTIONS, "without --from matrix or --to matrix; leave it out")
    if options.photo is not None:
        require_file(options.photo, "photo", "Converted")
    if options.model is not None and not options.model.is_dir():  # that of a BOP scene's models
        require_file(options.model, "model", "Converted")
    request = table.make(ConvertOptions, options, object_id=None)
    if options.photo is None or options.photo_size is not None:
        return request
    photo = load_photo(options.photo)
    return replace(request, photo_size=(photo.width, photo.height))


def _source(options: Namespace, request: ConvertOptions) -> tuple[Scene, ConvertOptions]:
    """Read the source, and choose the objects."""
    scene = _read(options, request) if options.source_format == SCENE else None
    asked: list[str] = options.object_id or []
    if len(asked) == 1 and asked[0].isdecimal() and (scene is None or len(scene.objects) == 1):
        request = replace(request, object_id=int(asked[0]))
        asked = []
    scene = scene or _read(options, request)
    if not asked:
        return scene, request
    matches = [(text, NUMBERED.fullmatch(text)) for text in asked]
    numbers = {match[1] if match else text: match and int(match[2]) for text, match in matches}
    chosen = tuple(scene.objects[scene.index(name)] for name in numbers)
    request = replace(request, object_ids=tuple(numbers.values()))
    return replace(scene, objects=chosen), request


def _read(options: Namespace, request: ConvertOptions) -> Scene:
    from poseviewer.files.checks import InputFile

    with InputFile(options.source, kind=f"{options.source_format} file").naming_errors():
        return FORMATS[options.source_format].read(options.source, request)


def _with_named_files(scene: Scene, request: ConvertOptions) -> Scene:
    """Replace the scene's files by those that the user names; equal names keep their hash."""
    from poseviewer.files.scene_assets import model_file, with_photo

    (view, *others), objects = scene.views, scene.objects
    if (path := request.photo) is not None:
        sha256 = view.file.sha256 if path.name == view.file.location.name else None
        view = with_photo(view, path, sha256)
    if len(objects) == 1:
        model = objects[0].model
        path = None if request.model and request.model.is_dir() else request.model
        sha256 = model.sha256 if path is None or path.name == model.location.name else None
        model = model_file(path or model.location, sha256, request.unit or model.unit)
        objects = (replace(objects[0], model=model),)
    return replace(scene, views=(view, *others), objects=objects)
