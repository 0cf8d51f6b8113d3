"""Calls in processes: what is done so far is looked at while they work."""

from operator import neg

import pytest

from poseviewer import processes
from poseviewer.processes import run_in_processes


@pytest.mark.parametrize(("text", "wanted"), [("1000", 1000), ("max", None), (None, None)])
def test_the_memory_is_the_machines_or_that_of_a_container(tmp_path, monkeypatch, text, wanted):
    monkeypatch.setattr(processes, "CONTROL_GROUP", tmp_path / "memory.max")
    if text is not None:
        (tmp_path / "memory.max").write_text(f"{text}\n")
    assert processes.memory_bytes() == wanted if wanted else processes.memory_bytes() > 1e8


def test_ticks_come_while_processes_work(monkeypatch):
    monkeypatch.setattr(processes, "TICK_S", 0.001)  # a process takes longer to begin
    ticks = []
    results = dict(run_in_processes(neg, [1, 2], 1, tick=lambda: ticks.append("tick")))
    assert results == {1: -1, 2: -2}
    assert ticks
