"""Whether an earlier run has compiled the kernels, which takes many seconds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from poseviewer.render import (
    kernel_attributes,
    kernel_coverage,
    kernel_moments,
    kernel_structure,
    kernel_visibility,
)


def kernels_are_compiled() -> bool:
    """Whether an earlier run left machine code for this version of the kernels."""
    kernels: tuple[Any, ...] = (
        kernel_visibility.list_others,
        kernel_coverage.draw_listed,
        kernel_attributes.accumulate,
        kernel_structure.edge_sums,
        kernel_moments.of_classes,
    )
    return all(_is_compiled(kernel) for kernel in kernels)


def _is_compiled(kernel: Any) -> bool:
    if not kernel.stats.cache_path:  # there is no place to keep it
        return False
    source = Path(kernel.py_func.__code__.co_filename)
    cached = Path(kernel.stats.cache_path).glob(f"{source.stem}.*.nbi")
    return any(index.stat().st_mtime >= source.stat().st_mtime for index in cached)
