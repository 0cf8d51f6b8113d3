"""Which process a file belongs to: a number alone is given again after a process has ended."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def process_start(process: int) -> str | None:
    """A text that stands for when a process started, or None where there is no such process.

    The same as long as the process lives; another process of the same number has another one.
    """
    if process <= 0:
        return None
    if sys.platform.startswith("linux"):
        return _start_on_linux(process)
    if sys.platform == "win32":
        return _start_on_windows(process)
    return _start_by_ps(process)


def _start_on_linux(process: int) -> str | None:
    """Boot and clock ticks since (proc(5), field 22); a process that only waits to be collected
    by its parent has ended.
    """
    try:
        line = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except OSError:
        return None
    # The second field is the program's name in brackets, and may itself hold blanks and brackets.
    fields = line.rpartition(")")[2].split()
    return None if fields[0] in "ZX" else f"{boot} {fields[19]}"


def _start_by_ps(process: int) -> str | None:
    found = subprocess.run(
        ["ps", "-o", "lstart=", "-p", str(process)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"LC_ALL": "C", "TZ": "UTC"},
    )
    return found.stdout.strip() or None


def _start_on_windows(process: int) -> str | None:
    import ctypes  # its windll is only there

    query_limited_information, still_active = 0x1000, 259
    kernel = ctypes.windll.kernel32  # type: ignore[attr-defined]
    kernel.OpenProcess.restype = ctypes.c_void_p
    handle = ctypes.c_void_p(kernel.OpenProcess(query_limited_information, False, process))
    if not handle:
        return None
    try:
        code, times = ctypes.c_ulong(), (ctypes.c_uint64 * 4)()
        kernel.GetExitCodeProcess(handle, ctypes.byref(code))
        if code.value != still_active:
            return None
        kernel.GetProcessTimes(handle, *(ctypes.byref(times, 8 * i) for i in range(4)))
        return str(times[0])
    finally:
        kernel.CloseHandle(handle)
