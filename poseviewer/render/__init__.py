"""From a mesh and a pose to attributes per pixel, moments, and pictures."""
