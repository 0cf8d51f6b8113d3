"""Evaluate many poses at once, by clones of a renderer on threads or by a GPU in batches."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import chain
from typing import Any, TypeVar

from poseviewer.geometry.camera import Pose
from poseviewer.render.attributes import Renderer

Item = TypeVar("Item")
Result = TypeVar("Result")

ITEMS_PER_CHUNK = 8
"""Items that a thread takes at a time: stopping waits some ten milliseconds at most."""


def processors() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class RendererPool:
    """Threads with a renderer each, or a tuple of them; one thread if they cannot be cloned."""

    def __init__(
        self,
        renderer: Renderer | tuple[Renderer, ...],
        threads: int | None = None,
        begin: Callable[[], None] | None = None,
    ) -> None:
        """Start ``threads``, by default one for each processor; each calls ``begin`` first."""
        count = processors() if threads is None else threads
        each = renderer if isinstance(renderer, tuple) else (renderer,)
        self._renderer, self._begin = renderer, begin
        self.threads = 1
        self._executor: ThreadPoolExecutor | None = None
        owns: list[Any] = [each] * each[0].callers
        if not owns and count > 1:
            owns = [tuple(one.clone() for one in each) for _ in range(count)]
        if owns and None not in owns[0]:
            is_tuple, self.threads = each is renderer, len(owns)
            self._free: deque[Any] = deque(own if is_tuple else own[0] for own in owns)
            self._executor = ThreadPoolExecutor(self.threads, "renderer", initializer=begin)

    def map(
        self,
        function: Callable[[Any, Item], Result],
        items: Sequence[Item],
        at_a_time: int = ITEMS_PER_CHUNK,
    ) -> Iterator[Result]:
        """Yield ``function(renderer, item)`` of all items in their order.

        The first error of ``function`` ends it. Threads take ``at_a_time`` items, and at most two
        such chunks each are queued. Stop iterating to stop.
        """
        if self._executor is None:
            for item in items:
                yield function(self._renderer, item)
            return
        size = min(at_a_time, -(-len(items) // (2 * self.threads)) or 1)  # every thread gets some
        chunks = (items[at : at + size] for at in range(0, len(items), size))
        waiting: deque[Future[list[Result]]] = deque()
        try:
            for chunk in chunks:
                waiting.append(self._executor.submit(self._work, function, chunk))
                if len(waiting) >= 2 * self.threads:
                    yield from waiting.popleft().result()
            while waiting:
                yield from waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()

    def cull_unseen(self, poses: Sequence[Sequence[Pose]]) -> RendererPool:
        """Make a pool for poses among some, which may leave out faces that none of them shows.

        ``poses`` are those of each renderer of a tuple, or all of the one renderer.
        """
        one, of_all = self._renderer, list(chain.from_iterable(poses))
        culled = (
            tuple(each.cull_unseen(own) for each, own in zip(one, poses, strict=True))
            if isinstance(one, tuple)
            else one.cull_unseen(of_all)
        )
        return RendererPool(culled, self.threads, self._begin)

    def start(self, work: Callable[[], Result]) -> Callable[[], Result]:
        """Begin ``work`` in a thread, and return a function that waits for its result.

        Without threads, the returned function does the work.
        """
        return work if self._executor is None else self._executor.submit(work).result

    def close(self) -> None:
        """End the threads after their present chunks."""
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)

    def __enter__(self) -> RendererPool:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _work(self, function: Callable[[Any, Item], Result], chunk: Sequence[Item]) -> list[Result]:
        # There are as many renderers as threads: one is always free.
        renderer = self._free.pop()
        try:
            return [function(renderer, item) for item in chunk]
        finally:
            self._free.append(renderer)
