"""What is lost when the app is killed: ``python -m tests.measure.kills --kills 200 --seed 1``.

The real app is driven as its page does, and killed (SIGKILL) at a random moment of nudges, drags, a
search after a drag, saves, or uploads. What it left is read: every file must be whole, what it kept
must open again, and hold the work but for its last second. The table has, for each kind of work,
how often it was killed and how many seconds of work were lost at most. Batches are killed, too,
each again and again until all its rows are done: what was done must stay. A file that cannot be
read ends the command with its name.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.app.workers.opening import restore
from poseviewer.figures.text_table import Table
from poseviewer.files.pose import load_pose
from poseviewer.files.state.autosave import load_autosave
from poseviewer.geometry.camera import Pose
from tests.app.app_process import REPOSITORY, AppProcess
from tests.app.running_app import settle
from tests.app.socket_page import SocketPage
from tests.scene import Scene, make_scene

PROMISED_S = 1.0
"""Work that may be lost."""
PRESS = 86.0, 60.0
"""On the model, px of the photo."""
STEP_PX = 3.0
"""Of each drag."""
BATCH_ROWS = 6
MOST_DRAGS = 8
"""Then the model is at the border of the photo."""


class Work:
    """Does something again and again, and knows when what was done."""

    def __init__(self, page: SocketPage, random_: random.Random, model: bytes) -> None:
        self._page, self._random, self._model = page, random_, model
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

    def upload(self) -> None:
        """A nudge, and often one more model that the photo may show, by a name of its own."""
        self.nudge()
        if self._random.random() < 0.6:
            self._page.upload("Add a model ...", f"{self.nudges}.ply", self._model)

    def _note(self) -> None:
        self.done.append((time.perf_counter(), self.nudges, self.drags))


KINDS: dict[str, Callable[[Work], None]] = {
    "nudges": Work.nudge,
    "drags": Work.drag,
    "a search after a drag": Work.search,
    "saves": Work.save,
    "uploads": Work.upload,
}


def main() -> None:
    """Kill, look at what is left, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--batches", type=int, default=5, help="kills of a batch")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        scene = make_scene(Path(folder))
        lost = kill(scene, Path(folder), options.kills, options.seed)
        rows = kill_batches(scene, Path(folder), options.batches, options.seed)
    print(f"{options.batches} kills of a batch: of {rows} rows that were done none was lost")
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
            work = Work(page, random_, scene.model.read_bytes())
            end = time.perf_counter() + random_.uniform(0.3, 4.0)
            while time.perf_counter() < end:
                KINDS[kind](work)
                time.sleep(min(random_.uniform(0.02, 0.4), max(end - time.perf_counter(), 0.0)))
            app.kill()
            killed = time.perf_counter()
        lost[kind].append(_lost(scene, state, saved, work, killed, kind))
    return lost


def kill_batches(scene: Scene, folder: Path, kills: int, seed: int) -> int:
    """Kill batches of some rows, each until all are done; gives how many rows were found done.

    Raises:
        AssertionError: a row that was done is no more, or is broken.
    """
    table, chance, found = folder / "jobs.csv", random.Random(f"{seed} batch"), 0
    lines = ["photo,model,start"]
    for number in range(BATCH_ROWS):
        photo = shutil.copy(scene.photo, folder / f"row{number}.png")
        lines.append(f"{photo},{scene.model},{scene.start}")
    table.write_text("\n".join(lines) + "\n")
    out, done = folder / "out", dict[str, bytes]()
    while kills:
        line = ("batch", table, "--out", out, "--processes", 1, "--quiet", "--evaluations", 60)
        with subprocess.Popen(
            [sys.executable, "-m", "poseviewer.cli.main", *map(str, line)],
            env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
            stdout=subprocess.DEVNULL,
        ) as process:
            try:
                assert process.wait(chance.uniform(0.5, 8.0)) == 0
            except subprocess.TimeoutExpired:
                process.kill()
                kills -= 1
        before, done = done, {p.name: p.read_bytes() for p in (out / "rows").glob("[!.]*.json")}
        assert before.items() <= done.items(), "a row that was done is no more"
        found += len(done) - len(before)
        for data in done.values():
            result = json.loads(data)
            load_pose(out / result["pose"], 160, 120)
            assert cv2.imread(str(out / result["picture"])) is not None, result["picture"]
        if process.returncode == 0:
            assert len(done) == BATCH_ROWS
            shutil.rmtree(out)
            done = {}
    return found


def _lost(scene: Scene, state: Path, saved: Path, work: Work, killed: float, kind: str) -> float:
    """Seconds from the first thing that is in no file until the kill."""
    kept = [load_autosave(path) for path in (state / "state" / "sessions").glob("*.json")]
    for session in kept:
        list(restore(session))
    left = [session.pose.pose for session in kept]
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
