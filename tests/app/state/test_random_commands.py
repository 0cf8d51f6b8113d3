"""Commands in any order: each is taken or refused with a sentence, and undo leads all the way back.

The page is driven at random by ``python -m tests.measure.drive``; this is what lies below it.
"""

import random
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.state import hiding as h
from poseviewer.app.state import marking as m
from poseviewer.app.state import objects as o
from poseviewer.app.state.edits import Edit, update
from poseviewer.errors import PoseViewerError
from tests.app.state import edits as c
from tests.app.state.documents import HEIGHT, WIDTH, make_session

COMMANDS = 80
"""Of a sequence: undo reaches back farther."""
NUMBERS = "rotation_x", "shift_y", "log_depth", "log_focal"
TOOLS = "pose", "region", "box", "pairs", "wheels", "brush", "part", "measure"


def make_command(chance: random.Random) -> Edit:
    """Any command of a user, with values that are mostly sane."""
    pick, some = chance.choice, chance.random

    def point() -> tuple[float, float]:
        return WIDTH * (0.5 + 0.25 * chance.gauss(0, 1)), HEIGHT * (0.5 + 0.25 * chance.gauss(0, 1))

    def focal() -> float:
        return pick((300.0, 1.0, 0.0, 1e308, 250.0 * some()))

    number = chance.randint(1, 4)
    stroke = h.Stroke("brush", np.array([point(), point()]), 5.0, some() < 0.3)
    kinds: tuple[Callable[[], Edit], ...] = (
        lambda: c.press(*point(), 1.0, some() < 0.2, some() < 0.2),
        lambda: c.drag_to(*point()),
        lambda: c.drag_to(*point()),
        c.release,
        c.cancel_drag,
        lambda: c.double_press(*point()),
        lambda: c.set_tool(pick(TOOLS)),
        lambda: c.nudge(pick(("move", "turn", "roll", "scale")), some(), 10.0 * some()),
        lambda: c.set_parameter(pick(NUMBERS), pick((0.0, 1e308, chance.gauss(0, 1)))),
        c.reset_to_start,
        c.make_start,
        lambda: c.view_from(pick(("front", "left", "top"))),
        c.undo,
        c.redo,
        lambda: c.set_loss(pick(("default", "paper"))),
        lambda: c.set_projection(pick(("perspective", "parallel"))),
        lambda: c.set_camera(focal(), focal(), focal(), focal()),
        lambda: c.set_field_of_view(chance.uniform(-5.0, 190.0)),
        m.remove_mark,
        m.clear_marks,
        lambda: o.pick_object(number),
        lambda: o.pick_object(number),
        o.add_object,
        lambda: o.remove_object(number),
        lambda: o.alter_object(number, hidden=some() < 0.5),
        lambda: o.alter_object(number, locked=some() < 0.7),
        lambda: o.alter_object(number, name=pick("ab")),
        lambda: c.alter_settings(lambda s: replace(s, free_focal=not s.free_focal)),
        c.start_search,
        c.stop_search,
        c.search_all,
        c.revert_search,
        c.accept_search,
        lambda: h.paint(stroke),
        h.unhide,
    )
    return pick(kinds)()


@pytest.mark.parametrize("seed", range(40))
def test_undo_leads_all_the_way_back_whatever_was_done(seed: int) -> None:
    chance = random.Random(seed)
    session = make_session()
    start = session.document
    for _ in range(COMMANDS):
        with suppress(PoseViewerError):
            session = update(session, make_command(chance))
    session = update(session, c.cancel_drag())
    while session.history.past:
        steps = len(session.history.past)
        session = update(session, c.undo())
        assert len(session.history.past) == steps - 1
    assert session.document is start
