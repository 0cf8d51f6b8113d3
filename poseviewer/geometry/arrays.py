"""Read-only arrays: what a frozen dataclass holds must be frozen as well."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

FloatArray = NDArray[np.float64]


def freeze_array(
    values: ArrayLike, shape: tuple[int, ...], dtype: DTypeLike = np.float64
) -> NDArray[Any]:
    """Make an array read-only and C-contiguous; ``ValueError`` unless of ``shape`` (-1: any)."""
    array = np.asarray(values)
    fits = array.ndim == len(shape) and all(
        want in (-1, have) for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise ValueError(f"an array of shape {array.shape} where {shape} was wanted")
    if array.dtype != np.dtype(dtype) or array.flags.writeable or not array.flags.c_contiguous:
        array = np.array(array, dtype=dtype, order="C")
    array.flags.writeable = False
    return array
