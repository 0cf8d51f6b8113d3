"""Photographs path-traced by Blender's Cycles: glossy paint, reflections, soft shadows."""
