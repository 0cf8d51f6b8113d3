"""What is asked for before the model can be drawn and compared."""

from __future__ import annotations

import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.session import Preparation, Session
from poseviewer.app.state.update import update
from tests.app.state.documents import PERSPECTIVE, after, make_document

TROUBLE = "No kernels; install numba again."


@pytest.fixture
def compiling() -> Session:
    return Session(make_document(PERSPECTIVE), preparation=Preparation(0.5))


def test_a_search_that_waits_is_there_when_all_is_ready(compiling: Session):
    waiting = after(compiling, c.StartSearch(), c.PreparationAdvanced(Preparation(0.9)))
    assert waiting.searching
    ready = after(waiting, c.PreparationAdvanced(None))
    assert ready.searching
    assert ready.preparation is None


def test_a_search_that_waits_can_be_stopped_as_if_it_were_never_asked_for(compiling: Session):
    stopped = after(compiling, c.StartSearch(), c.StopSearch())
    assert stopped.search is None
    assert stopped.document is compiling.document
    assert stopped.history.past == compiling.history.past


def test_trouble_is_said_ends_what_waits_and_refuses_more(compiling: Session):
    waiting = after(compiling, c.StartSearch(), c.ProposeStarts())
    failed = update(waiting, c.PreparationAdvanced(Preparation(trouble=TROUBLE)))
    assert failed.error_message == TROUBLE
    assert failed.search is None
    assert failed.proposals is None
    again = update(failed, c.StartSearch())
    assert again.search is None
    assert again.error_message == TROUBLE
    assert after(failed, c.Nudge("move", 3.0)).document is not failed.document
