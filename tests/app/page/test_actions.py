"""Buttons, help and docs of the table of actions."""

from pathlib import Path
from typing import Any

from poseviewer.app.below_viser.guard import serve
from poseviewer.app.page.controls import Controls
from poseviewer.app.page.panels import STEPS
from poseviewer.app.state.keys_and_buttons import ACTIONS, help_table
from tests.app.state.documents import make_session

DOCS = Path(__file__).parents[3] / "assets" / "docs"
CHECKBOXES = {"blink"}


def test_each_button_is_in_the_step_that_the_table_says():
    used, steps = set[tuple[str, str]](), list[str]()

    class Recording(Controls):
        def action(self, name: str, *given: Any, **options: Any) -> None:
            super().action(name, *given, **options)
            used.add((steps[-1], name))

        def actions(self, label: str, *names: str, **options: Any) -> None:
            super().actions(label, *names, **options)
            used.update((steps[-1], name) for name in names)

    guarded = serve("127.0.0.1", 0)
    try:
        for step, add_controls in STEPS.items():
            steps.append(step)
            add_controls(Recording(guarded.server.gui, lambda _: 0, make_session()))
    finally:
        guarded.stop()
    wanted = {(own.step, name) for name, own in ACTIONS.items() if own.name and own.step in STEPS}
    wanted -= {("Fit", "search")}  # it is above the steps
    assert {(step, name) for step, name in wanted if name not in CHECKBOXES} <= used


def test_a_key_has_one_action():
    codes = [code for own in ACTIONS.values() for code in set(own.codes)]
    assert len(codes) == len(set(codes))
    assert {"KeyZ", "shift KeyZ", "Space", "Escape", "Digit0"} <= set(codes)


def test_docs_have_the_table_of_the_help_dialog():
    assert help_table() in (DOCS / "place.md").read_text(encoding="utf-8")
