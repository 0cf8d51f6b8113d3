"""How soon what takes long ends where it is stopped: ``python -m tests.measure.stops``.

On the bundled demo, as a page does it over the websocket: each kind of work is begun, and stopped
at a random moment after the page shows that it is under way. The table has the seconds from the
key, or the press of the button, until the page shows that it has ended.
"""

from __future__ import annotations

import argparse
import os
import random
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh

from poseviewer.app.page.panels import FIT_TO_BOX, SYMMETRIC
from poseviewer.fit.settings import METHODS, Method
from tests.app.app_process import AppProcess
from tests.app.running_app import settle
from tests.app.socket_page import SocketPage

BOX = (200.0, 250.0), (800.0, 520.0)
"""About the car, px of the photo."""
SCRIBBLE = [300.0, 500.0, 420.0, 510.0, 500.0, 505.0]
LINE = "{:32}{:>6}{:>12}{:>12}"
LATEST_S = 0.6
"""It is stopped so long after it was seen, at most."""

Work = tuple[Callable[[], None], Callable[[], object], Callable[[], None]]
"""What begins it, whether it is under way, and what stops it."""


def kinds(page: SocketPage) -> dict[str, Work]:
    """All that may take longer than a second, but uploads: a page without a browser sends these at
    once.
    """

    def search(method: Method) -> Callable[[], None]:
        def begin() -> None:
            page.set("Method", METHODS[method])
            page.key("Space")

        return begin

    def box() -> None:
        page.click(FIT_TO_BOX)
        page.press(*BOX[0])
        page.drag(*BOX[1])
        page.release()

    def scribble() -> None:
        page.report(kind="stroke", shape="scribble", points=SCRIBBLE, radius=4.0, erase=False)

    def space() -> None:
        page.key("Space")

    def escape() -> None:
        page.key("Escape")

    def searching() -> bool:
        return "Stop (space)" in page.labels()

    def waiting() -> bool:
        return bool(page.shown.waits)

    return {
        "search": (search("default"), searching, space),
        "both methods compared": (lambda: page.click("Compare both methods"), searching, space),
        "starts for a box": (box, lambda: "Stop looking" in page.labels(), escape),
        "which model it is": (
            lambda: page.click("Tell them apart"),
            lambda: "Stop" in page.labels(),
            lambda: page.click("Stop"),
        ),
        "the edge of what is in front": (scribble, waiting, escape),
        "the model's symmetry": (lambda: page.set(SYMMETRIC, True), waiting, escape),
        "search, Jayawardena 2010": (search("paper"), searching, space),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    random_ = random.Random(options.seed)
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} at the start", flush=True)
    print(LINE.format("stopped", "times", "median, s", "at most, s"), flush=True)
    with tempfile.TemporaryDirectory() as name, AppProcess(Path(name)) as app:
        box = Path(name) / "box.ply"
        trimesh.creation.box((4.0, 1.8, 1.5)).export(str(box))
        with SocketPage(app.url) as page:
            settle(page)
            page.upload("Add a model ...", box.name, box.read_bytes())
            page.wait_until(lambda: page.text_with(box.name))
            for kind, (begin, is_under_way, stop) in kinds(page).items():
                took: list[float] = []
                for _ in range(options.times):
                    begin()
                    page.wait_until(is_under_way)
                    time.sleep(random_.uniform(0.0, LATEST_S))
                    if not is_under_way():
                        continue  # it has ended by itself
                    began = time.perf_counter()
                    stop()
                    page.wait_until(lambda ended=is_under_way: not ended())
                    took.append(time.perf_counter() - began)
                seconds = [f"{part(took):.3f}" for part in (np.median, max) if took]
                print(LINE.format(kind, len(took), *seconds or "--"), flush=True)


if __name__ == "__main__":
    main()
