"""Typing in real Chromium: what one types is what stands there, and is applied as one edit."""

import asyncio
import json
import random
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import cycle, product
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator

from poseviewer.app.state.document import Document
from poseviewer.app.state.edits import open_document
from poseviewer.app.state.frame_edits import edit_frames
from poseviewer.app.state.objects import add_object
from poseviewer.app.state.session import Session
from poseviewer.files.cameras import Calibration
from poseviewer.files.image_sequence import load_sequence
from tests.app.browser import READY, TWO_FRAMES, AppPage
from tests.app.running_app import RunningApp, running_app
from tests.app.sequences import CAMERA, write_sequence
from tests.app.state import edits as c
from tests.app.state.documents import open_files
from tests.scene import Scene

pytestmark = pytest.mark.slow
WINDOW = (1280, 1200)
"""High enough for every field of a step."""
FIELDS = ".mantine-NumberInput-input:visible, .mantine-TextInput-input:visible"
LABEL = """node => {
    while (!node.querySelector("label")) node = node.parentElement;
    return node.querySelector("label").textContent;
}"""
FOCUS = "document.activeElement.tagName"
BODY = "BODY"
OPEN_JUDGE = """() => {
    const tab = [...document.querySelectorAll("[role=tab]")].find(tab => tab.title === "Judge");
    tab.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
}"""
"""Opens the step as a key that is pressed over the photo does."""
FOCUS_AS_A_VALUE_WAITS = """field => {
    const { messageQueue, requestRender } = window.__viserMutable;
    const updates = { value: 405.5 };
    messageQueue.push({ type: "GuiUpdateMessage", uuid: field.id, updates });
    field.focus();
    requestRender();
}"""
FX = 7
"""Index of the focal length's field among those of its step."""
TEXTS = {
    "Name": "the van's",
    "Note": "left front door dented",
    "Z": "7.123456",
    "turn": "12.34567",
    "Field of view (°)": "41.23456",
    "fx (px)": "312.3456",
    "fy (px)": "312.3457",
    "cx (px)": "122.1234",
    "cy (px)": "91.23456",
    "Max evaluations": "1000000",
    "Time limit (s)": "1234.567",
    "Seed": "1234567",
    "Range ± %": "12.34567",
}
"""Text typed into a field by the begin of its label; else ``USUAL``."""
USUAL = "0.1234567"
OFTEN = "X (unit)", "fx (px)", "Note"
"""Fields that are typed into beside each work."""
HELD_MS = 60
"""A little more than viser holds a value."""
NOT_IN_HISTORY = "Opacity", "Range ± %"
FASTEST_MS, SLOWEST_MS = 40, 150
"""Between two keys: all speeds in fields of ``OFTEN``, the fastest in the others."""
WORK = "rest", "search", "propagation"
STEPS = (
    (1, ("Several objects",)),
    (2, ("Numbers", "Camera")),
    (3, ("Settings",)),
    (4, ()),
    (5, ()),
)
"""Steps of the left panel, and their folders with fields."""


@dataclass
class Typist:
    """A page of a sequence, and the app behind it."""

    tab: AppPage
    running: RunningApp
    base: Document
    """What is open at first: a key in the first frame."""
    begun: Document | None = None
    """What is open after ``begin``."""

    @property
    def session(self) -> Session:
        """The newest session."""
        return self.running.app.session

    @property
    def steps(self) -> int:
        """Number of undo steps."""
        return len(self.session.history.past)

    def press(self, key: str) -> None:
        """Press a key."""
        self.tab.page.keyboard.press(key)

    def begin(self, work: str) -> None:
        """Open what was open at first, at rest or with work under way."""
        app = self.running.app
        number = app._mailbox.post(open_document(self.base, is_first=True))
        if work != "rest":
            edits = {"search": c.toggle_search(), "propagation": edit_frames("to end")}
            number = app._mailbox.post(edits[work])
        self.tab.until(lambda: self.seen >= number and self.is_at(work))
        self.tab.until(lambda: work != "search" or self.session.own_progress)
        self.begun = self.session.document

    @property
    def seen(self) -> int:
        """Number of the last request that the page shows."""
        return self.running.app._page._controls._shown[1]

    def is_at(self, work: str) -> bool:
        """Whether that work, and no other, is under way."""
        at_work = self.session.is_searching, self.session.is_propagating
        return at_work == (work == "search", work == "propagation")

    def field(self, label: str) -> Locator:
        """The field with this label, on a step that is open."""
        fields = self.tab.page.locator(FIELDS)
        labels = fields.evaluate_all(f"all => all.map({LABEL})")
        return fields.nth(labels.index(label))

    def is_told(self) -> bool:
        """Whether the page has the session's newest values."""
        app = self.running.app
        is_shown = all(
            one._shown[0] is app.session and all(own.number <= one._shown[1] for own in one._inputs)
            for one in (app._page._controls, app._page._maps)
        )
        return is_shown and not app._mailbox._items.qsize()

    def value(self, label: str) -> object:
        """The session's value of a field."""
        app = self.running.app
        inputs = (*app._page._controls._inputs, *app._page._maps._inputs)
        return next(own.read(app.session) for own in inputs if own.handle.label == label)

    def type(self, field: Locator, text: str, delay_ms: float = FASTEST_MS) -> None:
        """Type in place of what stands in a field."""
        field.focus()
        self.tab.page.keyboard.press("Control+a")
        self.tab.page.keyboard.type(text, delay=delay_ms)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """That of the sequence."""
    return tmp_path_factory.mktemp("sequence")


@pytest.fixture(scope="module")
def page(browser: Browser, scene: Scene, folder: Path) -> Iterator[Typist]:
    frames, model, camera, start = write_sequence(folder)
    document = open_files(load_sequence(frames), model, start, Calibration(camera))
    state = folder / "state"
    with running_app(scene, state) as running, AppPage(browser, running.url, WINDOW) as tab:
        typist = Typist(tab, running, document)
        running.app._mailbox.post(c.show_style("solid"))  # its opacity is a number
        typist.begin("rest")
        tab.wait_for_text("at this pose")
        for step, folders in STEPS:
            tab.open_step(step)
            for name in folders:
                tab.page.get_by_text(name, exact=True).click()
        yield typist


@pytest.mark.long
def test_what_is_typed_stands_there_and_is_one_edit(page: Typist) -> None:
    """Every field, at speeds and beside work that change from field to field."""
    chance, works = random.Random(1), cycle(WORK)
    typed = set[str]()
    for step, _ in STEPS:
        page.tab.open_step(step)
        page.tab.page.evaluate("new Promise(done => setTimeout(done, 300))")  # folders slide open
        labels = page.tab.page.locator(FIELDS).evaluate_all(f"all => all.map({LABEL})")
        new = [label for label in labels if label not in typed]  # the maps' own are at each step
        beside = {label: WORK if label in OFTEN else (next(works),) for label in new}
        page.begin("rest")
        for work, label in product(WORK, new):
            if work in beside[label]:
                type_into(page, label, work, chance)
        typed.update(new)
    assert {*OFTEN, "Y (unit)", "turn x (°)", "Opacity"} <= typed
    assert set(TEXTS) - {"Z", "turn"} <= typed


def type_into(page: Typist, label: str, work: str, chance: random.Random) -> None:
    """Type into a field beside work, and check it at each moment."""
    text = next((text for name, text in TEXTS.items() if label.startswith(name)), USUAL)
    delay = chance.uniform(FASTEST_MS, SLOWEST_MS) if label in OFTEN else FASTEST_MS
    end = chance.choice(["Enter", "Tab"])
    said = f"{label}, {work}, {delay:.0f} ms, {end}"
    if work != "rest":
        page.begin(work)
    field, begun = page.field(label), page.session.document
    before, steps = page.value(label), page.steps
    page.type(field, text, delay)
    assert field.input_value() == text, said
    assert page.is_at(work), said
    assert page.steps == steps, said  # nothing is applied
    assert work != "rest" or page.session.document is begun, said  # no key led elsewhere
    page.press(end)
    wanted = text if isinstance(before, str) else float(text)
    page.tab.until(lambda: page.value(label) == pytest.approx(wanted) and page.is_told())
    page.tab.page.evaluate(TWO_FRAMES)
    assert page.field(label).input_value() == text, said
    assert page.steps == steps + (label not in NOT_IN_HISTORY), said


def test_what_is_no_number_and_what_is_taken_back_leave_the_old_one(page: Typist) -> None:
    page.tab.open_step(2)
    page.begin("rest")
    for text, end in (("-", "Enter"), ("", "Tab"), ("12", "Escape"), ("-", "Escape")):
        page.type(field := page.field("fx (px)"), text)
        if not text:
            page.press("Delete")
        page.press(end)
        page.tab.until(lambda: field.input_value() == "300")
    page.type(page.field("fx (px)"), "-5")  # it is refused
    page.press("Enter")
    page.tab.wait_for_text("wanted focal lengths")
    page.tab.until(lambda: page.field("fx (px)").input_value() == "300")
    assert page.session.document is page.begun


@pytest.mark.long
def test_what_is_taken_back_soon_after_a_field_was_left_stays_in_the_page(page: Typist) -> None:
    """The page holds it back longer than viser does, also where it was left just before."""
    page.tab.open_step(2)
    page.begin("rest")
    field = page.field("fx (px)")
    for pause_ms in 3 * (0, 10, 20, 30, 40, 50, 60):
        field.focus()
        page.press("Tab")
        page.tab.page.wait_for_timeout(pause_ms)
        page.type(field, "12", 10)
        page.press("Escape")
        page.tab.until(lambda: field.input_value() == "300")
        page.tab.page.wait_for_timeout(HELD_MS)
        assert page.session.document is page.begun, pause_ms


@pytest.mark.long
def test_no_number_is_read_otherwise_than_it_is_written(page: Typist) -> None:
    """What Mantine would make of it, as 1.3905 of 1,390.5, is taken back and said."""
    page.tab.open_step(2)
    page.begin("rest")
    field, keyboard = page.field("fx (px)"), page.tab.page.keyboard
    ends = cycle(("Enter", "Tab"))
    wrong = ("1,390.5", "1.390,5", "1e400", "13a90", "\u2212390", "5-3")
    for text, is_pasted in [*((one, False) for one in wrong), *((one, True) for one in wrong)]:
        page.type(field, "" if is_pasted else text)
        if is_pasted:
            keyboard.insert_text(text)
        page.press(next(ends))
        stood = text.replace(",390.", ".390.") if not is_pasted else text
        page.tab.wait_for_text(f"fx (px): '{stood}' is no number")
        page.tab.until(lambda: field.input_value() == "300" and page.is_told())
        assert page.session.document is page.begun, text
    # A decimal comma, and blanks between thousands, leave a number what it is.
    for text, wanted in (("310,25", 310.25), ("+320.5", 320.5), ("1 330", 1330.0)):
        page.type(field, text)
        page.press("Enter")
        page.tab.until(lambda: page.value("fx (px)") == wanted)  # noqa: B023
    page.type(field, "13a")  # it stays wrong with more letters, and not in a new text
    page.type(field, "340")
    page.press("Enter")
    page.tab.until(lambda: page.value("fx (px)") == 340.0)


def test_each_step_by_arrows_is_one_edit(page: Typist) -> None:
    page.tab.open_step(2)
    page.begin("rest")
    field = page.field("fx (px)")
    page.tab.until(lambda: field.input_value() == "300")
    field.focus()
    page.press("ArrowUp")
    page.tab.until(lambda: page.steps == 1)
    page.press("ArrowUp")
    page.tab.until(lambda: page.steps == 2)
    assert page.session.document.pose.camera == replace(CAMERA, fx=300.02)
    page.press("Escape")
    up = page.tab.page.locator("button[data-direction=up]:visible").nth(FX)
    box = up.bounding_box()
    assert box is not None
    page.tab.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.tab.page.mouse.down()
    page.tab.until(lambda: float(field.input_value()) > 300.1)
    assert page.steps == 2
    page.tab.page.mouse.up()
    page.tab.until(lambda: page.steps == 3 and page.is_told())
    assert field.input_value() == f"{page.value('fx (px)'):g}"
    assert page.tab.page.evaluate(FOCUS) == BODY  # keys are for the photo again


def test_keys_of_a_field_that_goes_lead_nowhere(page: Typist) -> None:
    page.tab.open_step(2)
    page.begin("rest")
    page.type(page.field("fx (px)"), "312")
    page.tab.page.evaluate(OPEN_JUDGE)
    page.tab.page.get_by_text("Opacity").wait_for()
    page.tab.page.keyboard.type(".5")  # else a frame on, and normals
    page.tab.until(lambda: page.session.document.pose.camera == replace(CAMERA, fx=312.0))
    page.tab.page.evaluate(TWO_FRAMES)
    assert page.session.display.style == "solid"
    page.tab.page.mouse.click(*page.tab.on_screen((5.0, 5.0), (CAMERA.width, CAMERA.height)))
    page.press(".")
    page.tab.until(lambda: page.session.document.scene.frame_index == 1)


def test_space_presses_the_button_that_has_the_focus(page: Typist) -> None:
    page.tab.open_step(2)
    page.begin("rest")
    page.running.app._mailbox.post(c.nudge("move", 5.0))
    page.tab.until(lambda: page.steps == 1)
    page.tab.page.get_by_role("button", name="Undo (Z)").focus()
    page.press("Space")
    page.tab.until(lambda: page.session.history.future)
    undone = page.session.document
    page.tab.page.locator(".pv-time").get_by_role("button", name="graph").focus()
    page.press("Space")
    page.tab.until(lambda: page.session.display.motion_graph)
    page.tab.open_step(4)
    slider = page.tab.page.locator("[role=slider][aria-valuemax='1']")
    before = page.session.display.opacity
    slider.focus()
    page.press("ArrowLeft")
    page.tab.until(lambda: page.session.display.opacity < before)
    assert page.session.document is undone
    assert page.session.search is None
    # A press by the mouse leaves the keys to the photo.
    page.tab.page.get_by_role("tab", name="Place").click()
    page.press("Space")
    page.tab.until(lambda: page.session.is_searching)


def test_ctrl_s_saves_what_has_just_been_typed(page: Typist, folder: Path) -> None:
    page.tab.open_step(5)
    page.begin("rest")
    page.type(page.field("Note"), "lamp broken")
    page.press("Control+s")
    path = folder / "frames.m.scene.json"
    page.tab.until(path.exists)
    assert json.loads(path.read_text())["objects"][0]["note"] == "lamp broken"
    page.tab.page.keyboard.type(", door")  # the field keeps the focus
    assert page.field("Note").input_value() == "lamp broken, door"
    page.tab.until(lambda: page.value("Note") == "lamp broken, door")  # also without an end
    assert page.steps == 1


def test_a_note_is_its_objects(page: Typist) -> None:
    page.tab.open_step(5)
    page.begin("rest")
    page.running.app._mailbox.post(add_object())
    row = page.tab.page.locator(".pv-objects tr")
    page.tab.until(lambda: row.count() == 2 and page.is_told())
    page.type(page.field("Note"), "the second")
    row.first.click()
    page.tab.until(lambda: page.session.document.active == 0 and page.is_told())
    notes = [item.note for item in page.session.document.scene.objects]
    assert notes == ["", "the second"]
    page.tab.until(lambda: page.field("Note").input_value() == "")


@pytest.mark.long
def test_another_tab_writes_into_no_field_with_the_focus(page: Typist, browser: Browser) -> None:
    page.tab.open_step(2)
    page.begin("rest")
    field = page.field("fx (px)")
    with AppPage(browser, page.running.url, WINDOW) as tab:
        other = Typist(tab, page.running, page.base)
        tab.page.get_by_text("Camera", exact=True).click()
        theirs = tab.page.get_by_label("fx (px)")
        page.type(field, "31")
        other.type(theirs, "405.5")
        other.press("Enter")
        page.tab.until(lambda: page.value("fx (px)") == 405.5)
        page.tab.page.keyboard.type("2.5", delay=FASTEST_MS)
        assert field.input_value() == "312.5"
        page.press("Enter")
        tab.until(lambda: theirs.input_value() == "312.5")
        # What stood there is what is typed, though others made something else of it.
        field.focus()
        other.type(theirs, "405.5")
        other.press("Enter")
        page.tab.until(lambda: page.value("fx (px)") == 405.5 and page.is_told())
        page.type(field, "312.5")
        page.press("Enter")
        tab.until(lambda: theirs.input_value() == "312.5")
        # What is not typed into shows at last what others made of it.
        field.focus()
        other.type(theirs, "322.5")
        other.press("Enter")
        page.tab.until(lambda: page.value("fx (px)") == 322.5)
        page.press("Tab")
        page.tab.until(lambda: field.input_value() == "322.5")


def test_what_still_waits_for_a_frame_is_not_written_into_the_field(page: Typist) -> None:
    page.tab.open_step(2)
    page.begin("rest")
    field = page.field("fx (px)")
    field.evaluate(FOCUS_AS_A_VALUE_WAITS)
    page.tab.page.evaluate(TWO_FRAMES)
    assert field.input_value() == "300"
    page.type(field, "312.5")
    assert field.input_value() == "312.5"
    page.press("Escape")
    page.tab.until(lambda: field.input_value() == "405.5")


@pytest.mark.long
def test_what_is_typed_outlives_the_connection(page: Typist) -> None:
    page.tab.open_step(5)
    page.begin("rest")
    page.type(page.field("Note"), "before the page came back")
    server = page.running.app._page._server
    (connection,) = server._websock_server._live_connections.values()
    page.tab.page.evaluate("window.isOld = true")
    asyncio.run_coroutine_threadsafe(connection.close(), server.get_event_loop())
    page.tab.page.wait_for_function(f"!window.isOld && ({READY})")
    page.tab.until(lambda: page.value("Note") == "before the page came back")
