"""From opening to a saved pose, as a person does it: ``python -m tests.measure.first_minute``.

A real browser is driven by a person's steps: a pause before each press and to read what is new, and
an aim that is not perfect. On the bundled demo, a path-traced car and a grocery, each by dragging,
by a box about the object, and by point pairs. The table has presses (of mouse and keys), seconds
from the command to the page, and from there to the saved file, those of them that the page made the
person wait, and how far the start and the saved pose are off, as a share of the model's size in the
photo.

The person looks by saving: what is in the file is what is seen. Those saves are not counted.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser
from playwright.sync_api import TimeoutError as TimedOut
from scipy.spatial.transform import Rotation

from poseviewer.app.page.controls import STEPS
from poseviewer.app.state.dragging import radius_in_photo
from poseviewer.evaluation.real_cases import load_cases
from poseviewer.files.demo import demo_case
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.frames import camera_as_integer_centres
from poseviewer.geometry.mesh import Mesh, hull_points
from poseviewer.geometry.pose_error import PoseError, pose_error
from poseviewer.starts.placing import SIDES, look_from, surface_point
from poseviewer.starts.point_pairs import fewest_pairs
from poseviewer.starts.registration import load_model
from poseviewer.starts.views import box_of
from poseviewer.vehicle.keypoints import VehicleKeypoints
from tests.app.app_process import REPOSITORY, AppProcess
from tests.app.browser import AppPage, open_browser

BEFORE_PRESS_S, READING_S = 0.8, 1.5
"""What a person takes to find a button or a place, and to read a sentence."""
AIM_PX = 6.0
"""A press is so far off at most, in px of the screen ..."""
AIM_BOX = 0.05
"""... a side of a box by this share of the object's size ..."""
AIM_TURN = 0.15
"""... and a turn of the model by this share of itself."""
ROUGHLY_DEG, ROUGHLY_SIZE = 12.0, 0.1
"""A person who drags leaves off where the model is turned, and as large, as well as this."""
LIKELY_DEG = 25.0
"""A proposal is taken whose view looks right: so far off at most."""
MOST_DRAGS = 10
POINTS = 120
"""Of the surface, of which some are pressed on."""
LARGEST_TURN = math.radians(60.0)
"""Of one drag: more leads beyond the model's rim."""
CASES = {"car": "bmw-0", "grocery": "hope-0002-light0-bbq_sauce"}
MOST_MISSES = 4
SEEN_MS, PATIENCE_MS = 3_000, 180_000
"""Until a press was missed, and until a search is given up."""
LINE = "{:9}{:7}" + 4 * "{:>10}" + 3 * "{:>10}" + "  {}"


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A photo, its model, and where the model is."""

    name: str
    photo: Path
    model: Path
    truth: Pose
    is_demo: bool = False


@dataclass(slots=True)
class Person:
    """Who does it: sees poses, aims badly, and takes time."""

    tab: AppPage
    subject: Subject
    mesh: Mesh
    keypoints: VehicleKeypoints | None
    file: Path
    pictures: Path | None
    random: np.random.Generator
    presses: int = 0
    waited: float = 0.0
    looked: float = 0.0
    step: int = 2
    shots: int = 0
    notes: list[str] = field(default_factory=list)

    # --- seeing ---------------------------------------------------------------------------------

    @property
    def photo(self) -> tuple[int, int]:
        """Its size, px."""
        return self.subject.truth.camera.width, self.subject.truth.camera.height

    @contextmanager
    def off_the_clock(self) -> Iterator[None]:
        """What takes a script time, but no person."""
        began = time.perf_counter()
        yield
        self.looked += time.perf_counter() - began

    def sees(self) -> Pose:
        """The pose that is shown; no time passes, and nothing is pressed."""
        with self.off_the_clock():
            self.tab.saved_pose(self.file)
            self.tab.page.evaluate(
                "document.querySelectorAll('.mantine-Notification-closeButton')"
                ".forEach(button => button.click())"
            )
        return load_pose(self.file, *self.photo).pose

    def off(self, pose: Pose) -> PoseError:
        """How far from the truth."""
        return pose_error(self.mesh, pose, self.subject.truth)

    def reads(self, what: str) -> None:
        """Take the time to read; a picture is kept of it."""
        time.sleep(READING_S)
        if self.pictures is not None:
            self.shots += 1
            path = self.pictures / f"{self.file.parent.name}-{self.shots:02d}-{what}.png"
            with self.off_the_clock():
                self.tab.page.screenshot(path=str(path))

    # --- doing ----------------------------------------------------------------------------------

    def key(self, name: str) -> None:
        """Press a key."""
        self._before_press()
        self.tab.page.keyboard.press(name)

    def button(self, name: str, step: int) -> None:
        """Press a button of a step, which is opened if it is not."""
        self.opens(step)
        self._before_press()
        self.tab.page.get_by_role("button", name=name, exact=True).click()

    def opens(self, step: int) -> None:
        """Open a step, if another one is."""
        if step != self.step:
            self._before_press()
            self.tab.page.get_by_text(STEPS[step - 1], exact=True).click()
            self.step = step

    def chooses(self, field: str, option: str) -> None:
        """Choose from a dropdown of the step at hand."""
        self._before_press()
        self.tab.page.get_by_label(field, exact=True).click()
        self._before_press()
        self.tab.page.get_by_role("option", name=option, exact=True).click()

    def press(self, place: Sequence[float] | FloatArray) -> None:
        """Press at a place of the photo, nearly."""
        self._before_press()
        self.tab.page.mouse.click(*self._aimed(place))

    def drag(self, start: FloatArray, end: FloatArray, key: str = "") -> None:
        """Press at one place of the photo, move to another one, nearly, and let go."""
        self._before_press()
        page, goal = self.tab.page, self._aimed(end)
        if key:
            page.keyboard.down(key)
        page.mouse.move(*self.tab.on_screen(tuple(start), self.photo))
        page.mouse.down()
        page.mouse.move(*goal, steps=15)
        page.mouse.up()
        if key:
            page.keyboard.up(key)

    def waits_for(self, *texts: str) -> None:
        """Until the page shows one of them."""
        began = time.perf_counter()
        found = self.tab.page.get_by_text(texts[0])
        for text in texts[1:]:
            found = found.or_(self.tab.page.get_by_text(text))
        found.first.wait_for(timeout=PATIENCE_MS)
        self.waited += time.perf_counter() - began

    def _before_press(self) -> None:
        time.sleep(BEFORE_PRESS_S)
        self.presses += 1

    def _aimed(self, place: Sequence[float] | FloatArray) -> tuple[float, float]:
        x, y = self.tab.on_screen((float(place[0]), float(place[1])), self.photo)
        angle, away = self.random.uniform(0.0, 2.0 * math.pi), self.random.uniform(0.0, AIM_PX)
        return x + away * math.cos(angle), y + away * math.sin(angle)


# --- three ways to a start ----------------------------------------------------------------------


def by_drag(person: Person) -> None:
    """Choose the likest view, or press where the object is; turn, roll and scale, and move, until
    it is roughly right.
    """
    truth, mesh = person.subject.truth, person.mesh
    if not person.subject.is_demo:
        side = min(SIDES, key=lambda name: person.off(_view(person, name)).rotation_deg)
        if side == "three-quarter":  # as it is
            person.press(truth.project(mesh.centre))
        else:
            person.chooses("View", side)
    for _ in range(MOST_DRAGS):
        pose = person.sees()
        here, there = pose.project(mesh.centre), truth.project(mesh.centre)
        old, new = pose.camera_from_model.rotation, truth.camera_from_model.rotation
        turn = Rotation.from_matrix(new @ old.T).as_rotvec()
        radius = radius_in_photo(pose, mesh)
        size = radius_in_photo(truth, mesh) / radius
        tilt = float(np.linalg.norm(turn[:2]))
        if tilt > math.radians(ROUGHLY_DEG):
            angle = min(tilt, LARGEST_TURN) * (1.0 + AIM_TURN * person.random.uniform(-1.0, 1.0))
            # A drag to the right turns the near side to the right: about the axis that points up.
            way = np.array([-turn[1], turn[0]]) / tilt
            small = angle <= math.pi / 4.0
            reach = math.sin(angle) if small else math.sqrt(math.tan(angle) / 2.0)
            person.drag(here, here + reach * radius * way, "Shift")
        elif abs(turn[2]) > math.radians(ROUGHLY_DEG) or abs(math.log(size)) > ROUGHLY_SIZE:
            cos, sin = math.cos(turn[2]), math.sin(turn[2])
            lever = 0.3 * radius
            end = here + size * lever * np.array([cos, sin])
            person.drag(here + np.array([lever, 0.0]), end, "Control")
        elif np.linalg.norm(here - there) > ROUGHLY_SIZE * radius:
            person.drag(here, there)
        else:
            return
    person.notes.append("gave up dragging")


def by_box(person: Person) -> None:
    """Draw a box, and go through the proposals until one looks right; if none does, drag."""
    left, top, width, height = box_of(person.subject.truth, hull_points(person.mesh))
    low, size = np.array([left, top]), np.array([width, height])
    off = person.random.uniform(-AIM_BOX, AIM_BOX, (2, 2)) * size
    low, high = low + off[0], low + size + off[1]
    person.button("Fit to box", 2)
    person.drag(low, high)
    person.waits_for("proposal 1 of")
    person.reads("proposals")
    text = person.tab.page.get_by_text("proposal 1 of").first.inner_text()
    count = int(text.split("of", 1)[1].split(",")[0])
    for _ in range(count):
        if person.off(person.sees()).rotation_deg <= LIKELY_DEG:
            return
        person.button("Next proposal", 2)
    person.notes.append(f"none of {count} proposals")
    by_drag(person)


def by_pairs(person: Person) -> None:
    """Bring a view that shows the same side, and press on points of the model and of the photo."""
    truth, mesh = person.subject.truth, person.mesh
    with person.off_the_clock():
        pick = np.random.default_rng(0).integers(len(mesh.vertices), size=POINTS)
        seen = _seen(mesh, truth, mesh.vertices[pick])
    if not person.subject.is_demo:
        with person.off_the_clock():
            views = {name: _view(person, name) for name in SIDES}
            side = max(views, key=lambda name: len(_seen(mesh, views[name], seen)))
        if side != "three-quarter":
            person.chooses("View", side)
    person.tab.page.get_by_text("Quick start", exact=True).click()
    person.button("Point pairs", 2)
    person.reads("pairs")
    pose = person.sees()
    with person.off_the_clock():
        seen = _seen(mesh, pose, seen)
    wanted = fewest_pairs(truth.camera)
    if len(seen) < wanted:
        person.notes.append("no view shows the same side")
        return
    for number, point in enumerate(_far_apart(seen, wanted), 1):
        for _ in range(MOST_MISSES):  # what lies at the model's rim is missed now and then
            person.press(pose.project(point))
            with suppress(TimedOut):
                picked = person.tab.page.get_by_text(f"pair {number}: click the same point")
                picked.wait_for(timeout=SEEN_MS)
                break
        person.press(truth.project(point))
    person.key("Escape")


WAYS: dict[str, Callable[[Person], None]] = {"drag": by_drag, "box": by_box, "pairs": by_pairs}


def _view(person: Person, side: str) -> Pose:
    return look_from(side, person.mesh, person.keypoints, person.subject.truth.camera)


def _seen(mesh: Mesh, pose: Pose, points: FloatArray) -> FloatArray:
    """(k, 3): those points (n, 3) of the surface that nothing hides at a pose."""
    hits = [surface_point(mesh, pose, pixel) for pixel in pose.project(points)]
    near = 0.01 * mesh.diameter
    shown = [
        hit is not None and float(np.linalg.norm(hit - point)) < near
        for hit, point in zip(hits, points, strict=True)
    ]
    return points[np.array(shown, bool)]


def _far_apart(points: FloatArray, count: int) -> FloatArray:
    """(count, 3): each the farthest from those before it."""
    found = [points[np.linalg.norm(points - points.mean(axis=0), axis=1).argmax()]]
    while len(found) < count:
        away = np.linalg.norm(points[:, None] - np.array(found), axis=2).min(axis=1)
        found.append(points[away.argmax()])
    return np.array(found)


# --- the table ----------------------------------------------------------------------------------


def run(subject: Subject, way: str, browser: Browser, options: argparse.Namespace) -> str:
    """One line of the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / f"{subject.name}-{way}"
        folder.mkdir()
        opening = time.perf_counter()
        with _opened(subject, folder, options.known_camera) as app:
            tab = AppPage(browser, app.url, options.window, device_scale_factor=options.scale)
            began = time.perf_counter()
            opened = began - opening
            model = load_model(subject.model)
            file = folder / f"{subject.photo.stem}.pose.json"
            random = np.random.default_rng(options.seed)
            person = Person(
                tab, subject, model.mesh, model.keypoints, file, options.pictures, random
            )
            person.looked = time.perf_counter() - began
            person.reads("opened")
            WAYS[way](person)
            start = person.off(person.sees())
            person.reads("start")
            person.key("Space")
            try:
                person.waits_for("Verdict:", "Stopped")
            except TimedOut:
                person.notes.append("the search did not end")
            person.opens(4)
            person.reads("verdict")
            said = tab.page.get_by_text("Verdict:")
            verdict = said.first.inner_text().partition(": ")[2] if said.count() else "none"
            person.presses += 1
            time.sleep(BEFORE_PRESS_S)
            tab.saved_pose(file)
            seconds = time.perf_counter() - began - person.looked
            person.reads("saved")
            end = person.off(person.sees())
            tab.page.close()
            notes = "; ".join([verdict.split(".")[0], *person.notes, *tab.errors])
    took = (f"{value:.0f}" for value in (opened, seconds, person.waited))
    off = (f"{value:.2f}" for value in (start.percent, end.percent, end.rotation_deg))
    return LINE.format(subject.name, way, person.presses, *took, *off, notes)


@contextmanager
def _opened(subject: Subject, folder: Path, known_camera: bool) -> Iterator[AppProcess]:
    """The app, on copies: poses are written beside the photo."""
    arguments: list[str | Path] = []
    if not subject.is_demo:
        photo = folder / subject.photo.name
        shutil.copy(subject.photo, photo)
        arguments = [photo, subject.model]
        if known_camera:
            calibration = folder / "camera.json"
            calibration.write_text(json.dumps(_intrinsics(subject.truth)))
            arguments += ["--calibration", calibration]
    with AppProcess(folder, *arguments) as app:
        yield app


def _intrinsics(pose: Pose) -> dict[str, float]:
    """As BOP's camera.json."""
    camera = camera_as_integer_centres(pose.camera)
    assert isinstance(camera, Perspective)
    names = ("fx", "fy", "cx", "cy", "width", "height")
    return {name: getattr(camera, name) for name in names}


def subjects(data: Path) -> Iterator[Subject]:
    """What there is of them; says what there is not."""
    case = demo_case()
    photo = load_photo(case.photo)
    truth = load_pose(case.truth, photo.width, photo.height).pose
    yield Subject("demo", case.photo, case.model, truth, is_demo=True)
    for name, pattern in CASES.items():
        if not (data / "cases.json").is_file():
            print(f"skipped: {name}, there is no {data / 'cases.json'}; set POSEVIEWER_DATA")
            continue
        for real in load_cases(data, pattern):
            yield Subject(name, real.photo, real.mesh, real.truth)


def _window(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    return int(width), int(height)


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="of the lines, as demo-drag or car")
    parser.add_argument("--window", type=_window, default=(1400, 900), metavar="WIDTHxHEIGHT")
    parser.add_argument("--scale", type=float, default=1.0, help="device px for a CSS px")
    parser.add_argument("--known-camera", action="store_true", help="give its calibration")
    parser.add_argument("--pictures", type=Path, help="a folder for pictures of every step")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    data = Path(os.environ.get("POSEVIEWER_DATA") or REPOSITORY.parent / "shared" / "data")
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} at the start", flush=True)
    took, off = ("page s", "saved s", "waited s"), ("start %", "saved %", "turned")
    print(LINE.format("photo", "way", "presses", *took, *off, "verdict"), flush=True)
    with open_browser() as browser:
        for subject in subjects(data):
            for way in WAYS:
                if options.only in f"{subject.name}-{way}":
                    print(run(subject, way, browser, options), flush=True)


if __name__ == "__main__":
    main()
