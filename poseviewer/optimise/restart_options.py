"""Options of a search by restarts; apart from the search, as help texts need no NumPy."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RestartOptions:
    """Size, tolerances and number of the descents. Lengths are in units of the scale."""

    step: float = 0.05
    """Edge of each new simplex."""
    multi_starts: int = 4
    """Short descents from the start, the best of which goes on: one often ends in a side valley."""
    multi_start_x_tolerance: float = 1e-2
    multi_start_f_tolerance: float = 1e-3
    x_tolerance: float = 5e-4
    """A descent ends when its simplex is this small ..."""
    f_tolerance: float = 2e-5
    """... and its losses differ by no more than this."""
    least_gain: float = 2e-4
    """A restart that gains less has not improved anything."""
    patience: int = 2
    """Number of restarts in a row without improvement that ends the search."""
