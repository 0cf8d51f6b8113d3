"""Pictures of the model over the photo."""

from typing import Literal, get_args

Look = Literal["outline", "edges", "relit", "residual", "normals", "solid", "none"]
"""Style in which the model is drawn over the photo."""
LOOKS: tuple[Look, ...] = get_args(Look)
"""Every look, as the command line and the app call it; the first is the default."""
