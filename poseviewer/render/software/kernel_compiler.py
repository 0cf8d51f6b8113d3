"""How kernels are compiled: for many threads at once, and kept on disk where that works."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
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
            compiled = njit(cache=True, **settings)(function)
        except RuntimeError:  # numba found no place for a cache
            return njit(**settings)(function)
        # By itself numba looks at the kernel's own file alone; kernels call those of others.
        it: Any = compiled
        it._cache._cache_file._source_stamp = sources_stamp()
        return compiled

    return decorate


@lru_cache(maxsize=1)
def sources_stamp() -> tuple[float, int]:
    """The time of the latest change of any kernel's file, and the size of all."""
    states = [source.stat() for source in Path(__file__).parent.glob("kernel_*.py")]
    return max(state.st_mtime for state in states), sum(state.st_size for state in states)
