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
from poseviewer.fit.progress import Status
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
    parser.add_argument(
        "--among", type=int, default=0, metavar="N", help="each of N objects, no app"
    )
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
    """Search for each of ``count`` objects of 20k triangles among the others as the app does, and
    as if it were alone: processor time from its start to its verdict, what is compared included.
    """
    with tempfile.TemporaryDirectory() as name:
        scene = load_scene(make_crowd(Path(name) / "crowd", count))
        print("object   among, s   alone, s   ratio   evaluations", flush=True)
        ratios = []
        for index, thing in enumerate(scene.scene.objects):
            own = replace(scene.registrations[index], others=())
            ways = (
                lambda thing=thing: (now.progress for now in scene.search(thing.id)),
                lambda own=own, index=index: make_case(
                    own, scene.settings, scene.renderers[index]
                ).search(),
            )
            took: tuple[list[float], ...] = ([], [])
            evaluations = [0, 0]
            for _ in range(times + 1):  # the first makes what others find
                for way, seconds in enumerate(took):
                    began = time.process_time()
                    ends = [now for now in ways[way]() if now.status is not Status.RUNNING]
                    seconds.append(time.process_time() - began)
                    evaluations[way] = sum(end.evaluations for end in ends)
            among, alone = (float(np.median(seconds[1:])) for seconds in took)
            ratios.append(among / alone)
            print(
                f"{thing.id:>6}{among:11.2f}{alone:11.2f}{ratios[-1]:8.2f}   "
                f"{evaluations[0]} and {evaluations[1]}",
                flush=True,
            )
    print(f"among / alone: {np.median(ratios):.2f} in the median, {max(ratios):.2f} at most")


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
