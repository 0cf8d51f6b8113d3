"""What workers find out, put into the session."""

from __future__ import annotations

from dataclasses import replace

from poseviewer.app.state import commands as c
from poseviewer.app.state.session import Session


def landscape_advanced(session: Session, command: c.LandscapeAdvanced) -> Session:
    """The maps, as far as they are known by now."""
    return replace(session, landscape=command.latest)


def painted(session: Session, command: c.OverlayDrawn) -> Session:
    """A drawing; until its own loss is known, it keeps that of the one before."""
    new, old = command.overlay, session.overlay
    if not new.weighed and old is not None:
        same = old.request.pose is new.request.pose and old.weighed
        new = replace(new, loss=old.loss, note=old.note, weighed=same)
    return replace(session, overlay=new)


def weighed(session: Session, command: c.LossComputed) -> Session:
    """The loss of the drawing, or of one a moment ago."""
    new, old = command.overlay, session.overlay
    if old is None or old.weighed:
        return session
    same = old.request.pose is new.request.pose
    return replace(session, overlay=replace(old, loss=new.loss, note=new.note, weighed=same))


def saved(session: Session, command: c.Saved) -> Session:
    """The pose stands in a file."""
    return replace(session, saved=command.pose)
