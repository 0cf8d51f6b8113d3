"""The models of which the photo may show one, and how far they are told apart."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from poseviewer.app.state.document import Document, Marks
from poseviewer.confidence.identify import Identification, Ranked, rank
from poseviewer.errors import SettingsError
from poseviewer.fit.registration import LoadedModel, Registration
from poseviewer.geometry.camera import Pose

MOST_CANDIDATES = 30
"""All of them are kept in memory."""


@dataclass(frozen=True, slots=True, eq=False)
class CandidateModel:
    """A model that the photo may show."""

    model: LoadedModel
    path: Path | None

    def is_same(self, other: CandidateModel) -> bool:
        """Whether both are of the same file's content."""
        return self.model.sha256 == other.model.sha256


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Models that are, or were, fitted to a photo from one pose."""

    number: int
    document: Document
    """What was at hand: photo, settings, and the pose that all start from."""
    models: tuple[CandidateModel, ...]
    """In the order of ``latest``'s indices."""
    running: bool = True
    latest: Identification | None = None

    @property
    def registrations(self) -> list[Registration]:
        """One for each model, in the frame that all share; that at hand without the parts that are
        left out.
        """
        own = replace(self.document.registration, start=self.document.pose)
        return [
            own if one.model.sha256 == own.mesh_sha256 else with_mesh(own, one.model)
            for one in self.models
        ]


@dataclass(frozen=True, slots=True, eq=False)
class CandidateRow:
    """A model, and what is known of it."""

    index: int
    """Among the candidates."""
    candidate: CandidateModel
    ranked: Ranked | None = None
    is_being_fitted: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """All models, and what is known of them."""

    models: tuple[CandidateModel, ...] = ()
    comparison: Comparison | None = None
    shown: Document | None = None
    """What the row that was shown last brought to hand."""

    def with_candidate(self, new: CandidateModel) -> Candidates:
        """One model more, the last one.

        Raises:
            SettingsError: it is among them, or there are too many.
        """
        name = new.model.name
        if any(new.is_same(one) for one in self.models):
            raise SettingsError(f"{name}: is among the models already; choose another file")
        if len(self.models) >= MOST_CANDIDATES:
            raise SettingsError(
                f"{name}: {MOST_CANDIDATES} models are the most that are compared; leave one out"
            )
        return replace(self, models=(*self.models, new))

    def with_model_of(self, document: Document) -> Candidates:
        """With the document's own model, the first one where it is new."""
        own = at_hand(document)
        if any(own.is_same(one) for one in self.models):
            return self
        return replace(self, models=(own, *self.models))

    @property
    def running(self) -> bool:
        """Whether a comparison runs."""
        return self.comparison is not None and self.comparison.running

    @property
    def paths(self) -> frozenset[Path]:
        """The models' files."""
        return frozenset(one.path for one in self.models if one.path is not None)

    def comparison_about(self, document: Document) -> Comparison | None:
        """The comparison, if it is of the document's photo."""
        found, photo = self.comparison, document.registration.photo
        return found if found and found.document.registration.photo is photo else None

    def rows(self, document: Document) -> tuple[CandidateRow, ...]:
        """The models ranked by what is known of them on the document's photo, then the others."""
        found = self.comparison_about(document)
        latest = None if found is None else found.latest
        if found is None or latest is None:
            return tuple(CandidateRow(index, one) for index, one in enumerate(self.models))
        place = {id(one): index for index, one in enumerate(self.models)}
        left = [
            one.candidate for one in latest.ranked if id(found.models[one.candidate.index]) in place
        ]
        rows = []
        for ranked in rank(left):
            candidate = found.models[ranked.candidate.index]
            rows.append(CandidateRow(place.pop(id(candidate)), candidate, ranked))
        at = found.models[latest.at] if found.running and latest.at is not None else None
        for index in place.values():
            candidate = self.models[index]
            rows.append(CandidateRow(index, candidate, is_being_fitted=candidate is at))
        return tuple(rows)

    def pose_of(self, index: int, document: Document) -> Pose | None:
        """The pose that was found for a model; None where none is known."""
        row = next(row for row in self.rows(document) if row.index == index)
        return None if row.ranked is None else row.ranked.candidate.fit.pose


def at_hand(document: Document) -> CandidateModel:
    """The document's own model."""
    own = document.registration
    model = LoadedModel(own.mesh, own.mesh_name, own.mesh_sha256, own.keypoints, own.whole_symmetry)
    return CandidateModel(model, document.model_path)


def with_model(document: Document, candidate: CandidateModel, pose: Pose) -> Document:
    """The document with another model, at a pose; what was marked on the model before is gone."""
    own, model = document.registration, candidate.model
    if own.mesh_sha256 == model.sha256:
        return replace(document, pose=pose)
    return replace(
        document.unsearched,
        registration=with_mesh(own, model),
        pose=pose,
        pins=(),
        model_path=candidate.path,
        marks=Marks(box=document.marks.box),
    )


def with_mesh(own: Registration, model: LoadedModel) -> Registration:
    """The registration of another model."""
    return replace(
        own,
        mesh=model.mesh,
        mesh_name=model.name,
        mesh_sha256=model.sha256,
        keypoints=model.keypoints,
        whole_symmetry=model.whole_symmetry,
        warnings=(),
    )
