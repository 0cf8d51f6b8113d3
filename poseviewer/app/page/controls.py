"""Controls of the page: what a user does with one posts a request, and the session's value is
written back only where it differs.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from html import escape
from typing import Any

import viser

from poseviewer.app.below_viser.upload_limits import take_upload
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import Export
from poseviewer.app.workers.tasks import Request, download, upload
from poseviewer.files.file_set import Kind
from poseviewer.files.state.uploads import ACCEPTED

Post = Callable[[Request], None]
Read = Callable[[Session], Any]

MARKUP = re.compile(r"[\\`*{}\[\]<>#|~!]|(?<![^\W_])_|_(?![^\W_])")
"""Characters that mean more in markdown; a picture there would make viser read its file."""


def plain(text: str) -> str:
    """A text from a file or a user, as markdown shows it letter for letter."""
    escaped = text.replace("&", "&amp;")
    return MARKUP.sub(lambda found: f"&#{ord(found.group())};", escaped)


SELECTED = "● "
"""Before the label of the choice that is selected."""


class Controls:
    """Makes the controls of ``gui``: their requests go to ``post``, and what they show is read from
    the session.

    Options of a control that are functions of the session are its properties whenever ``show`` is
    called; all others stay as they are.
    """

    def __init__(self, gui: viser.GuiApi, post: Post) -> None:
        self.gui = gui
        self._post = post
        self.where = ""
        """Path at which the pose was or will be saved."""
        self._shown: Session | None = None
        self._reads: list[tuple[Any, str, Read]] = []

    @property
    def session(self) -> Session:
        """The session that was shown last."""
        assert self._shown is not None
        return self._shown

    def show(self, session: Session) -> None:
        """Bring all controls to the session."""
        self._shown = session
        for handle, name, read in self._reads:
            set_properties(handle, **{name: read(session)})

    def add(self, handle: Any, **options: Any) -> Any:
        """Bring properties of a handle to the session, in their order."""
        for name, value in options.items():
            if callable(value):
                self._reads.append((handle, name, value))
        return handle

    def text(self, read: Read, add: Callable[..., Any] | None = None) -> None:
        """Markdown, or what ``add`` makes of content; hidden while it is empty."""
        handle = (add or self.gui.add_markdown)("", visible=False)
        self.add(handle, content=read, visible=lambda _: bool(handle.content))

    def html(self, read: Read) -> None:
        """HTML; hidden while it is empty."""
        self.text(read, self.gui.add_html)

    def field(self, handle: Any, asked: Callable[[Any], Request | None], **options: Any) -> Any:
        """An input; ``asked`` makes what a new value asks for (None: nothing)."""

        @handle.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is None or self._shown is None:  # our own writing
                return
            request = asked(handle.value)
            if request is not None:
                self._post(request)

        return self.add(handle, **options)

    def button(
        self, label: str | Read, asked: Request | Callable[[Session, int], Request], **options: Any
    ) -> Any:
        """A button that asks for a request, or for what the session and the client's id lead to;
        ``color`` None: the page's own.
        """
        options = {"label": label, "color": "gray", **options}
        handle = self.gui.add_button(**{"label": "", **_fixed(options)})

        @handle.on_click
        async def _(event: viser.GuiEvent) -> None:
            if event.client is None:
                return
            request = asked
            if not isinstance(request, Request):  # of a page that shows a session
                request = request(self.session, event.client.client_id)
            self._post(request)

        return self.add(handle, **options)

    def choices(
        self, label: str, asked: Mapping[str, Request], selected: Read | None = None, **options: Any
    ) -> Any:
        """Buttons in one line, each with what it asks for; ``selected`` reads the marked label."""
        handle = self.gui.add_button_group(label, tuple(asked), **_fixed(options))

        @handle.on_click
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                self._post(asked[handle.value.removeprefix(SELECTED)])

        if selected is not None:
            options["options"] = lambda session: tuple(
                SELECTED * (option == selected(session)) + option for option in asked
            )
        return self.add(handle, **options)

    def download(self, label: str, what: Export, icon: Any = "download") -> None:
        """A button that sends ``what`` to the page on which it is pressed."""
        self.button(label, lambda _, client: download(what, client), icon=icon)

    def upload(self, label: str, kind: Kind | None, icon: Any, adds: bool = False) -> None:
        """A button that takes files of a kind, or (None) a folder, and what is dropped."""
        accepted = "folder" if kind is None else ",".join(ACCEPTED[kind])
        handle = self.gui.add_upload_button(label, mime_type=accepted, icon=icon, color="gray")

        @handle.on_upload
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                file = take_upload(handle)
                self._post(upload(kind, file.name, file.content, adds))


def _fixed(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options that no session changes."""
    return {name: value for name, value in options.items() if not callable(value)}


def kept(key: Read, read: Read) -> Read:
    """Read anew only where ``key(session)`` is another one."""
    known: list[Any] = [object(), None]

    def look(session: Session) -> Any:
        now = key(session)
        if known[0] != now:
            known[:] = now, read(session)
        return known[1]

    return look


def on_press(kind: str, **report: Any) -> str:
    """HTML attribute that has the page's script report a press, or Enter, on an element."""
    return f'data-report="{escape(json.dumps({"kind": kind, **report}))}"'


def set_properties(handle: Any, **values: Any) -> None:
    """Assign where it changes something: every assignment is a message."""
    for name, value in values.items():
        now = getattr(handle, name)
        if now is not value and now != value:
            setattr(handle, name, value)
