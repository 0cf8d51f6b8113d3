"""Files that tests write, and values that they change in them."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any


def write(path: Path, content: object) -> Path:
    """Write bytes, a text, or anything else as JSON, with the folders above; returns the path."""
    if not isinstance(content, bytes):
        content = (content if isinstance(content, str) else json.dumps(content)).encode()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def edit(path: Path, change: Callable[[Any], object]) -> Path:
    """Change the values of a JSON file in place; returns its path."""
    data = json.loads(path.read_text())
    change(data)
    return write(path, data)
