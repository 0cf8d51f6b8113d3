"""How kernels are compiled: for many threads at once, and kept on disk where that works."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """A decorator: ``numba.njit`` without the GIL, with ``options`` of its own.

    Machine code is kept beside the source, or in the user's cache folder. Where neither can be
    written (a read-only install without a home), it is made anew in every process.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        settings = {"nogil": True, "error_model": "numpy", **options}
        try:
            return njit(cache=True, **settings)(function)
        except RuntimeError:  # numba found no place for a cache
            return njit(**settings)(function)

    return decorate
