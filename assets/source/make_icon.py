"""Draw the browser-tab icon: a wireframe cube inside the corners of a photo frame.

    python make_icon.py

Writes `icon.svg` and `icon.png` (64 px) from the same lines; needs numpy and Pillow.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

ASSETS = Path(__file__).resolve().parent.parent
SIZE = 64
GROUND, FRAME, CUBE, FAR = "#16202e", "#f2b441", "#7cc4ff", "#3f6f99"
Line = tuple[np.ndarray, str, float]


def lines() -> list[Line]:
    """Strokes in 0..64 units: (points (n,2), colour, width)."""
    out: list[Line] = []
    for sx in (-1, 1):
        for sy in (-1, 1):
            corner = np.array([[sx * 14, sy * 25], [sx * 25, sy * 25], [sx * 25, sy * 14]]) + 32.0
            out.append((corner, FRAME, 4.0))
    turn = np.radians(28)
    c, s = np.cos(turn), np.sin(turn)
    right, down = np.array([c, 0, s]), np.array([0.42 * s, 0.92, -0.42 * c])
    cube = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    flat = np.stack([cube @ right, cube @ down], 1) * 12.0 + 32.0
    nearness = cube @ np.cross(right, down)
    hidden = int(np.argmax(nearness))
    edges = [(i, j) for i in range(8) for j in range(i) if np.abs(cube[i] - cube[j]).sum() == 2]
    for far in (True, False):  # near edges last, on top
        for i, j in edges:
            if (hidden in (i, j)) == far:
                out.append((flat[[i, j]], FAR if far else CUBE, 2.2 if far else 3.2))
    return out


def main() -> None:
    """Write both files."""
    strokes = lines()
    body = "\n".join(
        f'  <polyline points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in points)}" stroke="{colour}" '
        f'stroke-width="{width}"/>'
        for points, colour, width in strokes
    )
    (ASSETS / "icon.svg").write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIZE} {SIZE}" fill="none" '
        f'stroke-linecap="round" stroke-linejoin="round">\n'
        f'  <rect width="{SIZE}" height="{SIZE}" rx="12" fill="{GROUND}"/>\n{body}\n</svg>\n'
    )
    k = 8
    image = Image.new("RGBA", (SIZE * k, SIZE * k), (0, 0, 0, 0))
    draw = ImageDraw.Draw(image)
    draw.rounded_rectangle((0, 0, SIZE * k - 1, SIZE * k - 1), 12 * k, fill=GROUND)
    for points, colour, width in strokes:
        draw.line(
            [tuple(p * k) for p in points], fill=colour, width=round(width * k), joint="curve"
        )
        for x, y in points * k:
            r = width * k / 2
            draw.ellipse((x - r, y - r, x + r, y + r), fill=colour)
    image.resize((SIZE, SIZE), Image.Resampling.LANCZOS).save(ASSETS / "icon.png", optimize=True)


if __name__ == "__main__":
    main()
