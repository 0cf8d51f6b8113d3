"""Cameras of a scene that stands still; the only package that imports pycolmap."""
