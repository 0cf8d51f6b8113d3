"""Which model is it: models gathered, compared, shown one after the other."""

from __future__ import annotations

from dataclasses import replace

from poseviewer.app.state import identify_commands as ic
from poseviewer.app.state.candidates import CandidateModel, Candidates, Comparison, with_model
from poseviewer.app.state.checks import require_in_sight, sentence
from poseviewer.app.state.searching import settled
from poseviewer.app.state.session import Session
from poseviewer.errors import SettingsError


def add(session: Session, command: ic.AddCandidate) -> Session:
    """One more model, beside the one at hand.

    Raises:
        SettingsError: it is among them, or there are too many.
    """
    candidates = session.candidates.with_model_of(session.document)
    return replace(session, candidates=candidates.with_candidate(command.candidate))


def drop(session: Session, command: ic.DropCandidate) -> Session:
    """One model less; those that are being compared stay until that is over."""
    candidates = session.candidates
    if not 0 <= command.index < len(candidates.models) or _is_running(candidates):
        return session
    kept = tuple(one for index, one in enumerate(candidates.models) if index != command.index)
    return replace(session, candidates=replace(candidates, models=kept))


def show(session: Session, command: ic.ShowCandidate) -> Session:
    """A model at the pose that was found for it, or, before that, at the one at hand."""
    if not 0 <= command.index < len(session.candidates.models):
        return session
    return _showing(session, command.index)


def identify(session: Session, command: ic.Identify) -> Session:
    """Begin to compare, unless that is under way; what a search has found is kept.

    Raises:
        SettingsError: there are fewer than two models.
    """
    del command
    if _is_running(session.candidates):
        return session
    candidates = session.candidates.with_model_of(session.document)
    if len(candidates.models) < 2:
        raise SettingsError("one model alone: add another one, to be told apart")
    session = replace(settled(session), search=None)
    compared = Comparison(session.comparisons + 1, session.document, candidates.models)
    candidates = replace(candidates, comparison=compared, shown=None)
    return replace(session, comparisons=compared.number, candidates=candidates)


def stop(session: Session, command: ic.StopIdentifying) -> Session:
    """Leave it at the models that are fitted; with none of them, nothing is left."""
    del command
    candidates = session.candidates
    found = candidates.comparison
    if found is None or not found.running:
        return session
    known = found.latest is not None and bool(found.latest.ranked)
    stopped = replace(found, running=False) if known else None
    return replace(session, candidates=replace(candidates, comparison=stopped))


def advanced(session: Session, command: ic.IdentificationAdvanced) -> Session:
    """What is known by now; at the end the likeliest model is shown, if nothing else was done."""
    candidates = session.candidates
    found = candidates.comparison
    if found is None or found.number != command.number or not found.running:
        return session
    if candidates.comparison_about(session.document) is None:  # another photo by now
        return replace(session, candidates=replace(candidates, comparison=None))
    is_over = command.latest.at is None
    compared = replace(found, latest=command.latest, running=not is_over)
    session = replace(session, candidates=replace(candidates, comparison=compared))
    is_idle = session.document is found.document and session.drag is None and session.search is None
    if not (is_over and is_idle):
        return session
    return _showing(session, session.candidates.rows(session.document)[0].index)


def failed(session: Session, command: ic.IdentificationFailed) -> Session:
    """They cannot be compared, and why."""
    found = session.candidates.comparison
    if found is None or found.number != command.number:
        return session
    candidates = replace(session.candidates, comparison=None)
    return replace(session, candidates=candidates, error_message=sentence(command.reason))


def _showing(session: Session, index: int) -> Session:
    """One undoable step, unless the last one was of this kind: then one step back leads to before
    all of them.
    """
    candidates, before = session.candidates, session.document
    candidate: CandidateModel = candidates.models[index]
    pose = candidates.pose_of(index, before) or before.pose
    document = with_model(before, candidate, pose)
    require_in_sight(document)
    session = settled(session)
    history = session.history if before is candidates.shown else session.history.with_step(before)
    if document.registration.mesh is not before.registration.mesh:
        session = replace(session, landscape=None, overlay=None)
    return replace(
        session,
        document=document,
        history=history,
        anchor=document.pose,
        search=None,
        candidates=replace(candidates, shown=document),
    )


def _is_running(candidates: Candidates) -> bool:
    return candidates.comparison is not None and candidates.comparison.running


HANDLERS = {
    ic.AddCandidate: add,
    ic.DropCandidate: drop,
    ic.ShowCandidate: show,
    ic.Identify: identify,
    ic.StopIdentifying: stop,
    ic.IdentificationAdvanced: advanced,
    ic.IdentificationFailed: failed,
}
