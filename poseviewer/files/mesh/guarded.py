"""Readers whose libraries can end the process, each call in a process of its own."""

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from poseviewer.errors import MeshFileError, PoseViewerError
from poseviewer.files.mesh.parts import Part

Read = tuple[list[Part], list[str]]
DEADLINE_S, BYTES_PER_S = 20.0, 250_000
"""Time that a reader may take, and longer by a second for so many bytes of the file."""
MOST_MEMORY, PER_BYTE = 4_000_000_000, 40
"""Bytes that a reader may take, and more for each byte of the file."""


def guarded(reader: Callable[[Path], Read]) -> Callable[[Path], Read]:
    """Return the reader with a deadline and a bound of memory, in a process of its own: what ends
    that process is a MeshFileError here.
    """

    def read(path: Path) -> Read:
        size = path.stat().st_size
        call = (reader.__module__, reader.__name__, path, MOST_MEMORY + PER_BYTE * size)
        code = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import answer; answer()"
        command, seconds = [sys.executable, "-c", code], DEADLINE_S + size / BYTES_PER_S
        try:
            done = subprocess.run(
                command,
                input=pickle.dumps(call),
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                timeout=seconds,
                check=True,
            )
        except subprocess.TimeoutExpired:
            found = f"its reader was not done after {seconds:.0f} s and was stopped"
            raise MeshFileError(f"{path.name}: {found}; export it again, or as GLB.") from None
        except subprocess.CalledProcessError:
            found = "its reader ended at it: damaged, or too large for the memory"
            raise MeshFileError(f"{path.name}: {found}; export it again, or as GLB.") from None
        result = pickle.loads(done.stdout)
        if isinstance(result, PoseViewerError):
            raise result
        return result

    return read


def answer() -> None:
    """Call the reader that the standard input names; write what it returns, or its error."""
    module, name, path, memory = pickle.load(sys.stdin.buffer)
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries print
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    result: Any
    try:
        result = getattr(import_module(module), name)(path)
    except PoseViewerError as error:
        result = error
    with out:
        out.write(pickle.dumps(result))
