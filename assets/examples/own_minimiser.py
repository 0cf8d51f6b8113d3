"""Search with a minimiser of your own: own_minimiser.py PHOTO MODEL START."""

import sys
from dataclasses import replace

import numpy as np

import poseviewer
from poseviewer.fit.stages import make_stages
from poseviewer.optimise.protocol import State


def minimise(objective, x0, scale, options, _seed=0):
    """Step along each axis of ``scale``; halve the step where no point is better."""
    best, value, step = x0, np.inf, options
    while step > options / 16:
        points = best + step * np.vstack([0 * x0, scale.T, -scale.T])
        losses = np.full(len(points), np.inf)
        for index, loss in enumerate(objective(list(points))):
            losses[index] = loss
            order = np.argsort(losses)
            yield State(points[order[0]], losses[order[0]], points[order], losses[order])
        step = step if losses.min() < value else step / 2
        best, value = points[order[0]], losses.min()
    yield State(best, value, points[order], losses[order], converged=True)


def own_stages(*about):
    """Put it on each pyramid level of the photo, with shorter steps on finer ones."""
    stages = enumerate(make_stages(*about))
    return tuple(replace(stage, minimise=minimise, options=0.2 / 4**i) for i, stage in stages)


result = poseviewer.load(*sys.argv[1:]).fit(stages=own_stages, threads=2)
print(f"unexplained {result.unexplained:.3f} by {result.evaluations} evaluations")
