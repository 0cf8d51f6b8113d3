"""viser's archive of icons, opened once for all of a page's.

Why: viser lists the archive's four thousand entries anew for every icon: a quarter of a second of
the app's start.
Written for viser 1.1.1: ``_icons.ICONS_DIR``, and the module ``zipfile`` as ``_icons`` knows it.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from types import SimpleNamespace
from typing import Any

from viser import _icons

ARCHIVE = "tabler-icons.zip"


@contextmanager
def icons_opened_once() -> Iterator[None]:
    """Inside the ``with`` block icons are read from one open archive."""
    with zipfile.ZipFile(_icons.ICONS_DIR / ARCHIVE) as archive:
        opened: Any = SimpleNamespace(ZipFile=lambda _: nullcontext(archive))
        _icons.zipfile = opened  # pyright: ignore[reportPrivateImportUsage]
        try:
            yield
        finally:
            _icons.zipfile = zipfile  # pyright: ignore[reportPrivateImportUsage]
