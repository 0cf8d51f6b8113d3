"""The server under attack and load: ``python -m tests.measure.attack --share 1``.

The real app is attacked from this machine, one attack after the other, while its memory is watched.
After each it must still answer a page that looks on, have said nothing but single lines in its log,
and have given most of the memory back. ``--share`` 0.1 does a tenth of everything.
"""

from __future__ import annotations

import argparse
import asyncio
import random
import resource
import sys
import tempfile
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException
from websockets.typing import Origin

from poseviewer.figures.text_table import Table
from tests.app.app_process import AppProcess
from tests.app.running_app import settle
from tests.app.socket_page import PROTOCOL, SocketPage
from tests.scene import Scene, make_scene

MOST_BYTES = 1 << 30
"""What any attack may add to the memory while it lasts."""
MOST_LEFT = 200_000_000
"""What may be left of it afterwards: pages, buffers, what Python keeps."""
WATCHED_S = 0.02
KINDS = 3
"""Some attacks are of three kinds in turn: each comes at least once."""
FOREIGN = Origin("http://evil.example")
SEED = 0


@dataclass(frozen=True)
class Felt:
    """What an attack did."""

    count: int
    seconds: float
    most: int
    """Bytes above what the app had before."""
    left: int
    answer_s: float
    """Until a page that looks on knows of another look."""


class Attacked:
    """The app, a page that looks on, and what can be done to the app."""

    def __init__(self, app: AppProcess, page: SocketPage, scene: Scene) -> None:
        self.app, self.page, self.scene = app, page, scene
        self.address = app.url.rstrip("/").replace("http://", "ws://")

    def foreign_pages(self, count: int) -> None:
        """Of other sites, and by other names of this machine."""

        async def one(number: int) -> None:
            headers = {"Host": "evil.example"} if number % 2 else {}
            try:
                async with connect(self.address, origin=FOREIGN, additional_headers=headers):
                    raise AssertionError("a foreign page got through")
            except WebSocketException:
                pass

        _together(one, count)

    def garbage(self, count: int) -> None:
        """Frames that are no messages."""
        chance = random.Random(SEED)

        async def one(number: int) -> None:
            del number
            async with self._rude_page() as page:
                data = chance.randbytes(chance.randrange(1, 10_000))
                await page.send(data if chance.random() < 0.8 else data.hex())
                with suppress(WebSocketException):
                    async for _ in page:
                        pass

        _together(one, count)

    def bombs(self, count: int) -> None:
        """Messages far larger than any page's, whole and in pieces, and such as unfold."""

        async def one(number: int) -> None:
            async with self._rude_page() as page:
                with suppress(WebSocketException, OSError):
                    if number % 3 == 0:
                        await page.send(60_000_000 * b"\x91")
                    elif number % 3 == 1:
                        await page.send(1_000_000 * b"x" for _ in range(60))  # one frame each
                    else:
                        await page.send(b"\xdd\xff\xff\xff\xff" * 100_000)
                    async for _ in page:
                        pass

        _together(one, count, at_once=8)

    def connections(self, count: int) -> None:
        """Pages that are open at the same time."""

        async def all_of_them() -> None:
            pages = []
            for _ in range(count):
                with suppress(WebSocketException, OSError):
                    pages.append(await self._page())
            await asyncio.sleep(1.0)
            await asyncio.gather(*(page.close() for page in pages))

        asyncio.run(all_of_them())

    def slow_pages(self, count: int) -> None:
        """Pages that read nothing, while another one turns the model."""

        async def all_of_them() -> None:
            pages = [await self._page() for _ in range(count)]
            for page in pages:
                page.transport.pause_reading()
            for _ in range(20):
                for _ in range(25):
                    self.page.key("KeyO")
                await asyncio.sleep(0.1)
            for page in pages:
                page.transport.abort()

        asyncio.run(all_of_them())

    def uploads(self, count: int) -> None:
        """Photos that are none, one after the other, until the last of them is read."""
        rubbish = random.Random(SEED).randbytes(1_000_000)
        for number in range(count):
            self.page.upload("Photo ...", f"{number}.png", rubbish)
        last = f"{count - 1}.png"
        self.page.wait_until(
            lambda: any(text.startswith(last) for _, text in self.page.shown.notices), 300.0
        )
        self.page.click("Download pose")  # is done after those that wait
        self.page.wait_until(lambda: self.page.shown.downloads)

    def announced(self, count: int) -> None:
        """Uploads that are announced and never come, or are larger than was said."""
        for number in range(count):
            size = (190_000_000, 1_000_000, 10**15)[number % 3]
            self.page.upload("Model ...", f"n{number}.glb", b"x" * 2_000_000, size_bytes=size)

    def leavers(self, count: int) -> None:
        """Pages that go in the middle of a drag, an upload, or a search that they began."""
        for number in range(count):
            with SocketPage(self.app.url) as page:
                if number % 3 == 0:
                    page.press(86.0, 60.0)
                    page.drag(90.0, 60.0)
                elif number % 3 == 1:
                    page.upload("Photo ...", "cut.png", b"x" * 600_000, size_bytes=150_000_000)
                else:
                    page.key("Space")
            self.page.key("Escape")

    def reports(self, count: int) -> None:
        """More reports than can be followed."""
        for number in range(count):
            kind = ("press", "drag", "release", "double", "cancel")[number % 5]
            self.page.report(kind=kind, x=float(number % 160), y=60.0, zoom=1.0)
            self.page.report_text(number * "[" if number < 1000 else "[]")

    @asynccontextmanager
    async def _rude_page(self) -> AsyncIterator[ClientConnection]:
        """One that goes without a word."""
        page = await self._page()
        try:
            yield page
        finally:
            with suppress(AttributeError):  # asyncio's: the connection is lost already
                page.transport.abort()

    def _page(self) -> connect:
        return connect(self.address, subprotocols=[PROTOCOL], max_size=None, compression=None)

    def answer(self) -> float:
        """Seconds until the page knows of another look, asked by its key."""
        label = "Model (1-5, 0)"
        code, name = ("Digit5", "residual"), ("Digit2", "solid")
        code, name = code if self.page.value(label) != code[1] else name
        began = time.perf_counter()
        self.page.key(code)
        self.page.wait_until(lambda: self.page.value(label) == name)
        return time.perf_counter() - began

    def memory(self) -> int:
        """Resident, bytes."""
        pages = Path(f"/proc/{self.app.pid}/statm").read_text().split()[1]
        return int(pages) * resource.getpagesize()


ATTACKS: dict[str, tuple[Callable[[Attacked, int], None], int]] = {
    "foreign pages": (Attacked.foreign_pages, 500),
    "garbage frames": (Attacked.garbage, 500),
    "message bombs": (Attacked.bombs, 60),
    "connections at once": (Attacked.connections, 500),
    "pages that read nothing": (Attacked.slow_pages, 50),
    "uploads of rubbish in a row": (Attacked.uploads, 1000),
    "uploads that lie": (Attacked.announced, 100),
    "pages that leave in the middle": (Attacked.leavers, 60),
    "reports without a pause": (Attacked.reports, 20_000),
}
"""What is done, and how often."""


def main() -> int:
    """Attack, and print; exit code 1 where a bound does not hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=1.0, help="of each attack's count")
    parser.add_argument("--only", nargs="*", choices=list(ATTACKS), metavar="ATTACK")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        felt = attack(make_scene(folder), folder, options.share, options.only or list(ATTACKS))
    rows = tuple(
        (name, f"{one.count:,}", f"{one.seconds:.1f}", f"{one.most / 1e6:.0f}",
         f"{one.left / 1e6:.0f}", f"{1000 * one.answer_s:.0f}")
        for name, one in felt.items()
    )  # fmt: skip
    columns = ("attack", "times", "seconds", "most, MB", "left, MB", "answer, ms")
    print(Table("", columns, rows).as_text())
    return int(not all(map(is_bounded, felt.values())))


def is_bounded(felt: Felt) -> bool:
    """Whether the memory stayed within its bounds."""
    return felt.most <= MOST_BYTES and felt.left <= MOST_LEFT


def attack(scene: Scene, folder: Path, share: float, names: list[str]) -> dict[str, Felt]:
    """What each attack did to an app of its own folder.

    Raises:
        AssertionError: something got through, the app answers no more, or its log has more than
            lines.
    """
    found = {}
    with (
        AppProcess(folder, scene.photo, scene.model, "--pose", scene.start) as app,
        SocketPage(app.url) as page,
    ):
        settle(page)
        attacked = Attacked(app, page, scene)
        attacked.answer()
        for name in names:
            run, count = ATTACKS[name]
            found[name] = _felt(attacked, run, max(KINDS, round(count * share)))
            print(f"{name}: {found[name]}", flush=True)
            assert not any("Traceback" in line for line in app.lines), app.lines[-30:]
        assert app.interrupt() == 0
    return found


def _felt(attacked: Attacked, run: Callable[[Attacked, int], None], count: int) -> Felt:
    before, held, over = attacked.memory(), [0], threading.Event()

    def watch() -> None:
        while not over.wait(WATCHED_S):
            held.append(attacked.memory())

    watching = threading.Thread(target=watch)
    watching.start()
    began = time.perf_counter()
    try:
        run(attacked, count)
        seconds = time.perf_counter() - began
        answer = attacked.answer()
    finally:
        over.set()
        watching.join()
    return Felt(count, seconds, max(held) - before, attacked.memory() - before, answer)


def _together(one: Callable[[int], Awaitable[None]], count: int, at_once: int = 50) -> None:
    """``one(number)`` for all numbers, some at a time."""

    async def run() -> None:
        gate = asyncio.Semaphore(at_once)

        async def through(number: int) -> None:
            async with gate:
                await one(number)

        await asyncio.gather(*map(through, range(count)))

    asyncio.run(run())


if __name__ == "__main__":
    sys.exit(main())
