"""Trust in a pose: the verdict and its calibration, and the pose's covariance."""
