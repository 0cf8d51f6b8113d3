"""Options that several commands share, and values read from their words.

An option that sets a field of a settings dataclass is made from that field (``add_fields``): name,
choices and default are written there alone, and ``made`` takes the value back to it.
"""

from __future__ import annotations

import argparse
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from poseviewer.errors import SettingsError
from poseviewer.fit.settings import CHOICES, FitSettings, Limits
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.optimise.restarts import RestartOptions

if TYPE_CHECKING:
    from poseviewer.files.cameras import Calibration
    from poseviewer.files.view_set import SetChoice

T = TypeVar("T")


def _value(
    read: Callable[[str], T], wanted: str, allowed: Callable[[T], bool]
) -> Callable[[str], T]:
    """A reader of an option's value, which refuses what is not ``wanted`` in a few words."""

    def value(text: str) -> T:
        try:
            found = read(text)
        except (ValueError, TypeError):
            found = None
        if found is None or not allowed(found):
            raise ArgumentTypeError(f"{text or repr(text)} is not {wanted}")
        return found

    return value


def listed(kind: Callable[[str], T]) -> Callable[[str], tuple[T, ...]]:
    """Several values, with commas between them."""
    return lambda text: tuple(kind(part.strip()) for part in text.split(","))


def names(text: str) -> tuple[str, ...]:
    """Names, with commas between them."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


positive = _value(float, "a number above 0", lambda value: 0.0 < value < float("inf"))
whole = _value(int, "a whole number above 0", lambda value: value > 0)
seed = _value(int, "a whole number of 0 or more", lambda value: value >= 0)
port = _value(int, "a port, from 0 to 65535", lambda value: 0 <= value <= 65535)
map_size = _value(int, "an odd number from 3 to 401", lambda value: value in range(3, 402, 2))
size = _value(
    lambda text: tuple(int(side) for side in text.lower().split("x")),
    "a size, such as 1920x1080",
    lambda sides: len(sides) == 2 and min(sides) > 0,
)
"""Width and height in px."""
rectangle = _value(
    lambda text: Rectangle(*listed(int)(text)),
    "four whole numbers, left,top,width,height",
    lambda _: True,
)
"""In px of the photo."""
RECTANGLE = "LEFT,TOP,WIDTH,HEIGHT"

COMPARED = {
    "chart": ("--chart",),
    "free_focal": ("--free-focal", "find the focal length as well"),
    "grey": ("--grey", "compare grey, not RGB"),
    "colour_reflectance": ("--colour-reflectance", "RGB reflectance of the model (m = 12)"),
    "pixels": (
        "--pixels",
        "those in a box about the start (near), the whole photo, or what the model covers "
        "(clip: the paper's clipped loss; its default)",
    ),
    "region": (f"--region {RECTANGLE}", "in px", rectangle),
    "mask": ("--mask MASK.png", "weights: white counts", Path),
    "without": ("--without PART", "a part to leave out (of a scene: ID:PART); again for more", str),
    "renderer": ("--renderer", "(software); gpu is experimental"),
}
"""Fields of ``FitSettings``, and the options that every command has for them."""
REPEATED = ("without",)
"""Those of them that may be given more than once."""
LIMITS = {
    "evaluations": ("--evaluations N", "limit ({:g})", whole),
    "seconds": ("--seconds SECONDS", "limit ({:g})", positive),
}
"""The same of ``Limits``."""
KEPT = {
    "keep_start": (
        "--keep-start",
        "the start is an estimate: give it back where the end is not sure to be better",
    )
}
"""A field of ``FitSettings`` that commands have which refine estimates."""


def option(
    group: argparse._ActionsContainer,
    usage: str,
    text: str | None = None,
    kind: Callable[[str], Any] | None = None,
    **more: Any,
) -> None:
    """Add ``--name VALUE``, read by ``kind``, the flag ``--name``, or a positional ``name``."""
    name, _, metavar = usage.partition(" ")
    if metavar:
        more |= {"metavar": metavar}
    elif name.startswith("--") and "choices" not in more:
        more |= {"action": "store_true"}
    if kind is not None:
        more |= {"type": kind}
    group.add_argument(name, help=text, **more)


def add_fields(
    group: argparse._ActionsContainer, of: type, options: Mapping[str, tuple[Any, ...]]
) -> None:
    """An option for each of these fields of a dataclass: usage, text and kind as of ``option``.

    ``{}`` in the text is the field's default; what was not typed is None, and a flag False.
    """
    defaults = {field.name: field.default for field in fields(of)}
    for name, (usage, *rest) in options.items():
        texts: list[Any] = [
            text.format(defaults[name]) if isinstance(text, str) else text for text in rest
        ]
        more = {"choices": CHOICES[name]} if name in CHOICES else {}
        more |= {"action": "append"} if name in REPEATED else {}
        option(group, usage, *texts, dest=name, **more)


def made(of: Callable[..., T], options: Namespace, /, **more: Any) -> T:
    """The dataclass of what was typed; the other fields have their defaults."""
    given = {field.name: getattr(options, field.name, None) for field in fields(of)}  # pyright: ignore[reportArgumentType]
    return of(**{name: value for name, value in given.items() if value is not None} | more)


def refuse_with_paper(options: Namespace) -> None:
    """Refuse the paper's method with what it does not have."""
    if getattr(options, "method", None) != "paper":
        return
    if options.pixels == "near":
        raise SettingsError("--method paper with --pixels near; it has clip and whole alone")
    if getattr(options, "colour_reflectance", False):
        raise SettingsError(
            "--method paper with --colour-reflectance; it compares grey: leave one of them out"
        )


def settings_of(options: Namespace) -> FitSettings:
    """How a fit is made."""
    refuse_with_paper(options)
    return made(
        FitSettings,
        options,
        mask=options.mask.name if options.mask else None,
        without=tuple(options.without) if options.without else None,
        options=made(RestartOptions, options),
        limits=made(Limits, options),
    )


def add_settings(parser: ArgumentParser) -> None:
    """What is compared."""
    add_fields(parser.add_argument_group("what is compared"), FitSettings, COMPARED)


def add_search(parser: ArgumentParser) -> argparse._ArgumentGroup:
    """The limits of a search; the group, for more."""
    group = parser.add_argument_group("search")
    add_fields(group, Limits, LIMITS)
    return group


SCENE = "several objects in one photo, in place of PHOTO and MODEL"


def add_files(parser: ArgumentParser, pose: str = "") -> None:
    """Photo, model and camera; where ``pose`` says what it is for, the pose, or a scene."""
    option(parser, "photo PHOTO", kind=Path, nargs="?")
    option(parser, "model MODEL", kind=Path, nargs="?")
    if pose:
        one = parser.add_mutually_exclusive_group(required=True)
        option(one, "--pose POSE.json", pose, Path)
        option(one, "--scene SCENE.json", SCENE, Path)
    option(parser, "--quiet", "no progress, no notes")
    add_calibration(parser)


def add_views(parser: ArgumentParser) -> None:
    """Several photos in place of one."""
    group = parser.add_argument_group("several photos, one pose")
    said = "in place of PHOTO: SET.json, COLMAP's folder, transforms.json, a BOP scene"
    option(group, "--views SET", said, Path)
    option(group, "--view NAME", "the photo of --pose (the one that its file names)")
    option(group, "--photos NAME,...", "which of the set's photos (all)", names)
    option(group, "--scale NUMBER", "lengths of the model's unit in one of the set's", positive)
    option(group, "--photo-folder FOLDER", "of COLMAP's photos", Path)
    moved = "the object of a BOP scene that tells how its camera moved"
    option(group, "--rig-object NUMBER", moved, whole)


OF_VIEWS = ("view", "photos", "scale", "photo_folder", "rig_object")
"""Options that go with ``--views``."""


def refuse(options: Namespace, names: Sequence[str], why: str) -> None:
    """Refuse the options of these names, where they are given."""
    for name in names:
        given = getattr(options, name, None)
        if given is not None and given is not False:
            called = name.upper() if name == "photo" else f"--{name.replace('_', '-')}"
            raise SettingsError(f"{called} {why}")


def refuse_views(options: Namespace) -> None:
    """Refuse what is said of a set of photos that is not there."""
    refuse(options, OF_VIEWS, "without --views; leave it out, or name a set of photos")


def refuse_beside(options: Namespace, flag: str, names: Sequence[str]) -> None:
    """Refuse options that say what the ``flag`` says itself."""
    refuse(options, names, f"with {flag}, which says it itself; leave it out")


def choice_of(options: Namespace) -> SetChoice:
    """What of the set is wanted."""
    from poseviewer.files.view_set import SetChoice

    return SetChoice(options.photos or (), options.photo_folder, options.rig_object)


def add_server(parser: ArgumentParser) -> None:
    """Where the app is served."""
    option(parser, "--port PORT", "(the first free one from 8080 on)", port)
    address = "serve others than this machine as well; the address then bears a token"
    option(parser, "--host HOST", address, default="127.0.0.1")
    option(parser, "--no-browser", "do not open the browser")


def add_calibration(parser: ArgumentParser, required: bool = False) -> None:
    """The photo's calibrated camera."""
    group = parser.add_argument_group("the photo's camera")
    option(
        group,
        "--calibration FILE",
        "camera and lens, from OpenCV's YAML, XML or JSON, COLMAP's cameras.txt or .bin, BOP's "
        "camera.json or scene_camera.json; the photo is undistorted by it",
        Path,
        required=required,
    )
    option(group, "--calibration-camera NAME", "which of the file's cameras")
    fisheye = "the lens is of OpenCV's fisheye model, where the file does not say so"
    option(group, "--calibration-fisheye", fisheye)


def calibration_of(options: Namespace) -> Calibration | None:
    """The calibration that the options name; None where they name none."""
    camera, fisheye = options.calibration_camera, options.calibration_fisheye
    if options.calibration is None:
        more = ("calibration_camera", "calibration_fisheye")
        refuse(options, more, "without --calibration; name its file")
        return None
    from poseviewer.files.cameras import Calibration

    return Calibration(options.calibration, camera, fisheye)
