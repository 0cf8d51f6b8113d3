"""How long the app takes to start: ``python -m tests.measure.start_up``.

On the bundled demo: with no kernel compiled, as after the installation, and again. Each time from
the command to the address, to the photo in the page, to the first outline in it, and until a search
that was asked for at once has begun; and, as other programs run too, the processor time of the app
till then, the processes that compile for it included once they have ended.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

from tests.app.app_process import AppProcess
from tests.app.socket_page import PHOTO, SocketPage

PATIENCE_S = 900.0


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
            kind = "first" if start == 0 else "again"
            steps = measure(folder).items()
            times = ", ".join(f"{step} {took:.1f} s ({used:.1f} s)" for step, (took, used) in steps)
            print(f"{kind}: {times}", flush=True)


def measure(folder: Path) -> dict[str, tuple[float, float]]:
    """Seconds until the address, the photo, the outline and the search were there, and seconds of
    the processor till then.
    """
    found: dict[str, tuple[float, float]] = {}
    began = time.perf_counter()
    with AppProcess(folder) as app:

        def reached(step: str) -> None:
            found[step] = time.perf_counter() - began, processor_seconds(app.pid)

        reached("address")
        with SocketPage(app.url) as page:
            page.wait_until(lambda: page.is_shown(PHOTO), PATIENCE_S)
            reached("photo")
            page.wait_until(lambda: len(page.outline()), PATIENCE_S)
            reached("outline")
            page.key("Space")
            page.wait_until(lambda: page.text_with("evaluations, restart"), PATIENCE_S)
            reached("search")
    return found


def processor_seconds(pid: int) -> float:
    """What a process and those of its children that have ended have used, all threads together;
    Linux.
    """
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main()
