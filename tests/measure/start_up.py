"""How long the app takes to start: ``python -m tests.measure.start_up``.

Twice, on the bundled demo: with no kernel compiled, as after the installation, and once more. Each
time from the start of the process to its address, to the page, and to the first outline in it.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
import urllib.request
from pathlib import Path

from tests.app.app_process import AppProcess
from tests.app.socket_page import OUTLINE, SocketPage


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=2, help="the first has nothing compiled")
    starts = parser.parse_args().starts
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # an installed package has its bytecode
    load = os.getloadavg()[0]
    print(f"{os.cpu_count()} processors, load {load:.1f} at the start", flush=True)
    with tempfile.TemporaryDirectory() as name:
        os.environ["NUMBA_CACHE_DIR"] = str(Path(name) / "kernels")
        for start in range(starts):
            folder = Path(name) / str(start)
            folder.mkdir()
            times, said = measure(folder)
            kind = "first" if start == 0 else "again"
            print(
                f"{kind}: " + ", ".join(f"{name} {took:.1f} s" for name, took in times.items()),
                flush=True,
            )
            print("\n".join(f"    {line}" for line in said), flush=True)


def measure(folder: Path) -> tuple[dict[str, float], list[str]]:
    """Seconds until the address, the page and the outline were there, and of the processor till
    then (on a busy machine they say more); what was printed.
    """
    began = time.perf_counter()
    with AppProcess(folder) as app:
        address = time.perf_counter() - began
        with urllib.request.urlopen(app.url) as answer:
            assert b"<html" in answer.read().lower()
        page = time.perf_counter() - began
        with SocketPage(app.url) as socket:
            socket.wait_until(lambda: socket.is_shown(OUTLINE))
            outline = time.perf_counter() - began
        times = {"address": address, "page": page, "outline": outline}
        return times | {"processor": processor_seconds(app.pid)}, list(app.lines)


def processor_seconds(pid: int) -> float:
    """What a process has used, all its threads together; Linux."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main()
