"""``assets/docs/pictures/rooms.svg``: the package's rooms, from their import contract.

Run from the repository's root: ``python -m assets.source.rooms``.
"""

import ast
import tomllib
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PICTURE = ROOT / "assets" / "docs" / "pictures" / "rooms.svg"
WIDTH, ROW, GAP, MARGIN = 920, 52, 8, 14
COLOURS = ("#dbe9f6", "#e8f3e1", "#fdf0d5", "#f6e1e1", "#ece4f5")


def layers() -> list[list[str]]:
    """The rooms, a list for each layer, the uppermost first."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    rows = contracts["contracts"][0]["layers"]
    return [[room.strip() for room in row.split("|")] for row in rows]


def purpose(room: str) -> str:
    """The first sentence of a room's docstring."""
    package = ROOT / "poseviewer" / room
    path = package / "__init__.py" if package.is_dir() else package.with_suffix(".py")
    text = ast.get_docstring(ast.parse(path.read_text())) or ""
    return " ".join(text.split("\n\n")[0].split()).rstrip(".")


def rooms_as_svg() -> str:
    """The picture: a row for each layer; a room imports only from rows below its own."""
    boxes = []
    for index, row in enumerate(layers()):
        width = (WIDTH - 2 * MARGIN - (len(row) - 1) * GAP) / len(row)
        y = MARGIN + index * (ROW + GAP)
        for column, room in enumerate(row):
            x = MARGIN + column * (width + GAP)
            words = purpose(room)
            limit = int(width / 6.9)
            if len(words) > limit:
                words = words[: words.rindex(" ", 0, limit)].rstrip(" ,;:") + " ..."
            boxes.append(
                f'<rect x="{x:.0f}" y="{y}" width="{width:.0f}" height="{ROW}" rx="6" '
                f'fill="{COLOURS[index % len(COLOURS)]}" stroke="#555"/>'
                f'<text x="{x + 10:.0f}" y="{y + 21}" font-weight="bold">{room}</text>'
                f'<text x="{x + 10:.0f}" y="{y + 40}" font-size="12">{escape(words)}</text>'
            )
    height = 2 * MARGIN + len(layers()) * (ROW + GAP) - GAP
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" '
        f'font-family="sans-serif" font-size="15">\n'
        f'<rect width="{WIDTH}" height="{height}" fill="white"/>\n'
        + "\n".join(boxes)
        + "\n</svg>\n"
    )


if __name__ == "__main__":
    PICTURE.write_text(rooms_as_svg(), encoding="utf-8")
