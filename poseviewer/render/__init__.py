"""From mesh and pose to attributes and moments.

The software renderer, OpenGL, the overlay, and the pyramid of levels.
"""
