"""Plans of studies: their photos, starts and settings."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

from poseviewer.losses.loss import LossName, PixelsName, SearchName
from poseviewer.losses.paper_loss import PAPER
from poseviewer.scene.settings import ChartName, FitSettings, Limits

Kind = Literal["plain", "background", "photo-parallel", "photo-perspective"]
KINDS: dict[Kind, str] = {
    "plain": "synthetic, plain black ground",
    "background": "synthetic, real background",
    "photo-parallel": "photo, parallel",
    "photo-perspective": "photo, perspective, 7 numbers",
}
"""Labels in tables: photos drawn by OpenGL (on black, as the paper's), and the demo's."""
DRAWN = ("plain", "background")
"""Kinds of photos that are drawn."""
ReadingName = Literal["relative", "absolute"]
"""``relative``: each parameter is off by up to a share of its own value, as in the paper.
``absolute``: by up to that share of its scale, which is harder for parameters near 0."""
READINGS: tuple[ReadingName, ...] = get_args(ReadingName)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Plan of a study: of ``real`` photos, of ``bop`` estimates, else the paper's deviations."""

    out: Path
    loss: LossName = "default"
    search: SearchName | Literal["auto"] = "auto"
    pixels: PixelsName | None = None
    """None: all that the loss has for a kind of photo."""
    limits: Limits = field(default_factory=Limits)
    starts: int = 10
    """Number for each kind of photo, pixels, reading and deviation."""
    photos: int = 5
    """Number of synthetic photos of each kind; starts take turns on them."""
    deviations: tuple[float, ...] = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
    """Deviations of starts, per cent."""
    readings: tuple[ReadingName, ...] = READINGS
    kinds: tuple[Kind, ...] = tuple(KINDS)
    size: tuple[int, int] = (640, 480)
    """Size of synthetic photos, px."""
    model: Path | None = None
    """Model of a vehicle for synthetic photos; None: the bundled one."""
    seed: int = 0
    real: Path | None = None
    """Folder of ``cases.json`` and ``starts.json``."""
    degrees: tuple[int, ...] = (5, 15)
    cases: str = ""
    """Pattern of the cases' ids, see ``load_cases``; "": all."""
    draws: int = 5
    among_others: bool = False
    """Whether the true poses of the other cases of each photo are given."""
    free_focal: bool = False
    """Whether starts are a tenth off in focal length, too, which is searched for."""
    bop: Path | None = None
    """A table of BOP results."""
    dataset: Path | None = None
    """Folder of ``models`` and ``test``; None: the nearest above the table."""

    def settings(self, kind: Kind | None = None) -> list[FitSettings]:
        """Return the settings of fits on a kind of photo of a vehicle; None: of any model.

        The paper's loss takes drawn photos whole and, but on black ground, clipped to the model.
        """
        chart: ChartName = "vehicle" if kind else "free-body"
        pixels: tuple[PixelsName, ...] = (self.pixels or "near",)
        if self.loss == PAPER.name and not self.pixels and kind in DRAWN:
            pixels = ("whole",) if kind == "plain" else ("whole", "clip")
        own = {"chart": chart, "limits": self.limits}
        return [FitSettings(self.loss, self.search, pixels=p, **own) for p in pixels]
