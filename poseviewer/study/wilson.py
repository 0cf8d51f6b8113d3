"""How sure a share of successes is."""

from __future__ import annotations

import math

Z_95 = 1.959963984540054
"""Of a normal distribution, 95 % lies within so many standard deviations."""


def wilson_interval(successes: int, trials: int, z: float = Z_95) -> tuple[float, float]:
    """The interval, in [0, 1], that holds the true share of successes with 95 % confidence.

    Wilson (1927), "Probable inference, the law of succession, and statistical inference": unlike
    the usual one it is right for few trials, and for none or all successful.

    Raises:
        ValueError: there is no trial, or there are more successes than trials.
    """
    if not 0 <= successes <= trials or trials == 0:
        raise ValueError(f"{successes} successes in {trials} trials")
    share, weight = successes / trials, z * z / trials
    middle = share + weight / 2.0
    half = z * math.sqrt(share * (1.0 - share) / trials + weight / (4.0 * trials))
    low, high = (middle - half) / (1.0 + weight), (middle + half) / (1.0 + weight)
    # All or none: exactly 1 or 0, whatever the rounding.
    return (0.0 if successes == 0 else low), (1.0 if successes == trials else high)
