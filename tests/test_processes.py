"""Calls in processes: what is done so far is looked at while they work."""

import os
import subprocess
import sys
import time
from operator import neg

import psutil
import pytest

from poseviewer import processes
from poseviewer.errors import SettingsError
from poseviewer.processes import iterate_in_subprocess, run_in_processes


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


def tell_and_sleep(tell, item: str) -> str:
    tell(f"{item} 1")
    if item == "wrong":
        raise SettingsError("it is wrong.")
    if item == "dead":
        os._exit(3)
    tell(f"{item} 2")
    if item == "long":
        time.sleep(600.0)
    sys.stdout.write("noise")  # which does not go among what is told
    sys.stdout.flush()
    return item.upper()


def taken(item: str) -> tuple[list[str], str]:
    steps, told = iterate_in_subprocess(tell_and_sleep, item), list[str]()
    while True:
        try:
            told.append(next(steps))
        except StopIteration as end:
            return told, end.value


def test_what_a_process_tells_is_yielded_and_its_result_returned():
    assert taken("a") == (["a 1", "a 2"], "A")
    with pytest.raises(SettingsError, match="it is wrong"):
        taken("wrong")
    with pytest.raises(subprocess.CalledProcessError) as ended:
        taken("dead")
    assert ended.value.returncode == 3


def test_closing_the_iteration_ends_the_process():
    before = set(psutil.Process().children())
    steps = iterate_in_subprocess(tell_and_sleep, "long")
    assert [next(steps), next(steps)] == ["long 1", "long 2"]
    (process,) = set(psutil.Process().children()) - before
    steps.close()
    assert not process.is_running()
