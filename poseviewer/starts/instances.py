"""Several instances of a model in one photo: places where none stands yet."""

from collections.abc import Sequence
from dataclasses import replace

from poseviewer.fit.scene import PlacedModel
from poseviewer.fit.visibility import NOTHING, visibility
from poseviewer.geometry.mask import Mask
from poseviewer.starts.loading import StartInputs


def beside(inputs: StartInputs, placed: Sequence[PlacedModel]) -> StartInputs:
    """The inputs with pixels of the ``placed`` models masked: another instance is elsewhere."""
    if not placed:
        return inputs
    free = visibility(placed).nearest == NOTHING
    weights = free if inputs.mask is None else free * inputs.mask.weights
    return replace(inputs, mask=Mask.of(weights))
