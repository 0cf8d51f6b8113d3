"""Maps of the loss about a pose, and their archives.

Archives are pickle-free (.npz). Keys, with d parameters of the chart, P pairs and grids of k x k
points:

- ``names`` (d,) text and ``centre``, ``spans`` (d,): the chart's parameters, the pose in the
  middle, and what counts as 100 % there;
- ``photo``, text: which photo the parameters belong to, as taken or undistorted;
- ``pairs`` (P, 2): the indices (first, second) of each slice's two parameters;
- ``first_values``, ``second_values`` (P, k): their values;
- ``losses`` (P, k, k): row by the second number, column by the first; nan where not evaluated.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np

from poseviewer.errors import SettingsError
from poseviewer.files.photo import photo_text
from poseviewer.files.writing import write_whole
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.slices import Slice
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.image import Photo
from poseviewer.losses.default_loss import DEFAULT
from poseviewer.losses.loss import LossScale


@dataclass(frozen=True, slots=True, eq=False)
class LossMaps:
    """Loss about a pose: a slice for every two of its parameters."""

    slices: Sequence[Slice]
    names: tuple[str, ...]
    centre: FloatArray
    """(d,): parameters of the pose in the middle."""
    scales: FloatArray
    """(d,): what counts as 100 % of each parameter."""
    loss_scale: LossScale
    """Scale of the sheet; archives have the losses themselves."""
    title: str = ""
    photo: str = ""
    """Name of the photo in files."""
    covariance: FloatArray | None = None
    """(d, d): of the pose, for its 90 % region on the sheet; None: none is drawn."""
    path: FloatArray | None = None
    """(n, d): the poses that a search came through, for the sheet; None: none is drawn."""

    @classmethod
    def about(
        cls,
        centre: FloatArray,
        slices: Iterable[Slice],
        half_width: float,
        problem: FitProblem,
        photo: Photo,
    ) -> LossMaps:
        """Put slices about a pose together.

        Args:
            centre: (d,): parameters of the pose.
            slices: A slice for each pair of parameters.
            half_width: Reach of the slices, as a share of each parameter's scale.
            problem: Problem whose loss it is.
            photo: The problem's first photo.
        """
        slices = tuple(slices)
        settings = problem.settings
        chart = problem.chart
        whose = "loss" if settings.loss == DEFAULT.name else f"loss of {settings.loss_name}"
        title = f"{photo.label}: {whose} about the pose, ±{100.0 * half_width:.0f} %"
        error = max((piece.error or 0.0 for piece in slices), default=0.0)
        title += f", good to {100.0 * error:.1f} % of each map's range" if error else ""
        scales, text = chart.scales(centre), photo_text(photo)
        return cls(slices, chart.names, centre, scales, problem.scale, title, text)

    def as_bytes(self, kind: str) -> bytes:
        """Encode a sheet (png, pdf, svg) or an archive (npz).

        Raises:
            ValueError: there is no such kind of files.
        """
        if kind == "npz":
            return self._archive()
        # Half a second of Matplotlib, which opening the app need not wait for.
        from poseviewer.figures.landscape_sheet import figure_bytes, make_landscape_sheet

        sheet = make_landscape_sheet(
            [piece.as_shown(self.loss_scale) for piece in self.slices],
            self.names,
            self.centre,
            title=self.title,
            what=self.loss_scale.name,
            covariance=self.covariance,
            path=self.path,
        )
        return figure_bytes(sheet, kind)

    def _archive(self) -> bytes:
        """Encode all slices, the coarser ones on the grid of the finest."""
        memory = BytesIO()
        steps = int(np.lcm.reduce([len(piece.first_values) - 1 for piece in self.slices]))
        grids = [_on_grid(piece, steps) for piece in self.slices]
        first_values, second_values, losses = (np.array(part) for part in zip(*grids, strict=True))
        np.savez_compressed(
            memory,
            names=np.array(self.names, dtype=str),
            photo=np.array(self.photo),
            centre=self.centre,
            spans=self.scales,
            pairs=np.array([[piece.first, piece.second] for piece in self.slices]),
            first_values=first_values,
            second_values=second_values,
            losses=losses,
        )
        return memory.getvalue()

    def save(self, path: str | Path) -> None:
        """Write a sheet of maps (.png, .pdf, .svg) or an archive (.npz).

        Raises:
            SettingsError: the ending is another one, or the file cannot be written.
        """
        path = Path(path)
        try:
            content = self.as_bytes(path.suffix[1:].lower() or "png")
        except ValueError as error:
            raise SettingsError(
                f"{path.name}: maps cannot be written as {path.suffix!r}; use .png, .pdf or .svg "
                "for a sheet, .npz for the numbers."
            ) from error
        write_whole(path, content, SettingsError)


def _on_grid(piece: Slice, steps: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return values (k,) twice and losses (k, k) of a slice, k = ``steps`` + 1: nan between."""
    stride = steps // max(len(piece.first_values) - 1, 1) or 1
    losses = np.full((steps + 1, steps + 1), np.nan)
    losses[::stride, ::stride] = piece.losses
    known, grid = np.arange(0, steps + 1, stride), np.arange(steps + 1)
    first, second = (np.interp(grid, known, v) for v in (piece.first_values, piece.second_values))
    return first, second, losses
