"""The evidence about a pose as a cell of a table, and back."""

from __future__ import annotations

from dataclasses import fields

from poseviewer.fit.verdict import Features

NUMBERS = tuple(field.name for field in fields(Features) if field.name != "weak")
"""Names of the evidence's numbers."""


def evidence_as_text(features: Features | None) -> str:
    """``name=value`` of each number, with blanks between them; empty for none."""
    if features is None:
        return ""
    return " ".join(f"{name}={float(getattr(features, name)):.6g}" for name in NUMBERS)


def evidence_from_text(text: str) -> dict[str, float]:
    """The numbers by their names.

    Raises:
        ValueError: it is not such a text.
    """
    pairs = [part.split("=", 1) for part in text.split()]
    return {name: float(value) for name, value in pairs}
