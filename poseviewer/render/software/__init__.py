"""The numba rasteriser."""
