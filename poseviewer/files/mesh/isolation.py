"""Readers whose libraries can end the process, each call in a process of its own."""

import subprocess
from collections.abc import Callable
from pathlib import Path

from poseviewer.errors import MeshFileError
from poseviewer.files.checks import InputFile, quiet_libraries
from poseviewer.files.mesh.parts import ModelParts
from poseviewer.processes import call_in_subprocess

DEADLINE_S, BYTES_PER_S = 20.0, 250_000
"""Time that a reader may take, and longer by a second for so many bytes of the file."""
MAX_MEMORY_BYTES, PER_BYTE = 4_000_000_000, 40
"""Bytes that a reader may take, and more for each byte of the file."""


def isolate(reader: Callable[[Path], ModelParts]) -> Callable[[Path], ModelParts]:
    """Return the reader with a deadline and a bound of memory, in a process of its own: what ends
    that process is a MeshFileError here.
    """

    def read(path: Path) -> ModelParts:
        size = path.stat().st_size
        seconds, memory = DEADLINE_S + size / BYTES_PER_S, MAX_MEMORY_BYTES + PER_BYTE * size
        try:
            return call_in_subprocess(_read, reader, path, seconds=seconds, memory=memory)
        except subprocess.TimeoutExpired:
            found = f"its reader was not done after {seconds:.0f} s and was stopped"
        except subprocess.CalledProcessError:
            found = "its reader ended at it: damaged, or too large for the memory"
        raise MeshFileError(f"{path.name}: {found}; export it again, or as GLB.") from None

    return read


def _read(reader: Callable[[Path], ModelParts], path: Path) -> ModelParts:
    kind = f"{path.suffix[1:].upper()} file"
    with InputFile(path, [], MeshFileError, kind).naming_errors(), quiet_libraries():
        return reader(path)
