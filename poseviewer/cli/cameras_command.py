"""Find the cameras of pictures of a scene that stands still, by features of the scene, by
markers in it, or by an object in it that was followed; and write them as a set of photos, in which
an object is placed once for all.
"""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli import options as table
from poseviewer.cli.case import calibration_of, load_named_sequence
from poseviewer.cli.terminal import progress_bar, say, tell
from poseviewer.errors import PoseFileError, SettingsError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from poseviewer.files.image_sequence import ImageSequence
    from poseviewer.geometry.camera import Perspective
    from poseviewer.geometry.lens import Undistortion
    from poseviewer.still.still_cameras import StillCameras

EVERY = table.SEQUENCE[0]
OF_MARKERS = (
    table.option(
        "--marker-size LENGTHS",
        "set the side of the markers' black squares, in the units of --unit, which is the scale of "
        "cameras by features, too (default: unknown)",
    ),
    table.option(
        "--unit NAME", "set the unit of --marker-size, such as m or mm (default: the model's)"
    ),
    table.option(
        "--board FILE",
        "take the places of markers from Kalibr's aprilgrid.yaml or a marker map of ArUco "
        "(default: find them)",
    ),
)
OPTIONS = {
    "": (
        table.option(
            "clip CLIP|FOLDER|SEQUENCE.json", "video, folder of pictures, or a sequence for object"
        ),
        table.option("--out FOLDER", "write set.json and a video's frames here", required=True),
        table.option(
            "--by",
            "find cameras so (default: markers if two or more are in most pictures, else features; "
            "object for SEQUENCE.json)",
            ("features", "markers", "object"),
        ),
        *OF_MARKERS,
        table.OBJECT,
        EVERY,
        table.option("--overwrite", "replace a set that is there"),
        table.QUIET,
    ),
    **table.CAMERA,
}
EXAMPLES = (
    "poseviewer cameras table.mp4 --out set",
    "poseviewer cameras photos/ --by features --marker-size 0.05 --unit m --out set",
)
STOPPED = "no set was written; frames of a video that were read are kept"


def run(options: Namespace) -> int:
    """Write the set and say what was found."""
    from poseviewer.files.formats.conversion import require_free
    from poseviewer.files.scene_json import save_scene
    from poseviewer.files.writing import making_folder
    from poseviewer.opening.photo_sets import SET

    path: Path = options.out / SET
    require_free([path], options.overwrite)
    with making_folder(options.out, PoseFileError):
        found = _of_object(options) if _is_of_object(options) else _of_pictures(options)
        save_scene(path, found.scene)
    for line in found.lines:
        say(table.in_options(line, OPTIONS))
    say(f"set: {path}")
    return 0


def _is_of_object(options: Namespace) -> bool:
    is_json = options.clip.suffix.lower() == ".json"
    if options.by is not None and is_json is not (options.by == "object"):
        wanted = "a sequence with poses goes with --by object, and a clip or a folder without"
        raise SettingsError(f"--by {options.by} with {options.clip}; {wanted}.")
    return is_json


def _of_object(options: Namespace) -> StillCameras:
    from poseviewer.still.tracked_object import cameras_of_object

    others = *OF_MARKERS, EVERY, table.CALIBRATION, *table.OF_CALIBRATION
    table.refuse(options, others, "with a sequence, which says its frames and camera; leave it out")
    return cameras_of_object(options.clip, options.object)


def _of_pictures(options: Namespace) -> StillCameras:
    from poseviewer.files.image_sequence import images_in
    from poseviewer.files.marker_board import NO_BOARD, load_board
    from poseviewer.files.mesh.size import METRES
    from poseviewer.still.still_cameras import StillCameras, find_cameras

    table.refuse(options, (table.OBJECT,), "without a sequence; leave it out, or name a SEQUENCE")
    if options.unit not in (None, *METRES):
        raise SettingsError(f"--unit {options.unit}: wanted one of {', '.join(METRES)}.")
    board = NO_BOARD if options.board is None else load_board(options.board)
    path: Path = options.clip
    if path.is_dir():
        pictures: list[Path] | ImageSequence = images_in(path)[:: options.every or 1]
        if not pictures:
            raise SettingsError(f"{path}: no picture in it; name a folder of pictures, or a video.")
    else:
        options.frames = options.out / "images"
        pictures = load_named_sequence(options, [path])
        for note in () if options.quiet else pictures.notes:
            tell(f"note: {note}")
    camera = _camera(options, pictures if isinstance(pictures, list) else pictures.paths)
    with progress_bar(None, options.quiet, shape="{desc} [{elapsed}]") as bar:
        steps = find_cameras(
            pictures, options.by or "auto", camera=camera, marker_size=options.marker_size,
            unit=options.unit, board=board,
        )  # fmt: skip
        for step in steps:
            if isinstance(step, StillCameras):
                return step
            bar.set_description_str(step, refresh=False)
            bar.update()
    raise AssertionError("no cameras, and no error")


def _camera(options: Namespace, paths: Sequence[Path]) -> Perspective | Undistortion | None:
    """Return the camera of the calibration that is given, with its lens."""
    from poseviewer.files.cameras import load_calibration
    from poseviewer.files.photo import load_header
    from poseviewer.geometry.lens import Undistortion

    calibration = calibration_of(options)
    if calibration is None:
        return None
    header = load_header(paths[0])
    size = header.width, header.height
    chosen, notes = load_calibration(calibration, paths[0].name, *size, header.orientation)
    for note in () if options.quiet else notes:
        tell(f"note: {note}")
    if chosen.lens is None:
        return chosen.camera
    return Undistortion.of(chosen.lens, chosen.camera)
