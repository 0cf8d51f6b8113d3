"""What colour is to every room alike: display-encoded RGB in [0, 1]."""

from poseviewer.geometry.arrays import frozen_array

GREY_WEIGHTS = frozen_array([0.299, 0.587, 0.114], (3,))
"""RGB to grey (ITU-R BT.601), for photo and reflectance alike."""
