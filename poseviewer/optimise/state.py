"""Types that every minimiser takes and yields."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from poseviewer.geometry.arrays import FloatArray

Objective = Callable[[Sequence[FloatArray]], Iterator[float]]
"""The losses of points (d,), in order; those of one call may be evaluated in parallel."""


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """A minimisation after one more evaluation."""

    best: FloatArray
    """(d,): the point to take if it ends here."""
    value: float
    """Its loss."""
    candidates: FloatArray
    """(n, d): the points that are compared now (simplex, population, samples), the best first."""
    candidate_losses: FloatArray
    """(n,): ascending; infinite where not yet evaluated."""
    axes: FloatArray | None = None
    """(d, d): where known, the shape of the valley: columns are its principal axes."""
    restart: int = 0
    """Number of restarts so far."""
    converged: bool = False
    """Whether this is the last one."""

    def since(self, before: State | None) -> State:
        """The state with the best point so far, where ``before`` has that until then."""
        if before is None or self.value < before.value:
            return self
        return replace(self, best=before.best, value=before.value)
