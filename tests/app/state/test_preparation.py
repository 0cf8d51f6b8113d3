"""What is asked for before the model can be drawn and compared."""

from __future__ import annotations

import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.session import Preparation, Session
from tests.app.state.documents import PERSPECTIVE, after, make_document, refused

TROUBLE = "No kernels; install numba again."


@pytest.fixture
def compiling() -> Session:
    return Session(make_document(PERSPECTIVE), preparation=Preparation(0.5))


def test_a_search_that_waits_is_there_when_all_is_ready(compiling: Session):
    waiting = after(compiling, c.start_search(), c.preparation_advanced(Preparation(0.9)))
    assert waiting.searching
    ready = after(waiting, c.preparation_advanced(None))
    assert ready.searching
    assert ready.preparation is None


def test_a_search_that_waits_can_be_stopped_as_if_it_were_never_asked_for(compiling: Session):
    stopped = after(compiling, c.start_search(), c.stop_search())
    assert stopped.search is None
    assert stopped.document is compiling.document
    assert stopped.history.past == compiling.history.past


def test_trouble_ends_what_waits_and_refuses_more(compiling: Session):
    waiting = after(compiling, c.start_search(), c.propose_starts())
    failed = after(waiting, c.preparation_advanced(Preparation(trouble=TROUBLE)))
    assert failed.search is None
    assert failed.proposals is None
    assert refused(failed, c.start_search()) == TROUBLE
    assert after(failed, c.nudge("move", 3.0)).document is not failed.document
