"""Map the loss around a pose, for all pairs of parameters: a sheet of contours and the numbers."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from poseviewer.cli.options import (
    add_fields,
    add_files,
    add_settings,
    add_views,
    map_size,
    names,
    option,
    positive,
)
from poseviewer.cli.terminal import progress_bar, say
from poseviewer.errors import SettingsError
from poseviewer.files.writing import make_folder
from poseviewer.fit.settings import FitSettings


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer landscape``."""
    add_files(parser, "the middle of the maps")
    option(parser, "--object ID", "of the scene: which one")
    option(parser, "--out FOLDER", kind=Path, required=True)
    option(parser, "--size SIZE", "points a side (41)", map_size, default=41)
    option(parser, "--range SHARE", "half width (0.2: 20 %%)", positive, default=0.2)
    add_views(parser)
    add_settings(parser)
    lock = ("--lock NAME,...", "parameters to leave out", names)
    add_fields(parser, FitSettings, {"lock": lock})


def run(options: Namespace) -> int:
    """Write ``landscape.png`` and ``landscape.npz``."""
    from poseviewer.cli.case import open_case, open_scene, open_views

    if options.views is not None:
        case = open_views(options).whole
    elif options.scene is None:
        case = open_case(options)
    elif options.object is None:
        raise SettingsError("--scene without --object; name the object to map with --object ID")
    else:
        case = open_scene(options).case(options.object)
    make_folder(options.out)
    with progress_bar(0, options.quiet) as bar:

        def watch(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        maps = case.start.landscape(half_width=options.range, size=options.size, watch=watch)
    sheet, data = options.out / "landscape.png", options.out / "landscape.npz"
    maps.save(sheet)
    maps.save(data)
    say(f"maps: {sheet}\nnumbers: {data}")
    return 0
