"""Promises of jobs, told by events: nothing here waits for the clock."""

import signal
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from poseviewer.app.state.edits import Edit
from poseviewer.app.state.pointer_edits import set_tool
from poseviewer.app.workers.worker import Mailbox, Worker
from tests.app.state.documents import after, make_session

LONG = 30.0
"""Seconds after which a test has failed; none waits so long when all is well."""

SIGNALLED = """
import signal
from poseviewer.app.workers.worker import Mailbox

mailbox, came = Mailbox(), []
signal.signal(signal.SIGALRM, lambda *_: (came.append(1), mailbox.notify()))
signal.setitimer(signal.ITIMER_REAL, 0.001, 0.001)
while len(came) < 300:
    mailbox.take(0.0)
signal.setitimer(signal.ITIMER_REAL, 0.0)
print("well")
"""


class Steps:
    """A job that gives one item for each ``go``; ``given`` tells how many were taken from it."""

    def __init__(self, items, error: Exception | None = None) -> None:
        self._items, self._error = items, error
        self._go = threading.Semaphore(0)
        self.began = threading.Event()
        self.asked = threading.Semaphore(0)
        self.thread = ""

    def go(self, count: int = 1) -> None:
        self._go.release(count)

    def __call__(self) -> Iterator[object]:
        self.thread = threading.current_thread().name
        self.began.set()
        for item in self._items:
            self.asked.release()
            assert self._go.acquire(timeout=LONG)
            yield item
        if self._error is not None:
            raise self._error


class Bell(Mailbox[object]):
    """A mailbox that counts rings, and can be waited for."""

    def __init__(self) -> None:
        super().__init__()
        self._rings = threading.Semaphore(0)

    def notify(self) -> None:
        self._rings.release()

    def heard(self, count: int = 1) -> None:
        for _ in range(count):
            assert self._rings.acquire(timeout=LONG)

    def silent(self) -> bool:
        return not self._rings.acquire(blocking=False)

    @property
    def items(self) -> list[object]:
        return self.take(0.0)


@pytest.fixture
def bell(monkeypatch: pytest.MonkeyPatch) -> Bell:
    """Every item rings."""
    monkeypatch.setattr("poseviewer.app.workers.worker.WAKE_S", -1.0)
    return Bell()


def test_a_mailbox_numbers_what_was_taken():
    mailbox = Mailbox[str]()
    numbers = [mailbox.post(item) for item in "ab"]
    mailbox.notify()
    assert (numbers, mailbox.taken) == ([1, 2], 0)
    assert (mailbox.take(0.0), mailbox.taken) == (["a", "b"], 2)
    assert (mailbox.post("c"), mailbox.take(0.0), mailbox.taken) == (3, ["c"], 3)


def test_the_newest_of_each_source_wins_behind_the_requests():
    mailbox = Mailbox[str]()
    for source, item in (("map", "a"), ("search", "b"), ("map", "c")):
        mailbox.publish(source, item)
    mailbox.publish("search", "end", adds=True)
    mailbox.post("request")
    assert [mailbox.has_news(source) for source in ("map", "task")] == [True, False]
    assert (mailbox.take(0.0), mailbox.taken) == (["request", "c", "b", "end"], 1)
    mailbox.publish("map", "d")
    mailbox.publish("map")
    assert not mailbox.has_news("map")
    assert not mailbox.take(0.0)


Tested = Worker[Steps, object]


def make_job(bell: Bell, low_priority: bool = False) -> Tested:
    made: Tested = Worker("tested", lambda _: None, Steps.__call__, low_priority=low_priority)
    made.mailbox = bell
    return made


@pytest.fixture(params=[False, True], ids=["", "low priority"])
def worker(bell, request) -> Iterator[Tested]:
    made = make_job(bell, request.param)
    yield made
    made.close()
    assert not any(thread.name.startswith("tested") for thread in threading.enumerate())


def test_each_item_is_taken_once_and_the_end_is_told(worker, bell):
    steps = Steps("ab")
    worker.begin(steps)
    assert worker.busy
    for item in "ab":
        assert not bell.items
        steps.go()
        bell.heard()
        if item == "a":
            assert bell.items == ["a"]
    bell.heard()  # the end rings as well
    assert bell.items == ["b"]
    assert not bell.items
    assert not worker.busy
    assert steps.thread.startswith("tested")


def test_items_in_quick_succession_wake_the_main_loop_once(worker, bell, monkeypatch):
    monkeypatch.setattr("poseviewer.app.workers.worker.WAKE_S", LONG)
    steps = Steps("abc")
    worker.begin(steps)
    steps.go(2)
    for _ in range(3):
        assert steps.asked.acquire(timeout=LONG)  # two are published
    bell.heard()
    assert bell.silent()
    steps.go()
    bell.heard()  # the end always does
    assert bell.items == ["c"]


@pytest.mark.parametrize("is_stopped", [False, True])
def test_a_displaced_request_publishes_no_more(worker, bell, is_stopped):
    old, new = Steps("abc"), Steps("x")
    worker.begin(old)
    old.go()
    bell.heard()
    for _ in range(2):
        assert old.asked.acquire(timeout=LONG)  # it is at its second item
    if is_stopped:
        worker.stop()
        assert not worker.busy
    worker.begin(new)
    assert not bell.items  # what the old one had published is gone
    old.go()
    assert new.began.wait(LONG)  # by then the old one's second item has been dropped
    assert bell.silent()
    new.go()
    bell.heard(2)
    assert bell.items == ["x"]
    assert not old.asked.acquire(blocking=False)  # it was never asked for a third


def test_a_held_job_pauses_between_two_items_and_goes_on(worker, bell):
    steps = Steps("abc")
    worker.hold(True)
    worker.begin(steps)
    assert not steps.began.wait(0.05)
    worker.hold(False)
    steps.go()
    for _ in range(2):
        assert steps.asked.acquire(timeout=LONG)
    worker.hold(True)
    steps.go(2)
    bell.heard(2)
    assert bell.items == ["b"]
    # It stands still: it is not asked for more, though it could give it.
    assert not steps.asked.acquire(timeout=0.05)
    assert worker.busy
    worker.hold(False)
    bell.heard(2)
    assert bell.items == ["c"]


def test_an_exception_is_told_and_the_next_request_is_worked_on(worker, bell):
    error = ValueError("no such thing")
    steps, after = Steps("a", error), Steps("x")
    worker.begin(steps)
    steps.go()
    bell.heard(2)
    assert bell.items == ["a", error]
    assert not worker.busy
    worker.begin(after)
    after.go()
    bell.heard(2)
    assert bell.items == ["x"]
    assert after.thread.startswith("tested")


def made(step: Steps) -> Iterator[Edit]:
    yield from (set_tool("box") for _ in step())


def test_a_job_is_begun_once_and_stopped_where_it_is_not_asked_for(bell):
    """What is asked for is the session's tool; an edit gives another one."""
    session, steps = make_session(), {"pairs": Steps("ab"), "wheels": Steps("c", ValueError("no"))}
    job = Worker(
        "tested",
        lambda now: now.tool if now.tool in steps else None,
        lambda asked: made(steps[asked]),
        failed=lambda *_: set_tool("region"),
    )
    job.mailbox = bell
    job.follow(session)
    assert not job.busy
    asked = after(session, set_tool("pairs"))
    job.follow(asked)
    job.follow(asked)
    assert steps["pairs"].asked.acquire(timeout=LONG)
    job.require_current("pairs")
    job.follow(session)
    assert not job.busy
    with pytest.raises(RuntimeError):
        job.require_current("pairs")
    steps["pairs"].go(2)
    other = after(session, set_tool("wheels"))
    job.follow(other)
    steps["wheels"].go()
    bell.heard(2)
    *edits, error = bell.items
    assert [edit(other).tool for edit in edits if isinstance(edit, Edit)] == ["box", "region"]
    assert isinstance(error, ValueError)
    job.close()


@pytest.mark.parametrize("held", [False, True])
def test_close_ends_the_thread_at_the_item_it_is_at(held, bell):
    worker, steps = make_job(bell), Steps("abc")
    worker.begin(steps)
    steps.go()
    bell.heard()
    worker.hold(held)
    steps.go(2)
    worker.close()
    assert not any(thread.name.startswith("tested") for thread in threading.enumerate())


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers that send signals")
def test_a_signal_in_the_middle_of_a_look_into_the_mailbox_is_borne():
    done = subprocess.run(
        [sys.executable, "-c", SIGNALLED], capture_output=True, text=True, timeout=LONG, check=False
    )
    assert done.stdout == "well\n", done.stderr[-500:]
