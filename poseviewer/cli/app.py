"""Open the app."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli.options import (
    COMPARED,
    add_calibration,
    add_fields,
    add_server,
    add_views,
    calibration_of,
    choice_of,
    option,
    refuse_beside,
    refuse_views,
)
from poseviewer.cli.terminal import say
from poseviewer.errors import SettingsError
from poseviewer.files.scene import is_scene_file
from poseviewer.fit.settings import FitSettings

if TYPE_CHECKING:
    from poseviewer.app.workers.opening import Opened
    from poseviewer.files.set_questions import Chosen, Question


def add_options(parser: ArgumentParser) -> None:
    """The options of ``poseviewer [PHOTO MODEL]``."""
    option(parser, "photo PHOTO|FOLDER|ZIP|SCENE.json", "what is to be opened", Path, nargs="?")
    option(parser, "model MODEL", kind=Path, nargs="?")
    option(parser, "--pose POSE.json", "the start", Path)
    option(parser, "--last", "start from the pose saved last")
    fields = {name: COMPARED[name] for name in ("mask", "without")}
    add_fields(parser, FitSettings, {"method": ("--method", "chosen at first"), **fields})
    add_views(parser)
    add_server(parser)
    add_calibration(parser)


def _is_set(path: Path) -> bool:
    return path.is_dir() or path.suffix.lower() == ".zip"


def _chosen_of(path: Path, model: Path | None) -> tuple[list[Path], list[Path], Chosen]:
    """What of a folder or a zip is to be opened: where its models (or the one that is named) lie,
    where those of further objects do, and the rest, with a photo or a set of photos.

    Raises:
        PoseViewerError: it holds no photo or no model, or cannot be read.
    """
    from poseviewer.files.file_set import files_below, sort_set
    from poseviewer.files.set_questions import choose
    from poseviewer.files.state.folder import state_folder
    from poseviewer.files.state.uploads import gathered, keep_zip

    uploads = state_folder() / "uploads"
    choosing = choose(sort_set(files_below(path if path.is_dir() else keep_zip(uploads, path))))
    answer = None
    while True:
        try:
            answer = _answer(path, choosing.send(answer))
        except StopIteration as end:
            chosen: Chosen = end.value
            break
    found = () if chosen.model is None else (chosen.model, *chosen.others)
    models = [gathered(uploads, one) for one in found] if model is None else [model]
    is_there = chosen.photo is not None or chosen.views is not None
    if not (is_there and models):
        what = "model" if is_there else "photo"
        raise SettingsError(f"{path}: no {what} was found in it; name PHOTO and MODEL")
    return models, [gathered(uploads, one) for one in chosen.objects], chosen


def _answer(path: Path, question: Question) -> str:
    """What the user says at the terminal."""
    if not sys.stdin.isatty():
        raise SettingsError(f"{path}: {question.text} Name PHOTO and MODEL")
    say(f"{path}: {question.text}")
    for number, text in enumerate(question.options, 1):
        say(f"{number:5}  {text}")
    while True:
        answer = input("Number: ").strip()
        if answer.isdecimal() and 1 <= int(answer) <= len(question.options):
            return question.options[int(answer) - 1]


SAID_BY_SET = ("last", "mask", "calibration")


def _opening_set(options: Namespace) -> Callable[[], Opened]:
    """What opens a set of photos."""
    refuse_beside(options, "--views", SAID_BY_SET)
    model, pose = options.photo, options.pose
    if model is None or options.model is not None:
        raise SettingsError("--views SET wants MODEL alone: the set says the photos")
    for path in filter(None, (model, pose)):
        if not path.is_file():
            raise SettingsError(f"{path}: no such file; check the path")
    if not options.views.exists():
        raise SettingsError(f"{options.views}: no such file or folder; check the path")

    def open_first() -> Opened:
        from poseviewer.app.workers.opening import open_set

        given = choice_of(options), options.view, options.scale, options.without or ()
        return open_set(options.views, model, pose, *given)

    return open_first


def _opening(options: Namespace) -> Callable[[], Opened]:
    """What opens all that is named otherwise, or the demo."""
    photo, model, pose, scene = options.photo, options.model, options.pose, False
    refuse_views(options)
    if photo is None:
        if pose is not None or options.last:
            raise SettingsError("--pose or --last without PHOTO and MODEL; name all three")
        for name in ("mask", "without"):
            if getattr(options, name):
                raise SettingsError(f"--{name} without PHOTO and MODEL; name all three")
        if options.calibration is not None:
            raise SettingsError("--calibration without PHOTO and MODEL; name all three")
    elif (scene := is_scene_file(photo)) and (model or pose or options.last or options.mask):
        raise SettingsError(f"{photo}: a scene file says what is where; leave out all but that")
    elif model is None and not (scene or _is_set(photo)):
        raise SettingsError(f"{photo}: a photo without a model; name PHOTO and MODEL")
    if options.last and pose is not None:
        raise SettingsError("--pose and --last are two starts; leave one of them out")
    calibration, place = calibration_of(options), None
    objects: list[Path] = []
    if photo is not None and _is_set(photo):
        (model, *_), objects, chosen = _chosen_of(photo, model)
        if chosen.views is not None:
            refuse_beside(options, "a set of photos", SAID_BY_SET)
            of_set, chosen_model = replace(chosen, pose=pose or chosen.pose), model
            return lambda: _open_chosen_set(of_set, chosen_model, options.without or ())
        photo, pose, place = chosen.photo, pose or chosen.pose, chosen.place
        calibration = calibration or chosen.calibration
    for path in filter(None, (photo, model, pose, options.mask)):
        if not path.is_file():  # before there is a page
            raise SettingsError(f"{path}: no such file; check the path")

    def open_first() -> Opened:
        from poseviewer.app.workers.opening import open_files, open_scene, placed
        from poseviewer.files.demo import demo_case
        from poseviewer.files.state.folder import last_pose

        if photo is not None and scene:
            return open_scene(photo, options.without or ())
        if photo is None or model is None:
            case = demo_case("perspective")
            return open_files(case.photo, case.model, case.start)
        start = last_pose() if options.last else pose
        hidden = options.mask, options.without or ()
        found = open_files(photo, model, start, calibration, *hidden, objects)
        return found if place is None or start is not None else placed(found, place)

    return open_first


def _open_chosen_set(chosen: Chosen, model: Path, without: Sequence[str]) -> Opened:
    from poseviewer.app.workers.opening import open_chosen_set

    return open_chosen_set(chosen, model, without)


def run(options: Namespace) -> int:
    """Serve the app until it is interrupted."""
    open_first = (_opening if options.views is None else _opening_set)(options)
    from poseviewer.app.serving import serve_app

    def opened() -> tuple[Opened, None]:
        from poseviewer.app.workers.opening import by_method

        return by_method(open_first(), options.method or "default"), None

    serve_app(
        opened,
        host=options.host,
        port=options.port,
        browser=not options.no_browser,
        tell=say,
    )
    return 0
