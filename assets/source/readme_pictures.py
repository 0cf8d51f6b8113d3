"""Makes the README's pictures from the bundled demo, with poseviewer's own commands.

Run in the tool's environment: ``python readme_pictures.py``; it writes ``demo.jpg``,
``landscape.png`` and ``search.webp`` into ``assets/readme``.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from poseviewer import load
from poseviewer.cli.main import main

ASSETS = Path(__file__).resolve().parent.parent
PHOTO, MODEL = ASSETS / "demo_photo.jpg", ASSETS / "demo_car.glb"
WIDTH = 640
"""px of each of the four pictures."""
ANIMATION_WIDTH, FRAME_MS, END_MS = 800, 160, 1500


def run(*arguments: object) -> None:
    """One command; anything but success ends the script."""
    code = main([str(argument) for argument in arguments])
    if code:
        raise SystemExit(code)


def draw(pose: Path, look: str, folder: Path) -> np.ndarray:
    """One look at a pose, reduced."""
    out = folder / f"{pose.stem}-{look}.png"
    run("overlay", PHOTO, MODEL, "--pose", pose, "--out", out, "--look", look)
    picture = cv2.imread(str(out))
    assert picture is not None
    height = round(picture.shape[0] * WIDTH / picture.shape[1])
    return cv2.resize(picture, (WIDTH, height), interpolation=cv2.INTER_AREA)


def animate_search() -> None:
    """A search of the demo: the outline wherever it finds a better pose."""
    case = load(PHOTO, MODEL, ASSETS / "demo_pose_start.json")
    frames, best = [], np.inf
    for progress in case.search():
        if progress.loss < best:
            best = progress.loss
            picture = Image.fromarray(case.at(progress.pose).picture())
            height = round(picture.height * ANIMATION_WIDTH / picture.width)
            frames.append(picture.resize((ANIMATION_WIDTH, height)))
    frames[0].save(
        ASSETS / "readme" / "search.webp",
        save_all=True,
        append_images=frames[1:],
        duration=[*[FRAME_MS] * (len(frames) - 1), END_MS],
        loop=0,
        quality=72,
    )


def make_pictures(folder: Path) -> None:
    """Fit the demo, then draw it: start and end, relit model and residual, two by two."""
    start, pose = ASSETS / "demo_pose_start.json", folder / "pose.json"
    run("fit", PHOTO, MODEL, "--pose", start, "--out", pose)
    rows = [
        [draw(start, "outline", folder), draw(pose, "outline", folder)],
        [draw(pose, "relit", folder), draw(pose, "residual", folder)],
    ]
    gap = 6
    padded = [
        [np.pad(p, ((0, gap), (0, gap), (0, 0)), constant_values=255) for p in r] for r in rows
    ]
    sheet = np.vstack([np.hstack(row) for row in padded])[:-gap, :-gap]
    readme = ASSETS / "readme"
    readme.mkdir(exist_ok=True)
    cv2.imwrite(str(readme / "demo.jpg"), sheet, [cv2.IMWRITE_JPEG_QUALITY, 88])
    run("landscape", PHOTO, MODEL, "--pose", pose, "--out", folder / "maps", "--size", 21)
    maps = Image.open(folder / "maps" / "landscape.png").convert("RGB")
    maps.quantize(256).save(readme / "landscape.png", optimize=True)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        make_pictures(Path(temporary))
    animate_search()
