"""Pictures of the model over the photo."""

from typing import Literal, get_args

RenderStyle = Literal["outline", "edges", "relit", "residual", "normals", "solid", "none"]
"""Style in which the model is drawn over the photo."""
RENDER_STYLES: tuple[RenderStyle, ...] = get_args(RenderStyle)
"""All render styles; the first is the default."""
