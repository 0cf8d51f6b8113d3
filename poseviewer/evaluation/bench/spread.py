"""Evaluations over all cores: each gets a renderer of its own, for kernels run side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue
from types import TracebackType
from typing import TypeVar

from poseviewer.render.software import SoftwareRenderer

T = TypeVar("T")
R = TypeVar("R")


class Spread:
    """A pool of clones of a renderer."""

    def __init__(self, renderer: SoftwareRenderer, threads: int) -> None:
        self.threads = threads
        self._free: SimpleQueue[SoftwareRenderer] = SimpleQueue()
        for _ in range(threads):
            self._free.put(renderer.clone())
        self._executor = ThreadPoolExecutor(threads)

    def __enter__(self) -> Spread:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the threads, once what they are at is done."""
        self._executor.shutdown()

    def map(self, task: Callable[[SoftwareRenderer, T], R], items: Sequence[T]) -> list[R]:
        """What ``task`` gives for each item, in order; an item goes to a renderer that is free."""

        def run(item: T) -> R:
            renderer = self._free.get()
            try:
                return task(renderer, item)
            finally:
                self._free.put(renderer)

        return list(self._executor.map(run, items))
