"""Panels, the scene over the photo, and maps: all that a person sees."""
