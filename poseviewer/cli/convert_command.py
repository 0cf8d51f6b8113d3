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
from poseviewer.files.formats.known_formats import FORMATS

if TYPE_CHECKING:
    from poseviewer.files.scene_file import SceneRecord

SCENE = "scene"
"""Name of the format of scene files."""
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
    from poseviewer.files.formats.conversion import refuse_existing
    from poseviewer.files.photo import is_stored_turned
    from poseviewer.files.scene_file import save_scene

    scene, request = _source(options)
    for warning in scene.warnings:
        say(f"note: {warning}")
    if options.out_format == SCENE:
        refuse_existing(request, options.out)
        save_scene(options.out, scene)
        return _tell((options.out,), options)
    written = FORMATS[options.out_format].convert(scene, options.out, request)
    if options.out_format == "bop" and len(scene.objects) > 1:
        _save_masks(scene, request, options.out)
    photo = written.photo
    if photo.is_file() and options.out_format not in UPRIGHT and is_stored_turned(photo):
        say(
            f"note: {photo.name} is stored turned (EXIF), and the pose is one in the upright "
            "photo; save it upright for tools that do not turn it."
        )
    for note in written.notes:
        say(f"note: {note}")
    return _tell(written.files, options)


def _source(options: Namespace) -> tuple[SceneRecord, ConvertOptions]:
    """The scene to be written, of the objects that are asked for, by the files that are named."""
    from poseviewer.files.checks import Reading
    from poseviewer.files.formats.bop import read_bop_image
    from poseviewer.files.scene_file import load_scene, scene_of_pose

    if options.source_format == SCENE:
        scene = load_scene(options.source)
        ids = [one.id for one in scene.objects]
        is_named = options.object in ids or (options.object and len(ids) > 1)
        if is_named:
            scene = structs.replace(scene, objects=(scene.objects[scene.index(options.object)],))
        request = _request(options, **({"object_id": None} if is_named else {}))
    else:
        request = _request(options)
        if (options.source_format, options.out_format) == ("bop", SCENE):
            return read_bop_image(options.source, request), request
        with Reading(options.source, kind=f"{options.source_format} file").naming_errors():
            record = FORMATS[options.source_format].read(options.source, request)
        scene = scene_of_pose(options.source, record)
    return _with_named(scene, request), request


def _with_named(scene: SceneRecord, request: ConvertOptions) -> SceneRecord:
    """The scene with the files that the user names in place of those that it was made with."""
    (view, *others), objects = scene.views, scene.objects
    if request.photo is not None:
        sha256 = view.photo.sha256 if request.photo.name == view.path.name else None
        photo = structs.replace(view.photo, file=str(request.photo), sha256=sha256)
        view = structs.replace(view, photo=photo)
    if len(objects) == 1:
        model = objects[0].model
        if request.model is not None:
            sha256 = model.sha256 if request.model.name == objects[0].path.name else None
            model = structs.replace(model, file=str(request.model), sha256=sha256)
        model = structs.replace(model, unit=request.unit or model.unit)
        objects = (structs.replace(objects[0], model=model),)
    return structs.replace(scene, views=(view, *others), objects=objects)


def _save_masks(scene: SceneRecord, request: ConvertOptions, out: Path) -> None:
    """Write which pixels show each object of a BOP image, alone and among the others."""
    from poseviewer.files.formats.bop import image_number, save_masks
    from poseviewer.files.mesh.load import load_mesh
    from poseviewer.fit.scene import PlacedModel
    from poseviewer.fit.visibility import visibility

    meshes = {path: load_mesh(path) for path in {one.path for one in scene.objects}}
    models = [
        PlacedModel(meshes[one.path], scene.pose(index)) for index, one in enumerate(scene.objects)
    ]
    seen = visibility(models)
    visible = [seen.seen(index) for index in range(len(models))]
    save_masks(out, image_number(scene, request), seen.drawn, visible)


def _tell(files: Iterable[Path], options: Namespace) -> int:
    for path in files:
        say(f"{options.out_format}: {path}")
    return 0


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
