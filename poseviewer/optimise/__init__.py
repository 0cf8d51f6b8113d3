"""Minimisers that know no pose.

Each has ``minimise(objective, x0, scale, options) -> Iterator[State]``: ``objective`` takes a
sequence of points (d,) and yields their losses in order, ``x0`` (d,) is the start, and the columns
of ``scale`` (d, d) are the directions and lengths that the options' lengths are measured in. A
state is yielded after every evaluation, and once more at the end; to stop, stop asking. Minimisers
that draw random numbers take a ``seed``; the same arguments give the same search.
"""
