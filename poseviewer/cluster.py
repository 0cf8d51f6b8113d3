"""Calls on a Dask cluster, whose workers see all files under the same paths as this machine.

When a worker dies, Dask gives its items to others; those with results are not done again.
"""

import logging
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

from poseviewer.errors import BatchError

Item = TypeVar("Item")
Result = TypeVar("Result")
CONNECT_SECONDS = 10.0
WORKER_SECONDS = 60.0
"""Time within which a worker has to be there: one that a queue starts may take this long."""


def run_on_cluster(
    function: Callable[[Item], Result], items: Mapping[str, Item], address: str
) -> Iterator[tuple[Item, Result | None]]:
    """Call a function on named items; yield each with its result, None if workers died at it."""
    with _connect(address) as client:
        from distributed import (  # pyright: ignore[reportMissingImports] - an extra
            CancelledError,
            KilledWorker,
            as_completed,
        )

        try:
            client.wait_for_workers(1, timeout=WORKER_SECONDS)
        except TimeoutError:
            raise BatchError(
                f"{address}: no worker joined the Dask scheduler in {WORKER_SECONDS:.0f} s; start "
                f"one with `dask worker {address}`. What is done is kept."
            ) from None
        submitted = {client.submit(function, item, key=name): item for name, item in items.items()}
        try:
            for future in as_completed(list(submitted), loop=client.loop):
                try:
                    yield submitted[future], future.result()
                except KilledWorker:
                    yield submitted[future], None
                except (CancelledError, OSError):  # a closed connection is an OSError
                    raise BatchError(
                        f"{address}: the Dask scheduler went away. What is done is kept: start it "
                        "again, and run the same again to go on."
                    ) from None
        finally:
            if running := [future for future in submitted if not future.done()]:
                client.cancel(running)


def _connect(address: str) -> Any:
    """Connect a client to the scheduler."""
    try:
        from distributed import Client, Security  # pyright: ignore[reportMissingImports] - an extra
        from distributed.comm.addressing import (  # pyright: ignore[reportMissingImports]
            get_address_host_port,
        )
    except ImportError:
        raise BatchError(
            "A cluster needs Dask: pip install 'poseviewer[cluster]', here and on the workers."
        ) from None
    for handler in logging.getLogger("distributed").handlers:
        handler.setLevel(logging.CRITICAL)  # of a scheduler that is gone it has tracebacks
    client: Any = None
    try:
        get_address_host_port(address)  # a client of a wrong address takes long to end
        if (
            address.startswith("tls:")
            and not Security().get_connection_args("client")["ssl_context"]
        ):
            raise ValueError("its certificates are wanted, in Dask's configuration")
        client = Client.__new__(Client)
        client.__init__(address, timeout=CONNECT_SECONDS, set_as_default=False)
        return client
    except Exception as error:  # noqa: BLE001 - whoever answers there may send anything
        if client is not None:
            client.status = "closed"  # else its end waits for the answer that made no sense
        reason = (str(error).splitlines() or [type(error).__name__])[0][:100]
        raise BatchError(
            f"{address}: no Dask scheduler answers there ({reason}); start one with "
            "`dask scheduler`, or check the address (tcp://HOST:8786). What is done is kept."
        ) from None
