"""Files that come from a browser: checked, and kept under names that poseviewer gives."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Collection
from pathlib import Path
from typing import Literal

from poseviewer.errors import MeshFileError, PhotoFileError, PoseFileError, PoseViewerError
from poseviewer.files.mesh.load import READERS
from poseviewer.files.writing import write_whole

Kind = Literal["photo", "model", "pose"]

LARGEST_UPLOAD = 200_000_000
"""Bytes: viser holds an upload in memory."""
KEPT = 20
"""Newest uploads that stay."""
LONGEST_NAME = 80
ENDINGS: dict[Kind, tuple[str, ...]] = {
    "photo": (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp"),
    "model": tuple(READERS),
    "pose": (".json",),
}
ERRORS: dict[Kind, type[PoseViewerError]] = {
    "photo": PhotoFileError,
    "model": MeshFileError,
    "pose": PoseFileError,
}
FOLDER_NAME = re.compile(r"[0-9a-f]{16}")


def keep_upload(
    folder: Path,
    name: str,
    data: bytes,
    kind: Kind,
    largest_bytes: int = LARGEST_UPLOAD,
    kept: int = KEPT,
    in_use: Collection[Path] = (),
) -> Path:
    """Keep an uploaded file in ``folder`` as ``<its fingerprint>/<kind><ending>``.

    Of the name that the browser gives only the ending is used, and only as a choice among
    ``ENDINGS``. The same bytes go to the same place. All but the ``kept`` newest and those
    ``in_use`` (paths that this function gave) are removed.

    Raises:
        PoseViewerError: the kind's own: empty, too large, of an unknown ending, or the folder
            cannot be written to.
    """
    error, shown = ERRORS[kind], display_name(name)
    ending = _known_ending(name, kind)
    if ending is None:
        known = ", ".join(ENDINGS[kind])
        raise error(f"{shown}: not the name of a {kind} file; wanted one that ends in {known}.")
    if not data:
        raise error(f"{shown}: an empty file; wanted a {kind}, choose another file.")
    problem = too_large(shown, len(data), largest_bytes)
    if problem:
        raise error(problem)
    place = folder / hashlib.sha256(data).hexdigest()[:16]
    path = place / f"{kind}{ending}"
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_whole(path, data, error)
        place.touch()
        _remove_old(folder, kept, {place.name, *(used.parent.name for used in in_use)})
    except OSError as failed:
        raise error(
            f"{shown}: cannot be kept in {folder} ({failed.strerror}); check that the folder is "
            "yours to write to."
        ) from failed
    return path


def too_large(name: str, size: int, largest: int = LARGEST_UPLOAD) -> str:
    """Why ``size`` bytes of a file, shown as ``name``, are too many; "" where they are not."""
    if size <= largest:
        return ""
    return (
        f"{name}: {size:,} bytes; up to {largest:,} can be uploaded, make it smaller or start "
        "poseviewer with its path."
    )


def why_unfit(name: str, size: int) -> str:
    """Why a page's file, with the name and size (bytes) that the browser gives, is not taken."""
    known = ", ".join(ending for endings in ENDINGS.values() for ending in endings)
    shown = display_name(name)
    return too_large(shown, size) or (
        f"{shown}: not the name of a photo, a model or a pose file; wanted one that "
        f"ends in {known}."
    )


def display_name(name: str) -> str:
    """A name from a browser as text that is safe to show: one line, at most 80 characters."""
    last = re.split(r"[/\\]", name)[-1]
    # No control, format (which can turn the reading direction) or lone surrogate characters.
    shown = " ".join("".join(c if c.isprintable() else " " for c in last).split())
    if len(shown) > LONGEST_NAME:
        half = LONGEST_NAME // 2 - 1
        shown = f"{shown[:half]}…{shown[-half:]}"
    return shown or "unnamed"


def _known_ending(name: str, kind: Kind) -> str | None:
    return next((e for e in ENDINGS[kind] if name.lower().endswith(e)), None)


def _remove_old(folder: Path, kept: int, needed: set[str]) -> None:
    """Remove all but the newest; only what looks like ours."""
    ours = [p for p in folder.iterdir() if FOLDER_NAME.fullmatch(p.name) and not p.is_symlink()]
    ours.sort(key=lambda place: place.stat().st_mtime_ns, reverse=True)
    for place in ours[kept:]:
        if place.name not in needed:
            shutil.rmtree(place, ignore_errors=True)
