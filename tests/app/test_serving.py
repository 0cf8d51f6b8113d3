"""The start of the app."""

from __future__ import annotations

import subprocess
import sys

import pytest

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
