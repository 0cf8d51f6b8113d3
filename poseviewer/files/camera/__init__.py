"""Camera and calibration files."""
