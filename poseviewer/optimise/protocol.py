"""Types that every minimiser takes and yields."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

from poseviewer.geometry.arrays import FloatArray

Objective = Callable[[Sequence[FloatArray]], Iterator[float]]
"""The losses of points (d,), in order; those of one call may be evaluated in parallel."""
Options = TypeVar("Options", contravariant=True)
"""Options of a minimiser."""


class Minimiser(Protocol[Options]):
    """A search that yields a state after every evaluation, and once more at the end.

    To stop it, stop asking. The same arguments give the same search.
    """

    def __call__(
        self,
        objective: Objective,
        x0: FloatArray,
        scale: FloatArray,
        options: Options,
        seed: int = 0,
    ) -> Iterator[State]:
        """Search about a point.

        Args:
            objective: function that returns the losses of points.
            x0: (d,), the start.
            scale: (d, d), whose columns are the directions and units of the options' lengths.
            options: options of the minimiser.
            seed: seed of the random numbers.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """A minimisation after one more evaluation."""

    best: FloatArray
    """(d,): the point to take if the search ends here."""
    value: float
    """Loss of the best point."""
    candidates: FloatArray
    """(n, d): the points that are compared (simplex, population, samples), the best first."""
    candidate_losses: FloatArray
    """(n,): ascending; infinite where not yet evaluated."""
    axes: FloatArray | None = None
    """(d, d): principal axes of the valley as columns, where its shape is known."""
    restart: int = 0
    """Number of restarts so far."""
    converged: bool = False
    """Whether this is the last state."""

    def since(self, before: State | None) -> State:
        """Return the state with the best point of this one and all ``before``."""
        if before is None or self.value < before.value:
            return self
        return replace(self, best=before.best, value=before.value)
