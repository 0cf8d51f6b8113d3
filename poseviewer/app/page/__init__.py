"""Panels, the scene over the photo, and maps."""
