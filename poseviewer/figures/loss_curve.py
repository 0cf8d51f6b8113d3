"""The course of a search: its best loss after every evaluation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

INK = "0.15"


def make_loss_curve(losses: ArrayLike, restarts: Sequence[int] = (), *, title: str = "") -> Figure:
    """Best loss so far (N,) after evaluations 1 to N, with the first evaluations of restarts."""
    losses = np.asarray(losses, dtype=float)
    figure = Figure(figsize=(6.4, 3.2), facecolor="white", layout="constrained")
    axes = figure.add_subplot()
    for number, evaluation in enumerate(restarts):
        label = "simplex rebuilt" if number == 0 else None
        axes.axvline(evaluation, color="0.75", linewidth=0.8, linestyle="--", label=label)
    evaluations = np.arange(1, len(losses) + 1)
    axes.step(evaluations, losses, where="post", color="#20639b", linewidth=1.6)
    axes.set_xlabel("evaluations", color=INK)
    axes.set_ylabel("best loss so far", color=INK)
    axes.set_title(title, loc="left", fontsize=11, color=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="0.92", linewidth=0.8)
    axes.set_axisbelow(True)
    if len(restarts):
        axes.legend(frameon=False, fontsize=8, labelcolor=INK)
    return figure
