"""Emptying the rasteriser's buffers, with a last look at what was in them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

NO_FACE = np.int32(-1)
MEMORY = np.int8(8)  # pictures for which a cluster counts as likely to be seen again

_jit: Any = njit(nogil=True, cache=True, error_model="numpy")


@_jit
def clear(box, cluster_bits, depth, ids, likely):
    """Empty the buffers inside ``box`` (left, top, right, bottom), in whole px, ends excluded.

    Sets ``likely`` (C,) to MEMORY for clusters that were seen there, and counts the others down:
    those seen in one of the last MEMORY pictures are above 0.
    """
    left, top, right, bottom = box
    for cluster in range(likely.shape[0]):
        likely[cluster] -= 1 if likely[cluster] > 0 else 0
    last = NO_FACE
    for row in range(top, bottom):
        for column in range(left, right):
            face = ids[row, column]
            if face != last:
                last = face
                if face >= 0:
                    likely[face >> cluster_bits] = MEMORY
        for column in range(left, right):
            depth[row, column] = -np.inf
        for column in range(left, right):
            ids[row, column] = NO_FACE
