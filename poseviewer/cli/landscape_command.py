"""Map the loss around a pose, for all pairs of parameters: a sheet of contours and the numbers."""

from argparse import Namespace

from poseviewer.cli import options as table
from poseviewer.cli.case import open_scene
from poseviewer.cli.terminal import progress_bar, say
from poseviewer.files.writing import make_folder

OPTIONS = {
    "": (
        *table.FILES,
        table.POSE,
        table.OBJECT,
        table.option("--out FOLDER", required=True),
        table.option("--size POINTS", "a side (41)", default=41),
        table.option("--range SHARE", "half width (0.2: 20 %%)", default=0.2),
        table.option("--lock NAME,...", "parameters to leave out"),
    ),
    **table.SCENE,
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
