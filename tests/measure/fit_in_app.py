"""How long a search takes in the app: ``python -m tests.measure.fit_in_app``.

Starts the app on the bundled demo and its 8 % start, and presses *Search* as a page does, which is
shown all that a page is shown. Before and after, the same search runs alone, on as many processors:
what the app adds is their ratio.
"""

from __future__ import annotations

import argparse
import os
import re
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from poseviewer.api import Case, load, load_scene, make_case
from poseviewer.files.demo import demo_case
from poseviewer.render.pool import processors
from tests.app.app_process import AppProcess
from tests.app.socket_page import SocketPage
from tests.several import make_crowd

SECONDS = re.compile(r"evaluations, restart \d+, ([\d.]+) s")
MAPS, PAUSE_S = 10, 1.0
MOST_S = 120.0


@dataclass(frozen=True)
class Took:
    """Seconds from the press of the button until the page shows something."""

    news: float
    """The first news of the search."""
    verdict: float
    """All of it, the verdict too."""
    pose: float
    """What the app says that the search took, to a tenth: the verdict comes after it."""


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--among", type=int, default=0, metavar="N", help="N objects, no app")
    options = parser.parse_args()
    times = options.times
    if times < 1:
        parser.error(f"--times {times}: at least 1 is wanted")
    if options.among:
        _among(options.among, times)
        return
    files = demo_case()
    print(f"{processors()} processors, load {os.getloadavg()[0]:.1f} at the start", flush=True)
    case = load(files.photo, files.model, files.start)
    _alone(case)
    alone = [_alone(case) for _ in range(times)]
    with tempfile.TemporaryDirectory() as name:
        arguments = [files.photo, files.model, "--pose", files.start]
        with AppProcess(Path(name), *arguments) as app, SocketPage(app.url) as page:
            inside = [_press(page) for _ in range(times + 1)]
    alone += [_alone(case) for _ in range(times)]
    print(f"first search in the app, to its pose: {inside[0].pose:.2f} s", flush=True)
    for name in ("news", "verdict", "pose"):
        _line(f"in the app, to its {name}", [getattr(took, name) for took in inside[1:]])
    _line("alone", alone)
    ratio = np.median([took.pose for took in inside[1:]]) / np.median(alone)
    print(f"in the app / alone: {ratio:.2f}", flush=True)


def _among(count: int, times: int) -> None:
    """Search for the farthest of ``count`` objects of 20k triangles as the app does, and for it
    as if it were alone.
    """
    with tempfile.TemporaryDirectory() as name:
        scene = load_scene(make_crowd(Path(name) / "crowd", count))
        own = replace(scene.registrations[-1], others=())
        alone = make_case(own, scene.settings, scene.renderers[-1])
        took: dict[str, list[float]] = {f"one among {count}": [], "alone": []}
        evaluations = [0, 0]
        for _ in range(times + 1):
            searches = (
                (now.progress for now in scene.search(scene.scene.objects[-1].id)),
                alone.search(),
            )
            for index, (seconds, found) in enumerate(zip(took.values(), searches, strict=True)):
                began = time.process_time()
                evaluations[index] = sum(1 for _ in found)
                seconds.append(time.process_time() - began)
    for label, seconds in took.items():
        _line(label, seconds[1:])
    among, one = (np.median(seconds[1:]) for seconds in took.values())
    print(f"evaluations {evaluations[0]} and {evaluations[1]}; among / alone: {among / one:.2f}")


def _press(page: SocketPage) -> Took:
    """Search in the app, once its first maps are there, and go back."""
    page.wait_until(lambda: page.maps() >= MAPS and not page.text_with("evaluations"))
    time.sleep(PAUSE_S)
    began = time.perf_counter()
    page.click("Search (space)")
    page.wait_until(lambda: page.text_with("evaluations"), MOST_S)
    news = time.perf_counter() - began
    page.wait_until(lambda: "Verdict:" in page.text_with("evaluations"), MOST_S)
    verdict = time.perf_counter() - began
    said = SECONDS.search(page.text_with("evaluations"))
    assert said is not None
    page.click("Go back")
    return Took(news, verdict, float(said.group(1)))


def _alone(case: Case) -> float:
    """The same search in this process, without the verdict that follows it; seconds."""
    seconds = 0.0
    for progress in case.search(threads=processors()):
        seconds = progress.seconds
    return seconds


def _line(label: str, seconds: Sequence[float]) -> None:
    least, middle, most = np.min(seconds), np.median(seconds), np.max(seconds)
    print(f"{label:32}{middle:6.2f} s in the median, {least:.2f} to {most:.2f}", flush=True)


if __name__ == "__main__":
    main()
