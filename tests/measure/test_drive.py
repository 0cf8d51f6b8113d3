"""The random driver of the page drives, and sees what is wrong. The long run is
``python -m tests.measure.drive``.
"""

from __future__ import annotations

import sys

import numpy as np
import pytest

from tests.measure.drive import Driven, differences, drive

SECONDS = 3.0


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
def test_a_page_that_is_driven_over_the_wire_is_well() -> None:
    driven = drive(seed=1, seconds=SECONDS, with_browser=False)
    assert driven.found == []
    assert driven.rounds >= 1
    assert sum(driven.acts.values()) > 5
    assert str(driven.rounds) in driven.report()


def test_pages_that_differ_are_seen() -> None:
    one = {"a": {"value": 1.0, "label": "x"}, "b": {"points": np.zeros(3)}, "c": {"value": "own"}}
    same = {"a": {"value": 1, "label": "x"}, "b": {"points": np.zeros((3, 1))}, "c": {"value": ""}}
    assert differences("input", one, same, but="c") == []
    assert differences("input", one, {**same, "a": {"value": 2, "label": "x"}}, but="c")
    assert differences("input", one, {"a": same["a"]}, but="c")
    gone = {"b": {"points": np.zeros(3), "visible": False}}
    assert differences("input", gone, {}, but="c") == []
    assert differences("input", gone, {"b": {"points": np.zeros(3)}}, but="c")


def test_memory_that_grows_is_seen() -> None:
    steady, growing = Driven(), Driven()
    for at in range(0, 600, 20):
        steady.memory.append((float(at), 400_000_000))
        growing.memory.append((float(at), 400_000_000 + 200_000 * at))
    assert steady.growth() == 0.0
    assert (growing.growth() or 0.0) > 0.05
    assert Driven(memory=steady.memory[:5]).growth() is None


def test_answers_that_are_late_are_seen_but_for_waits_for_a_processor() -> None:
    assert Driven().own_s() == 0.0
    assert Driven(answers_s=[0.1] * 10 + [3.0], waits_s=[0.0] * 11).own_s() == 0.1
    assert Driven(answers_s=[0.1] * 10 + [3.0] * 2, waits_s=[0.0] * 12).own_s() == 3.0
    assert Driven(answers_s=[3.0] * 9, waits_s=[2.9] * 9).own_s() < 0.2
