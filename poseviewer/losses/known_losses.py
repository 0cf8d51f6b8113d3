"""The losses by their names: one more takes a file like ``paper_loss.py``, and a row here."""

from poseviewer.losses.default_loss import DEFAULT
from poseviewer.losses.loss import Loss, LossName
from poseviewer.losses.paper_loss import PAPER

LOSSES: dict[LossName, Loss] = {loss.name: loss for loss in (DEFAULT, PAPER)}
"""Losses by their names, in the order in which people see them."""
