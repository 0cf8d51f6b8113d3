"""How kernels are compiled: for many threads at once, and kept on disk where that works."""

from __future__ import annotations

import hashlib
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
            compiled: Any = njit(cache=True, **settings)(function)
        except RuntimeError:  # numba found no place for a cache
            return njit(**settings)(function)
        # By itself numba looks at the kernel's own file alone; kernels call those of others.
        compiled._cache._cache_file._source_stamp = sources_stamp()
        return compiled

    return decorate


@lru_cache(maxsize=1)
def sources_stamp() -> str:
    """A hash of the kernels' sources: the same in a copy, another after any change.

    numba 0.68 looks at what is in a file as well, before that at the time of its last change.
    """
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.name.encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()
