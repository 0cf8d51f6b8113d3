"""Calls in processes of this machine: many at once, or one that may crash or hang."""

import math
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from poseviewer.errors import PoseViewerError

Item = TypeVar("Item")
Result = TypeVar("Result")
_SPAWN = multiprocessing.get_context("spawn")
"""A fork would copy an OpenGL context, and other threads' locks as they happen to be."""
CONTROL_GROUP = Path("/sys/fs/cgroup/memory.max")
"""File in which a container finds how much memory it has."""
TOLD, RETURNED = "told", "returned"
"""Kinds of what a process writes that is iterated over."""
TICK_S = 1.0
"""Time between two looks at what the processes have done so far, s."""


def memory_bytes() -> float:
    """Return the bytes of this machine's memory, or of its control group's; infinite if unknown."""
    known = [math.inf]
    with suppress(AttributeError, ValueError, OSError):
        known.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    with suppress(ValueError, OSError):
        known.append(int(CONTROL_GROUP.read_text()))  # or "max"
    return min(known)


def call_in_subprocess(
    function: Callable[..., Result],
    *given: Any,
    seconds: float | None = None,
    memory: int | None = None,
) -> Result:
    """Call a function of a module in a process of its own, of up to ``memory`` bytes.

    Raises:
        PoseViewerError: as the function.
        subprocess.CalledProcessError: the process ended at it.
        subprocess.TimeoutExpired: it was stopped after so many ``seconds``.
    """
    code = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import answer; answer()"
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=pickle.dumps(memory) + pickle.dumps((function, given)),
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        timeout=seconds,
        check=True,
    )
    result = pickle.loads(done.stdout)
    if isinstance(result, PoseViewerError):
        raise result
    return result


def answer() -> None:
    """Call the function that the standard input names; write what it returns, or its error."""
    memory = pickle.load(sys.stdin.buffer)
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries print
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if memory is not None:
            resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    function, given = pickle.load(sys.stdin.buffer)
    try:
        result = function(*given)
    except PoseViewerError as error:
        result = error
    with out:
        out.write(pickle.dumps(result))


def iterate_in_subprocess(
    function: Callable[..., Result], *given: Any
) -> Generator[Any, None, Result]:
    """Yield what a function of a module tells, called in a process of its own as
    ``function(tell, *given)``; return its result. Closing the generator ends the process.

    Raises:
        Exception: as the function.
        subprocess.CalledProcessError: the process ended at it.
    """
    code = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import tell_all; tell_all()"
    # Ctrl-C goes to all processes of a terminal's session; this one is ended by its starter.
    child = subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    assert child.stdin is not None
    assert child.stdout is not None
    try:
        with suppress(BrokenPipeError):
            child.stdin.write(pickle.dumps((function, given)))
            child.stdin.flush()
        while True:
            try:
                kind, item = pickle.load(child.stdout)
            except (EOFError, pickle.UnpicklingError):
                raise subprocess.CalledProcessError(child.wait(), function.__name__) from None
            if kind == TOLD:
                yield item
            elif kind == RETURNED:
                return item
            else:
                raise item
    finally:
        child.kill()
        with suppress(OSError):  # what it did not read
            child.stdin.close()
        child.stdout.close()
        child.wait()


def tell_all() -> None:
    """Call the function that the standard input names; write what it tells, and its result or
    error. The process ends when its starter does.
    """
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries print
    function, given = pickle.load(sys.stdin.buffer)

    def end() -> None:
        os.read(0, 1)
        os._exit(1)

    def send(kind: str, item: Any) -> None:
        out.write(pickle.dumps((kind, item)))
        out.flush()

    threading.Thread(target=end, name="end with parent", daemon=True).start()
    try:
        send(RETURNED, function(lambda item: send(TOLD, item), *given))
    except Exception as error:  # noqa: BLE001 - the starter raises it
        send("raised", error)


def run_in_processes(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    count: int,
    tick: Callable[[], object] = lambda: None,
) -> Iterator[tuple[Item, Result | None]]:
    """Call a function on items in up to ``count`` processes; yield each with its result as it
    comes, or with None if the process died at it twice. An error of the function ends all.

    Args:
        function: of a module.
        items: what it is called on.
        count: number of processes.
        tick: called every second in which no result comes.
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

    threads, ended = ThreadPoolExecutor(count), SimpleQueue[Future[Result | None]]()

    def next_ended() -> Future[Result | None]:
        while True:
            with suppress(Empty):
                return ended.get(timeout=TICK_S)
            tick()

    try:
        running = {threads.submit(run, item): item for item in items}
        for future in running:
            future.add_done_callback(ended.put)
        for _ in items:
            future = next_ended()
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
