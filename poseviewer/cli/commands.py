"""What each command does once its options are parsed: load, call, print."""

from __future__ import annotations

import os
import sys
from argparse import Namespace
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from tqdm import tqdm

from poseviewer.api import Case, FitResult, load
from poseviewer.app.workers.worker import beside
from poseviewer.cli import convert as converting
from poseviewer.cli import describe
from poseviewer.cli.calibration_options import calibration_of
from poseviewer.errors import (
    EXIT_INTERRUPTED,
    PhotoFileError,
    PoseFileError,
    PoseViewerError,
    SettingsError,
)
from poseviewer.files.demo import demo_case
from poseviewer.files.marks import load_pairs, load_wheels
from poseviewer.files.photo.calibrated import load_calibrated_photo, photo_text, pixels_for
from poseviewer.files.photo.load import save_image
from poseviewer.files.state.last_pose import keep_last_pose, last_pose
from poseviewer.files.writing import write_whole
from poseviewer.fit.problem import FitProgress
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.optimise.restarts import RestartOptions
from poseviewer.render.pool import processors
from poseviewer.starts.automatic import AUTOMATIC
from poseviewer.starts.point_pairs import start_from_pairs
from poseviewer.starts.registration import Start, StartCamera, StartInputs
from poseviewer.starts.wheels import start_from_found_wheels, start_from_wheels

LOOKS_OF_THE_DEMO = ("outline", "relit", "residual")


def app(options: Namespace) -> int:
    """Serve the app until it is interrupted."""
    photo, model, pose = options.photo, options.model, options.pose
    if photo is None:
        if pose is not None or options.last:
            raise SettingsError("--pose or --last without PHOTO and MODEL; name all three")
        if options.calibration is not None:
            raise SettingsError("--calibration without PHOTO and MODEL; name all three")
        case = demo_case("perspective")
        photo, model, pose = case.photo, case.model, case.start
    elif model is None:
        raise SettingsError(f"{photo}: a photo without a model; name PHOTO and MODEL")
    if options.last:
        if pose is not None:
            raise SettingsError("--pose and --last are two starts; leave one of them out")
        pose = last_pose()
    from poseviewer.render.software.compiled import compile_kernels, compile_rasteriser

    _tell_of_compiling()
    compile_kernels()
    beside(compile_rasteriser)  # by now it only loads them, while the app is imported
    from poseviewer.app.serving import serve_app

    serve_app(
        photo,
        model,
        pose,
        calibration_of(options),
        options.others,
        host=options.host,
        port=options.port,
        browser=not options.no_browser,
        tell=lambda line: print(line, flush=True),
    )
    return 0


def fit(options: Namespace) -> int:
    """Search from a start pose; write the pose, and an overlay if wanted."""
    _require_folder(options.out, PoseFileError)
    if options.overlay:
        _require_folder(options.overlay, PhotoFileError)
    found = _search(_open(options), options.quiet)
    found.save(options.out)
    keep_last_pose(found.record)
    print(f"pose: {options.out}")
    if options.overlay:
        found.draw(options.overlay, options.look)
        print(f"overlay: {options.overlay}")
    return EXIT_INTERRUPTED if found.stopped else 0


def overlay(options: Namespace) -> int:
    """Draw the model over the photo at a pose."""
    _require_folder(options.out, PhotoFileError)
    _open(options).start.draw(options.out, options.look)
    print(f"overlay: {options.out}")
    return 0


def landscape_sheet(options: Namespace) -> int:
    """Map the loss around a pose: a sheet of contours and the numbers."""
    case = _open(options)
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PoseFileError(
            f"{options.out}: cannot be made ({error.strerror}); name a folder of yours"
        ) from None
    with _bar(0, options.quiet) as bar:

        def watch(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        maps = case.start.landscape(half_width=options.range, size=options.size, watch=watch)
    sheet, data = options.out / "landscape.png", options.out / "landscape.npz"
    maps.save(sheet)
    maps.save(data)
    print(f"maps: {sheet}\nnumbers: {data}")
    return 0


def info(options: Namespace) -> int:
    """Say what was understood of a photo, a model or a pose."""
    print(describe.file(options.path, calibration_of(options)))
    return 0


def undistort(options: Namespace) -> int:
    """Write the undistorted photo; say its camera."""
    _require_folder(options.out, PhotoFileError)
    photo = load_calibrated_photo(options.photo, calibration_of(options))
    if photo.undistortion is None:
        raise SettingsError(f"{options.calibration}: a camera without distortion; nothing to undo")
    save_image(options.out, pixels_for(options.out, photo), photo_text(photo))
    print(describe.camera_of(photo))
    print(f"undistorted: {options.out}")
    return 0


def demo(options: Namespace) -> int:
    """Fit the bundled demo, and say where the results are."""
    folder: Path = options.out
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise PoseFileError(
            f"{folder}: cannot be made ({error.strerror}); run poseviewer in a folder of yours"
        ) from None
    print("Fitting the bundled demo: a car of our own making on a path-traced photo.")
    _tell_of_compiling()
    files = demo_case()
    case = load(files.photo, files.model, files.start)
    found = _search(case, quiet=False)
    found.save(folder / "pose.json")
    for look in LOOKS_OF_THE_DEMO:
        found.draw(folder / f"{look}.png", look)
    case.start.draw(folder / "start.png")
    names = ", ".join(f"{look}.png" for look in ("start", *LOOKS_OF_THE_DEMO))
    print(f"The pose and pictures of it are in {folder}/: pose.json, {names}.")
    return EXIT_INTERRUPTED if found.stopped else 0


def bench(options: Namespace) -> int:
    """Measure how long evaluations, searches and maps take; print the tables."""
    from poseviewer.bench import report as reports
    from poseviewer.bench.run import QUICK, BenchOptions, run_bench
    from poseviewer.figures.bench_sheet import make_bench_sheet
    from poseviewer.figures.save import check_kind, save_figure

    for path in (options.json, options.plot):
        if path:
            _require_folder(path, SettingsError)
    if options.plot:
        check_kind(options.plot)
    _tell_of_compiling()
    wanted = QUICK if options.quick else BenchOptions()
    report = run_bench(wanted, _say_nothing if options.quiet else _tell)
    print(reports.as_text(report, options.markdown))
    if options.json:
        write_whole(options.json, reports.as_json_bytes(report), SettingsError)
        print(f"\nrows: {options.json}")
    if options.plot:
        save_figure(options.plot, make_bench_sheet(reports.make_sheet(report)))
        print(f"\nplot: {options.plot}")
    return 0


def convert(options: Namespace) -> int:
    """Write a pose for another tool, or read one from it."""
    for line in converting.convert(options):
        print(line)
    return 0


def _open(options: Namespace) -> Case:
    """Photo, model and start: from a pose file, from marks on the photo, or found."""
    settings, given = _settings(options), vars(options)
    if given.get("box") and options.start is None:
        raise SettingsError("--box without --start auto; leave it out, or add --start auto")
    if settings.renderer == "software":
        _tell_of_compiling()
    parallel = given.get("projection") == "parallel"
    known = StartCamera(parallel, given.get("focal"), options.free_focal)
    with _bar(None, options.quiet) as bar:
        case = load(
            options.photo,
            options.model,
            _start(options, known),
            settings,
            calibration=calibration_of(options),
            box=given.get("box"),
            camera=known,
            mask=options.mask,
            watch=bar.update,
        )
    if not options.quiet:
        for note in case.notes:
            _tell(f"note: {note}")
    return case


def _start(options: Namespace, known: StartCamera) -> Path | str | Callable[[StartInputs], Start]:
    given = vars(options)
    if given.get("last"):
        return last_pose()
    if options.pose is not None:
        return options.pose
    if options.start is not None:
        return AUTOMATIC

    def find(material: StartInputs) -> Start:
        if given.get("pairs") is not None:
            return start_from_pairs(material, load_pairs(options.pairs), known)
        if options.find_wheels is not None:
            return start_from_found_wheels(material, options.find_wheels, known)
        return start_from_wheels(material, load_wheels(options.wheels), known)

    return find


def _settings(options: Namespace) -> FitSettings:
    given = vars(options)
    method = given.get("method", "default")
    _check_method(options, method)
    rules = RestartOptions()
    if given.get("tolerance"):
        rules = replace(rules, x_tolerance=given["tolerance"])
    if given.get("step"):
        rules = replace(rules, step=given["step"])
    return FitSettings(
        chart=options.chart,
        free_focal=options.free_focal,
        lock=tuple(name.strip() for name in given.get("lock", "").split(",") if name.strip()),
        grey=options.grey,
        colour_reflectance=options.colour_reflectance,
        pixels=options.pixels or "near",
        region=options.region,
        mask=options.mask.name if options.mask else None,
        renderer=options.renderer,
        rules=rules,
        limits=Limits(given.get("evaluations", 1), given.get("seconds", 1.0)),
        seed=given.get("seed", 0),
        method=method,
    )


def _check_method(options: Namespace, method: str) -> None:
    """The paper's method leaves some things no choice; rather say so than do something else."""
    if method == "paper" and options.pixels == "near":
        raise SettingsError("--method paper with --pixels near; it has clip and whole alone")
    if method == "paper" and options.colour_reflectance:
        raise SettingsError(
            "--method paper with --colour-reflectance; it compares grey: leave one of them out"
        )


def _tell_of_compiling() -> None:
    from poseviewer.render.software.compiled import kernels_are_compiled

    if not kernels_are_compiled():
        _tell("Compiling the kernels for this machine: about half a minute, this once.")


def _search(case: Case, quiet: bool) -> FitResult:
    """Run a fit to its end, or to Ctrl-C, which keeps the best pose so far; say how it ended."""
    with _bar(None, quiet) as bar:

        def watch(progress: FitProgress) -> None:
            text = f"restart {progress.restart}, loss {progress.loss:.5f}"
            bar.set_description_str(text, refresh=False)
            bar.update(progress.evaluations - bar.n)

        found = case.fit(watch=watch, threads=processors(), interruptible=True)
    assert found.progress is not None  # it was searched for
    print(describe.fit_result(found.progress))
    return found


def _bar(total: int | None, quiet: bool) -> tqdm:
    """A progress bar on standard error, for what takes longer than a second."""
    shape = "{desc} [{elapsed}, {n_fmt} evaluations, {rate_fmt}]"
    if total is not None:
        shape = "{percentage:3.0f}% |{bar}| {n_fmt}/{total_fmt} [{elapsed}<{remaining}]"
    # A log file wants a line now and then, not ten a second.
    interval = 0.1 if sys.stderr.isatty() else 5.0
    return tqdm(
        total=total,
        bar_format=shape,
        delay=1.0,
        mininterval=interval,
        disable=quiet,
        leave=False,
    )


def _require_folder(path: Path, error: type[PoseViewerError]) -> None:
    """Before the work, not after it."""
    if not path.parent.is_dir():
        raise error(f"{path}: there is no folder {path.parent}; make it, or write elsewhere")
    if path.is_dir():
        raise error(f"{path}: is a folder; name a file in it")
    if not os.access(path.parent, os.W_OK):
        raise error(f"{path}: {path.parent} is not yours to write to; write elsewhere")


def _say_nothing(text: str) -> None:
    """For whoever wants quiet."""


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
