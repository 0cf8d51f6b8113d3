"""Jobs on a Dask cluster; the only importer of distributed.

The workers see photos, models and the folder of results under the same paths as this machine. A
worker that dies loses nothing: Dask gives its jobs to others, and those of them whose results were
written are not done again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from poseviewer.batch.jobs import Job
from poseviewer.batch.results import JobResult, failed_result
from poseviewer.batch.work import Plan, run_job
from poseviewer.errors import BatchError

CONNECT_SECONDS = 10.0


def run_on_cluster(jobs: Sequence[Job], plan: Plan, address: str) -> Iterator[JobResult]:
    """The results of the jobs as they come, in no order.

    Raises:
        BatchError: Dask is not installed, or no scheduler answers; results cannot be written.
    """
    try:
        from distributed import (  # pyright: ignore[reportMissingImports] - an extra
            Client,
            KilledWorker,
            as_completed,
        )
        from distributed.comm.addressing import (  # pyright: ignore[reportMissingImports]
            get_address_host_port,
        )
    except ImportError:
        raise BatchError(
            "--scheduler needs Dask: pip install 'poseviewer[cluster]', here and on the workers."
        ) from None
    try:
        get_address_host_port(address)  # a client of no address is long in ending
        client = Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:  # a TimeoutError is an OSError
        raise BatchError(
            f"{address}: no Dask scheduler answers there ({_short(error)}); start one with "
            "`dask scheduler`, or check the address (tcp://HOST:8786)."
        ) from None
    with client:
        flying = _submit(client, jobs, plan)
        try:
            for future in as_completed(list(flying), loop=client.loop):
                try:
                    yield future.result()
                except KilledWorker:
                    yield failed_result(
                        flying[future],
                        "every worker that fitted it died; is there memory enough for the photo "
                        "and the model?",
                    )
        finally:
            client.cancel([future for future in flying if not future.done()])


def _submit(client: Any, jobs: Sequence[Job], plan: Plan) -> dict[Any, Job]:
    """The futures of all jobs; one that starts from the row above is run after that."""
    futures: dict[str, Any] = {}
    for job in jobs:
        above = futures.get(job.above[0]) if job.above else None
        futures[job.key] = client.submit(_run_after, job, plan, above, key=_name(job, plan))
    return {futures[job.key]: job for job in jobs}


def _run_after(job: Job, plan: Plan, above: JobResult | None) -> JobResult:
    """Run a job, now that the row above it is done; what came of that is read from its file."""
    del above
    return run_job(job, plan)


def _name(job: Job, plan: Plan) -> str:
    """The same for the same job of the same batch, whoever asks for it."""
    return f"poseviewer-{job.key}-{plan.folder}"


def _short(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:100]
