"""Write a file whole or not at all, lock one, make a folder for results, and fingerprint a file."""

import hashlib
import json
import os
import re
import secrets
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO, Any

import msgspec

from poseviewer.errors import PoseFileError, PoseViewerError

OLD_PART_S = 600.0
"""Age (s) of a file half written at which nobody writes it any more."""
MAX_PART_LETTERS = 100
"""Characters of a name on disk: file systems take 255 bytes."""
NO_NAME = '<>:"|?*'
"""Characters that names cannot hold on Windows."""
RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
_kept: set[tuple[int, int, int]] = set()
"""Device, inode and time of the user's own files that were read."""


def keep(path: Path) -> None:
    """Let no later output replace a file of the user's, by whatever name."""
    with suppress(OSError, ValueError):
        _kept.add(_identity(path.stat()))


@contextmanager
def keeping(paths: Iterable[Path]) -> Iterator[None]:
    """Keep these files, and those read inside the ``with`` block, as long as it lasts."""
    before = set(_kept)
    for path in paths:
        keep(path)
    try:
        yield
    finally:
        _kept.intersection_update(before)


def _identity(status: os.stat_result) -> tuple[int, int, int]:
    return status.st_dev, status.st_ino, status.st_mtime_ns


def require_replaceable(path: Path, error: type[PoseViewerError], *, is_own: bool = False) -> None:
    """Raise unless ``path`` is free, or a regular file that is no link, and not kept or our own."""
    if path.is_symlink():  # the file it leads to may be anyone's
        raise error(f"{path}: is a link and was not written through; name the file itself.")
    if not path.exists():
        return
    if not path.is_file():  # a device would be a file from then on
        what = "a folder" if path.is_dir() else "no regular file"
        raise error(f"{path}: is {what} and was not replaced; name another.")
    if not is_own and _identity(path.stat()) in _kept:
        raise error(f"{path}: is read as an input and was not replaced; write to another file.")


@contextmanager
def writing_to(folder: Path, name: str, error: type[PoseViewerError]) -> Iterator[None]:
    """Turn an OSError into an ``error`` that says what cannot be written, and where."""
    try:
        yield
    except OSError as problem:
        wanted = "check that there is room, and that the folder exists and is yours to write to"
        found = f"cannot be written to {folder} ({problem.strerror})"
        raise error(f"{name}: {found}; {wanted}.") from problem


def write_whole(
    path: Path, data: bytes, error: type[PoseViewerError], *, is_own: bool = False
) -> None:
    """Write beside ``path`` and then rename, so that no reader sees half a file.

    Args:
        path: file to write.
        data: its content.
        error: type of the error where it cannot be written.
        is_own: whether a file that was read may be replaced.
    """
    with writing_to(path.parent, path.name, error):
        require_replaceable(path, error, is_own=is_own)
    start = f".{path.name[:40]}."
    temporary = path.with_name(f"{start}{secrets.token_hex(4)}.part")
    try:
        with writing_to(path.parent, path.name, error):
            for entry in os.scandir(path.parent):
                if entry.name.startswith(start) and entry.name.endswith(".part"):
                    with suppress(OSError):
                        if time.time() - entry.stat().st_mtime > OLD_PART_S:
                            Path(entry).unlink()
            with temporary.open("xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            if path.exists():
                temporary.chmod(path.stat().st_mode & 0o777)
            temporary.replace(path)
    finally:
        with suppress(OSError):
            temporary.unlink()


def write_json(
    path: Path, data: Any, error: type[PoseViewerError], *, indent: int = 2, is_own: bool = False
) -> None:
    """Write what JSON can hold, in UTF-8, as ``write_whole`` does.

    Args:
        path: file to write.
        data: its entries.
        error: type of the error where it cannot be written.
        indent: spaces of a level.
        is_own: whether a file that was read may be replaced.
    """
    write_whole(path, json_bytes(path, data, error, indent=indent), error, is_own=is_own)


def json_bytes(
    path: Path, data: Any, error: type[PoseViewerError], *, indent: int | None = 2,
    rows: str = "", **first: Any,
) -> bytes:  # fmt: skip
    """Encode a dict or a struct, after the entries ``first``, as the text of a JSON file.

    Args:
        path: file, for messages.
        data: entries.
        error: type of the error where a number is not finite.
        indent: spaces of a level; None: all in one line.
        rows: key of a list that stands last, an entry a line; may be missing.
        first: entries before those of ``data``.
    """
    encode = partial(json.dumps, allow_nan=False, ensure_ascii=False)
    try:
        entries = {**first, **msgspec.to_builtins(data, enc_hook=float)}
        lines = ",\n".join(map(encode, entries.pop(rows, ())))
        text = encode(entries, indent=indent)
        if lines:
            margin = " " * (indent or 0)
            text = f'{text[:-2]},\n{margin}"{rows}": [\n{lines}\n{margin}]\n}}'
    except (ValueError, TypeError) as problem:
        found = f"{path.name}: holds what JSON cannot ({problem})"
        raise error(f"{found}; nothing was written.") from problem
    return (text + "\n").encode(errors="replace")


def open_to_append(path: Path) -> IO[bytes]:
    """Open a file to append to, through no link and without waiting at a pipe.

    Raises:
        OSError: that cannot be.
    """
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT
    for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"):
        flags |= getattr(os, name, 0)
    return os.fdopen(os.open(path, flags, 0o666), "ab")


def append(path: Path, data: bytes) -> None:
    """Append to a file, or leave it as long as it was, so that no later line goes on from half a
    one.

    Raises:
        OSError: the data cannot be written.
    """
    with open_to_append(path) as file:
        before, left = os.fstat(file.fileno()).st_size, memoryview(data)
        try:
            while left:
                left = left[os.write(file.fileno(), left) :]
        except OSError:
            os.ftruncate(file.fileno(), before)
            raise


def lock_file(path: Path) -> IO[bytes] | None:
    """Open ``path``, locked while open; None where another process has it.

    Raises:
        OSError: it cannot be opened.
    """
    file = open_to_append(path)
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if not os.fstat(file.fileno()).st_nlink:  # its holder removed it as it ended
                raise BlockingIOError
    except (BlockingIOError, PermissionError):
        file.close()
        return None
    except OSError:
        pass  # a disk without locks: as good as it goes
    return file


def make_folder(
    folder: Path, error: type[PoseViewerError] = PoseFileError, *, parents: bool = True
) -> None:
    """Make a folder, and with ``parents`` those above it, unless it is there."""
    try:
        folder.mkdir(parents=parents, exist_ok=True)
    except OSError as problem:
        found = f"{folder}: cannot be made ({problem.strerror})"
        raise error(f"{found}; name a folder of yours.") from None


@contextmanager
def making_folder(folder: Path, error: type[PoseViewerError] = PoseFileError) -> Iterator[None]:
    """Make a folder and those above it; remove them at the end where nothing was written there."""
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    make_folder(folder, error)
    try:
        yield
    finally:
        with suppress(OSError):  # not empty
            for path in made:
                path.rmdir()


def sha256_of(path: str | Path) -> str:
    """Return the SHA-256 of a file's bytes in hexadecimal, read piece by piece.

    Raises:
        OSError: the file cannot be read.
    """
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def safe_path(name: str) -> PurePosixPath:
    """A path from a browser or a zip as one that any system can have, and that never leads out."""
    parts = [_safe_part(part) for part in re.split(r"[/\\]", name)]
    return PurePosixPath(*[part for part in parts if part] or ["unnamed"])


def _safe_part(part: str) -> str:
    part = "".join(c if c.isprintable() and c not in NO_NAME else "_" for c in part).strip()
    part = part.rstrip(". ")
    if len(part) > MAX_PART_LETTERS:
        part = f"{part[: MAX_PART_LETTERS // 2]}{part[-MAX_PART_LETTERS // 2 :]}"
    return f"_{part}" if RESERVED.fullmatch(part) else part
