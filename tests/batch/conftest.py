"""What the tests of batches share."""

from __future__ import annotations

import pytest


@pytest.fixture
def one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows are fitted in this process: how they are handed out to others is tested without this."""
    monkeypatch.setattr(
        "poseviewer.batch.run.run_in_processes",
        lambda function, jobs, _: ((job, function(job)) for job in jobs),
    )
