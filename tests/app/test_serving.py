"""The start of the app."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from poseviewer.app.serving import serve_app
from poseviewer.errors import SettingsError
from tests.app.below_viser.socket_page import SocketPage
from tests.app.running_app import running_app
from tests.scene import Scene

HELD_AFTER = """
import resource
from poseviewer.app.serving import return_freed_memory

def held():
    return int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize()

if {wanted}:
    return_freed_memory()
large = bytes(30_000_000)
del large  # from now on glibc takes blocks of a megabyte from its heap
before = held()
blocks = [(b"x" * 1_000_000, b"x" * 1_000) for _ in range(100)]
between = [small for _, small in blocks]
del blocks
print(held() - before)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc's, and looks into /proc")
def test_memory_of_large_blocks_goes_back_to_the_system() -> None:
    kept, returned = (
        int(subprocess.check_output([sys.executable, "-c", HELD_AFTER.format(wanted=wanted)]))
        for wanted in (False, True)
    )
    assert returned < 10_000_000
    assert returned < kept


def test_a_failure_while_showing_is_told_once_and_ends_nothing(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    with running_app(scene, tmp_path) as running, SocketPage(running.url) as page:
        show, failures = running.app._page.show, [1, 2]

        def fail_twice(*shown: Any) -> None:
            if failures:
                raise ArithmeticError(failures.pop())
            show(*shown)

        with monkeypatch.context() as patch:
            patch.setattr(running.app._page, "show", fail_twice)
            before = running.app.session.document
            page.change(running.uuid("report"), '{"kind": "key", "code": "KeyL"}')
            page.wait_until(lambda: running.app.session.document is not before)
            page.wait_until(lambda: not failures)
        page.wait_until(lambda: any("Undo or save" in text for text in page.notices()))
    assert caplog.text.count("fail_twice") == 1


def test_the_address_bears_a_token_and_that_of_the_browser_is_no_other_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened, told = list[str](), list[str]()
    monkeypatch.setenv("POSEVIEWER_STATE", str(tmp_path))
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr("signal.signal", lambda *_: None)

    def fail() -> Any:
        raise SettingsError("no photo")

    with pytest.raises(SettingsError):
        serve_app(fail, host="127.0.0.1", port=0, browser=True, tell=told.append)
    token = told[0].split()[3].partition("?token=")[2]
    assert len(token) > 40
    assert "/?token=" in opened[0]
    assert token not in opened[0]
