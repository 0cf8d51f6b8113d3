"""Map the loss around a pose, for all pairs of parameters: a sheet of contours and the numbers."""

from __future__ import annotations

from argparse import Namespace

from poseviewer.cli.case import open_scene
from poseviewer.cli.options import FILES, SCENE, option
from poseviewer.cli.terminal import progress_bar, say
from poseviewer.files.writing import make_folder

OPTIONS = {
    "": (
        *FILES,
        option("--pose POSE.json", "the middle of the maps"),
        option("--object ID", "of the scene: which one"),
        option("--out FOLDER", required=True),
        option("--size POINTS", "a side (41)", default=41),
        option("--range SHARE", "half width (0.2: 20 %%)", default=0.2),
        option("--lock NAME,...", "parameters to leave out"),
    ),
    **SCENE,
}


def run(options: Namespace) -> int:
    """Write ``landscape.png`` and ``landscape.npz``."""
    scene = open_scene(options)
    _ = scene.problem  # says what cannot be mapped before there is a folder
    make_folder(options.out)
    with progress_bar(0, options.quiet) as bar:

        def watch(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        maps = scene.landscape(half_width=options.range, size=options.size, watch=watch)
    sheet, data = options.out / "landscape.png", options.out / "landscape.npz"
    maps.save(sheet)
    maps.save(data)
    say(f"maps: {sheet}\nnumbers: {data}")
    return 0
