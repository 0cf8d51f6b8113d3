"""Settings of a fit, as a user chooses them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

import msgspec

from poseviewer.errors import SettingsError
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.losses.known_losses import LOSSES
from poseviewer.losses.loss import Loss, LossName, PixelsName, SearchName
from poseviewer.optimise.restart_options import RestartOptions
from poseviewer.render.renderers import RendererName

ChartName = Literal["auto", "vehicle", "free-body"]
InFrontName = Literal["find", "painted", "nothing"]
SEARCHES: dict[SearchName, str] = {
    "simplex": "Restarted simplex", "models": "CMA-ES, quadratic models"
}  # fmt: skip
OF_LOSS = ("grey", "colour_reflectance", "pixels")
"""The settings that each loss has its own of: what it compares."""


@dataclass(frozen=True, slots=True)
class Limits:
    """When to stop a search that still improves."""

    evaluations: int = 20_000
    seconds: float = 600.0


CHOICES: dict[str, Collection[str]] = {
    "loss": LOSSES, "search": ("auto", *get_args(SearchName)),
    "chart": get_args(ChartName), "pixels": get_args(PixelsName),
    "in_front": get_args(InFrontName), "renderer": get_args(RendererName),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class FitSettings:
    """Settings of a fit; a loss may set what it compares: see ``Loss.pixels`` and ``is_grey``."""

    loss: LossName = "default"
    """Name of a loss in ``LOSSES``: the default, or exactly the paper's."""
    search: SearchName | Literal["auto"] = "auto"
    """Minimiser of the loss; ``auto``: see ``searched_by``."""
    chart: ChartName = "auto"
    free_focal: bool = False
    """Search for the focal length as well: a seventh number."""
    free_principal_point: bool = False
    """Search for the principal point as well, two more numbers, by several photos or a vehicle's
    chart: that of a cropped photo is not in its middle."""
    lock: tuple[str, ...] = ()
    """Names of the chart's numbers that stay as they are."""
    grey: bool = False
    """Photo attributes grey (n = 1) even where the photo has colour (n = 3), by ``MIN_COLOUR``."""
    colour_reflectance: bool = False
    """Model attributes of RGB reflectance (m = 12) instead of grey (m = 4)."""
    pixels: PixelsName = "near"
    """P: a fixed box about the start, the whole photo, or what the model covers at each pose."""
    in_front: InFrontName = "find"
    """Pixels left out: masks and what a search finds in front, masks alone, or none."""
    region: Rectangle | None = None
    """Rectangle that P lies in, px."""
    mask: str | None = None
    """File name of the mask, for the record."""
    without: tuple[str, ...] | None = None
    """Names of the model's parts that are left out as it is loaded: neither compared nor drawn."""
    renderer: RendererName = "auto"
    """``auto`` is ``software``; ``gpu`` is experimental: it pays beside few cores only."""
    options: RestartOptions = field(default_factory=RestartOptions)
    """Options of the restarted simplex on the photo alone, by the paper's loss."""
    limits: Limits = field(default_factory=Limits)
    seed: int = 0
    keep_start: bool = False
    """Give the start back where the search ends in a pose that is not sure to be better."""

    def __post_init__(self) -> None:
        """Check choices and seed.

        Raises:
            SettingsError: there is no such choice or seed.
        """
        for name, choices in CHOICES.items():
            if (value := getattr(self, name)) not in tuple(choices):
                found = f"{name}={value!r}: there is no such choice"
                raise SettingsError(f"{found}; take one of {', '.join(choices)}.")
        if not isinstance(self.seed, int) or self.seed < 0:
            raise SettingsError(f"seed={self.seed!r}: wanted a whole number of 0 or more.")
        if self.region is not None:
            object.__setattr__(self, "region", Rectangle(*self.region))
        loss = LOSSES[self.loss]
        if self.pixels not in loss.pixels:
            object.__setattr__(self, "pixels", loss.pixels[0])
        if loss.is_grey:
            object.__setattr__(self, "grey", True)
            object.__setattr__(self, "colour_reflectance", False)

    @property
    def has_free_camera(self) -> bool:
        """Whether the camera is searched for, too."""
        return self.free_focal or self.free_principal_point

    @property
    def minimised(self) -> Loss:
        """Loss that is minimised on the chosen pixels."""
        return LOSSES[self.loss].on(self.pixels)

    @property
    def loss_name(self) -> str:
        """Name of the loss for people: ``Paper (2010), pixels inside the model``."""
        compared = {"near": "", "whole": ", whole photo", "clip": ", pixels inside the model"}
        return self.minimised.label + compared[self.pixels]

    @property
    def searched_by(self) -> SearchName:
        """The search: if ``auto``, that of the loss."""
        return self.minimised.search if self.search == "auto" else self.search

    @property
    def method(self) -> str:
        """Loss, and search unless ``auto``, for tables: ``paper``, ``default by simplex``."""
        return self.loss if self.search == "auto" else f"{self.loss} by {self.search}"

    def of_loss(self, loss: LossName, like: FitSettings | None = None) -> FitSettings:
        """Change the loss; what it compares is as in ``like`` of that loss, else the default."""
        if loss == self.loss:
            return self
        like = like if like is not None and like.loss == loss else FitSettings(loss)
        return replace(self, loss=loss, **{name: getattr(like, name) for name in OF_LOSS})


def settings_as_json(settings: FitSettings) -> dict[str, Any]:
    """The settings as JSON holds them; what is not set is left out."""
    return {key: value for key, value in msgspec.to_builtins(settings).items() if value is not None}


def settings_from_json(data: Mapping[str, Any]) -> FitSettings:
    """Read the settings, without unknown names.

    Raises:
        SettingsError: one makes no sense.
    """
    try:
        return msgspec.convert(data, FitSettings)
    except msgspec.ValidationError as error:
        raise SettingsError(f"settings of a file: {error}; take them out of it.") from None
    except SettingsError as error:
        raise SettingsError(f"settings of a file: {error}") from None
