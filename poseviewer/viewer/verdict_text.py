"""The verdict on a pose, for the panel."""

from __future__ import annotations

from poseviewer.fit.verdict import Verdict

SIGNS = {"found": "🟢", "doubtful": "🟡", "lost": "🔴"}


def verdict_text(verdict: Verdict | None) -> str:
    """Markdown, to go below how the search ended: the word, then the reasons; empty for none."""
    if verdict is None:
        return ""
    reasons = "\n".join(f"- {reason}" for reason in verdict.reasons)
    return (
        f"\n\n### {SIGNS[verdict.word]} {verdict.word}\n"
        f"{verdict.probability:.0%} of fits that look like this one are right.\n\n{reasons}"
    )
