"""What a random driver does with the app's page: in real Chromium, and over the wire as a page's
script does, only faster.
"""

from __future__ import annotations

import random
import string
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser
from playwright.sync_api import Error as BrowserError

from tests.app.browser import AppPage
from tests.app.socket_page import PHOTO, SocketPage

SIZES = (160, 120), (320, 240)
"""Of the photos, and of those of the set, px."""
WINDOWS = ((1400, 900), (1000, 700), (600, 500))
MOST_TABS = 2
RUBBISH = (
    "", "-", "1e308", "-1e308", "1e-320", "nan", "Infinity", "0", "-0", "-1", "9" * 400, "12",
    "179.9", "<b>bold</b><script>document.title='x'</script>", "\u202egpj.x", "a" * 5000, "\x1b[2J",
    "💥 x", "None", "../../x", "%s%n",
)  # fmt: skip
KEYS = (
    "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "j", "l", "i", "k", "u", "o", "PageUp",
    "PageDown", "1", "2", "3", "4", "5", "0", " ", "b", "g", "h", "z", "y", "r", "Escape", "f", "?",
    "Tab", "Enter", "Delete", "a", "n", "p", "w", "d", "q", "e",
)  # fmt: skip
CODES = (
    "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "KeyJ", "KeyL", "KeyI", "KeyK", "KeyU",
    "KeyO", "PageUp", "PageDown", "Digit1", "Digit2", "Digit3", "Digit4", "Digit5", "Digit0",
    "Space", "KeyB", "KeyG", "KeyH", "KeyZ", "KeyZ", "KeyY", "KeyR", "Escape",
)  # fmt: skip
ODD_NUMBERS = (0, -1, 1, 1e308, -1e308, 1e-308, 1e9, 12.5, 300.0, 2**31, 0.1)
PRESSABLE = (
    "button, input, textarea, [role=tab], [role=option], tr[tabindex], .pv-cell, .pv-photo, "
    "svg rect"
)
AT_RANDOM = """([selector, share, options]) => {
    const all = [...document.querySelectorAll(options ? "[role=option]" : selector)].filter(e => {
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
    const kind = found.tagName === "INPUT" ? found.type : found.tagName;
    return {
        at, kind, dropdown: found.getAttribute("aria-haspopup") === "listbox",
        label: (found.getAttribute("aria-label") || found.title || found.textContent || found.id)
            .trim().slice(0, 40),
    };
}"""
"""Something that can be pressed, scrolled to; null where it is covered."""
UPLOADS = {
    "Photo ...": "photos", "Pose file ...": "poses", "Model ...": "models", "Folder ...": "sets",
}  # fmt: skip
DOWNLOAD = "Download pose"
MORE_MODELS = "Add another object ...", "Add a model ..."


def page_over_wire(url: str) -> SocketPage:
    """A page that has been told everything."""
    page = SocketPage(url)
    page.wait_until(lambda: page.is_shown(PHOTO) and DOWNLOAD in page.labels())
    return page


def contents(path: Path) -> list[tuple[str, bytes]]:
    """Name and bytes of a file, or of the files in a folder."""
    paths = sorted(path.iterdir()) if path.is_dir() else [path]
    return [(one.name, one.read_bytes()) for one in paths]


@dataclass
class Files:
    """What is uploaded: good files and bad ones, by what they are taken for."""

    photos: Sequence[Path]
    models: Sequence[Path]
    poses: Sequence[Path]
    sets: Sequence[Path]
    """Folders, each with the photos of one."""


@dataclass
class Budget:
    """What may still be done before undo would no longer reach the start."""

    steps: int
    photos: int


@dataclass
class Hand:
    """Does random things; what it did is in ``trail``, newest last."""

    url: str
    chance: random.Random
    files: Files
    wire: SocketPage
    browser: Browser | None
    tabs: list[AppPage] = field(default_factory=list)
    trail: list[str] = field(default_factory=list)
    models_left: int = 2
    """Of all models that may be uploaded while the app runs: undo keeps four."""
    down: bool = False
    """Whether a tab's main button is held."""
    sent: dict[str, Any] = field(default_factory=dict)
    """What the page over the wire has last changed each input to."""
    stale: list[str] = field(default_factory=list)
    """Errors of tabs that were closed since."""

    def act(self, budget: Budget) -> str:
        """Do one thing; gives its kind."""
        by_wire = self.browser is None or self.chance.random() < 0.4
        if not by_wire and not self.tabs:
            self.open_tab()
        acts: dict[str, tuple[int, Callable[[Budget], str]]] = (
            {
                "reports": (8, self._reports),
                "values": (6, self._values),
                "buttons": (6, self._button),
                "uploads": (2, self._upload),
                "a page that leaves": (1, self._leaver),
            }
            if by_wire
            else {
                "drags in Chromium": (8, self._drag),
                "keys in Chromium": (8, self._key),
                "presses in Chromium": (14, self._press),
                "views in Chromium": (3, self._view),
                "files in Chromium": (1, self._choose_file),
                "tabs of Chromium": (1, self._tabs),
            }
        )
        kind = self.chance.choices(list(acts), [weight for weight, _ in acts.values()])[0]
        try:
            said = acts[kind][1](budget)
        except BrowserError as error:
            if "Timeout" not in str(error):
                raise
            said = f"{kind}: in vain"
        self.trail.append(f"{'wire' if by_wire else 'tab'} {kind}: {said}")
        return kind

    # --- in Chromium -----------------------------------------------------------------------------

    def open_tab(self) -> None:
        """One more tab, with a window of its own."""
        assert self.browser is not None
        self.tabs.append(AppPage(self.browser, self.url, self.chance.choice(WINDOWS)))
        self.tabs[-1].page.set_default_timeout(5_000)

    def close_tab(self, number: int) -> None:
        """Leave a tab, in the middle of whatever it is at."""
        tab = self.tabs.pop(number)
        self.stale += tab.errors
        tab.page.close()
        self.down = False

    def _tab(self) -> AppPage:
        return self.chance.choice(self.tabs)

    def _place(self, tab: AppPage) -> tuple[float, float]:
        left, top, width, height = tab.view()["box"]
        x, y = (0.5 + 0.25 * self.chance.gauss(0.0, 1.0) for _ in range(2))
        x, y = (min(max(share, 0.02), 0.98) for share in (x, y))
        return left + x * max(width, 4.0), top + y * max(height, 4.0)

    def _held(self) -> list[str]:
        return self.chance.choice(([], [], [], ["Shift"], ["Control"], ["Alt"], ["Shift", "Alt"]))

    def _drag(self, budget: Budget) -> str:
        """A drag; now and then one that is not ended, or a double click."""
        budget.steps -= 2
        tab, keys = self._tab(), self._held()
        mouse, keyboard = tab.page.mouse, tab.page.keyboard
        for key in keys:
            keyboard.down(key)
        start, end = self._place(tab), self._place(tab)
        mouse.move(*start)
        if self.chance.random() < 0.15:
            mouse.dblclick(*start)
        else:
            mouse.down()
            mouse.move(*end, steps=self.chance.randint(1, 8))
            self.down = self.chance.random() < 0.1
            if not self.down:
                mouse.up()
        for key in keys:
            keyboard.up(key)
        return f"{keys} {start} to {end}{', held' if self.down else ''}"

    def _key(self, budget: Budget) -> str:
        budget.steps -= 2
        tab, keys, key = self._tab(), self._held(), self.chance.choice(KEYS)
        tab.page.keyboard.press("+".join((*keys, key if key != " " else "Space")))
        return f"{keys} {key}"

    def _press(self, budget: Budget) -> str:
        """Press anything; into a field rubbish is typed."""
        budget.steps -= 3
        tab, options = self._tab(), self.chance.random() < 0.2
        found = tab.page.evaluate(AT_RANDOM, [PRESSABLE, self.chance.random(), options])
        if found is None:
            return "nothing"
        tab.page.mouse.click(*found["at"])
        typed = None
        if found["kind"] in ("text", "TEXTAREA") and not found["dropdown"]:
            typed = self.chance.choice(RUBBISH)
            tab.page.keyboard.press("Control+a")
            tab.page.keyboard.insert_text(typed)
            tab.page.keyboard.press(self.chance.choice(("Enter", "Tab", "Escape")))
        return f"{found['kind']} {found['label']!r} {'' if typed is None else repr(typed[:40])}"

    def _view(self, budget: Budget) -> str:
        del budget
        tab = self._tab()
        what = self.chance.choice(("zoom", "pan", "window", "step"))
        match what:
            case "zoom":
                tab.page.mouse.move(*self._place(tab))
                tab.page.mouse.wheel(0, self.chance.choice((-700, -100, 100, 2000)))
            case "pan":
                tab.page.mouse.move(*self._place(tab))
                tab.page.mouse.down(button="right")
                tab.page.mouse.move(*self._place(tab), steps=3)
                tab.page.mouse.up(button="right")
            case "window":
                width, height = self.chance.choice(WINDOWS)
                tab.page.set_viewport_size({"width": width, "height": height})
            case _:
                tab.open_step(self.chance.randint(1, 5))
        return what

    def _choose_file(self, budget: Budget) -> str:
        label, path = self._file(budget)
        if label is None or label in MORE_MODELS:
            return "none left"
        tab = self._tab()
        if path.is_dir():
            tab.drop_files([path])
            return f"{path.name} dropped"
        tab.open_step(1)
        with tab.page.expect_file_chooser() as chooser:
            tab.page.get_by_role("button", name=label).click()
        chooser.value.set_files(str(path))
        return f"{label} {path.name}"

    def _tabs(self, budget: Budget) -> str:
        """Leave a tab, load it anew, or open one more."""
        del budget
        number = self.chance.randrange(len(self.tabs))
        if len(self.tabs) < MOST_TABS:
            self.open_tab()
            return "another one"
        if self.chance.random() < 0.5:
            self.tabs[number].page.set_default_timeout(120_000)
            self.tabs[number].reload()
            self.tabs[number].page.set_default_timeout(5_000)
            self.down = False
            return "anew"
        self.close_tab(number)
        return "one less"

    # --- over the wire ---------------------------------------------------------------------------

    def _point(self) -> dict[str, float]:
        size = self.chance.choice(SIZES)
        x, y = (side * (0.5 + 0.25 * self.chance.gauss(0.0, 1.0)) for side in size)
        return {"x": x, "y": y}

    def _report(self) -> dict[str, Any]:
        """What a page's script may report."""
        chance = self.chance
        kind = chance.choice(
            ("press", "drag", "drag", "release", "release", "key", "key", "key", "double", "pick",
             "stroke", "object", "model", "part", "enlarge", "cancel", "photo", "photo")
        )  # fmt: skip
        held = {"shift": chance.random() < 0.2, "ctrl": chance.random() < 0.2}
        match kind:
            case "press" | "double":
                return {"kind": kind, **self._point(), "zoom": chance.choice((0.3, 1, 8)), **held}
            case "drag":
                return {"kind": kind, **self._point(), **held}
            case "key":
                repeat = chance.random() < 0.1
                return {"kind": kind, "code": chance.choice(CODES), "repeat": repeat, **held}
            case "pick" | "enlarge":
                first, second = sorted(chance.sample(range(7), 2))
                place = {"u": chance.uniform(-0.1, 1.1), "v": chance.uniform(-0.1, 1.1)}
                return {"kind": kind, "first": first, "second": second, **place}
            case "stroke":
                points = [value for _ in range(9) for value in self._point().values()]
                shape = chance.choice(("brush", "polygon", "scribble"))
                radius, erase = chance.uniform(0.0, 30.0), chance.random() < 0.3
                return {"kind": kind, "shape": shape, "points": points, "radius": radius,
                        "erase": erase}  # fmt: skip
            case "object":
                wishes = ("pick", "pick", "double", "remove", "hide", "show", "lock", "unlock")
                return {"kind": kind, "wish": chance.choice(wishes), "number": chance.randint(0, 4)}
            case "model":
                wish = chance.choice(("show", "show", "drop"))
                return {"kind": kind, "wish": wish, "index": chance.randint(-1, 3)}
            case "part":
                return {"kind": kind, "index": chance.randint(-1, 2)}
            case "photo":
                wish = chance.choice(("look", "look", "compare", "leave"))
                return {"kind": kind, "wish": wish, "index": chance.randint(-1, 3)}
        return {"kind": kind}

    def _reports(self, budget: Budget) -> str:
        reports = [self._report() for _ in range(self.chance.randint(1, 12))]
        budget.steps -= len(reports)
        for report in reports:
            self.wire.report(**report)
        return "; ".join(str(report) for report in reports)

    def _inputs(self) -> list[tuple[str, dict[str, Any]]]:
        """Those that a user could change."""
        return [
            (uuid, props)
            for uuid, props in list(self.wire.shown.fields.items())
            if props.get("visible", True)
            and "value" in props
            and not props.get("disabled")
            and uuid != self.wire.shown.channel
        ]

    def _values(self, budget: Budget) -> str:
        """Another value in some fields, of the kind that a page sends."""
        said, inputs = [], self._inputs()
        for uuid, props in self.chance.sample(inputs, min(len(inputs), self.chance.randint(1, 3))):
            value, kind = props["value"], props["kind"]
            if kind == "GuiNumberMessage":
                near = value * self.chance.uniform(0.8, 1.2) + self.chance.uniform(-0.1, 0.1)
                value = self.chance.choice((near, near, self.chance.choice(ODD_NUMBERS)))
                value = round(value, props.get("precision") or 0)  # as the page does
                self.wire.change(uuid, value)
                if props.get("min") is not None:  # once the field is left
                    value = max(props["min"], min(props["max"], value))
            elif kind == "GuiSliderMessage":
                value = self.chance.uniform(props["min"], props["max"])
            elif kind == "GuiCheckboxMessage":
                value = not value
            elif kind == "GuiDropdownMessage":
                value = self.chance.choice(props["options"])
            elif kind == "GuiTextMessage":
                value = self.chance.choice((*RUBBISH, *string.ascii_letters))
            else:
                continue
            budget.steps -= 1
            self.wire.shown.fields[uuid]["value"] = self.sent[uuid] = value
            self.wire.change(uuid, value)
            said.append(f"{props['label']!r} = {str(value)[:30]}")
        return ", ".join(said)

    def _button(self, budget: Budget) -> str:
        budget.steps -= 3
        kinds = ("GuiButtonMessage", "GuiButtonGroupMessage")
        found = [(u, p) for u, p in list(self.wire.shown.fields.items()) if p.get("kind") in kinds]
        found = [(u, p) for u, p in found if p.get("visible", True) and not p.get("disabled")]
        uuid, props = self.chance.choice(found)
        options = props.get("options")
        value = self.chance.choice(options) if options else True
        self.wire.change(uuid, value)
        return f"{props['label']!r} {value if options else ''}"

    def _file(self, budget: Budget) -> tuple[str | None, Path]:
        kinds = dict(UPLOADS)
        if self.models_left <= 0:
            del kinds["Model ..."]
        else:
            kinds |= dict.fromkeys(MORE_MODELS, "models")
        if budget.photos <= 0:
            del kinds["Photo ..."], kinds["Folder ..."]
        label = self.chance.choice(list(kinds))
        path = self.chance.choice(getattr(self.files, kinds[label]))
        budget.steps -= 2
        budget.photos -= kinds[label] in ("photos", "sets")
        self.models_left -= kinds[label] == "models"
        return label, path

    def _upload(self, budget: Budget) -> str:
        label, path = self._file(budget)
        assert label is not None
        files = contents(path)
        if self.chance.random() < 0.3:
            which = self.chance.randrange(len(files))
            name, data = files[which]
            at = self.chance.randrange(len(data))
            files[which] = name, data[:at] + self.chance.randbytes(3) + data[at + 3 :]
        if len(files) == 1 and self.chance.random() < 0.5:
            files[0] = "<b>&\u202e.x" + path.suffix, files[0][1]
        self.wire.upload_set(label, files)
        return f"{label} {path.name}"

    def _leaver(self, budget: Budget) -> str:
        """A page that goes in the middle of a drag, an upload, or a search that it began."""
        budget.steps -= 3
        doing = self.chance.choice(("a drag", "an upload", "a search"))
        with page_over_wire(self.url) as page:
            if doing == "a drag":
                page.press(*self._point().values())
                page.drag(*self._point().values())
            elif doing == "an upload":
                page.upload("Pose file ...", "x.json", b"{", part_count=2, size_bytes=600_000)
            else:
                page.key("Space")
        return doing
