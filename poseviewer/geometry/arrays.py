"""Read-only arrays: the arrays of a frozen dataclass must be frozen as well."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

FloatArray = NDArray[np.float64]
"""Array of double precision; its shape stands beside each use."""


def freeze_array(
    values: ArrayLike, shape: tuple[int, ...], dtype: DTypeLike = np.float64
) -> NDArray[Any]:
    """Make an array read-only and C-contiguous.

    Raises:
        ValueError: the array is not of the ``shape``, in which -1 stands for any length.
    """
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
