"""Files in and out: what is open, and what can be saved."""

from __future__ import annotations

from html import escape
from typing import Any

import viser

from poseviewer.app.below_viser.upload_limits import take_upload
from poseviewer.app.page.fields import Post, button, download_button, set_property
from poseviewer.app.state.requests import SavePose, ShowHelp, Upload
from poseviewer.app.state.session import Session
from poseviewer.files.state.uploads import ENDINGS, Kind


class OpenPanel:
    """Folder "Open"; where photo and model are ``fixed``, pose files alone."""

    def __init__(self, gui: viser.GuiApi, post: Post, fixed: bool = False) -> None:
        with gui.add_folder("1 · Open"):
            self._what = gui.add_markdown("")
            self._uploads = (
                []
                if fixed
                else [
                    upload_button(gui, post, "photo", "Photo ...", "photo"),
                    upload_button(gui, post, "model", "Model ...", "cube"),
                ]
            )
            self._uploads.append(upload_button(gui, post, "pose", "Pose file ...", "file-import"))
            button(gui, "Keys and mouse (?)", post, ShowHelp, icon="help", color="gray")

    def show(self, session: Session) -> None:
        """Say what is open."""
        registration = session.document.registration
        photo, mesh = registration.photo, registration.mesh
        text = (
            f"**{escape(photo.label)}**  \n{photo.width} x {photo.height} px  \n"
            f"**{escape(registration.mesh_name)}**  \n{len(mesh.faces):,} triangles, "
            f"{len(mesh.part_names) or 1} part{'s' if len(mesh.part_names) > 1 else ''}"
        )
        set_property(self._what, "content", text)


class SavePanel:
    """Folder "Save"."""

    def __init__(self, gui: viser.GuiApi, post: Post) -> None:
        with gui.add_folder("4 · Save"):
            self._state = gui.add_markdown("")
            button(
                gui, "Save pose (S)", post, lambda _: SavePose(), icon="device-floppy", color="cyan"
            )
            download_button(gui, "Download pose", post, "pose")
            download_button(gui, "Download overlay", post, "overlay", icon="photo-down")

    def show(self, session: Session, where: str) -> None:
        """Say whether the pose stands in a file; ``where`` it was or will be written."""
        text = "● unsaved changes" if session.unsaved else "no unsaved changes"
        set_property(self._state, "content", f"{text}  \n{escape(where)}")


def upload_button(
    gui: viser.GuiApi, post: Post, kind: Kind, text: str, icon: Any, beside: bool = False
) -> Any:
    """A button that takes a file; a model may go ``beside`` the one at hand."""
    handle = gui.add_upload_button(text, mime_type=",".join(ENDINGS[kind]), icon=icon, color="gray")

    @handle.on_upload
    async def _(event: viser.GuiEvent) -> None:
        if event.client is not None:
            file = take_upload(handle)
            post(Upload(kind, file.name, file.content, beside))

    return handle
