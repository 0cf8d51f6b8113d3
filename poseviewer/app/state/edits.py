"""Edits: functions from a session to the next one, which pages and workers request. Those of the
whole document, of a drag and of what is shown; ``update`` makes any edit.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import wraps
from typing import Annotated, Any, Concatenate, Literal, ParamSpec

import numpy as np
from msgspec import Meta

from poseviewer.app.state.document import MARKING, Document, label_of
from poseviewer.app.state.history import MAX_OPENED, History
from poseviewer.app.state.results import ProposedStarts
from poseviewer.app.state.session import Session, is_in_sight
from poseviewer.errors import PoseViewerError, SettingsError
from poseviewer.geometry.charts import OutsideChartError

P = ParamSpec("P")
Px = Annotated[float, Meta(ge=-1e6, le=1e6)]
"""Coordinate in the photo, in the range that a page may send."""
Zoom = Annotated[float, Meta(ge=1e-3, le=1e3)]
"""Screen px per photo px, in the range that a page may send."""
MAX_INPUT = 1e9
"""Largest number (px, steps, parameters) that is taken; larger ones would overflow."""


@dataclass(frozen=True, slots=True)
class Edit:
    """A function from a session to the next one, with the arguments that follow the session."""

    change: Callable[..., Session]
    arguments: tuple[Any, ...]
    named: dict[str, Any]
    keeps_drag: bool
    """Whether a drag goes on; other edits end it first, so that undo steps stay in order."""

    def __call__(self, session: Session) -> Session:
        """Make the edit; the same object is returned if nothing changes."""
        return self.change(session, *self.arguments, **self.named)

    def calls(self, function: Callable[..., "Edit"]) -> bool:
        """Whether the edit was made by a function such as ``drag_to``."""
        return self.change is function.__wrapped__  # pyright: ignore[reportFunctionMemberAccess]


@dataclass(frozen=True, slots=True)
class SavePose:
    """Request to write the pose beside the photo."""

    on_taken: Literal["ask", "replace", "beside", "leave"] = "ask"
    """Treatment of a file that this session did not write."""
    then: Any = None
    """Request to do once the pose is saved; None: none."""


@dataclass(frozen=True, slots=True)
class ShowHelp:
    """Request to open the dialog with the keys on one page."""

    client: int = -1


@dataclass(frozen=True, slots=True)
class AskNumbers:
    """Request to ask on one page for the numbers of image and objects in a download."""

    what: str
    client: int


@dataclass(frozen=True, slots=True)
class AskStill:
    """Request to ask on one page how the cameras of a scene that stands still are found."""

    client: int = -1


@dataclass(frozen=True, slots=True)
class ReviewRow:
    """Request to open a row of a review, or to decide on the row that is open."""

    what: int | Literal["next", "previous", "accepted", "rejected"]
    """Index of a row, a step from the open one, or a decision."""


def edit(
    change: Callable[Concatenate[Session, P], Session], keeps_drag: bool = False
) -> Callable[P, Edit]:
    """Decorate a function of a session: called without the session, it returns an ``Edit``."""

    @wraps(change)
    def make(*arguments: P.args, **named: P.kwargs) -> Edit:
        return Edit(change, arguments, named, keeps_drag)

    return make


def drag_edit(change: Callable[Concatenate[Session, P], Session]) -> Callable[P, Edit]:
    """Decorate like ``edit``, for edits that do not end a drag."""
    return edit(change, keeps_drag=True)


@edit
def undo(session: Session) -> Session:
    """Undo one step; a search is one."""
    return session.with_history(*session.history.undo(session.document))


@edit
def redo(session: Session) -> Session:
    """Redo one step."""
    return session.with_history(*session.history.redo(session.document))


@edit
def open_document(
    session: Session,
    document: Document,
    unsaved: bool = False,
    is_first: bool = False,
    looks: bool = True,
) -> Session:
    """Open another photo, model or both.

    Args:
        session: before the edit.
        document: the opened one.
        unsaved: its pose is in no file; starts are not proposed.
        is_first: undo does not lead back before it.
        looks: starts are proposed for a model without a pose.
    """
    document = document.with_renderer(session.document.settings.renderer)
    session = session.with_document(document)
    session = session.with_first_proposals if looks and not unsaved else session
    history = History() if is_first else session.history
    before = () if is_first or session.saved is None else (session.saved, *session.saved_before)
    saved, before = None if unsaved else document, before[:MAX_OPENED]
    changes = {"tool": "pose", "saved": saved, "saved_before": before}
    return replace(session, history=history, drag=None, **changes)


@drag_edit
def set_fields(session: Session, part: str = "", **values: Any) -> Session:
    """Set fields of the session, or of a ``part`` of it such as ``display``."""
    if part:
        values = {part: replace(getattr(session, part), **values)}
    return replace(session, **values)


@drag_edit
def show_results(session: Session, document: Document, **values: Any) -> Session:
    """Show a worker's results, unless another photo or model has been opened since."""
    is_stale = document.shown != session.document.shown
    return session if is_stale else set_fields("results", **values)(session)


@drag_edit
def show_style(session: Session, style: str) -> Session:
    """Show the model in a look."""
    return set_fields("display", style=style, photo_alone=False)(session)


@drag_edit
def toggle_model(session: Session) -> Session:
    """Show the photo alone, or the model again."""
    return set_fields("display", photo_alone=not session.display.photo_alone)(session)


@drag_edit
def enlarge_map(session: Session, first: int, second: int) -> Session:
    """Toggle the large map of a pair of parameters."""
    pair = None if session.display.large_map == (first, second) else (first, second)
    return set_fields("display", large_map=pair)(session)


@drag_edit
def report_error(_: Session, sentence: str) -> Session:
    """Show an error's sentence; nothing changes."""
    raise SettingsError(sentence)


@drag_edit
def drag_to(session: Session, x: Px, y: Px) -> Session:
    """Move what is held to the pointer, and end a search. The pose is checked on ``release``."""
    drag = session.drag
    if drag is None:
        return session
    document = drag.follow(session.document, np.array([x, y]))
    if drag.before is None:
        drag = replace(drag, before=session.document)
        session = replace(session.without_search(session.compared_scene), drag=drag)
    return replace(session, document=document)


@drag_edit
def release(session: Session) -> Session:
    """End the drag, as one undo step. A box that was drawn takes the model, and starts are proposed
    in it.
    """
    drag, document, tool = session.drag, session.document, session.tool
    if drag is None:
        return session
    session = replace(session, drag=None, tool=tool if tool in MARKING else "pose")
    if drag.before is None:
        return session
    session, document = replace(session, document=drag.before), drag.end(document)
    if not is_in_sight(document):
        return session
    session = session.with_document(document)
    is_boxed = tool == "box" and document.marks.box is not None
    return session.with_proposals(ProposedStarts(session.document)) if is_boxed else session


@drag_edit
def cancel_drag(session: Session) -> Session:
    """Take the drag back, leave the tool, and stop proposing starts and propagating poses."""
    session, drag = session.stop_proposing().stop_propagating(), session.drag
    document = session.document if drag is None or drag.before is None else drag.before
    return replace(session, drag=None, tool="pose", document=document)


def update(session: Session, request: Edit) -> Session:
    """The session after an edit; the same object if nothing changes.

    Raises:
        SettingsError: the edit cannot be made; a sentence for the user.
    """
    for value in (*request.arguments, *request.named.values()):
        if isinstance(value, int | float) and not abs(value) <= MAX_INPUT:
            wanted = f"wanted one within {MAX_INPUT:g} of zero; nothing was changed."
            raise SettingsError(f"A number is {value}: {wanted}")
    try:
        keeps_drag = request.keeps_drag or session.drag is None
        return request(session if keeps_drag else release()(session))
    except (PoseViewerError, OutsideChartError, ArithmeticError) as error:
        text = str(error)
        names = [label_of(item) for item in session.document.scene.objects]
        if not text.startswith(tuple(names)):
            text = f"{text[:1].upper()}{text[1:]}"
        end = "" if text.endswith((".", "!", "?")) else "."
        raise SettingsError(f"{text}{end}") from error
