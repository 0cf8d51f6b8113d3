"""Whether poses that a turn of the model makes equal are one."""

from __future__ import annotations

from dataclasses import dataclass, replace

from poseviewer.app.state.commands import Command
from poseviewer.app.state.requests import Request
from poseviewer.app.state.session import Session
from poseviewer.fit.registration import Registration
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.symmetry import NO_SYMMETRY, Symmetry


@dataclass(frozen=True, slots=True)
class FindSymmetry(Request):
    """Use what a file says of the model's symmetry, or what its surface has."""


@dataclass(frozen=True, slots=True, eq=False)
class UseSymmetry(Command):
    """Use a symmetry that was found for a model."""

    mesh: Mesh
    """The whole model."""
    symmetry: Symmetry

    def __call__(self, session: Session) -> Session:
        if session.document.registration.mesh.whole is not self.mesh:  # another one by now
            return session
        return _with_symmetry(session, self.symmetry)


@dataclass(frozen=True, slots=True)
class DropSymmetry(Command):
    """All poses are told apart."""

    def __call__(self, session: Session) -> Session:
        if session.document.registration.whole_symmetry.is_none:
            return session
        return _with_symmetry(session, NO_SYMMETRY)


def symmetry_text(own: Registration) -> str:
    """Which poses count as one."""
    if own.whole_symmetry.is_none:
        return "all poses are told apart"
    if own.symmetry.is_none:
        return "with parts left out, all poses are told apart"
    return f"poses are one that differ by {own.symmetry.words}"


def _with_symmetry(session: Session, symmetry: Symmetry) -> Session:
    document = session.document
    registration = replace(document.registration, whole_symmetry=symmetry)
    # What a search said of its end was said of other poses.
    return session.with_document(replace(document.unsearched, registration=registration))
