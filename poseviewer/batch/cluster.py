"""Jobs on a Dask cluster; the only importer of distributed.

The workers see photos, models and the folder of results under the same paths as this machine. When
a worker dies, Dask gives its jobs to others; those whose results were written are not done again.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from typing import Any

from poseviewer.batch.job import run_job
from poseviewer.batch.job_table import Job
from poseviewer.batch.results import Batch, JobResult, save_failure
from poseviewer.errors import BatchError

CONNECT_SECONDS = 10.0


def run_on_cluster(jobs: Sequence[Job], plan: Batch, address: str) -> Iterator[JobResult]:
    """Yield the results of the jobs as they come, in no order."""
    with _connected(address) as client:
        from distributed import (  # pyright: ignore[reportMissingImports] - an extra
            CancelledError,
            KilledWorker,
            as_completed,
        )

        # A job of a batch has one name, whoever submits it.
        names = {job: f"poseviewer-{job.key}-{plan.folder}" for job in jobs}
        submitted = {client.submit(run_job, job, plan, key=key): job for job, key in names.items()}
        try:
            for future in as_completed(list(submitted), loop=client.loop):
                try:
                    yield future.result()
                except KilledWorker:
                    yield save_failure(
                        plan.folder,
                        submitted[future],
                        "every worker that fitted it died; is there memory enough for the photo "
                        "and the model?",
                    )
                except (CancelledError, OSError):  # a closed connection is an OSError
                    raise BatchError(
                        f"{address}: the Dask scheduler went away. What is done is kept: start it "
                        "again, and run the batch again to go on."
                    ) from None
        finally:
            if running := [future for future in submitted if not future.done()]:
                client.cancel(running)


def _connected(address: str) -> Any:
    """A client of the scheduler."""
    try:
        from distributed import Client  # pyright: ignore[reportMissingImports] - an extra
        from distributed.comm.addressing import (  # pyright: ignore[reportMissingImports]
            get_address_host_port,
        )
    except ImportError:
        raise BatchError(
            "--scheduler needs Dask: pip install 'poseviewer[cluster]', here and on the workers."
        ) from None
    for handler in logging.getLogger("distributed").handlers:
        handler.setLevel(logging.CRITICAL)  # of a scheduler that is gone it has tracebacks
    try:
        get_address_host_port(address)  # a client of a wrong address takes long to end
        return Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:  # a TimeoutError is an OSError
        reason = (str(error).splitlines() or [type(error).__name__])[0][:100]
        raise BatchError(
            f"{address}: no Dask scheduler answers there ({reason}); start one with "
            "`dask scheduler`, or check the address (tcp://HOST:8786). What is done is kept."
        ) from None
