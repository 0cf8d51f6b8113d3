"""The options that name a photo's calibrated camera, on every command that takes a photo.

Nothing heavy is imported before there is such an option.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli.option_values import positive, rectangle
from poseviewer.errors import SettingsError

if TYPE_CHECKING:
    from poseviewer.files.camera.calibration import Calibration

DETAILS = {
    "calibration_camera": None,
    "calibration_crop": None,
    "calibration_resized": False,
    "calibration_fisheye": False,
    "undistorted_zoom": None,
}
"""What is said of a calibration, and what stands there where nothing is."""


def add_calibration(parser: ArgumentParser, required: bool = False) -> None:
    """The options."""
    group = parser.add_argument_group("the photo's camera")
    group.add_argument(
        "--calibration",
        type=Path,
        metavar="FILE",
        required=required,
        help="camera and lens, from OpenCV's YAML, XML or JSON, COLMAP's cameras.txt, BOP's "
        "camera.json or scene_camera.json; the photo is undistorted by it",
    )
    group.add_argument("--calibration-camera", metavar="NAME", help="which of the file's cameras")
    group.add_argument(
        "--calibration-crop",
        type=rectangle,
        metavar="LEFT,TOP,WIDTH,HEIGHT",
        help="the part of the calibrated picture that the photo shows",
    )
    group.add_argument(
        "--calibration-resized",
        action="store_true",
        help="the photo is that picture (or its part) in another size",
    )
    group.add_argument(
        "--calibration-fisheye",
        action="store_true",
        help="the lens is of OpenCV's fisheye model, where the file does not say so",
    )
    group.add_argument(
        "--undistorted-zoom",
        type=positive,
        metavar="FACTOR",
        help="focal length of the undistorted photo in those of the calibration (1); below 1 it "
        "shows more of the edges",
    )


def calibration_of(options: Namespace) -> Calibration | None:
    """The calibration that the options name; None where they name none.

    Raises:
        SettingsError: something is said of a calibration that is not there.
    """
    given = vars(options)
    details = {name: given.get(name, nothing) for name, nothing in DETAILS.items()}
    if given.get("calibration") is None:
        for name, nothing in DETAILS.items():
            if details[name] != nothing:
                raise SettingsError(
                    f"--{name.replace('_', '-')} without --calibration; name its file"
                )
        return None
    from poseviewer.files.camera.calibration import Calibration

    return Calibration(
        options.calibration,
        details["calibration_camera"],
        details["calibration_crop"],
        details["calibration_resized"],
        details["calibration_fisheye"],
        details["undistorted_zoom"] or 1.0,
    )
