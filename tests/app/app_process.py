"""The real app as a process of its own, for tests and measurements."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

from tests.ctrl_c import ctrl_c_ends_them

REPOSITORY = Path(__file__).resolve().parent.parent.parent
PATIENCE_S = 120.0
ADDRESS = re.compile(r"http://\S+")
MAP_SIZE = 11
"""Points along a side of the finest maps, of 41: maps take most of the time of a page at rest."""
COMMAND_LINE = f"""
import sys
from poseviewer.app.workers import maps
from poseviewer.cli.main import main
maps.SIZE = {MAP_SIZE}
sys.exit(main())
"""


class AppProcess:
    """``poseviewer ... --no-browser``; its state and what it saves are in ``folder``."""

    def __init__(
        self, folder: Path, *arguments: str | Path, port: int = 0, has_fine_maps: bool = False
    ) -> None:
        """``port`` 0: any free one; ``has_fine_maps``: as users have them."""
        program = ["-m", "poseviewer.cli.main"] if has_fine_maps else ["-c", COMMAND_LINE]
        command = [sys.executable, *program, *map(str, arguments)]
        state = str(folder / "state")
        self.folder = folder
        with ctrl_c_ends_them():
            self._process = subprocess.Popen(
                [*command, "--no-browser", "--port", str(port)],
                cwd=folder,
                env={**os.environ, "POSEVIEWER_STATE": state, "PYTHONPATH": str(REPOSITORY)},
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                start_new_session=True,
            )
        self.lines: list[str] = []
        """All that it has printed."""
        self._found = threading.Event()
        self.url = ""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        if not self._found.wait(PATIENCE_S) or not self.url:
            self.kill()
            raise AssertionError(f"no address in {self.lines}")

    def __enter__(self) -> AppProcess:
        return self

    def __exit__(self, *_: object) -> None:
        if self.running:
            self.kill()

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    def kill(self) -> None:
        """End it as a crash would."""
        self._signal(signal.SIGKILL)

    def interrupt(self) -> int:
        """End it as Ctrl-C would; gives its exit code."""
        return self._signal(signal.SIGINT)

    def terminate(self) -> int:
        """Ask it to end; gives its exit code."""
        return self._signal(signal.SIGTERM)

    def leaves_nothing(self) -> bool:
        """Whether no process of its group is left."""
        try:
            os.killpg(self._process.pid, 0)
        except ProcessLookupError:
            return True
        return False

    def _signal(self, number: signal.Signals) -> int:
        self._process.send_signal(number)
        code = self._process.wait(PATIENCE_S)
        self._reader.join(PATIENCE_S)
        if self._process.stdout is not None:
            self._process.stdout.close()
        return code

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.lines.append(line.rstrip("\n"))
            found = ADDRESS.search(line)
            if found and not self.url:
                self.url = found.group(0)
                self._found.set()
        self._found.set()
