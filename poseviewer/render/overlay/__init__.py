"""Pictures of the model over the photo."""

from typing import NamedTuple


class Look(NamedTuple):
    """How the model is drawn over the photo; ``styles.draw_style`` draws it."""

    key: str | None = None
    """Key that shows it on the page, whose list has the looks with a key."""
    needs_light: bool = False
    """Whether the light is recovered from the photo first."""


LOOKS = {
    "outline": Look("1"),
    "solid": Look("2"),
    "relit": Look("3", needs_light=True),
    "normals": Look("4"),
    "residual": Look("5", needs_light=True),
    "none": Look("0"),
    "edges": Look(),
}
"""Looks by name; the first is the default."""
