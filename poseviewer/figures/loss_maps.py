"""The loss about a pose, as maps that can be written to files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from poseviewer.errors import SettingsError
from poseviewer.files.landscape import landscape_npz_bytes
from poseviewer.files.writing import write_whole
from poseviewer.fit.loss import LossScale
from poseviewer.fit.slices import Slice
from poseviewer.geometry.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class LossMaps:
    """The loss about a pose: a slice for every two of its numbers."""

    slices: Sequence[Slice]
    names: tuple[str, ...]
    centre: FloatArray
    """(d,): the pose in the middle."""
    scales: FloatArray
    """(d,): what counts as 100 % of each number."""
    loss_scale: LossScale
    """Scale of the sheet; the numbers are the losses themselves."""
    title: str = ""
    photo: str = ""
    """Which photo it is, as files say it."""

    def as_bytes(self, kind: str) -> bytes:
        """Encode a sheet (png, pdf, svg) or numbers (npz), or raise ``ValueError`` else."""
        if kind == "npz":
            about = self.names, self.centre, self.scales
            return landscape_npz_bytes(*about, self.slices, self.photo)
        # Half a second of Matplotlib, which opening the app need not wait for.
        from poseviewer.figures.landscape_sheet import figure_bytes, make_landscape_sheet

        sheet = make_landscape_sheet(
            [piece.shown(self.loss_scale) for piece in self.slices],
            self.names,
            self.centre,
            title=self.title,
            what=self.loss_scale.name,
        )
        return figure_bytes(sheet, kind)

    def save(self, path: str | Path) -> None:
        """Write a sheet of maps (.png, .pdf, .svg) or the numbers (.npz), or ``SettingsError``."""
        path = Path(path)
        try:
            content = self.as_bytes(path.suffix[1:].lower() or "png")
        except ValueError as error:
            raise SettingsError(
                f"{path.name}: maps cannot be written as {path.suffix!r}; use .png, .pdf or .svg "
                "for a sheet, .npz for the numbers."
            ) from error
        write_whole(path, content, SettingsError)
