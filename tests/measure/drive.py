"""The page driven at random: ``python -m tests.measure.drive --seed 1 --on still``.

One or two tabs of real Chromium on the real app do what ``ACTS`` says. After each round of acts all
must be well: no error on a page, nothing in the log; the tabs show the same values as one that has
just come; what is saved and autosaved can be read; undo all the way gives the first document. Exit
code 1 on a finding; the same seed does the same again, as far as the app answers as fast.
"""

import argparse
import logging
import os
import random
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack, chdir
from dataclasses import dataclass, field, replace
from logging.handlers import BufferingHandler
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Browser
from playwright.sync_api import Error as BrowserError

from poseviewer.app.state.document import Document
from poseviewer.app.workers.opening import open_sources
from poseviewer.errors import PoseViewerError
from poseviewer.files.pose import PoseRecord, load_pose, save_pose
from poseviewer.files.scene_assets import view_of_file
from poseviewer.files.scene_json import as_saved, load_scene, save_scene, scene_contents
from poseviewer.files.state.session_file import load_autosave
from poseviewer.files.structs import PhotoReference
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.opening.sources import name_sources
from poseviewer.scene.types import Scene as ModelScene
from tests.app.browser import AppPage, open_browser
from tests.app.running_app import RunningApp, running_app
from tests.meshes import make_box, make_painted
from tests.scene import Scene, make_scene, make_scene_of
from tests.several import save_model
from tests.still_scene import CAMERA, arc, write_pictures
from tests.view_sets import write_views

ON = ("photo", "photos", "still")
"""What is open at first: one photo, three of known cameras, or many of a still scene."""
STILL_PHOTOS = 14
"""Enough for a time line in place of the strip."""
ROUND_ACTS, ROUND_SECONDS = 80, 25.0
PAST_STEPS = 150
"""Steps of a round that undo reaches back: it keeps 200."""
ROUND_PHOTOS = 3
"""Photos opened in a round: undo keeps four."""
RUN_MODELS = 2
"""Models opened in a run: undo keeps four."""
ACT_MS = 5_000
LOAD_MS = 60_000
AGREEMENT_SECONDS = 60.0
WINDOWS = ((1400, 900), (1000, 700), (600, 500))
RUBBISH = (
    "", "-", "1e308", "-1e308", "1e-320", "nan", "Infinity", "0", "-0", "-1", "9" * 400, "12",
    "179.9", "<b>bold</b><script>document.title='x'</script>", "\u202egpj.x", "a" * 5000, "\x1b[2J",
    "💥 x", "None", "../../x", "%s%n",
)  # fmt: skip
KEYS = (
    "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "j", "l", "i", "k", "u", "o", "PageUp",
    "PageDown", "1", "2", "3", "4", "5", "0", "Space", "b", "h", "z", "y", "r", "Escape", "f",
    "?", "Tab", "Enter", "Delete", "a", "n", "p", "w", "d", "q", "e",
)  # fmt: skip
MODIFIERS = ([], [], [], ["Shift"], ["Control"], ["Alt"], ["Shift", "Alt"])
NOT_OURS = ("showSaveFilePicker",)
"""Harmless errors of a page: a save dialog that a Chromium without a window sends away."""
PRESSABLE = (
    "button, input, textarea, [role=tab], [role=option], tr[tabindex], .pv-cell, .pv-photo, "
    "svg rect"
)
PICK = """([selector, share]) => {
    const all = [...document.querySelectorAll(selector)].filter(e => {
        const box = e.getBoundingClientRect();
        const isAddress = (e.value || "").startsWith("ws");  // the server's, in viser's own panel
        return box.width > 0 && box.height > 0 && e.type !== "file" && !e.disabled && !isAddress;
    });
    if (!all.length) return null;
    const found = all[Math.floor(share * all.length)];
    found.scrollIntoView({ block: "center", behavior: "instant" });
    const box = found.getBoundingClientRect();
    const at = [box.left + box.width / 2, box.top + box.height / 2];
    const top = document.elementFromPoint(...at);
    if (!top || !(found.contains(top) || top.contains(found))) return null;
    const typed = ["text", "textarea"].includes(found.type);
    const label = found.getAttribute("aria-label") || found.title || found.textContent || found.id;
    return { at, typed: typed && found.getAttribute("aria-haspopup") !== "listbox",
             label: label.trim().slice(0, 40) };
}"""
"""Something that can be pressed, scrolled to; null where it is covered."""
INPUTS = """() => Object.fromEntries(
    [...document.querySelectorAll("input[id], textarea[id]")]
        .filter(e => e !== document.activeElement && e.type !== "file")
        .map(e => [e.id, e.type === "checkbox" ? e.checked : e.value]))"""


@dataclass(slots=True)
class Driver:
    """A hand that does random things in tabs of a browser."""

    browser: Browser
    url: str
    chance: random.Random
    files: dict[str, list[Path]]
    """What is opened, by the label of its button."""
    tabs: list[AppPage] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    """Errors of tabs that were closed."""
    photos_left: int = ROUND_PHOTOS
    models_left: int = RUN_MODELS
    acts: Counter[str] = field(default_factory=Counter)
    trail: list[str] = field(default_factory=list)

    @property
    def tab(self) -> AppPage:
        return self.chance.choice(self.tabs)

    def act(self) -> None:
        name = self.chance.choices(list(ACTS), [weight for weight, _ in ACTS.values()])[0]
        try:
            said = ACTS[name][1](self)
        except BrowserError as error:
            if "Timeout" not in str(error):
                raise
            said = "in vain"
        self.acts[name] += 1
        self.trail.append(f"{name}: {said}")

    def open_tab(self) -> AppPage:
        self.tabs.append(AppPage(self.browser, self.url, self.chance.choice(WINDOWS)))
        self.tabs[-1].page.set_default_timeout(ACT_MS)
        return self.tabs[-1]

    def close_tab(self, tab: AppPage) -> None:
        """Leave a tab, in the middle of whatever it is at."""
        self.tabs.remove(tab)
        self.errors += tab.errors
        tab.page.close()

    def place(self, tab: AppPage) -> tuple[float, float]:
        """A place over the photo."""
        left, top, width, height = tab.view()["box"]
        x, y = (min(max(0.5 + 0.25 * self.chance.gauss(0, 1), 0.02), 0.98) for _ in range(2))
        return left + x * max(width, 4.0), top + y * max(height, 4.0)


def drag(driver: Driver) -> str:
    """Drag; now and then without an end, or a double click."""
    tab, keys = driver.tab, driver.chance.choice(MODIFIERS)
    mouse = tab.page.mouse
    start = driver.place(tab)
    end = driver.place(tab)
    for key in keys:
        tab.page.keyboard.down(key)
    mouse.move(*start)
    if driver.chance.random() < 0.15:
        mouse.dblclick(*start)
    else:
        mouse.down()
        mouse.move(*end, steps=driver.chance.randint(1, 8))
        if driver.chance.random() < 0.9:
            mouse.up()
    for key in keys:
        tab.page.keyboard.up(key)
    return f"{keys} {start} to {end}"


def press_key(driver: Driver) -> str:
    keys = "+".join((*driver.chance.choice(MODIFIERS), driver.chance.choice(KEYS)))
    driver.tab.page.keyboard.press(keys)
    return keys


def press_anything(driver: Driver) -> str:
    """Press anything; into a field rubbish is typed."""
    page = driver.tab.page
    selector = "[role=option]" if driver.chance.random() < 0.2 else PRESSABLE
    picked = page.evaluate(PICK, [selector, driver.chance.random()])
    if picked is None:
        return "nothing"
    page.mouse.click(*picked["at"])
    text = driver.chance.choice(RUBBISH)
    if picked["typed"]:
        page.keyboard.press("Control+a")
        page.keyboard.insert_text(text)
        page.keyboard.press(driver.chance.choice(("Enter", "Tab", "Escape")))
    return f"{picked['label']!r} {text[:40]!r}" if picked["typed"] else f"{picked['label']!r}"


def change_view(driver: Driver) -> str:
    tab = driver.tab
    page, chance = tab.page, driver.chance
    page.mouse.move(*driver.place(tab))
    way = chance.choice(("zoom", "pan", "window", "step"))
    match way:
        case "zoom":
            page.mouse.wheel(0, chance.choice((-700, -100, 100, 2000)))
        case "pan":
            page.mouse.down(button="right")
            page.mouse.move(*driver.place(tab), steps=3)
            page.mouse.up(button="right")
        case "window":
            width, height = chance.choice(WINDOWS)
            page.set_viewport_size({"width": width, "height": height})
        case _:
            tab.open_step(chance.randint(1, 5))
    return way


def open_file(driver: Driver) -> str:
    """Open a file, good or broken, by its button or by a drop."""
    label = driver.chance.choice(list(driver.files))
    path = driver.chance.choice(driver.files[label])
    driver.photos_left -= label in ("Photo ...", "Folder ...")
    driver.models_left -= label == "Model ..."
    if min(driver.photos_left, driver.models_left) < 0:
        return "none left"
    if path.is_dir() or driver.chance.random() < 0.5:
        driver.tab.drop_files([path])
        return f"{path.name} dropped"
    driver.tab.choose_file(label, path)
    return f"{label} {path.name}"


def change_tabs(driver: Driver) -> str:
    """Open a second tab; with two, leave one or load it anew."""
    if len(driver.tabs) < 2:
        driver.open_tab()
        return "another one"
    if driver.chance.random() < 0.5:
        driver.close_tab(driver.tab)
        return "one less"
    tab = driver.tab
    tab.page.set_default_timeout(LOAD_MS)
    tab.reload()
    tab.page.set_default_timeout(ACT_MS)
    return "anew"


ACTS: dict[str, tuple[int, Callable[[Driver], str]]] = {
    "drag": (8, drag),
    "key": (8, press_key),
    "press": (14, press_anything),
    "view": (3, change_view),
    "file": (1, open_file),
    "tabs": (1, change_tabs),
}
"""Weights, and functions that say what they did."""


def drive(seed: int, seconds: float, on: str = ON[0]) -> list[str]:
    """Drive the app until something is found or the time is over; prints, and returns, findings.

    Args:
        seed: of the acts.
        seconds: to drive; a round is driven to its end.
        on: what is open at first, of ``ON``.
    """
    log, findings = BufferingHandler(10_000), list[str]()
    log.setLevel(logging.WARNING)
    logging.captureWarnings(True)
    logging.getLogger().addHandler(log)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        stack.enter_context(chdir(folder))
        scene, files = make_files(folder)
        document = None if on == ON[0] else open_set(folder / "open", on)
        running = stack.enter_context(running_app(scene, folder / "state", document=document))
        browser = stack.enter_context(open_browser())
        driver = Driver(browser, running.url, random.Random(seed), files)
        try:
            drive_rounds(driver, running, log, folder, seconds)
        except (AssertionError, BrowserError, PoseViewerError) as error:
            findings.append(str(error))
            traceback.print_exc()
            print("\n".join([*driver.trail[-30:], *map(log.format, log.buffer)]))
    logging.getLogger().removeHandler(log)
    logging.captureWarnings(False)
    counts = ", ".join(f"{count} {name}" for name, count in sorted(driver.acts.items()))
    print(f"{driver.acts.total()} acts: {counts}")
    return findings


def make_files(folder: Path) -> tuple[Scene, dict[str, list[Path]]]:
    """The scene that is open at first, and what is opened later, by the label of its button."""
    places = [folder / name for name in ("scene", "box", "set")]
    for place in places:
        place.mkdir()
    scene, box = make_scene(places[0]), make_scene_of(make_painted(), places[1])
    _, model, _ = write_views(places[2])
    model.unlink()  # the set is opened with the model at hand
    broken = [folder / name for name in ("no.png", "no.json", "no.ply")]
    for path in broken:
        path.write_bytes(b"no such thing \xff\xfe{")
    return scene, {
        "Photo ...": [scene.photo, box.photo, broken[0]],
        "Pose file ...": [scene.start, scene.truth, box.start, broken[1]],
        "Model ...": [scene.model, box.model, broken[2]],
        "Folder ...": [places[2]],
    }


def open_set(folder: Path, on: str) -> Document:
    """Open some photos of known cameras, or many of a still scene."""
    folder.mkdir()
    if on == ON[1]:
        return open_sources(name_sources(*write_views(folder)))
    places = arc(STILL_PHOTOS)
    views = tuple(
        view_of_file(path, CAMERA, camera_from_world=place)
        for path, place in zip(write_pictures(folder, places), places, strict=True)
    )
    save_scene(folder / "set.json", ModelScene(views=views, unit="m"))
    save_model(folder / "low.ply", replace(make_box((0.2, 0.08, 0.08)), unit="m"))
    start = RigidTransform(np.eye(3), np.array([0.055, -0.12, 0.04]))
    photo = PhotoReference(views[0].file.name, CAMERA.width, CAMERA.height)
    save_pose(folder / "start.json", PoseRecord.of(Pose(CAMERA, places[0] @ start), photo))
    return open_sources(name_sources(*(folder / n for n in ("set.json", "low.ply", "start.json"))))


def drive_rounds(
    driver: Driver, running: RunningApp, log: BufferingHandler, folder: Path, seconds: float
) -> None:
    """Act, and check, round after round; raise an ``AssertionError`` for what is wrong."""
    driver.open_tab()
    first = running.app.session.document
    ends = time.monotonic() + seconds
    rounds = 0
    while rounds == 0 or time.monotonic() < ends:
        driver.photos_left = ROUND_PHOTOS
        round_ends = min(ends, time.monotonic() + ROUND_SECONDS)
        for _ in range(ROUND_ACTS):
            driver.act()
            is_far = len(running.app.session.history.past) > PAST_STEPS
            if is_far or time.monotonic() > round_ends:
                break
        for tab in driver.tabs:
            tab.page.mouse.up()
            press(tab, "Escape", 2)
        check_agreement(driver)
        check_files(driver.tabs[0], running, folder)
        undo_all(driver.tabs[0], running)
        if not is_same(running.app.session.document, first):
            raise AssertionError("undo all the way does not give the first document")
        if log.buffer:
            raise AssertionError(f"the log says: {log.format(log.buffer[-1])}")
        errors = [*driver.errors, *(error for tab in driver.tabs for error in tab.errors)]
        if ours := [error for error in errors if not any(words in error for words in NOT_OURS)]:
            raise AssertionError(f"an error on the page: {ours[0]}")
        rounds += 1
        print(f"round {rounds}: {driver.acts.total()} acts", flush=True)


def press(tab: AppPage, key: str, times: int = 1) -> None:
    """Press a key over the page, not in one of its fields."""
    tab.page.evaluate("document.activeElement && document.activeElement.blur()")
    for _ in range(times):
        tab.page.keyboard.press(key)


def is_same(one: Document, other: Document) -> bool:
    """Whether two documents are one, whichever view is large: to show another is no step. Undo
    reads photos of many views anew; such documents have to say the same.
    """
    told = (scene_contents(Path("same.json"), as_saved(each.scene)) for each in (one, other))
    is_scene = one.scene is other.scene or (bool(other.stepped) and next(told) == next(told))
    return is_scene and one.states is other.states and one.active == other.active


def undo_all(tab: AppPage, running: RunningApp) -> None:
    """Undo by the key until nothing is left to undo."""
    tab.until(lambda: press(tab, "z", 10) or not running.app.session.history.past)


def check_agreement(driver: Driver) -> None:
    """All tabs show, within a minute, the values that a tab shows that comes now."""
    wrong: list[str] = []
    ends = time.monotonic() + AGREEMENT_SECONDS
    while time.monotonic() < ends:
        new = driver.open_tab()
        shown = new.page.evaluate(INPUTS)
        driver.close_tab(new)
        wrong = [line for tab in driver.tabs for line in unlike(tab.page.evaluate(INPUTS), shown)]
        if not wrong:
            return
    raise AssertionError(f"tabs do not agree: {wrong[:4]}")


def unlike(shown: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """Values that two tabs show differently, of the inputs that both have."""
    both = sorted(shown.keys() & new.keys())
    return [f"{i}: {shown[i]!r:.60}, {new[i]!r:.60}" for i in both if shown[i] != new[i]]


def check_files(tab: AppPage, running: RunningApp, folder: Path) -> None:
    """What is saved is the pose at hand; all poses, scenes and sessions can be read."""

    def is_saved() -> bool:
        document = running.app.session.document  # what was asked for may still arrive
        in_pose, in_scene = document.pose.camera_from_model, document.object.world_from_model.rigid
        if tab.page.get_by_text("The pose is not saved").is_visible():  # asked late
            press(tab, "Escape")
        press(tab, "s")
        poses = [load_pose(path).pose for path in folder.rglob("*.pose.json")]
        objects = [one for path in folder.rglob("*.scene.json") for one in load_scene(path).objects]
        return any(is_near(pose.camera_from_model, in_pose) for pose in poses) or any(
            is_near(one.world_from_model.rigid, in_scene) for one in objects
        )

    tab.until(is_saved)
    for path in (folder / "state" / "sessions").glob("*.json"):
        load_autosave(path)


def is_near(one: RigidTransform, other: RigidTransform) -> bool:
    """Whether two transforms are the same but for rounding."""
    parts = ((getattr(one, name), getattr(other, name)) for name in ("rotation", "translation"))
    return all(np.allclose(mine, theirs) for mine, theirs in parts)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--on", choices=ON, default=ON[0], help="what is open at first")
    parser.add_argument("--seed", type=int, help="(a new one, which is printed)")
    options = parser.parse_args()
    seed = random.SystemRandom().randrange(1 << 32) if options.seed is None else options.seed
    print(f"seed {seed}", flush=True)
    findings = drive(seed, options.seconds, options.on)
    for finding in findings:
        print(f"FOUND: {finding}")
    return int(bool(findings))


if __name__ == "__main__":
    os.environ["POSEVIEWER_STATE"] = tempfile.mkdtemp()
    sys.exit(main())
