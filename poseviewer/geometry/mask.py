"""Masks of photos: white where a pixel counts, black where something is in front."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, reduce

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Mask:
    """A weight for each pixel, in [0, 1], kept packed: an undo history holds hundreds of masks."""

    width: int
    height: int
    _packed: bytes
    _is_binary: bool

    @classmethod
    def of(cls, weights: ArrayLike) -> Mask:
        """Pack weights (height, width), 1 where a pixel counts.

        Raises:
            ValueError: a weight is not in [0, 1].
        """
        values = np.asarray(weights, np.float32)
        if values.ndim != 2 or not np.all((values >= 0.0) & (values <= 1.0)):
            raise ValueError(f"a mask of shape {values.shape}: wanted (height, width), from 0 to 1")
        height, width = values.shape
        is_binary = bool(np.isin(values, (0.0, 1.0)).all())
        content = np.packbits(values > 0.0) if is_binary else values
        return cls(width, height, zlib.compress(content.tobytes(), level=1), is_binary)

    @classmethod
    def product(cls, masks: Sequence[Mask]) -> Mask | None:
        """Multiply the weights of masks; None: there are none."""
        if len(masks) < 2:
            return masks[0] if masks else None
        return cls.of(reduce(np.multiply, (mask.weights for mask in masks)))

    @property
    def weights(self) -> NDArray[np.float32]:
        """(height, width), read-only: 1 counts, 0 does not."""
        return _unpack(self)


@lru_cache(maxsize=2)
def _unpack(mask: Mask) -> NDArray[np.float32]:
    content = zlib.decompress(mask._packed)
    if mask._is_binary:
        bits = np.unpackbits(np.frombuffer(content, np.uint8), count=mask.width * mask.height)
        weights = bits.astype(np.float32)
    else:
        weights = np.frombuffer(content, np.float32)
    weights = weights.reshape(mask.height, mask.width)
    weights.flags.writeable = False
    return weights
