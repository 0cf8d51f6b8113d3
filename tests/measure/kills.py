"""What is lost when the app is killed: ``python -m tests.measure.kills --kills 200 --seed 1``.

The real app is driven as its page does, and killed (SIGKILL) at a random moment of nudges, drags, a
search after a drag, or saves. What it left is read: every file must be whole, and hold the work but
for its last second. The table has, for each kind of work, how often it was killed and how many
seconds of work were lost at most; a file that cannot be read ends the command with its name.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.figures.text_table import Table
from poseviewer.files.pose import load_pose
from poseviewer.files.state.autosave import load_autosave
from poseviewer.geometry.camera import Pose
from tests.app.app_process import AppProcess
from tests.app.running_app import settle
from tests.app.socket_page import SocketPage
from tests.scene import Scene, make_scene

PROMISED_S = 1.0
"""Work that may be lost."""
PRESS = 86.0, 60.0
"""On the model, px of the photo."""
STEP_PX = 3.0
"""Of each drag."""
MOST_DRAGS = 8
"""Then the model is at the border of the photo."""


class Work:
    """Does something again and again, and knows when what was done."""

    def __init__(self, page: SocketPage, random_: random.Random) -> None:
        self._page, self._random = page, random_
        self.done: list[tuple[float, int, int]] = []
        """Seconds, and the nudges and drags until then."""
        self.nudges = self.drags = 0

    def nudge(self) -> None:
        """Roll the model by a degree."""
        self._page.key("KeyO")
        self.nudges += 1
        self._note()

    def drag(self) -> None:
        """Drag the model to the right, in a few steps."""
        if self.drags == MOST_DRAGS:
            return
        x, y = PRESS[0] + STEP_PX * self.drags, PRESS[1]
        self._page.press(x, y)
        for share in (0.3, 0.7, 1.0):
            self._page.drag(x + share * STEP_PX, y)
            time.sleep(0.01)
        self._page.release()
        self.drags += 1
        self._note()

    def search(self) -> None:
        """A drag, and a search from there."""
        if not self.done:
            self.drag()
            self._page.key("Space")

    def save(self) -> None:
        """A nudge, and often a save."""
        self.nudge()
        if self._random.random() < 0.7:
            self._page.key("KeyS")

    def _note(self) -> None:
        self.done.append((time.perf_counter(), self.nudges, self.drags))


KINDS: dict[str, Callable[[Work], None]] = {
    "nudges": Work.nudge,
    "drags": Work.drag,
    "a search after a drag": Work.search,
    "saves": Work.save,
}


def main() -> None:
    """Kill, look at what is left, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        lost = kill(make_scene(Path(folder)), Path(folder), options.kills, options.seed)
    rows = [
        (kind, str(len(times)), f"{np.median(times):.2f}", f"{max(times):.2f}")
        for kind, times in lost.items()
        if times
    ]
    columns = ("killed in", "times", "lost, median s", "at most, s")
    print(Table("", columns, tuple(rows)).as_text())
    sys.exit(any(max(times, default=0.0) > PROMISED_S for times in lost.values()))


def kill(scene: Scene, folder: Path, kills: int, seed: int) -> dict[str, list[float]]:
    """By kind of work, the seconds of it that each kill lost."""
    lost: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for number in range(kills):
        random_ = random.Random(f"{seed} {number}")
        kind = list(KINDS)[number % len(KINDS)]
        state = folder / f"{number}"
        state.mkdir()
        saved = scene.photo.with_name("p.pose.json")
        saved.unlink(missing_ok=True)
        with (
            AppProcess(state, scene.photo, scene.model, "--pose", scene.start) as app,
            SocketPage(app.url) as page,
        ):
            settle(page)
            work = Work(page, random_)
            end = time.perf_counter() + random_.uniform(0.3, 4.0)
            while time.perf_counter() < end:
                KINDS[kind](work)
                time.sleep(min(random_.uniform(0.02, 0.4), max(end - time.perf_counter(), 0.0)))
            app.kill()
            killed = time.perf_counter()
        lost[kind].append(_lost(scene, state, saved, work, killed, kind))
    return lost


def _lost(scene: Scene, state: Path, saved: Path, work: Work, killed: float, kind: str) -> float:
    """Seconds from the first thing that is in no file until the kill."""
    left = [load_autosave(path).pose.pose for path in (state / "state" / "sessions").glob("*.json")]
    if saved.exists():
        left.append(load_pose(saved, 160, 120).pose)
    start = load_pose(scene.start, 160, 120).pose
    counts = [_counts(pose, start) for pose in left]
    for when, nudges, drags in work.done:
        if kind == "a search after a drag":
            known = bool(left)  # it has gone on from there
        else:
            known = any(own >= nudges and other >= drags for own, other in counts)
        if not known:
            return killed - when
    return 0.0


def _counts(pose: Pose, start: Pose) -> tuple[int, int]:
    """The nudges and drags that lead from the start to a pose."""
    turned = pose.camera_from_model.rotation @ start.camera_from_model.rotation.T
    degrees = np.degrees(np.linalg.norm(Rotation.from_matrix(turned).as_rotvec()))
    (now,), (before,) = (one.project(np.zeros((1, 3))) for one in (pose, start))
    return round(float(degrees)), round(float(now[0] - before[0]) / STEP_PX)


if __name__ == "__main__":
    main()
