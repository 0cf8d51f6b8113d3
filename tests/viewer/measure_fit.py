"""How long a search takes in the app: ``python -m tests.viewer.measure_fit``.

Starts the app on the bundled demo and its 8 % start, and presses *Search* as a page does, which is
shown all that a page is shown. In between, while the app has nothing to do, the same search runs
alone in a process of its own, on as many processors: what the app adds is their ratio.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseviewer.api import Case, load
from poseviewer.demo import demo_case
from poseviewer.render.many import processors
from tests.viewer.app_process import AppProcess
from tests.viewer.measure_start import processor_seconds
from tests.viewer.socket_page import SocketPage

EVALUATIONS = re.compile(r"(\d+) evaluations")
PAUSE_S = 0.5
"""The app's maps and pictures are done when its process has used next to nothing for so long."""
MOST_S = 120.0


@dataclass(frozen=True)
class Took:
    """Seconds from the press of the button until the page shows it."""

    news: float
    """The first news of the search."""
    pose: float
    """The last evaluation: the pose is there."""
    verdict: float


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=5)
    times = parser.parse_args().times
    files = demo_case()
    _say(f"{processors()} processors, load {os.getloadavg()[0]:.1f} at the start")
    case = load(files.photo, files.model, files.start)
    _alone(case)
    inside, alone = list[Took](), list[float]()
    with tempfile.TemporaryDirectory() as name:
        arguments = [files.photo, files.model, "--pose", files.start]
        with AppProcess(Path(name), *arguments) as app, SocketPage(app.url) as page:
            page.wait_until(lambda: page.maps() >= 10)
            for _ in range(times + 1):
                _wait_for_quiet(app.pid)
                alone.append(_alone(case))
                inside.append(_press(page))
                page.click("Go back")
                page.wait_until(lambda: not page.text_with("evaluations"))
    _say(f"first search in the app, to its pose: {inside[0].pose:.2f} s")
    for name in ("news", "pose", "verdict"):
        _line(f"in the app, to its {name}", [getattr(took, name) for took in inside[1:]])
    _line("alone", alone[1:])
    ratio = np.median([took.pose for took in inside[1:]]) / np.median(alone[1:])
    _say(f"in the app / alone: {ratio:.2f}")


def _press(page: SocketPage) -> Took:
    """Search in the app."""
    news, pose, evaluations = 0.0, 0.0, 0
    began = time.perf_counter()
    page.click("Search (space)")

    def ended() -> bool:
        nonlocal news, pose, evaluations
        text = page.text_with("evaluations")
        found = EVALUATIONS.search(text)
        if found and int(found.group(1)) != evaluations:
            evaluations, pose = int(found.group(1)), time.perf_counter() - began
            news = news or pose
        return "Verdict:" in text

    page.wait_until(ended, MOST_S)
    return Took(news, pose, time.perf_counter() - began)


def _alone(case: Case) -> float:
    """The same search in this process, without the verdict that follows it; seconds."""
    seconds = 0.0
    for progress in case.search(threads=processors()):
        seconds = progress.seconds
    return seconds


def _wait_for_quiet(pid: int) -> None:
    end, used = time.monotonic() + MOST_S, processor_seconds(pid)
    while time.monotonic() < end:
        time.sleep(PAUSE_S)
        now = processor_seconds(pid)
        if now - used < 0.1 * PAUSE_S:
            return
        used = now


def _line(label: str, seconds: Sequence[float]) -> None:
    least, middle, most = np.min(seconds), np.median(seconds), np.max(seconds)
    _say(f"{label:32}{middle:6.2f} s in the median, {least:.2f} to {most:.2f}")


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
