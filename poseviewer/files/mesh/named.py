"""Find the files that a model names: its material files, textures and buffers."""

import re
import unicodedata
from pathlib import Path

TEXTURE_FOLDERS = ("textures", "texture", "maps", "images", "materials")
"""Folders of pictures with programs and model shops: below the model's folder, or beside it."""


def bare_name(written: str) -> str:
    """The file name in a path, as programs on any system write it."""
    return re.split(r"[/\\]", written.strip().strip('"'))[-1]


def plain_name(written: str) -> str:
    """File name in one spelling: small letters, composed accents (macOS takes them apart)."""
    return unicodedata.normalize("NFC", bare_name(written)).casefold()


def find_named(folder: Path, written: str) -> Path | None:
    """The file that a model (or its material file) in ``folder`` calls ``written``, or None.

    Sought by its path, by its bare name beside the model, and in any spelling in usual folders.
    """
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
