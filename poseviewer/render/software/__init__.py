"""Numba rasteriser."""
