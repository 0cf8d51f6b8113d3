"""What a user, or a worker, asks of the models that the photo may show."""

from __future__ import annotations

from dataclasses import dataclass

from poseviewer.app.state.candidates import CandidateModel
from poseviewer.confidence.identify import Identification


@dataclass(frozen=True, slots=True, eq=False)
class AddCandidate:
    """One more model, read and ready."""

    candidate: CandidateModel


@dataclass(frozen=True, slots=True)
class DropCandidate:
    """Take a model away, by its place among them."""

    index: int


@dataclass(frozen=True, slots=True)
class ShowCandidate:
    """A model comes to hand, at the pose that was found for it."""

    index: int


@dataclass(frozen=True, slots=True)
class Identify:
    """Fit all models from the pose at hand, and rank them."""


@dataclass(frozen=True, slots=True)
class StopIdentifying:
    """Leave it at the models that are fitted."""


@dataclass(frozen=True, slots=True, eq=False)
class IdentificationAdvanced:
    """A worker's news of comparison ``number``."""

    number: int
    latest: Identification


@dataclass(frozen=True, slots=True, eq=False)
class IdentificationFailed:
    """Comparison ``number`` could not go on."""

    number: int
    reason: str


IdentifyCommand = (
    AddCandidate
    | DropCandidate
    | ShowCandidate
    | Identify
    | StopIdentifying
    | IdentificationAdvanced
    | IdentificationFailed
)
