"""Readers whose libraries can end the process, each call in a process of its own."""

import subprocess
from collections.abc import Callable
from pathlib import Path

from poseviewer.errors import MeshFileError
from poseviewer.files.checks import InputFile, quiet_libraries
from poseviewer.files.mesh.parts import ModelParts
from poseviewer.processes import call_in_subprocess

DEADLINE_S = 20.0
"""Time that a reader may take for a small file."""
BYTES_PER_S = 250_000
"""Bytes of a file that give its reader a second more."""
MAX_MEMORY_BYTES = 4_000_000_000
"""Memory that a reader may take for a small file."""
MEMORY_PER_BYTE = 40
"""Memory that a reader may take for each byte of the file besides."""


def isolate(reader: Callable[[Path], ModelParts]) -> Callable[[Path], ModelParts]:
    """Run a reader in a process of its own, within a deadline and a bound of memory."""

    def read(path: Path) -> ModelParts:
        size = path.stat().st_size
        seconds, memory = DEADLINE_S + size / BYTES_PER_S, MAX_MEMORY_BYTES + MEMORY_PER_BYTE * size
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
