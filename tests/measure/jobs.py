"""Whole jobs as a new user does them: ``python -m tests.measure.jobs wheels box``.

In real Chromium, on photos with known poses (``POSEVIEWER_DATA``), cameras unknown but for those of
several photos. A press, a drag, a key, a chosen file or entry is a click. A line for each job: its
clicks and the most there may be, seconds, the worst error of what it saved (percent of the model's
size in the photo), verdicts. Exit code 1 where a job took more clicks, or came to no end.
"""

import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from playwright.sync_api import Browser, Error

from assets.source.data_folder import DATA
from poseviewer.app.state.marking import pose_beside_wheels
from poseviewer.app.workers.overlay import ALONE_MARGIN
from poseviewer.evaluation.cases import Case, load_cases, load_starts
from poseviewer.files.demo import demo_case
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import PoseRecord, load_pose, save_pose
from poseviewer.files.scene_assets import load_model, view_of_file
from poseviewer.files.scene_json import load_scene, save_scene
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.placing import fit_into_rectangle, surface_point
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import rotation_angle
from poseviewer.scene.types import Scene
from poseviewer.starts.sides import SIDES, look_from
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints
from tests.app.app_process import REPOSITORY, AppProcess
from tests.app.browser import AppPage, open_browser

WINDOW = (1500, 900)
OPEN = 1
PLACE = 2
FIT = 3
Words = Sequence[str | Path]

BOX = "node => (box => [box.x, box.y, box.width, box.height])(node.getBoundingClientRect())"


class Hand:
    """A hand on the page, which counts its clicks. Places are px of the photo."""

    def __init__(self, tab: AppPage, cases: Sequence[Case], folder: Path) -> None:
        self.tab = tab
        self.cases = cases
        self.folder = folder
        self.clicks = 0
        self.models = [load_model(case.mesh) for case in cases]
        self.size = cases[0].truth.camera.width, cases[0].truth.camera.height

    def press(self, *buttons: str) -> None:
        for name in buttons:
            self.clicks += 1
            button = self.tab.page.get_by_role("button", name=name)
            button.filter(visible=True).first.click()

    def step(self, number: int) -> None:
        self.clicks += 1
        self.tab.open_step(number)

    def key(self, key: str) -> None:
        self.clicks += 1
        self.tab.page.evaluate("document.activeElement.blur()")
        self.tab.page.keyboard.press(key)

    def point(self, at: ArrayLike) -> None:
        self.clicks += 1
        self.tab.page.mouse.click(*self.tab.on_screen(np.asarray(at).tolist(), self.size))

    def drag(self, start: ArrayLike, end: ArrayLike, *held: str) -> None:
        self.clicks += 1
        self.tab.drag(np.asarray(start).tolist(), np.asarray(end).tolist(), self.size, held)

    def box(self, index: int = 0) -> tuple[FloatArray, FloatArray]:
        drawn = self.cases[index].truth.project(self.models[index].mesh.vertices)
        inside = np.array(self.size) - 8.0
        return np.maximum(drawn.min(axis=0) - 4.0, 8.0), np.minimum(drawn.max(axis=0) + 4.0, inside)

    def look_from(self, side: str) -> Pose:
        camera = load_photo(self.cases[0].photo).default_camera()
        return look_from(side, self.models[0].mesh, self.models[0].keypoints, camera)

    def fit_to_box(self, index: int = 0) -> None:
        self.press("Fit to box")
        self.tab.wait_for_text("drag a rectangle about the object")
        self.drag(*self.box(index))
        self.tab.wait_for_text("proposal 1 of")

    def drawn_alone(self, pose: Pose | None = None) -> Pose:
        """The pose in the model's picture beside the photo, from a side or the usual one."""
        frame = Rectangle(0, 0, *self.size).expand(-ALONE_MARGIN)
        pose = pose or self.look_from("three-quarter")
        return fit_into_rectangle(pose, self.models[0].mesh, frame)

    def mark_model(self, at: FloatArray) -> None:
        """Press the model's picture at a place, in px of the photo."""
        self.clicks += 1
        left, top, *size = self.tab.page.locator(".pv-model svg").evaluate(BOX)
        self.tab.page.mouse.click(*([left, top] + at / self.size * size))

    def search_and_save(self, *buttons: str) -> None:
        self.key("Space")
        self.tab.wait_for_text("Verdict:")
        self.press(*buttons)
        self.save()

    def save(self) -> None:
        self.key("s")
        self.tab.until(lambda: any(self.folder.glob("*.json")))


def by_wheels(hand: Hand) -> None:
    hand.press("Wheels", "Find wheels: draw a region")
    hand.drag(*hand.box())
    hand.press("Find wheels in the region")
    hand.tab.wait_for_text("space: search from here")
    hand.search_and_save("Keep it")


def save_demo_without_wheels(path: Path) -> Path:
    """Write the demo's car with parts of which no name says that they are wheels."""
    content = demo_case().model.read_bytes()
    path.write_bytes(re.sub(rb'"wheel [^"]*', lambda name: b'"'.ljust(len(name[0]), b"p"), content))
    return path


def mark_wheels(hand: Hand, keypoints: VehicleKeypoints, count: int = 2) -> None:
    """Press the middle of the rear wheel, and of the front one, on the model's picture."""
    hand.press("Wheels")
    hand.tab.page.locator(".pv-model image").wait_for()
    hand.tab.settled_picture()
    now = hand.drawn_alone(pose_beside_wheels(hand.models[0].mesh, hand.cases[0].truth.camera))
    sides = keypoints.left, keypoints.right
    side = max(sides, key=lambda own: float(-now.camera_from_model.rotation[2] @ own.axle))
    marks = hand.tab.page.locator(".pv-model text")
    for number, hub in enumerate((side.rear_wheel, side.front_wheel)[:count], 1):
        hand.mark_model(now.project(hub))
        if number < count:
            hand.tab.until(lambda number=number: marks.count() == number)


def by_marked_wheels(hand: Hand, keypoints: VehicleKeypoints) -> None:
    """Mark wheels that have no names: the car is found by them, with its verdict."""
    mark_wheels(hand, keypoints)
    hand.tab.wait_for_text("Verdict:")
    hand.save()


def by_box(hand: Hand) -> None:
    hand.fit_to_box()
    hand.search_and_save()


def by_drag(hand: Hand) -> None:
    truth, centre = hand.cases[0].truth, hand.models[0].mesh.centre

    def angle(side: str) -> float:
        own, true = hand.look_from(side).camera_from_model, truth.camera_from_model
        return rotation_angle(own.rotation, true.rotation)

    side = min(SIDES, key=angle)
    hand.point(truth.project(centre))
    hand.clicks += 2
    hand.tab.page.get_by_label("View", exact=True).filter(visible=True).click()
    hand.tab.page.get_by_role("option", name=side, exact=True).click()
    drawn = hand.look_from(side).project(hand.models[0].mesh.vertices)
    grown = np.linalg.norm(np.ptp(hand.box(), axis=0)) / np.linalg.norm(np.ptp(drawn, axis=0))
    at, reach = truth.project(centre), np.array([40.0, 0.0])
    hand.drag(at + reach, at + grown * reach, "Control")
    hand.search_and_save()


def by_pairs(hand: Hand) -> None:
    """Four points that model and photo show, as far from one another as may be."""
    truth = hand.cases[0].truth
    mesh = hand.models[0].mesh
    now = hand.drawn_alone()

    def is_seen(pose: Pose, point: FloatArray) -> bool:
        hit = surface_point(mesh, pose, pose.project(point))
        return hit is not None and float(np.linalg.norm(hit - point)) < 0.01 * mesh.diameter

    points = mesh.vertices[mesh.faces[:: 1 + len(mesh.faces) // 500]].mean(axis=1)
    points = [p for p in points if is_seen(now, p) and is_seen(truth, p)]
    chosen = points[:1]
    while len(chosen) < 4:
        chosen.append(max(points, key=lambda p: min(float(np.linalg.norm(p - q)) for q in chosen)))
    hand.press("Point pairs")
    hand.tab.page.locator(".pv-model image").wait_for()
    hand.tab.settled_picture()
    for number, point in enumerate(chosen, 1):
        hand.mark_model(now.project(point))
        hand.tab.wait_for_text(f"pair {number}: click the same point")
        hand.point(truth.project(point))
        hand.tab.wait_for_text(f"pair {number + 1}: ")
    hand.search_and_save()


def three_objects(hand: Hand) -> None:
    hand.fit_to_box()
    for index, case in enumerate(hand.cases[1:], 1):
        hand.step(OPEN)
        hand.clicks += 3 if index == 1 else 2  # the folder, the button, the file
        hand.tab.add_object(case.mesh)
        hand.tab.until(lambda name=case.mesh.name: hand.tab.verdicts().get(name) == "not placed")
        hand.step(PLACE)
        hand.fit_to_box(index)
    hand.press("Find the focal length")
    ends = {"found", "doubtful", "lost"}
    hand.tab.until(lambda: ends.issuperset(hand.tab.verdicts().values()))
    hand.save()


def by_both_losses(hand: Hand) -> None:
    hand.step(FIT)
    hand.press("Compare the losses", "Default")
    hand.save()


def in_review(hand: Hand) -> None:
    for index in range(len(hand.cases)):
        hand.tab.wait_for_text("at this pose")
        hand.key("a")
        hand.tab.wait_for_text(f"{index + 1} accepted")


def photo_and_model(cases: Sequence[Case], _: Path) -> Words:
    return cases[0].photo, cases[0].mesh


def from_start(cases: Sequence[Case], folder: Path) -> Words:
    start = next(s for s in load_starts(DATA, (5,), 1) if s.case == cases[0].name)
    path = folder / "starts" / f"{cases[0].name}.json"
    path.parent.mkdir(exist_ok=True)
    save_pose(path, PoseRecord.of(Pose(cases[0].truth.camera, start.camera_from_model.rigid)))
    return cases[0].photo, cases[0].mesh, "--pose", path


def in_views(cases: Sequence[Case], folder: Path) -> Words:
    """Photos of one thing, whose cameras are known in its frame."""
    views = []
    for case in cases:
        truth = case.truth
        view = view_of_file(case.photo, truth.camera, camera_from_world=truth.camera_from_model)
        views.append(view)
    save_scene(folder / "set.json", Scene(views=tuple(views)))
    return "--views", folder / "set.json", cases[0].mesh


def fitted(cases: Sequence[Case], folder: Path) -> Words:
    rows = [map(str, from_start([case], folder)) for case in cases]
    lines = ["photo,model,start", *(f"{photo},{mesh},{start}" for photo, mesh, _, start in rows)]
    (folder / "jobs.csv").write_text("\n".join(lines))
    command = [sys.executable, "-m", "poseviewer.cli.main", "batch", folder / "jobs.csv"]
    command += ["--out", folder / "out", "--quiet"]
    subprocess.run(command, cwd=REPOSITORY, check=True, stdout=subprocess.DEVNULL)
    return "review", folder / "out"


UserJob = tuple[str, Callable[[Sequence[Case], Path], Words], Callable[[Hand], None], int]
"""Names of cases, the app's command line for them, the work, and clicks that it may take."""
CLUTTER = "clutter-1-cat clutter-1-driller clutter-1-bbq_sauce"
HOPE = "hope-0000-light0-mustard hope-0002-light0-bbq_sauce hope-0002-light1-alphabet_soup"
VIEWS = "clutter-1-driller clutter-0-driller clutter-6-driller"
JOBS: dict[str, UserJob] = {
    "wheels": ("bmw-0", photo_and_model, by_wheels, 7),
    "box": ("bmw-1", photo_and_model, by_box, 5),
    "drag": ("hope-0000-light0-mustard", photo_and_model, by_drag, 6),
    "pairs": ("hope-0002-light0-alphabet_soup", photo_and_model, by_pairs, 14),
    "objects": (CLUTTER, photo_and_model, three_objects, 18),
    "losses": ("bmw-2", from_start, by_both_losses, 4),
    "photos": (VIEWS, in_views, by_box, 5),
    "review": (HOPE, fitted, in_review, 3),
}


def case_of(name: str) -> Case:
    return load_cases(DATA / ("clutter" if name.startswith("clutter") else ""), name)[0]


def ends_in(folder: Path, cases: Sequence[Case]) -> tuple[float, str]:
    """Worst error of the cases' poses in a folder's files, and their verdicts."""
    poses, verdicts = list[Pose](), list[str]()
    for path in sorted(folder.glob("*.json")):
        if "objects" in json.loads(path.read_text()):
            scene = load_scene(path)
            poses += [scene.pose(index, 0) for index in range(len(scene.objects))]
            found = [one.result and one.result.verdict for one in scene.objects]
        else:
            record = load_pose(path)
            poses, found = [*poses, record.pose], [record.verdict]
        verdicts += [verdict.label if verdict else "-" for verdict in found]
    pairs = zip(poses, cases, strict=True)
    errors = [pose_error(load_model(c.mesh).mesh, pose, c.truth).percent for pose, c in pairs]
    return max(errors), " ".join(verdicts)


def do(name: str, browser: Browser) -> bool:
    """Do a job and print its line; whether it ended in as many clicks as it may take."""
    (named, open_app, work, most), began = JOBS[name], time.monotonic()
    with tempfile.TemporaryDirectory() as made:
        folder, photos = Path(made), Path(made) / "photos"
        photos.mkdir()  # poses are saved beside them
        cases = [case_of(case) for case in named.split()]
        cases = [replace(case, photo=Path(shutil.copy(case.photo, photos))) for case in cases]
        words = open_app(cases, folder)
        with (
            AppProcess(folder, *words, has_fine_maps=True) as app,
            AppPage(browser, app.url, WINDOW) as tab,
        ):
            hand = Hand(tab, cases, photos)
            try:
                begin = tab.page.get_by_text(re.compile("is not placed yet|at this pose"))
                begin.filter(visible=True).first.wait_for()
                work(hand)
                saved = folder / "out" / "poses" if name == "review" else photos
                percent, verdicts = ends_in(saved, cases[: 1 if name == "photos" else None])
                end = f"{percent:.2f} %, {verdicts}"
            except (AssertionError, Error, ValueError) as error:
                end = f"came to no end: {str(error).splitlines()[0]}"
    seconds = f"{time.monotonic() - began:.0f} s"
    print(f"{name}: {hand.clicks} of {most} clicks, {seconds}, {end}", flush=True)
    return hand.clicks <= most and "no end" not in end


def main(names: Sequence[str]) -> int:
    if not DATA.is_dir():
        print(f"skipped: no photos in {DATA}; set POSEVIEWER_DATA")
        return 0
    with open_browser() as browser:
        return 1 if [name for name in names if not do(name, browser)] else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or list(JOBS)))
