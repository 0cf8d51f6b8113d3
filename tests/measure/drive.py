"""A page that is driven at random: ``python -m tests.measure.drive --seconds 600 --seed 1``.

The real app, two tabs of real Chromium, and a page over the wire; what they do is in
``drive_acts``. After each round all must be well: no error on a page or in the log; all pages agree
with one that has just come; what is saved and kept can be read; undo all the way gives the start.
The app answers within half a second, 19 of 20 times, where its threads' waits for a processor do
not count: the machine may be busy with other work. In runs of more than two minutes the memory
after the first minute grows by less than 5 %. Exit code 1 where something was found; the same seed
does the same things again, as far as the app answers as fast.
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from websockets.exceptions import ConnectionClosed

from poseviewer.errors import PoseViewerError
from poseviewer.figures.text_table import Table
from poseviewer.files.pose import load_pose
from poseviewer.files.state.autosave import load_autosave
from tests.app.app_process import AppProcess
from tests.app.browser import open_browser
from tests.app.socket_page import SocketPage
from tests.measure.drive_acts import DOWNLOAD, Budget, Files, Hand, contents, page_over_wire
from tests.meshes import make_painted
from tests.scene import Scene, make_scene, make_scene_of
from tests.view_sets import write_views

MOST_GROWTH, WARM_S, LONG_S = 0.05, 60.0, 120.0
"""Of the memory, counted from ``WARM_S`` on, in runs of ``LONG_S`` and more."""
FEWEST_ROUNDS = 8
"""To tell a growth from chance."""
ANSWER_S = 0.5
"""Within which the app answers."""
ROUND_ACTS, ROUND_S = 80, 25.0
"""A round ends after so many acts, or seconds."""
UNDO_STEPS, UNDO_PHOTOS = 180, 3
"""Undo reaches back 200 steps and four photos."""
UNDONE = 210
ANSWERS_EVERY = 10
"""Acts from one look at how soon the app answers to the next."""
USED_FIRST = (
    "Sheet (PNG)", "Numbers (NPZ)", "Download overlay", "Propose starts", "Compare both methods",
)  # fmt: skip
BUSY = {"Stop (space)", "Stop looking"}
"""Labels of buttons while something goes on."""
TRAIL_SHOWN = 30
WRONG_WORDS = "Something went wrong inside", "Traceback", "Error:", "WARNING", "Exception"
"""Of a log, or of a notice, that are never to be there."""
DOWNLOADS, DOWNLOAD_S, AGREEMENT_S = 4, 20.0, 60.0
PRESSES, PRESSED_S = 20, 3.0
"""Patience: what goes on behind the page may take a while on a busy machine."""
NOT_OURS = "showSaveFilePicker", "_redrawFromAutoMarginCount", ".emit is not a function"
"""Errors of a page that harm nobody: a dialog for a file that is sent away (a Chromium without a
window does so at once), a map of plotly's that is closed while it is drawn (two)."""
OF_THE_VIEW = (
    "Model (1-5, 0)", "Opacity", "Wipe", "Photo alone (B)", "Swing", "Rotation rings (G)", "View",
    "Whose loss", "As a surface", "Range ± %", "One colour scale", "Erase (alt)",
    "Outlines of the candidates",
)  # fmt: skip
"""Inputs that undo leaves alone."""
SHOWN_VALUES = """ids => ids.map(id => {
    const found = document.getElementById(id);
    if (!found || found === document.activeElement || found.value === undefined) return null;
    return found.type === "checkbox" ? found.checked : found.value;
})"""


class FoundError(AssertionError):
    """What is not as it has to be."""


@dataclass
class Driven:
    """What a run has seen."""

    acts: Counter[str] = field(default_factory=Counter)
    rounds: int = 0
    answers_s: list[float] = field(default_factory=list)
    waits_s: list[float] = field(default_factory=list)
    """For how long the app's threads stood ready during each answer without a processor."""
    memory: list[tuple[float, int]] = field(default_factory=list)
    """Seconds from the start, and bytes of the app, after each round."""
    found: list[str] = field(default_factory=list)

    def growth(self) -> float | None:
        """Of the memory, from the first half of the rounds after the first minute to the last
        quarter of them (medians); None where the run was short.
        """
        warm = [held for at, held in self.memory if at > WARM_S]
        if not self.memory or self.memory[-1][0] < LONG_S or len(warm) < FEWEST_ROUNDS:
            return None
        first, last = warm[: len(warm) // 2], warm[-max(len(warm) // 4, 1) :]
        return float(np.median(last) / np.median(first) - 1.0)

    def own_s(self) -> float:
        """Within which the app answered 19 of 20 times, but for its waits for a processor; of few
        answers the longest does not count.
        """
        own = np.maximum(np.array(self.answers_s) - np.array(self.waits_s), 0.0)
        return float(np.quantile(own, 0.95, method="lower")) if len(own) else 0.0

    def report(self) -> str:
        """For a terminal."""
        rows = tuple((kind, f"{count:,}") for kind, count in sorted(self.acts.items()))
        lines = [Table("", ("acts", "times"), rows).as_text()]
        lines.append(f"{sum(self.acts.values()):,} acts in {self.rounds} rounds")
        if self.answers_s:
            answers = 1000.0 * np.quantile(self.answers_s, [0.5, 0.95, 1.0])
            median, most, longest = answers
            lines.append(
                f"answers ({len(self.answers_s)}): median {median:.0f} ms, 95 % within "
                f"{most:.0f} ms, at most {longest:.0f} ms; but for waits for a processor 95 % "
                f"within {1000.0 * self.own_s():.0f} ms"
            )
        held = [f"{size / 1e6:.0f}" for _, size in self.memory]
        grown = self.growth()
        shown = "" if grown is None else f"; grown by {grown:.1%} since the first minute"
        lines.append(f"memory after each round, MB: {', '.join(held)}{shown}")
        return "\n".join(lines)


def main() -> int:
    """Drive, and print; exit code 1 where something was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, help="(a new one, which is printed)")
    parser.add_argument("--wire-alone", action="store_true", help="without Chromium")
    options = parser.parse_args()
    seed = random.SystemRandom().randrange(1 << 32) if options.seed is None else options.seed
    print(f"seed {seed}", flush=True)
    driven = drive(seed, options.seconds, with_browser=not options.wire_alone)
    print(driven.report())
    grown = driven.growth()
    if grown is not None and grown > MOST_GROWTH:
        driven.found.append(f"the memory has grown by {grown:.1%}")
    if driven.own_s() > ANSWER_S:
        driven.found.append(f"answers take {driven.own_s():.2f} s")
    for found in driven.found:
        print(f"FOUND: {found}")
    return int(bool(driven.found))


def drive(seed: int, seconds: float, with_browser: bool) -> Driven:
    """Drive the app, until something is found or the time is over."""
    driven, chance = Driven(), random.Random(f"{seed}")
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        scene, files = _files(folder)
        app = stack.enter_context(
            AppProcess(folder, scene.photo, scene.model, "--pose", scene.start)
        )
        browser = stack.enter_context(open_browser()) if with_browser else None
        wire = stack.enter_context(page_over_wire(app.url))
        hand = Hand(app.url, chance, files, wire, browser)
        try:
            _rounds(driven, hand, app, folder, scene, seconds)
            for number in reversed(range(len(hand.tabs))):
                hand.close_tab(number)
            wire.close()
            if app.interrupt() != 0:
                raise FoundError("the app did not end as it should")
            _check_log(app)
        except (AssertionError, PoseViewerError, ConnectionClosed) as error:
            driven.found.append(str(error))
            traceback.print_exc()
            print("\n".join(hand.trail[-TRAIL_SHOWN:]))
            print("\n".join(app.lines[-40:]))
            print(wire.shown.notices[-5:])
    return driven


def _files(folder: Path) -> tuple[Scene, Files]:
    """The scene that is open at first, and what is uploaded."""
    places = [folder / name for name in ("scene", "box", "set")]
    for place in places:
        place.mkdir()
    scene, box = make_scene(places[0]), make_scene_of(make_painted(), places[1])
    _, model, _ = write_views(places[2])
    model.unlink()  # it is opened with the one at hand
    broken = {name: folder / name for name in ("no.png", "no.ply", "no.json")}
    for path in broken.values():
        path.write_bytes(b"no such thing \xff\xfe{")
    return scene, Files(
        (scene.photo, box.photo, broken["no.png"]),
        (scene.model, box.model, broken["no.ply"]),
        (scene.start, scene.truth, box.start, broken["no.json"]),
        (places[2],),
    )


def _rounds(
    driven: Driven, hand: Hand, app: AppProcess, folder: Path, scene: Scene, seconds: float
) -> None:
    hand.wire.wait_until(lambda: hand.wire.maps() and "Sheet (PNG)" in hand.wire.labels())
    start = _kept_by_undo(hand, _download(hand.wire))
    if seconds >= LONG_S:
        _use_all(hand)
    began = time.monotonic()
    while time.monotonic() - began < seconds:
        budget = Budget(UNDO_STEPS, UNDO_PHOTOS)
        ends = time.monotonic() + min(ROUND_S, max(began + seconds - time.monotonic(), 1.0))
        for number in range(ROUND_ACTS):
            if time.monotonic() > ends or budget.steps <= 0:
                break
            driven.acts[hand.act(budget)] += 1
            if number % ANSWERS_EVERY == 0:
                waited = _waited_s(app.pid)
                driven.answers_s.append(_answer(hand.wire))
                driven.waits_s.append(_waited_s(app.pid) - waited)
        _rest(hand)
        _check_agreement(hand)
        _check_files(hand, folder, scene)
        for _ in range(UNDONE):
            hand.wire.key("KeyZ")
        pose = _download(hand.wire)
        patience = time.monotonic() + AGREEMENT_S
        while (now := _kept_by_undo(hand, pose)) != start and time.monotonic() < patience:
            pass  # the panels follow the pose
        if now != start:
            differ = {
                k: (start.get(k), now.get(k)) for k in start | now if start.get(k) != now.get(k)
            }
            raise FoundError(f"undo all the way does not give the start: {differ}")
        _check_log(app)
        _check_pages(hand)
        driven.rounds += 1
        statm = Path(f"/proc/{app.pid}/statm").read_text().split()
        held = int(statm[1]) * resource.getpagesize()
        driven.memory.append((time.monotonic() - began, held))


def _use_all(hand: Hand) -> None:
    """Use once, and undo, what takes memory when it is used first and keeps it: what draws figures,
    searches by both methods and over a set, what finds edges, plots, starts, symmetries.
    """
    wire = hand.wire
    for folder in (None, *hand.files.sets):
        if folder is not None:
            wire.upload_set("Folder ...", contents(folder))
            wire.wait_until(lambda: wire.text_with("mean of"))
        wire.report(kind="enlarge", first=0, second=1)
        wire.wait_until(lambda: "As a surface" in wire.labels())
        wire.set("As a surface", True)
        line = [40.0, 30.0, 60.0, 30.0, 80.0, 40.0]
        wire.report(kind="stroke", shape="scribble", points=line, radius=3.0, erase=False)
        for label in USED_FIRST:
            wire.click(label)
            _download(wire)
            wire.wait_until(lambda: not BUSY & wire.labels())
        wire.set("As a surface", False)
        wire.click("Close the large map")
    for _ in range(UNDONE):
        wire.key("KeyZ")
    _rest(hand)


def _answer(wire: SocketPage) -> float:
    """Seconds until the page knows of another look, asked by its key (or by another page's)."""
    label = "Model (1-5, 0)"
    before = wire.value(label)
    began = time.perf_counter()
    for _ in range(PRESSES):
        wire.key("Digit3" if before != "relit" else "Digit2")
        with suppress(AssertionError):  # the key of another page has taken it back at once
            wire.wait_until(lambda: wire.value(label) != before, PRESSED_S)
            return time.perf_counter() - began
    raise FoundError(f"no answer to a key, {PRESSES} times")


def _waited_s(pid: int) -> float:
    """For how long a process's threads, those that are there, stood ready without a processor."""
    waited_ns = 0
    for thread in Path(f"/proc/{pid}/task").iterdir():
        with suppress(OSError):  # it has ended
            waited_ns += int((thread / "schedstat").read_text().split()[1])
    return 1e-9 * waited_ns


def _rest(hand: Hand) -> None:
    """Let go of everything, stop all that runs."""
    wire = hand.wire
    for tab in hand.tabs:
        if hand.down:
            tab.page.mouse.up()
        tab.page.keyboard.press("Escape")
    hand.down = False
    wire.key("Escape")
    if wire.value("Swing"):
        wire.set("Swing", False)
    _download(wire)  # a dialog that was asked for is there
    for label in ("Stop (space)", "Stop looking", "Stop", "Close"):  # dialogs are a page's own
        for uuid, props in list(wire.shown.fields.items()):
            if props.get("label") == label:
                wire.change(uuid, True)
    _download(wire)


def _download(wire: SocketPage) -> Mapping[str, Any]:
    """The pose at hand, once all that was asked for before is done."""
    wire.shown.downloads.clear()

    def found() -> Any:
        for data in list(wire.shown.downloads.values()):
            try:
                return json.loads(data)
            except ValueError:
                pass  # not all of it yet
        return None

    for _ in range(DOWNLOADS):
        wire.click(DOWNLOAD)
        with suppress(AssertionError):  # the Esc of another page has dropped it
            return wire.wait_until(found, DOWNLOAD_S)
    raise FoundError(f"no answer to {DOWNLOAD!r}, {DOWNLOADS} times")


def _kept_by_undo(hand: Hand, pose: Mapping[str, Any]) -> dict[str, Any]:
    """What undo has to bring back: the pose to the last digit, settings, names, objects."""
    kept: dict[str, Any] = {f"pose {key}": pose.get(key) for key in ("camera", "camera_from_model")}
    with page_over_wire(hand.url) as page:
        for uuid, props in page.shown.fields.items():
            is_input = "value" in props and "Button" not in props["kind"]
            known = props.get("label") not in OF_THE_VIEW and uuid != page.shown.channel
            if is_input and known and props.get("visible", True):
                kept[f"{props['kind']} {props.get('label')!r} {uuid}"] = props["value"]
        kept["open"] = page.text_with("triangles")
        kept["objects"] = page.text_with("pv-objects")
    return kept


def _check_agreement(hand: Hand) -> None:
    """A page that comes now is shown what those are shown that were there."""
    wire = hand.wire

    def look() -> list[str]:
        with page_over_wire(hand.url) as new:
            return [
                *differences("input", _echoed(hand, new), new.shown.fields, wire.shown.channel),
                *differences("node", wire.shown.nodes, new.shown.nodes, ""),
                *(text for tab in hand.tabs for text in _wrong_values(tab, new)),
            ]

    last: list[str] = []
    ends = time.monotonic() + AGREEMENT_S
    while time.monotonic() < ends:
        last = look()
        if not last:
            return
    raise FoundError(f"pages do not agree: {last[:4]}")


def _echoed(hand: Hand, new: SocketPage) -> dict[str, Any]:
    """The inputs of the page over the wire, with its own changes that all others are shown: what a
    page is told is not taken back where its change came between.
    """
    fields = dict(hand.wire.shown.fields)
    for uuid, value in hand.sent.items():
        if uuid in fields and _same(new.shown.fields.get(uuid, {}).get("value"), value):
            fields[uuid] = {**fields[uuid], "value": value}
    return fields


def differences(what: str, there: Mapping[str, Any], new: Mapping[str, Any], but: str) -> list[str]:
    """In what two pages differ that is shown on either; ``but``: a name that is left out."""
    found = []
    for name in sorted((there.keys() | new.keys()) - {but}):
        one, other = there.get(name, {}), new.get(name, {})
        if not any(props and props.get("visible", True) for props in (one, other)):
            continue
        for key in sorted(one.keys() | other.keys()):
            if not _same(one.get(key), other.get(key)):
                values = f"{str(one.get(key))[:80]} and {str(other.get(key))[:80]}"
                found.append(f"{what} {other.get('label', name)!r}: {key} is {values}")
    return found


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(np.ravel(one), np.ravel(other))
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other)


def _wrong_values(tab: Any, new: SocketPage) -> list[str]:
    """Inputs in which a tab shows something else."""
    inputs = [
        (uuid, props)
        for uuid, props in new.shown.fields.items()
        if props["kind"]
        in ("GuiNumberMessage", "GuiTextMessage", "GuiCheckboxMessage", "GuiDropdownMessage")
        and props.get("visible", True)
    ]
    shown = tab.page.evaluate(SHOWN_VALUES, [uuid for uuid, _ in inputs])
    wrong = []
    for (_, props), value in zip(inputs, shown, strict=True):
        wanted = props["value"]
        if value is None:
            continue
        if props["kind"] == "GuiNumberMessage":
            try:
                value, wanted = float(value), float(wanted)
            except ValueError:
                continue  # what is typed is no number yet
            rounded = 0.501 * 0.1 ** (props.get("precision") or 0)
            if abs(value - wanted) <= rounded + 1e-6 * abs(wanted):
                continue
        if value != wanted:
            wrong.append(f"{props['label']!r} is {value!r:.60} in Chromium, not {wanted!r:.60}")
    return wrong


def _check_files(hand: Hand, folder: Path, scene: Scene) -> None:
    """What is saved, and what is kept for after a crash, can be read."""
    hand.wire.key("KeyS")
    pose = _download(hand.wire)
    saved = list(folder.rglob("*.pose.json"))
    if not saved:
        raise FoundError("nothing was saved")
    newest = max(saved, key=lambda path: path.stat().st_mtime_ns)
    photo = pose["photo"]
    load_pose(newest, photo["width"], photo["height"])
    if json.loads(newest.read_text())["camera_from_model"] != pose["camera_from_model"]:
        raise FoundError(f"{newest.name} has not the pose at hand")
    for path in (folder / "state" / "sessions").glob("*.json"):
        load_autosave(path)
    for path in folder.rglob("*.png"):
        if (
            path.name != "no.png"
            and "uploads" not in path.parts
            and cv2.imread(str(path), -1) is None
        ):
            raise FoundError(f"{path.name} cannot be read")
    del scene


def _check_log(app: AppProcess) -> None:
    wrong = [line for line in app.lines if any(word in line for word in WRONG_WORDS)]
    if wrong:
        raise FoundError(f"the log says: {wrong[-1]}")


def _check_pages(hand: Hand) -> None:
    errors = [*hand.stale, *(error for tab in hand.tabs for error in tab.errors)]
    errors = [error for error in errors if not any(words in error for words in NOT_OURS)]
    if errors:
        raise FoundError(f"an error on the page: {errors[0]}")
    notices = [text for notice in hand.wire.shown.notices for text in notice]
    wrong = [text for text in notices if any(word in text for word in WRONG_WORDS)]
    if wrong:
        raise FoundError(f"the page says: {wrong[-1]}")
    del hand.wire.shown.notices[:]


if __name__ == "__main__":
    sys.exit(main())
