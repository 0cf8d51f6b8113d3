"""Jobs on a Dask cluster; the only importer of distributed.

The workers see photos, models and the folder of results under the same paths as this machine. A
worker that dies loses nothing: Dask gives its jobs to others, and those of them whose results were
written are not done again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

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
        from distributed.comm import (  # pyright: ignore[reportMissingImports]
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
        flying = {client.submit(run_job, job, plan, key=_name(job, plan)): job for job in jobs}
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


def _name(job: Job, plan: Plan) -> str:
    """The same for the same job of the same batch, whoever asks for it."""
    return f"poseviewer-{job.key}-{plan.folder}"


def _short(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:100]
