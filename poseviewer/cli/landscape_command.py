"""Map the loss about a pose for all pairs of parameters, as contour plots and as numbers."""

from argparse import Namespace

from poseviewer.cli import options as table
from poseviewer.cli.case import load_named
from poseviewer.cli.terminal import progress_bar, say
from poseviewer.files.writing import make_folder

OPTIONS = {
    "": (
        *table.FILES,
        table.POSE,
        table.OBJECT,
        table.METHODS[0],
        table.option("--out FOLDER", "write landscape.png and landscape.npz here", required=True),
        table.option("--size POINTS", "compute points a side (default: 41)", default=41),
        table.option("--range SHARE", "go so far, in shares of scales (default: 0.2)", default=0.2),
        table.option("--lock NAME,...", "leave out these pose parameters (default: none)"),
    ),
    **table.SCENE,
}
EXAMPLES = (
    "poseviewer landscape photo.jpg car.glb --pose pose.json --out maps",
    "poseviewer landscape shelf.scene.json --object duck --out maps --size 21 --range 0.1",
)


def run(options: Namespace) -> int:
    """Write ``landscape.png`` and ``landscape.npz``."""
    registration = load_named(options)
    _ = registration.problem  # says what cannot be mapped before there is a folder
    make_folder(options.out)
    with progress_bar(0, options.quiet) as bar:

        def watch(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        maps = registration.landscape(half_width=options.range, size=options.size, watch=watch)
    sheet, data = options.out / "landscape.png", options.out / "landscape.npz"
    maps.save(sheet)
    maps.save(data)
    say(f"maps: {sheet}\nnumbers: {data}")
    return 0
