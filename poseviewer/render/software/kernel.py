"""Decorator of kernels: compiled for many threads at once, and kept on disk for later runs."""

from __future__ import annotations

import atexit
import hashlib
import logging
import os
import shutil
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
import platformdirs
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator

_log = logging.getLogger(__name__)

KERNELS: list[Any] = []
"""All kernels; those that others call stand before these."""


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorate as ``numba.njit`` without the GIL; machine code is kept in ``kernels_folder()``."""

    def decorate(function: Callable[..., Any]) -> Any:
        compiled: Any = numba.njit(nogil=True, error_model="numpy", **options)(function)
        compiled._cache = _Cache(function)
        KERNELS.append(compiled)
        return compiled

    return decorate


jit: Any = kernel()
"""Decorator of kernels whose operations keep their order."""
jit_sums: Any = kernel(fastmath={"reassoc", "contract", "nsz", "nnan"})
"""Decorator of kernels that may sum in another order, in lanes of a vector: rows are short, so that
it costs no accuracy."""


def is_compiled(kernel: Any) -> bool:
    """Tell whether machine code of a kernel is kept for this machine."""
    cache, machine = kernel._cache, kernel.targetctx.codegen().magic_tuple()
    return any(magic == machine for _, magic, _ in cache._cache_file._load_index())


@lru_cache(maxsize=1)
def kernels_folder() -> Path:
    """Return the folder of machine code by the sources' hash.

    It is in ``NUMBA_CACHE_DIR`` or the user's cache, else one for this process and its children.
    """
    root = os.environ.get("NUMBA_CACHE_DIR")
    root = Path(root) if root else platformdirs.user_cache_path("poseviewer", appauthor=False)
    folder = root / f"kernels-{sources_hash()[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        found = f"{folder.parent}: cannot be written to ({error.strerror})"
        wanted = "name another in NUMBA_CACHE_DIR"
        _log.warning(
            "%s: kernels are compiled anew at each call, half a minute; %s.", found, wanted
        )
        os.environ["NUMBA_CACHE_DIR"] = temporary = tempfile.mkdtemp(prefix="poseviewer-")
        atexit.register(shutil.rmtree, temporary, ignore_errors=True)
        folder = Path(temporary)
    return folder


@lru_cache(maxsize=1)
def sources_hash() -> str:
    """Hash the kernels' sources and their compiler: equal in a copy, new after any change."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.name.encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()


class _Locator(_CacheLocator):
    """Cache of machine code by the sources of all kernels, which call each other; not by one's."""

    def __init__(self, function: Any) -> None:
        self._line = function.__code__.co_firstlineno

    def get_cache_path(self) -> str:
        return str(kernels_folder())

    def get_source_stamp(self) -> str:
        return sources_hash()

    def get_disambiguator(self) -> str:
        return str(self._line)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Locator:
        del py_file
        return cls(py_func)


class _Implementation(CompileResultCacheImpl):
    _locator_classes = [_Locator]  # noqa: RUF012 - as numba has it


class _Cache(FunctionCache):
    _impl_class = _Implementation
