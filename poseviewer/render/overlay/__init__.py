"""Pictures of the model over the photo."""

from typing import Literal, get_args

RenderStyle = Literal["outline", "edges", "relit", "residual", "normals", "solid", "none"]
"""Style in which the model is drawn over the photo."""
RENDER_STYLES: tuple[RenderStyle, ...] = get_args(RenderStyle)
"""Every look, as the command line and the app call it; the first is the default."""
