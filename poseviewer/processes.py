"""Calls in processes of this machine, which end with the process that started them."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")
_SPAWN = multiprocessing.get_context("spawn")
"""A fork would copy an OpenGL context, and other threads' locks as they happen to be."""


def run_in_processes(
    function: Callable[[Item], Result], items: Sequence[Item], count: int
) -> Iterator[tuple[Item, Result | None]]:
    """Call a function on items in up to ``count`` processes; yield each with its result as it
    comes, or with None if the process died at it twice. An error of the function ends all.
    """
    reader, writer = _SPAWN.Pipe(duplex=False)
    own = threading.local()  # a process for each thread: its death is no other item's

    def run(item: Item) -> Result | None:
        for _ in range(2):
            if writer.closed:
                break
            if not hasattr(own, "process"):
                own.process = ProcessPoolExecutor(1, _SPAWN, _begin, (reader,))
                _block_ctrl_c()  # only now: the first pool starts a tracker, which unblocks it
            try:
                return own.process.submit(function, item).result()
            except BrokenProcessPool:
                del own.process
        return None

    threads = ThreadPoolExecutor(count)
    try:
        running = {threads.submit(run, item): item for item in items}
        for future in as_completed(running):
            yield running[future], future.result()
    finally:
        writer.close()
        threads.shutdown(cancel_futures=True)
        reader.close()


def _block_ctrl_c() -> None:
    """Keep Ctrl-C, which a terminal sends to all, from the processes that this thread starts: they
    would end with a traceback before ``_begin``.
    """
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def _begin(reader: Connection) -> None:
    """End this process when the pipe's other end is closed, as by the death of its starter."""

    def end() -> None:
        reader.poll(None)
        os._exit(1)

    # Ctrl-C goes to all processes of a terminal; the first one tells the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end, name="end with parent", daemon=True).start()
