"""What the tests of batches share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pytest

from poseviewer.batch.job import run_job
from poseviewer.batch.job_table import Job
from poseviewer.batch.results import Batch, JobResult


@pytest.fixture
def one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows are fitted in this process: how they are handed out to others is tested without this."""

    def run_here(jobs: Sequence[Job], plan: Batch, _: int) -> Iterator[JobResult]:
        yield from (run_job(job, plan) for job in jobs)

    monkeypatch.setattr("poseviewer.batch.run.run_here", run_here)
