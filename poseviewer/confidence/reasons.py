"""The features of a pose in sentences."""

from __future__ import annotations

from poseviewer.fit.verdict import Features

SMALL_SPREAD_PERCENT = 3.0
"""Spread below which searches from near by have come back."""
LOW_TURN_MARGIN = 0.3
"""Turn margin that right poses seldom have."""
GOOD_OUTLINE, POOR_OUTLINE = 0.9, 0.75
"""Shares of the outline."""


def reasons_for(features: Features) -> tuple[str, ...]:
    """What speaks for and against the pose, a sentence each."""
    sentences = (part(features) for part in (_spread, _turned, _outline, _hidden))
    return tuple(sentence for sentence in sentences if sentence)


def _spread(features: Features) -> str:
    spread = features.spread_percent
    if spread < SMALL_SPREAD_PERCENT:
        return "Searches from near by came back to it."
    return f"Searches from near by ended {spread:.0f} % of the model's size away."


def _turned(features: Features) -> str:
    if features.turn_margin < 0.0:
        return "Turned about one of its own axes the model costs less on the coarse photo."
    if features.turn_margin < LOW_TURN_MARGIN:
        return "Turned about one of its own axes the model costs hardly more: it may be turned."
    return ""


def _outline(features: Features) -> str:
    share = features.outline
    how = "" if share >= GOOD_OUTLINE else "only " if share < POOR_OUTLINE else "some "
    return f"Along {how}{share:.0%} of its outline the photo has an edge of that direction."


def _hidden(features: Features) -> str:
    if features.seen < 0.9:
        return f"Only {features.seen:.0%} of the model is seen: the rest lies on pixels left out."
    return ""
