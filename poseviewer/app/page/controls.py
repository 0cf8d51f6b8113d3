"""Controls of the page: what a user does with one posts a request, and the session's value is
written back only where it differs.
"""

import base64
import json
import math
import operator
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import cv2
import htpy as h
import numpy as np
import viser
from numpy.typing import NDArray

from poseviewer.app.below_viser.incoming import take_upload
from poseviewer.app.below_viser.inputs import call_in_loop, confirm_value
from poseviewer.app.state.edits import ShowHelp, set_fields
from poseviewer.app.state.keys_and_buttons import ACTIONS
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import Export
from poseviewer.app.workers.tasks import Request, download, upload
from poseviewer.errors import in_words
from poseviewer.geometry.lens import LensModel
from poseviewer.opening.sources import Kind
from poseviewer.opening.uploads import ACCEPTED

Post = Callable[[Request], int]
"""Posts a request; gives its number, which counts up."""
Read = Callable[[Session], Any]

MARKUP = re.compile(r"[\\`*{}\[\]<>#|~!]|(?<![^\W_])_|_(?![^\W_])")
"""Characters that mean more in markdown; a picture there would make viser read its file."""


LINK = re.compile(r"(?<=http)(?=s?://)|(?<=www)(?=\.)|(?<=[-.+\w])(?=@)", re.IGNORECASE)
"""Places in addresses, of pages and e-mail, which viser's page makes links of, entities or not."""
NOTHING = "<!-- -->"


def plain(text: str) -> str:
    """A text from a file or a user, as markdown shows it letter for letter."""
    escaped = on_page(text).replace("&", "&amp;")
    escaped = MARKUP.sub(lambda match: f"&#{ord(match.group())};", escaped)
    return LINK.sub(NOTHING, escaped)


FIELDS = {
    "chart": "Parameters",
    "evaluations": "Max evaluations",
    "free_focal": "Find the focal length",
    "free_principal_point": "Find the principal point",
    "in_front": "In front",
    "lens_model": "Lens model",
    "lock": "Lock",
    "loss": "Loss",
    "pixels": "Pixels",
    "renderer": "Renderer",
    "search": "Search",
    "seconds": "Time limit (s)",
    "seed": "Seed",
    "unit": "Model's unit",
}
"""Labels of the fields of settings that sentences name."""
WAYS = {
    **dict.fromkeys(("image", "object_id", "overwrite"), "poseviewer convert"),
    **dict.fromkeys(("key", "label", "mask_all_frames"), "poseviewer track"),
    **dict.fromkeys(("rig_object", "scale"), "the command line"),
    "calibration": "a calibration file",
    "camera": "a file of it alone",
    "folder": "a drop of all files",
    "keep_start": "keeping the start",
    "marker_size": "the markers' side",
    "model": "the model",
    "photo": "the photo",
    "photo_size": "its size",
    "photos": "a set of fewer",
    "view": "its file",
}
"""Ways of the page for settings that have no field; sentences say them after *add*,
*with* or *without*.
"""
MAX_DECIMALS = 12
"""Decimals that a field takes: viser would cut off those beyond its arrows' step."""
SHOWN_DIGITS = 8
"""Digits of a number in its field: one more than people type, fewer than rounding errors show."""
SELECTED = "● "
"""Before the label of the choice that is selected."""


def on_page(sentence: str) -> str:
    """A sentence of any package in the page's words: fields for settings of the library."""

    def word(name: str, value: str) -> str | None:
        return f'"{FIELDS[name]}{": " * bool(value)}{value}"' if name in FIELDS else WAYS.get(name)

    return in_words(sentence, word)


class Controls:
    """Controls of ``gui``: their requests go to ``post``, they show what is read from the session.

    Options of a control that are functions of the session are brought to it by ``show``.
    """

    def __init__(
        self, gui: viser.GuiApi, post: Post, session: Session, period: float = 0.0
    ) -> None:
        """``period``: seconds between two times that they are brought to the session."""
        self.gui = gui
        self._post = post
        self.session = session
        """The newest session."""
        self.where = ""
        """Path at which the pose was or will be saved."""
        self.lens_model: Callable[[], LensModel | None] = lambda: None
        """Gives OpenCV's model of the lens in a file of cameras that does not say it."""
        self._reads: list[tuple[Any, str, Read]] = []
        self._inputs: list[_Input] = []
        self._shown: tuple[Session | None, int] = None, 0
        self._period, self._next = period, 0.0

    def show(self, session: Session, seen: int) -> None:
        """Bring all controls to the session, at once or (unless a search ends) in a while. An input
        whose newest value the session has not ``seen`` keeps it: the number of the last request
        that the session includes.
        """
        now, is_urgent = time.monotonic(), session.is_searching is not self.session.is_searching
        self.session = session
        newest = max((own.number for own in self._inputs), default=0)
        is_shown = session is self._shown[0] and newest <= self._shown[1]
        if is_shown or (now < self._next and not is_urgent):
            return
        self._shown, self._next = (session, seen), now + self._period
        for handle, name, read in self._reads:
            set_properties(handle, **{name: read(session)})
        values = [(own, own.read(session)) for own in self._inputs]
        call_in_loop(self.gui, _write, values, seen)

    def add(self, handle: Any, **options: Any) -> Any:
        """Bring properties of a handle to the session, now and later, in their order."""
        for name, read in options.items():
            if callable(read):
                self._reads.append((handle, name, read))
                set_properties(handle, **{name: read(self.session)})
        return handle

    def text(self, read: Read, add: Callable[..., Any] | None = None) -> None:
        """Markdown, or what ``add`` makes of content; hidden while it is empty."""
        handle = (add or self.gui.add_markdown)("", visible=False)
        self.add(handle, content=read, visible=lambda _: bool(handle.content))

    def html(self, read: Read) -> None:
        """HTML; hidden while it is empty."""
        self.text(read, self.gui.add_html)

    def field(self, handle: Any, make: Callable[[Any], Request | None], **options: Any) -> Any:
        """An input; ``make`` gives the request of a new value, bounded as the input is."""

        def request(_: int) -> Request | None:
            value = handle.value
            if getattr(handle, "min", None) is not None:
                value = max(handle.min, min(handle.max, value))
            return make(value)

        def take(number: int) -> None:
            own.number = number
            confirm_value(handle)

        own = _Input(handle, options.pop("value", lambda _: handle.value))
        if isinstance(handle.value, float):
            handle.precision = MAX_DECIMALS
            read = own.read
            own.read = lambda session: _number_shown(handle.value, read(session))
        self._inputs.append(own)
        self._on(handle.on_update, request, take)
        self.add(handle, **options)
        set_properties(handle, value=own.read(self.session))
        return handle

    def bind(self, handle: Any, part: str, name: str, **options: Any) -> None:
        """An input of a field of a part of the session."""
        value = attrgetter(f"{part}.{name}")
        self.field(handle, lambda new: set_fields(part, **{name: new}), value=value, **options)

    def dropdown(
        self,
        label: str,
        texts: Mapping[Any, str],
        make: Callable[[Any], Request],
        read: Read,
        hint: str | None = None,
        **options: Any,
    ) -> None:
        """A choice between values.

        Args:
            label: its text.
            texts: text of each value.
            make: gives the request of a value.
            read: gives the session's value.
            hint: tooltip.
            options: further properties of the control, as of ``add``.
        """
        values = {text: value for value, text in texts.items()}
        handle = self.gui.add_dropdown(label, tuple(values), hint=hint)
        own = {"value": lambda session: texts[read(session)]}
        self.field(handle, lambda text: make(values[text]), **options, **own)

    def button(
        self, label: str | Read, of: Request | Callable[[Session, int], Request], **options: Any
    ) -> Any:
        """A button of a request, or of that which session and client's id lead to."""

        def request(client: int) -> Request:
            request = of if isinstance(of, Request) else of(self.session, client)
            return ShowHelp(client) if isinstance(request, ShowHelp) else request

        options = {"label": label, "color": "gray", **options}
        handle = self.gui.add_button(**{"label": "", **_constants(options)})
        self._on(handle.on_click, request)
        return self.add(handle, **options)

    def action(
        self, name: str, ends: Read | None = None, label: Read | None = None, **options: Any
    ) -> None:
        """The button of an action; ``ends``: whether it would end by now what it began."""
        own: Any = ACTIONS[name]
        if ends is not None:
            label = lambda s: own.label(ends(s))  # noqa: E731
        self.button(label or own.label(), own.request, **{"hint": own.tooltip or None, **options})

    def actions(self, label: str, *names: str, **options: Any) -> None:
        """The buttons of actions in one line."""
        chosen: list[Any] = [ACTIONS[name] for name in names]
        hint = "; ".join(f"{own.name}: {own.tooltip}" for own in chosen if own.tooltip) or None
        self.choices(
            label, {own.label(): own.request for own in chosen}, **{"hint": hint, **options}
        )

    def choices(
        self, label: str, of: Mapping[str, Request], selected: Read | None = None, **options: Any
    ) -> None:
        """Buttons in one line by their requests; ``selected`` reads the marked label."""
        handle = self.gui.add_button_group(label, tuple(of), **_constants(options))
        self._on(handle.on_click, lambda _: of[handle.value.removeprefix(SELECTED)])
        if selected is not None:
            options["options"] = lambda session: tuple(
                SELECTED * (option == selected(session)) + option for option in of
            )
        self.add(handle, **options)

    def download(self, label: str, what: Export, icon: Any = "download", **options: Any) -> None:
        """A button that sends ``what`` to the page on which it is pressed."""
        self.button(label, lambda _, client: download(what, client), icon=icon, **options)

    def upload(
        self,
        label: str,
        kind: Kind | None,
        icon: Any,
        adds: bool = False,
        accepted: str = "",
        missing: Callable[[Session], Sequence[str]] = lambda _: (),
        visible: Read | None = None,
        **options: Any,
    ) -> None:
        """A button that takes files of a kind, or (None) a folder, and what is dropped.

        Args:
            label: its text.
            kind: kind of the files; None: whatever they are.
            icon: name of its picture.
            adds: whether models are further objects.
            accepted: endings that the file chooser offers, by default those of the kind.
            missing: gives names of files that the open model misses; any other is taken for the
                first of them.
            visible: whether it is shown.
            options: further properties of the button.
        """
        accepted = accepted or ("folder" if kind is None else ",".join(ACCEPTED[kind]))
        constant: Any = {"mime_type": accepted, "icon": icon, "color": "gray", **options}
        with self.gui.add_folder(None) as folder:  # viser hides folders, but not such buttons
            handle = self.gui.add_upload_button(label, **constant)
        self.add(folder, visible=visible)

        def request(client: int) -> Request:
            file, names, lens = take_upload(handle), missing(self.session), self.lens_model()
            return upload(kind, file.name, file.content, adds, lens, client, names)

        self._on(handle.on_upload, request)

    def _on(
        self,
        subscribe: Callable[..., Any],
        make: Callable[[int], Request | None],
        posted: Callable[[int], None] = lambda _: None,
    ) -> None:
        """Post the request of a page, by its client's id, and hand on its number; what we write
        ourselves makes none.
        """

        @subscribe
        async def _(event: viser.GuiEvent) -> None:
            request = None if event.client is None else make(event.client.client_id)
            if request is not None:
                posted(self._post(request))


@dataclass(slots=True, eq=False)
class _Input:
    handle: Any
    read: Read
    """Reads its value from the session."""
    number: int = 0
    """Number of the request by its newest value from a page."""


def _write(values: Sequence[tuple[_Input, Any]], seen: int) -> None:
    """Write values of inputs, but of those whose newest value is that of a later request."""
    for own, value in values:
        if own.number <= seen:
            set_properties(own.handle, value=value)


def _number_shown(now: float, value: float) -> float:
    """A number as its field shows it: as it was typed, or to ``SHOWN_DIGITS``."""
    is_typed = math.isclose(now, value, rel_tol=1e-9, abs_tol=1e-12)
    return now if is_typed else float(f"{value:.{SHOWN_DIGITS}g}")


def _constants(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options that no session changes."""
    return {name: value for name, value in options.items() if not callable(value)}


def memoize(key: Callable[[Session], tuple[object, ...]], read: Read) -> Read:
    """Read anew only where ``key(session)`` has other objects."""
    known: list[Any] = [None, None]

    def look(session: Session) -> Any:
        now = key(session)
        if known[0] is None or not all(map(operator.is_, known[0], now)):
            known[:] = now, read(session)
        return known[1]

    return look


def as_html(*nodes: h.Node) -> str:
    """HTML, or SVG, of elements; texts in them are shown letter for letter."""
    return "".join(h.fragment[nodes].iter_chunks())


def on_press(kind: str, **report: Any) -> dict[str, str]:
    """Attribute that has the page's script report a press, or Enter, on an element."""
    return {"data-report": json.dumps({"kind": kind, **report})}


def data_url(kind: str, content: bytes) -> str:
    """URL of a picture: ``png``, ``jpeg``."""
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def jpeg_url(pixels: NDArray[np.uint8], quality: int) -> str:
    """URL of BGR pixels (h, w, 3) as JPEG."""
    content = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return data_url("jpeg", content.tobytes())


def set_properties(handle: Any, **values: Any) -> None:
    """Assign where it changes something: every assignment is a message."""
    for name, value in values.items():
        now = getattr(handle, name)
        if now is not value and now != value:
            setattr(handle, name, value)
