"""How fast the app answers, and whether it grows: ``python -m tests.measure.drags``.

Starts the app on the bundled demo (``--objects 8``: on so many objects) and drives it over the
websocket, as a page does. For each drag report it takes the time until an outline arrives that lies
where the pointer then was. Pointers move along a line, so outlines drawn for a later pointer answer
the earlier ones too.
"""

from __future__ import annotations

import argparse
import bisect
import random
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseviewer.app.page.scene import OUTLINE as OUTLINE_DEPTH
from poseviewer.app.page.scene import SIDE
from poseviewer.files.demo import demo_case
from poseviewer.files.photo import load_photo
from tests.app.app_process import AppProcess
from tests.app.socket_page import SocketPage
from tests.scene import Scene, make_scene
from tests.several import make_crowd

RATE_HZ = 30.0
STROKE, STEP_PX = 30, 3.0
"""Drags of a stroke, and how far the pointer moves at each, in px of the photo."""
SAMPLE_S = 10.0
WARM_SHARE = 0.25
"""Share of the soak until memory is first looked at: buffers, caches and undo fill first."""
EVALUATIONS = "evaluations"


@dataclass
class Drive:
    """A page, and the demo's model in its photo."""

    page: SocketPage
    unit: float
    """World units for a px of the photo, at the outline's depth."""
    size: tuple[float, float]
    latencies: list[float]
    lost: int = 0

    def middle(self, points: NDArray[np.float32]) -> NDArray[np.float64]:
        """(2,): of an outline's box, px of the photo from its middle."""
        flat = points.reshape(-1, 3)[:, :2].astype(float)
        return (flat.min(axis=0) + flat.max(axis=0)) / 2.0 / self.unit

    def point_on_model(self) -> NDArray[np.float64]:
        """(2,): where a drag begins, px of the photo; between the pins, which are at its ends."""
        points = self.page.outline()
        flat = points.reshape(-1, 3)[:, :2].astype(float) / self.unit
        low, high = flat.min(axis=0), flat.max(axis=0)
        return low + np.array([0.45, 0.35]) * (high - low) + np.array(self.size) / 2.0

    def stroke(self, way: int) -> None:
        """One drag to the right (``way`` 1) or back (-1); its latencies are noted."""
        page = self.page
        start = self.point_on_model()
        first = len(page.outlines)
        mark = time.perf_counter()
        page.press(*map(float, start))
        sent: list[float] = []
        for step in range(1, STROKE + 1):
            page.drag(float(start[0]) + way * STEP_PX * step, float(start[1]))
            sent.append(time.perf_counter())
            _wait_until(mark + step / RATE_HZ)
        page.wait_until(lambda: page.outlines and page.outlines[-1][0] > sent[-1])
        _wait_until(time.perf_counter() + 0.2)
        page.release()
        self._note(sent, way, list(page.outlines[first - len(page.outlines) :]), mark)

    def _note(
        self,
        sent: list[float],
        way: int,
        outlines: list[tuple[float, NDArray[np.float32]]],
        mark: float,
    ) -> None:
        news = [(at, points) for at, points in outlines if at > mark and points.size]
        before = [o for o in self.page.outlines if o[0] <= mark and o[1].size]
        if not news or not before:
            self.lost += len(sent)
            return
        origin = self.middle(before[-1][1])[0]
        went = [way * (self.middle(points)[0] - origin) / STEP_PX for _, points in news]
        reached = np.maximum.accumulate(np.array(went)) + 0.5
        for step, at in enumerate(sent, start=1):
            index = bisect.bisect_left(list(reached), step)
            if index < len(news):
                self.latencies.append(news[index][0] - at)
            else:
                self.lost += 1


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="for each of the three loads")
    parser.add_argument(
        "--objects", type=int, default=1, help="in the photo: more than one, of 20k triangles each"
    )
    parser.add_argument("--soak", type=float, default=0.0, metavar="MINUTES")
    options = parser.parse_args()
    case = demo_case()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        photo, files = case.photo, [case.photo, case.model, "--pose", case.start]
        if options.objects > 1:
            scene = make_crowd(folder / "crowd", options.objects)
            photo, files = scene.with_name("crowd.png"), [scene]
        with AppProcess(folder, *files) as app, SocketPage(app.url) as page:
            page.wait_until(lambda: page.maps() >= 10 and len(page.outline()))
            if options.seconds > 0.0:
                _measure(page, photo, options.seconds)
            if options.soak > 0.0:
                _soak(app, page, make_scene(folder), options.soak * 60.0)
            print(f"exit code {app.terminate()}", *app.lines[2:], sep="\n")


def _measure(page: SocketPage, photo: Path, seconds: float) -> None:
    opened = load_photo(photo)
    width, height = opened.width, opened.height
    unit = SIDE / max(width, height) * OUTLINE_DEPTH
    stops: list[float] = []
    print(f"{'drags at 30 Hz':34}{'median':>10}{'95 %':>10}{'drags':>8}{'lost':>6}", flush=True)
    loads: tuple[tuple[str, Callable[[], object]], ...] = (
        ("maps at rest", lambda: _quiet(page)),
        ("maps being drawn", lambda: None),
        ("search just stopped, maps drawn", lambda: _search(page, stops)),
    )
    for label, prepare in loads:
        drive = Drive(page, unit, (width, height), [])
        end, way = time.monotonic() + seconds, 1
        while time.monotonic() < end:
            prepare()
            drive.stroke(way)
            way = -way
        times = np.array(drive.latencies) * 1e3
        median, high = np.percentile(times, [50, 95]) if len(times) else (np.nan, np.nan)
        print(f"{label:34}{median:7.1f} ms{high:7.1f} ms{len(times):8d}{drive.lost:6d}", flush=True)
    if stops:
        print(
            f"stop of a search to its last news: median {1e3 * np.median(stops):.0f} ms, "
            f"most {1e3 * max(stops):.0f} ms, {len(stops)} stops"
        )


def _quiet(page: SocketPage, still_s: float = 3.0, most_s: float = 60.0) -> None:
    """Wait until the maps no longer change."""
    end = time.monotonic() + most_s
    shown, since = page.text_with("pv-land"), time.monotonic()
    while time.monotonic() - since < still_s and time.monotonic() < end:
        _wait_until(time.perf_counter() + 0.2)
        now = page.text_with("pv-land")
        if now != shown:
            shown, since = now, time.monotonic()


def _search(page: SocketPage, stops: list[float]) -> None:
    """Search for a second; stop now and then by the key, else the drag that follows stops it."""
    page.key("Space")
    page.wait_until(lambda: page.text_with(EVALUATIONS) and "Stop (space)" in page.labels())
    _wait_until(time.perf_counter() + 1.0)
    if len(stops) % 2 == 0 or random.random() < 0.5:
        if "Stop (space)" not in page.labels():
            return
        asked = time.perf_counter()
        page.key("Space")
        page.wait_until(lambda: "Search (space)" in page.labels())
        stops.append(time.perf_counter() - asked)


def _soak(app: AppProcess, page: SocketPage, other: Scene, seconds: float) -> None:
    """Drive at random; print memory and threads as they go."""
    case = demo_case()
    chance = random.Random(0)
    begun = time.monotonic()
    next_sample, samples = begun, list[tuple[float, float, int]]()
    actions = 0
    while (now := time.monotonic()) - begun < seconds:
        if now >= next_sample:
            next_sample += SAMPLE_S
            samples.append((now - begun, *_memory(app.pid)))
            seconds_in, size, threads = samples[-1]
            print(
                f"{seconds_in:6.0f} s {size:8.1f} MiB {threads:3d} threads, {actions} actions",
                flush=True,
            )
        _act(page, chance, (other, (case.photo, case.model)))
        actions += 1
    _quiet(page, most_s=20.0)
    samples.append((time.monotonic() - begun, *_memory(app.pid)))
    warm = next(s for s in samples if s[0] >= WARM_SHARE * seconds)
    last = samples[-1]
    print(
        f"{actions} actions in {last[0]:.0f} s; RSS {warm[1]:.1f} MiB at {warm[0]:.0f} s, "
        f"{last[1]:.1f} MiB at the end: {100.0 * (last[1] / warm[1] - 1.0):+.1f} %; "
        f"threads {samples[0][2]} at first, {last[2]} at the end"
    )


def _act(page: SocketPage, chance: random.Random, files: tuple[Scene, tuple[Path, Path]]) -> None:
    """One thing that a user might do."""
    kind = chance.random()
    if kind < 0.5:
        _random_drag(page, chance)
    elif kind < 0.62:
        page.key("Space")
    elif kind < 0.72:
        page.key("KeyZ", shift=chance.random() < 0.5)
    elif kind < 0.80:
        page.key(f"Digit{chance.randrange(6)}")
    elif kind < 0.88:
        u, v = chance.random(), chance.random()
        page.report(kind="pick", first=0, second=1 + chance.randrange(4), u=u, v=v)
    elif kind < 0.93:
        page.key("KeyR")
    elif kind < 0.97:
        page.key(chance.choice(("KeyG", "KeyB", "ArrowLeft", "PageUp", "KeyJ")))
    else:
        other, (photo, model) = files
        path, label = chance.choice(
            (
                (other.photo, "Photo ..."),
                (photo, "Photo ..."),
                (other.model, "Model ..."),
                (model, "Model ..."),
            )
        )
        page.upload(label, path.name, path.read_bytes())
    _wait_until(time.perf_counter() + chance.uniform(0.0, 0.6))


def _random_drag(page: SocketPage, chance: random.Random) -> None:
    picture = page.shown.nodes["/photo"]
    unit = picture["render_width"] / 640.0
    points = page.outline().reshape(-1, 3)[:, :2].astype(float)
    x, y = points.mean(axis=0) / unit + [320.0, 240.0] if len(points) else (320.0, 240.0)
    page.press(x, y, shift=chance.random() < 0.3, ctrl=chance.random() < 0.2)
    dx, dy = chance.uniform(-4.0, 4.0), chance.uniform(-4.0, 4.0)
    for step in range(chance.randrange(3, 30)):
        page.drag(x + dx * step, y + dy * step)
        _wait_until(time.perf_counter() + 1.0 / RATE_HZ)
    page.release()


def _memory(pid: int) -> tuple[float, int]:
    """Resident memory in MiB and number of threads of a process (Linux)."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    parameters = {
        name: rest.split()[0]
        for name, _, rest in (line.partition(":") for line in lines)
        if name in ("VmRSS", "Threads")
    }
    return int(parameters["VmRSS"]) / 1024.0, int(parameters["Threads"])


def _wait_until(moment: float) -> None:
    time.sleep(max(0.0, moment - time.perf_counter()))


if __name__ == "__main__":
    main()
