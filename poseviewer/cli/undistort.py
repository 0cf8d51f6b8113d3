"""Write the undistorted photo, which the poses belong to; say its camera."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from poseviewer.cli.options import add_calibration, calibration_of, option
from poseviewer.cli.terminal import require_writable, say
from poseviewer.errors import PhotoFileError, SettingsError


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer undistort``."""
    option(parser, "photo PHOTO", kind=Path)
    option(parser, "--out UNDISTORTED.png", kind=Path, required=True)
    add_calibration(parser, required=True)


def run(options: Namespace) -> int:
    """Write it."""
    require_writable(options.out, PhotoFileError)
    from poseviewer.cli.info import print_camera
    from poseviewer.files.photo import load_calibrated_photo, pixels_for, save_image

    photo = load_calibrated_photo(options.photo, calibration_of(options))
    if photo.undistortion is None:
        raise SettingsError(f"{options.calibration}: a camera without distortion; nothing to undo")
    save_image(options.out, pixels_for(options.out, photo))
    print_camera(photo)
    say(f"undistorted: {options.out}")
    return 0
