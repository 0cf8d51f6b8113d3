"""The features of a pose in sentences."""

from __future__ import annotations

from poseviewer.fit.verdict import Features

SMALL_SPREAD_PERCENT = 3.0
"""Spread below which searches from near by have come back."""
LOW_TURN_MARGIN = 0.3
"""Turn margin that right poses seldom have."""
GOOD_OUTLINE, POOR_OUTLINE = 0.9, 0.75
"""Shares of the outline."""
LEAST_WHOLE = 0.9
"""Share of the model below which it is said to be hidden in part."""


def reasons_for(features: Features) -> tuple[str, ...]:
    """What speaks for and against the pose, a sentence each."""
    spread, turn, outline = features.spread_percent, features.turn_margin, features.outline
    is_back = spread < SMALL_SPREAD_PERCENT
    end = "came back to it" if is_back else f"ended {spread:.0f} % of the model's size away"
    reasons = [f"Searches from near by {end}."]
    if turn < LOW_TURN_MARGIN:
        cost = "less on the coarse photo" if turn < 0.0 else "hardly more: it may be turned"
        reasons.append(f"Turned about one of its own axes the model costs {cost}.")
    how = "" if outline >= GOOD_OUTLINE else "only " if outline < POOR_OUTLINE else "some "
    reasons.append(
        f"Along {how}{outline:.0%} of its outline the photo has an edge of that direction."
    )
    if features.seen < LEAST_WHOLE:
        reasons.append(
            f"Only {features.seen:.0%} of the model is seen: the rest lies on pixels left out."
        )
    return tuple(reasons)
