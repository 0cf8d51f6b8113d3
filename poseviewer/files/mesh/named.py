"""Find the files that a model names: its material files, textures and buffers."""

import re
import unicodedata
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

TEXTURE_FOLDERS = ("textures", "texture", "maps", "images", "materials")
"""Folders of pictures with programs and model shops: below the model's folder, or beside it."""

NOT_THERE = "is not there; add it to the model's files"
"""End of a note on a file that a model names."""
NO_TEXTURE = f"Texture left out: {{}} {NOT_THERE}."
"""Note on a picture that a model names, and that is nowhere near."""


def missing_textures(notes: Iterable[str]) -> list[str]:
    """Return the names of the pictures that the notes on a model say are not there."""
    start, end = NO_TEXTURE.split("{}")
    return [
        n.removeprefix(start).removesuffix(end)
        for n in notes
        if n.startswith(start) and n.endswith(end)
    ]


def bare_name(written: str) -> str:
    """The file name in a path, as programs on any system write it."""
    return re.split(r"[/\\]", written.strip().strip('"'))[-1]


def plain_name(written: str) -> str:
    """File name in one spelling: small letters, composed accents (macOS takes them apart)."""
    return unicodedata.normalize("NFC", bare_name(written)).casefold()


def find_named(folder: Path, written: str) -> Path | None:
    """Find the file that a model calls ``written``: at its path, beside the model, or near it."""
    for spelling in spellings(written):
        if (found := _find(folder, spelling)) is not None:
            return found
    return None


def spellings(written: str) -> list[str]:
    """A name as read, and, where its bytes are no UTF-8, in the encodings of Windows."""
    raw, names = written.encode("utf-8", "surrogateescape"), [written]
    if not raw.isascii() and "\udc80" <= max(written) <= "\udcff":
        for encoding in ("gb18030", "cp1252"):
            with suppress(UnicodeDecodeError):
                names.append(raw.decode(encoding))
    return names


def _find(folder: Path, written: str) -> Path | None:
    relative = Path(written.strip().strip('"').replace("\\", "/"))
    try:
        for path in (folder / relative, folder / relative.name):
            if path.is_file():
                return path
        wanted = plain_name(written)
        for place in (folder, *(up / n for up in (folder, folder.parent) for n in TEXTURE_FOLDERS)):
            if place.is_dir():
                for path in sorted(place.iterdir()):
                    if plain_name(path.name) == wanted and path.is_file():
                        return path
    except (OSError, ValueError):
        pass  # a name that no file can have, a folder that is not to be read
    return None
