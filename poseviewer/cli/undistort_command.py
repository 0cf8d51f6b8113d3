"""Write the undistorted photo, to which the poses belong, and print its camera."""

from argparse import Namespace

from poseviewer.cli import options as table
from poseviewer.cli.case import calibration_of
from poseviewer.cli.terminal import require_writable, say
from poseviewer.errors import PhotoFileError, SettingsError

OPTIONS = {
    "": (
        table.option("photo PHOTO", "photo as taken"),
        table.option("--out UNDISTORTED.png", "write it here", required=True, is_output=True),
    ),
    **table.CAMERA,
}
EXAMPLES = (
    "poseviewer undistort photo.jpg --calibration camera.yml --out flat.png",
    "poseviewer undistort 12.png --calibration cameras.txt --calibration-camera 2 --out flat.png",
)


def run(options: Namespace) -> int:
    """Write the photo."""
    if options.calibration is None:
        raise SettingsError("the photo's camera is wanted: give --calibration")
    require_writable(options.out, PhotoFileError)
    from poseviewer.cli.info_command import print_camera
    from poseviewer.files.photo import load_calibrated_photo, save_photo

    photo = load_calibrated_photo(options.photo, calibration_of(options))
    if photo.undistortion is None:
        raise SettingsError(f"{options.calibration}: a camera without distortion; nothing to undo")
    save_photo(options.out, photo)
    print_camera(photo)
    say(f"undistorted: {options.out}")
    return 0
