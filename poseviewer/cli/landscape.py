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
    from poseviewer.api import SceneCase, SetCase
    from poseviewer.cli.case import open_any

    if options.scene is not None and options.views is None and options.object is None:
        raise SettingsError("--scene without --object; name the object to map with --object ID")
    case = open_any(options)
    if isinstance(case, SceneCase):
        case = case.case(options.object)
    elif isinstance(case, SetCase):
        case = case.whole
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
