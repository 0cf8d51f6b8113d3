"""Options of a search by restarts; apart from the search, as help texts need no NumPy."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RestartOptions:
    """Size, tolerances and number of the descents, with lengths in units of the scale."""

    step: float = 0.02
    """Edge of each new simplex."""
    multi_starts: int = 8
    """Most short descents from the start, the best of which goes on: one often ends beside."""
    multi_start_step: float = 0.2
    """Edge of the simplex of a short descent."""
    multi_start_x_tolerance: float = 2e-2
    multi_start_f_tolerance: float = 1e-3
    x_tolerance: float = 1e-3
    """A descent ends when its simplex is this small ..."""
    f_tolerance: float = 2e-4
    """... and its losses differ by no more than this."""
    least_gain: float = 2e-3
    """Gain in loss below which a restart has not improved anything."""
    patience: int = 1
    """Number of restarts in a row without improvement that ends the search."""
