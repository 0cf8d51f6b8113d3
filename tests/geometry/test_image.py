from dataclasses import replace

import numpy as np

from poseviewer.geometry.camera import Parallel, Perspective
from poseviewer.geometry.image import Photo

PHOTO = Photo(np.zeros((480, 640, 3), np.uint8), "p.png", "0" * 64)


def test_a_focal_length_that_nobody_gave_is_called_a_guess_and_a_known_one_is_not():
    assert "is assumed (a view of 50 degrees)" in PHOTO.focal_note(PHOTO.default_camera())
    calibrated = Perspective(812.0, 811.0, 320.0, 240.0, 640, 480)
    assert PHOTO.focal_note(calibrated) == ""
    assert PHOTO.focal_note(Parallel(9.0, 320.0, 240.0, 640, 480)) == ""
    for known in (replace(PHOTO, camera=calibrated), replace(PHOTO, focal_length_35mm=28.0)):
        assert known.focal_note(known.default_camera()) == ""
