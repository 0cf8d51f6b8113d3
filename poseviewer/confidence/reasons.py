"""The features of a pose in sentences."""

from __future__ import annotations

from poseviewer.fit.verdict import Features

MOST_WEAK = 3
"""Directions that are named."""
LOW_MARGIN = 2.0
"""Loss margin, in standard deviations, that wrong poses often reach."""
LOW_TURN_MARGIN = 0.3
"""Turn margin that right poses seldom have."""
GOOD_OUTLINE, POOR_OUTLINE = 0.9, 0.75
"""Shares of the outline."""
FEW_PIXELS = 1000


def reasons_for(features: Features) -> tuple[str, ...]:
    """What speaks for and against the pose, a sentence each."""
    parts = (_loss, _restarts, _rival, _turned, _outline, _explained, _hidden)
    weak = [
        f"{'Nor does it tell' if index else 'The photo does not tell'} {direction.words}."
        for index, direction in enumerate(features.weak[:MOST_WEAK])
    ]
    return tuple(sentence for part in parts if (sentence := part(features))) + tuple(weak)


def _loss(features: Features) -> str:
    margin = features.loss_margin
    if margin <= 0.0:
        return "Wrong poses of this model cost no more on this photo."
    how = "no more than " if margin < LOW_MARGIN else ""
    return (
        f"Its loss is {how}{margin:.1f} standard deviations below that of wrong poses of this "
        "model on this photo."
    )


def _restarts(features: Features) -> str:
    share = features.agreement
    if share >= 0.99:
        return "All searches from near by came back to it."
    if share <= 0.01:
        return (
            "No search from near by came back to it: they ended "
            f"{features.spread_percent:.0f} % of the model's size away."
        )
    return f"Of the searches from near by, {share:.0%} came back to it."


def _rival(features: Features) -> str:
    if features.rival_percent <= 0.0:
        return ""
    where = f"Another pose, {features.rival_percent:.0f} % of the model's size away,"
    if features.rival_margin < 0.0:
        return f"{where} has a lower loss on the coarse photo."
    if features.rival_margin < 1.0:
        return f"{where} is nearly as good."
    return ""


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


def _explained(features: Features) -> str:
    return f"Light explains {features.explained:.0%} of the model's pixels."


def _hidden(features: Features) -> str:
    if features.seen < 0.9:
        return f"Only {features.seen:.0%} of the model is seen: the rest lies on pixels left out."
    if 10.0**features.pixels < FEW_PIXELS:
        return f"The model covers only {10.0**features.pixels:.0f} pixels."
    return ""
