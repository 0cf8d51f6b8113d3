"""The verdict on a pose, for the panel."""

from __future__ import annotations

from poseviewer.fit.verdict import Verdict


def verdict_text(verdict: Verdict | None) -> str:
    """Markdown, to go below how the search ended: the word, then the reasons; empty for none."""
    if verdict is None:
        return ""
    reasons = "\n".join(f"- {reason}" for reason in verdict.reasons)
    return (
        f"\n\n**Verdict: {verdict.word}.** {verdict.probability:.0%} of the fits that it was "
        f"calibrated on and that looked like this one were right.\n\n{reasons}"
    )
