"""Emptying the rasteriser's buffers, with a last look at what was in them."""

from __future__ import annotations

from typing import Any

import numpy as np

from poseviewer.render.software.kernel_compiler import kernel

NO_FACE = np.int32(-1)

_jit: Any = kernel()


@_jit
def clear(box, now, cluster_bits, depth, ids, seen, cluster_seen):
    """Empty the buffers inside ``box`` (left, top, right, bottom), in whole px, ends excluded.

    Notes for each face that was seen there, in ``seen`` (F + 1,), the last entry for none, and
    for its cluster, in ``cluster_seen`` (C + 1,), that it was seen at ``now``.
    """
    left, top, right, bottom = box
    none, no_cluster = np.int64(seen.shape[0] - 1), np.int64(cluster_seen.shape[0] - 1)
    for row in range(top, bottom):
        faces, depths = ids[row, left:right], depth[row, left:right]
        for k in range(right - left):
            face = np.int64(faces[k])
            seen[np.uint64(face if face >= 0 else none)] = now
            cluster_seen[np.uint64(face >> cluster_bits if face >= 0 else no_cluster)] = now
        depths[:] = -np.inf
        faces[:] = NO_FACE
