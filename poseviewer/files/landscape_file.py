"""Loss landscapes as NumPy archives (.npz), for the user's own plots. No pickles in them.

Keys, with d numbers of the chart, P pairs and grids of k x k points:

- ``names`` (d,) text and ``centre``, ``spans`` (d,): the chart's numbers, the pose in the middle,
  and what counts as 100 % there;
- ``pairs`` (P, 2): the indices (first, second) of each slice's two numbers;
- ``first_values``, ``second_values`` (P, k): what they take;
- ``losses`` (P, k, k): row by the second number, column by the first; nan where not evaluated.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poseviewer.errors import SettingsError
from poseviewer.files.writing import write_whole
from poseviewer.geometry.arrays import FloatArray

KEYS = ("names", "centre", "spans", "pairs", "first_values", "second_values", "losses")


class LossSlice(Protocol):
    """What is saved of a slice (``fit.landscape.Slice`` is one)."""

    @property
    def first(self) -> int: ...  # noqa: D102

    @property
    def second(self) -> int: ...  # noqa: D102

    @property
    def first_values(self) -> FloatArray: ...  # noqa: D102

    @property
    def second_values(self) -> FloatArray: ...  # noqa: D102

    @property
    def losses(self) -> FloatArray: ...  # noqa: D102


def save_landscape(
    path: str | Path,
    names: Sequence[str],
    centre: ArrayLike,
    spans: ArrayLike,
    slices: Sequence[LossSlice],
) -> None:
    """Write the slices (all of the same size) to an .npz file, whole or not at all.

    Raises:
        SettingsError: the folder is missing or not to be written to.
    """
    path = Path(path)
    memory = BytesIO()
    np.savez_compressed(
        memory,
        names=np.array(names, dtype=str),
        centre=np.asarray(centre, dtype=float),
        spans=np.asarray(spans, dtype=float),
        pairs=np.array([[piece.first, piece.second] for piece in slices]),
        first_values=np.array([piece.first_values for piece in slices]),
        second_values=np.array([piece.second_values for piece in slices]),
        losses=np.array([piece.losses for piece in slices]),
    )
    write_whole(path, memory.getvalue(), SettingsError)


def load_landscape(path: str | Path) -> dict[str, NDArray]:
    """The arrays of a file of ``save_landscape``, by their keys.

    Raises:
        OSError: the file cannot be read.
        KeyError: it is an archive of something else.
    """
    with np.load(Path(path), allow_pickle=False) as archive:
        return {key: archive[key] for key in KEYS}
