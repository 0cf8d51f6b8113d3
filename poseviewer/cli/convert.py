"""``poseviewer convert``: a pose from one tool's file into another's."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli import option_values

if TYPE_CHECKING:
    from poseviewer.files.formats.request import Request
    from poseviewer.files.pose.file import PoseRecord

FORMAT_NAMES = (
    "poseviewer", "opencv", "matrices", "bop", "colmap", "nerfstudio", "gltf", "blender", "meshlab",
)  # fmt: skip
"""The keys of ``files.formats.table.FORMATS``, here without importing NumPy and OpenCV."""
UPRIGHT = ("poseviewer", "gltf")
"""Formats whose photo is upright whatever its EXIF says."""
UNITS = ("km", "m", "cm", "mm", "in", "ft")


def add_convert(commands: argparse._SubParsersAction) -> None:
    """The command's options."""
    convert = commands.add_parser(
        "convert",
        help="write a pose for another tool, or read one from it",
        description="Write a pose for another tool, or read one from it. Axes, units and pixel "
        "centres of each format: assets/docs/formats.md.",
    )
    convert.add_argument("source", type=Path, metavar="POSE")
    convert.add_argument("out", type=Path, metavar="OUT")
    convert.add_argument(
        "--from", dest="source_format", choices=FORMAT_NAMES, default="poseviewer", metavar="FORMAT"
    )
    convert.add_argument(
        "--to", dest="out_format", choices=FORMAT_NAMES, default="poseviewer", metavar="FORMAT",
        help=", ".join(FORMAT_NAMES),
    )  # fmt: skip
    convert.add_argument("--photo", type=Path, help="(the one beside POSE that it names)")
    convert.add_argument("--model", type=Path, help="(the one beside POSE that it names)")
    convert.add_argument(
        "--photo-size",
        type=option_values.size,
        metavar="WxH",
        help="in px, where POSE does not say it",
    )
    convert.add_argument("--unit", choices=UNITS, help="of the model, where POSE does not say it")
    convert.add_argument(
        "--image", metavar="NAME|NUMBER", help="which image of a file with several; BOP: its number"
    )
    convert.add_argument(
        "--object", type=option_values.whole_from_zero, metavar="NUMBER", help="BOP: of the object"
    )
    convert.add_argument(
        "--undistorted-photo",
        type=Path,
        metavar="FILE.png",
        help="where a lens was undone: write the undistorted photo, and the pose for it (done "
        "beside OUT for formats that do not have the lens)",
    )
    convert.add_argument("--overwrite", action="store_true", help="replace OUT if it is there")
    convert.set_defaults(command="convert")


def convert(options: argparse.Namespace) -> Iterator[str]:
    """Read, write; yields the lines to print.

    Raises:
        PoseViewerError: the pose cannot be read, or not be said in the format wanted.
    """
    from poseviewer.errors import PoseFileError
    from poseviewer.files.formats.lens import for_one_photo
    from poseviewer.files.formats.table import FORMATS
    from poseviewer.files.photo.load import is_stored_turned

    read = FORMATS[options.source_format].read
    if read is None:
        raise PoseFileError(
            f"Poses cannot be read from {options.source_format} files; convert from another format."
        )
    request = _request(options)
    record = read(options.source, request)
    record, request = _with_files(record, request, options.source)
    yield from (f"note: {warning}" for warning in record.warnings)
    known = FORMATS[options.out_format]

    def beside() -> Path:
        return _undistorted_beside(options, record)

    with for_one_photo(record, request, known.held(record), beside) as chosen:
        written = known.write(chosen.record, options.out, chosen.request)
    photo = chosen.request.photo
    if photo and options.out_format not in UPRIGHT and is_stored_turned(photo):
        yield (
            f"note: {photo.name} is stored turned (EXIF), and the pose is one in the "
            "upright photo; save it upright for tools that do not turn it."
        )
    yield from (f"note: {note}" for note in (*chosen.notes, *written.notes))
    yield from (f"undistorted photo: {path}" for path in chosen.files)
    yield from (f"{options.out_format}: {path}" for path in written.files)


def _undistorted_beside(options: argparse.Namespace, record: PoseRecord) -> Path:
    """Where the undistorted photo goes: where BOP looks for it, or beside the file."""
    from poseviewer.files.formats.request import make_folder

    name = Path((record.photo.file if record.photo else None) or "photo").stem
    if options.out_format == "bop":
        number = Path(options.image or name).stem
        path = options.out / "rgb" / f"{number.zfill(6)}.png"
    elif options.out_format == "colmap":
        path = options.out / f"{name}.undistorted.png"
    else:
        return options.out.parent / f"{name}.undistorted.png"
    make_folder(path.parent)
    return path


def _request(options: argparse.Namespace) -> Request:
    from poseviewer.files.formats.request import Request, require_file
    from poseviewer.files.photo.load import load_photo

    size = options.photo_size
    for path, what in ((options.photo, "photo"), (options.model, "model")):
        if path is not None:
            require_file(path, what, "Converted")
    if options.photo is not None and size is None:
        photo = load_photo(options.photo)
        size = photo.width, photo.height
    return Request(
        options.photo,
        options.model,
        size,
        options.unit,
        options.image,
        options.object,
        options.overwrite,
        options.undistorted_photo,
    )


def _with_files(record: PoseRecord, request: Request, source: Path) -> tuple[PoseRecord, Request]:
    """The photo and model that lie beside the pose, where the user names none; and their names."""
    from poseviewer.files.pose.file import ModelReference, PhotoReference

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
    if not name:
        return None
    path = (source if source.is_dir() else source.parent) / Path(name).name
    return path if path.is_file() else None
