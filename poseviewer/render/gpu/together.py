"""Many calls for moments as one: each caller waits in a greenlet of its own until all have asked.

So whatever asks for one pose after the other, a descent or the loss over several photos, is judged
in batches beside others of its kind, without a thread for each.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from poseviewer.geometry.camera import Pose
from poseviewer.render.types import Moments, PhotoAttributes

if TYPE_CHECKING:
    from poseviewer.render.gpu.renderer import GpuRenderer

Item = TypeVar("Item")
Result = TypeVar("Result")
BATCH = 512
"""Items that are judged together."""


def ask(renderer: GpuRenderer, pose: Pose, photo: PhotoAttributes) -> Moments:
    """The moments at a pose, alone or, within ``run_together``, with those of the others."""
    from greenlet import getcurrent

    mine: Any = getcurrent()
    if getattr(mine, "asks", False):
        return mine.parent.switch((renderer, photo, pose))
    return renderer.moments_at([pose], photo)[0]


def run_together(
    function: Callable[[Any, Item], Result], renderer: Any, items: Sequence[Item]
) -> Iterator[Result]:
    """``function(renderer, item)`` of all items, in their order, ``BATCH`` at a time.

    Raises:
        Exception: whatever ``function`` raised.
    """
    for begin in range(0, len(items), BATCH):
        results: dict[int, Result] = {}

        def work(i: int, item: Item, results: dict[int, Result] = results) -> None:
            results[i] = function(renderer, item)

        batch = list(enumerate(items[begin : begin + BATCH]))
        waiting = _gone_on((_asker(work), item) for item in batch)
        while waiting:
            waiting = _gone_on(_answered(waiting))
        yield from (results[i] for i, _ in batch)


def _asker(work: Callable[..., None]) -> Any:
    from greenlet import greenlet

    asker: Any = greenlet(work)
    asker.asks = True
    return asker


def _gone_on(answers: Iterator[tuple[Any, tuple[Any, ...]]]) -> list[tuple[Any, Any]]:
    """Let each asker go on with its answer; those that ask again, with what they ask."""
    asked = [(asker, asker.switch(*answer)) for asker, answer in answers]
    return [(asker, question) for asker, question in asked if not asker.dead]


def _answered(waiting: Sequence[tuple[Any, Any]]) -> Iterator[tuple[Any, tuple[Any, ...]]]:
    questions: dict[Any, list[tuple[Any, Pose]]] = defaultdict(list)
    for asker, (renderer, photo, pose) in waiting:
        questions[renderer, photo].append((asker, pose))
    for (renderer, photo), asked in questions.items():
        found = renderer.moments_at([pose for _, pose in asked], photo)
        for (asker, _), moments in zip(asked, found, strict=True):
            yield asker, (moments,)
