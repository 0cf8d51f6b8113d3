"""Open the app."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from poseviewer.cli.options import add_calibration, add_server, calibration_of, option
from poseviewer.cli.terminal import tell_of_compiling
from poseviewer.errors import SettingsError


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer [PHOTO MODEL]``."""
    option(parser, "photo PHOTO", kind=Path, nargs="?")
    option(parser, "model MODEL", kind=Path, nargs="?")
    option(parser, "others MODEL", "more, to tell which one it is", Path, nargs="*")
    option(parser, "--pose POSE.json", "the start", Path)
    option(parser, "--last", "start from the pose saved last")
    add_server(parser)
    add_calibration(parser)


def run(options: Namespace) -> int:
    """Serve the app until it is interrupted."""
    photo, model, pose = options.photo, options.model, options.pose
    if photo is None:
        if pose is not None or options.last:
            raise SettingsError("--pose or --last without PHOTO and MODEL; name all three")
        if options.calibration is not None:
            raise SettingsError("--calibration without PHOTO and MODEL; name all three")
    elif model is None:
        raise SettingsError(f"{photo}: a photo without a model; name PHOTO and MODEL")
    if options.last and pose is not None:
        raise SettingsError("--pose and --last are two starts; leave one of them out")
    from poseviewer.app.workers.worker import in_background
    from poseviewer.files.demo import demo_case
    from poseviewer.files.state.folder import last_pose
    from poseviewer.render.software.compiled import compile_kernels, compile_rasteriser

    if photo is None:
        case = demo_case("perspective")
        photo, model, pose = case.photo, case.model, case.start
    elif options.last:
        pose = last_pose()
    tell_of_compiling()
    compile_kernels()
    in_background(compile_rasteriser)  # by now it only loads them, while the app is imported
    from poseviewer.app.serving import serve_app
    from poseviewer.app.workers.opening import open_files

    serve_app(
        open_files(photo, model, pose, calibration_of(options), options.others),
        host=options.host,
        port=options.port,
        browser=not options.no_browser,
        tell=lambda line: print(line, flush=True),
    )
    return 0
