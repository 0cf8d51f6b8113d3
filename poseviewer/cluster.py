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


def run_on_cluster(
    function: Callable[[Item], Result], items: Mapping[str, Item], address: str
) -> Iterator[tuple[Item, Result | None]]:
    """Call a function on named items; yield each with its result, None if workers died at it."""
    with _connected(address) as client:
        from distributed import (  # pyright: ignore[reportMissingImports] - an extra
            CancelledError,
            KilledWorker,
            as_completed,
        )

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
