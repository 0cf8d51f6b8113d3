"""How the model is shown."""

from __future__ import annotations

import viser

from poseviewer.app.page.fields import Field, Post
from poseviewer.app.state import commands as c
from poseviewer.app.state.session import Session

LOOKS = ("outline", "solid", "relit", "normals", "residual", "none")


class LookPanel:
    """Folder "Look"."""

    def __init__(self, gui: viser.GuiApi, post: Post) -> None:
        with gui.add_folder("Look"):
            self._look = Field(
                gui.add_dropdown("Model (1-5, 0)", LOOKS),
                post,
                lambda name: c.ChangeView(look=name, hidden=False),
            )
            self._opacity = Field(
                gui.add_slider("Opacity", 0.0, 1.0, 0.05, 0.8),
                post,
                lambda value: c.ChangeView(opacity=float(value)),
            )
            self._wipe = Field(
                gui.add_slider("Wipe", 0.0, 1.0, 0.01, 1.0),
                post,
                lambda value: c.ChangeView(wipe=float(value)),
            )
            self._hidden = Field(
                gui.add_checkbox("Photo alone (B)", False),
                post,
                lambda on: c.ChangeView(hidden=bool(on)),
            )

    def show(self, session: Session) -> None:
        """Bring the controls to the session."""
        look = session.look
        self._look.show(look.name)
        self._opacity.show(look.opacity, visible=look.name == "solid")
        self._wipe.show(look.wipe)
        self._hidden.show(look.hidden)
