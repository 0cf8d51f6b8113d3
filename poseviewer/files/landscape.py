"""Loss landscapes (``fit.slices.Slice``) for the user's own plots: pickle-free archives (.npz).

Keys, with d numbers of the chart, P pairs and grids of k x k points:

- ``names`` (d,) text and ``centre``, ``spans`` (d,): the chart's numbers, the pose in the middle,
  and what counts as 100 % there;
- ``photo``, text: which photo the numbers belong to, as taken or undistorted;
- ``pairs`` (P, 2): the indices (first, second) of each slice's two numbers;
- ``first_values``, ``second_values`` (P, k): what they take;
- ``losses`` (P, k, k): row by the second number, column by the first; nan where not evaluated.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def landscape_npz_bytes(
    names: Sequence[str],
    centre: ArrayLike,
    scales: ArrayLike,
    slices: Sequence[Any],
    photo: str = "",
) -> bytes:
    """An archive: ``centre`` and ``spans`` (d,), the slices, and which ``photo`` it is of. Coarser
    slices are on the grid of the finest.
    """
    memory = BytesIO()
    steps = int(np.lcm.reduce([len(piece.first_values) - 1 for piece in slices]))
    grids = [_on_grid(piece, steps) for piece in slices]
    first_values, second_values, losses = (np.array(part) for part in zip(*grids, strict=True))
    np.savez_compressed(
        memory,
        names=np.array(names, dtype=str),
        photo=np.array(photo),
        centre=np.asarray(centre, dtype=float),
        spans=np.asarray(scales, dtype=float),
        pairs=np.array([[piece.first, piece.second] for piece in slices]),
        first_values=first_values,
        second_values=second_values,
        losses=losses,
    )
    return memory.getvalue()


def _on_grid(piece: Any, steps: int) -> tuple[Any, Any, Any]:
    """Values (k,) twice and losses (k, k) of a slice, k = ``steps`` + 1: nan between its own."""
    stride = steps // max(len(piece.first_values) - 1, 1) or 1
    losses = np.full((steps + 1, steps + 1), np.nan)
    losses[::stride, ::stride] = piece.losses
    own, shares = np.arange(0, steps + 1, stride), np.arange(steps + 1)
    values = (np.interp(shares, own, of) for of in (piece.first_values, piece.second_values))
    return *values, losses
