"""Commands in any order: each is taken or refused with a sentence, and undo leads all the way back.

The page is driven at random by ``python -m tests.measure.drive``; this is what lies below it.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state import hiding as h
from poseviewer.app.state import objects as o
from poseviewer.app.state.update import update
from tests.app.state.documents import HEIGHT, WIDTH, make_session

COMMANDS = 80
"""Of a sequence: undo reaches back farther."""
NUMBERS = "rotation_x", "shift_y", "log_depth", "log_focal"
TOOLS = "pose", "region", "box", "pairs", "wheels", "brush", "part"


def make_command(chance: random.Random) -> c.Command:
    """Any command of a user, with values that are mostly sane."""
    pick, some = chance.choice, chance.random

    def point() -> tuple[float, float]:
        return WIDTH * (0.5 + 0.25 * chance.gauss(0, 1)), HEIGHT * (0.5 + 0.25 * chance.gauss(0, 1))

    def focal() -> float:
        return pick((300.0, 1.0, 0.0, 1e308, 250.0 * some()))

    number = chance.randint(1, 4)
    stroke = h.Stroke("brush", np.array([point(), point()]), 5.0, some() < 0.3)
    kinds: tuple[Callable[[], c.Command], ...] = (
        lambda: c.Press(*point(), 1.0, some() < 0.2, some() < 0.2),
        lambda: c.DragTo(*point()),
        lambda: c.DragTo(*point()),
        c.Release,
        c.CancelDrag,
        lambda: c.DoublePress(*point()),
        lambda: c.SetTool(pick(TOOLS)),
        lambda: c.Nudge(pick(("move", "turn", "roll", "scale")), some(), 10.0 * some()),
        lambda: c.SetNumber(pick(NUMBERS), pick((0.0, 1e308, chance.gauss(0, 1)))),
        c.ResetToStart,
        c.MakeStart,
        lambda: c.LookFrom(pick(("front", "left", "top"))),
        c.Undo,
        c.Redo,
        lambda: c.SetMethod(pick(("default", "paper"))),
        lambda: c.SetProjection(pick(("perspective", "parallel"))),
        lambda: c.SetCamera(focal(), focal(), focal(), focal()),
        lambda: c.SetFieldOfView(chance.uniform(-5.0, 190.0)),
        c.RemoveMark,
        c.ClearMarks,
        lambda: o.PickObject(number),
        lambda: o.PickObject(number),
        o.AddObject,
        lambda: o.RemoveObject(number),
        lambda: o.AlterObject(number, hidden=some() < 0.5),
        lambda: o.AlterObject(number, locked=some() < 0.7),
        lambda: o.AlterObject(number, name=pick("ab")),
        lambda: c.AlterSettings(lambda s: replace(s, free_focal=not s.free_focal)),
        c.StartSearch,
        c.StopSearch,
        c.SearchAll,
        c.RevertSearch,
        c.AcceptSearch,
        lambda: h.Paint(stroke),
        h.Unhide,
    )
    return pick(kinds)()


@pytest.mark.parametrize("seed", range(40))
def test_undo_leads_all_the_way_back_whatever_was_done(seed: int) -> None:
    chance = random.Random(seed)
    session = make_session()
    start = session.document
    for _ in range(COMMANDS):
        session = update(session, make_command(chance))
        assert not session.error_message or session.error_message.isprintable()
    session = update(session, c.CancelDrag())
    while session.history.past:
        steps = len(session.history.past)
        session = update(session, c.Undo())
        assert len(session.history.past) == steps - 1, session.error_message
    assert session.document is start


def test_undo_leads_back_over_what_was_locked_since() -> None:
    session = make_session()
    start = session.document
    for command in (
        o.AddObject(),
        c.SetCamera(1.0, 300.0, 118.0, 0.0),
        c.StartSearch(),
        o.AlterObject(2, locked=True),
        o.PickObject(2),
        c.SetProjection("parallel"),
        c.ResetToStart(),
        o.AlterObject(3, name="a"),
    ):
        session = update(session, command)
    for _ in range(10):
        session = update(session, c.Undo())
        assert session.error_message == ""
    assert session.document is start
