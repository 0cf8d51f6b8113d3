"""Options of the commands as tables, and readers of their values.

A command's ``OPTIONS`` are groups of options by their titles (without one: ""). What several
commands share is here; an option that sets a field of a settings dataclass has the field's name, so
that ``made`` takes its value there.
"""

from argparse import ArgumentTypeError, Namespace, _ActionsContainer
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from poseviewer.errors import SettingsError
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.overlay import RENDER_STYLES
from poseviewer.scene.settings import CHOICES, Limits

T = TypeVar("T")


def _value(
    read: Callable[[str], T], wanted: str, allowed: Callable[[T], bool] = lambda _: True
) -> Callable[[str], T]:
    """Return a reader of a value, which refuses what is not ``wanted`` in a few words."""

    def value(text: str) -> T:
        try:
            result = read(text)
        except (ValueError, TypeError):
            result = None
        if result is None or not allowed(result):
            raise ArgumentTypeError(f"{text or repr(text)} is not {wanted}")
        return result

    return value


def listed(kind: Callable[[str], T]) -> Callable[[str], tuple[T, ...]]:
    """Return a reader of several values, with commas between them."""
    return lambda text: tuple(kind(part.strip()) for part in text.split(","))


def some_of(names: Iterable[str]) -> Callable[[str], tuple[str, ...]]:
    """Return a reader of several of these names."""
    return listed(_value(str, f"one of {', '.join(names)}", lambda name: name in names))


positive = _value(float, "a number above 0", lambda value: 0.0 < value < float("inf"))
whole = _value(int, "a whole number above 0", lambda value: value > 0)
RECTANGLE = "LEFT,TOP,WIDTH,HEIGHT"
READERS: Mapping[str, Callable[[str], Any]] = {
    **dict.fromkeys(("ADDRESS", "HOST", "PART", "PATTERN", "REAR;FRONT"), str),
    **dict.fromkeys(
        ("ID", "ID|NUMBER", "NAME", "NAME|NUMBER"),
        _value(str, "a name of at most 255 characters", lambda text: len(text) < 256),
    ),
    **dict.fromkeys(("LENGTHS", "PX", "SECONDS", "SHARE"), positive),
    "N": whole,
    "N,...": listed(whole),
    "NAME,...": lambda text: tuple(name for part in text.split(",") if (name := part.strip())),
    "PERCENT,...": listed(_value(float, "a number from 0 to 100", lambda value: 0 < value <= 100)),
    "PORT": _value(int, "a port, from 0 to 65535", lambda value: 0 <= value <= 65535),
    "POINTS": _value(int, "an odd number from 3 to 401", lambda value: value in range(3, 402, 2)),
    "SEED": _value(int, "a whole number of 0 or more", lambda value: value >= 0),
    "WIDTHxHEIGHT": _value(
        lambda text: tuple(int(side) for side in text.lower().split("x")),
        "a size, such as 1920x1080",
        lambda sides: len(sides) == 2 and min(sides) > 0,
    ),
    RECTANGLE: _value(
        lambda text: Rectangle(*listed(int)(text)), "four whole numbers, left,top,width,height"
    ),
}
"""Readers of values by what a usage calls the value; those of other names are paths."""


class Option(NamedTuple):
    """An option of a command, or a positional argument."""

    flag: str
    settings: Mapping[str, Any]
    """Settings of ``add_argument``."""
    is_output: bool = False
    """Whether it names a file to be written, which may be none of those that are read."""

    @property
    def name(self) -> str:
        """The attribute of the options as parsed."""
        return self.settings.get("dest") or self.flag.lstrip("-").replace("-", "_")


Group = Sequence["Option | Group"]
"""Options; of those in a group inside a group one alone may be given."""
Options = Mapping[str, Group]


def option(
    usage: str,
    text: str | None = None,
    choices: Iterable[str] | None = None,
    *,
    is_output: bool = False,
    **more: Any,
) -> Option:
    """Make ``--name VALUE`` (by ``READERS``), ``--name`` (choices or a flag), or ``name SHOWN``."""
    flag, _, shown = usage.partition(" ")
    if choices is not None:
        more["choices"] = tuple(choices)
    elif shown:
        more = {"type": READERS.get(shown, Path), **more}
    else:
        more.setdefault("action", "store_true")
    if shown:
        more["metavar"] = shown
    return Option(flag, {"help": text, **more}, is_output)


def add_all(parser: _ActionsContainer, group: Group) -> None:
    """Add options to a parser, or a group of it."""
    for item in group:
        if isinstance(item, Option):
            parser.add_argument(item.flag, **item.settings)
        else:
            add_all(parser.add_mutually_exclusive_group(), item)


SCHEDULER = option("--scheduler ADDRESS", "of a Dask cluster to run on")
QUIET = option("--quiet", "no progress, no notes")
PHOTO = option("photo PHOTO|SCENE.json", nargs="?")
MODEL = option("model MODEL", nargs="?")
FILES = (PHOTO, MODEL, QUIET)
LOOK = option("--look", "how the model is drawn", RENDER_STYLES, default=RENDER_STYLES[0])
LOSS = option(
    "--loss", "light, classes and edges; or the paper's of grey, clip or whole", CHOICES["loss"]
)
SEARCH = option(
    "--search", "(auto: the paper's simplex for its loss, else models)", CHOICES["search"]
)
METHOD = option("--method", "the loss with its own search", CHOICES["loss"], dest="loss")
METHODS = ((LOSS, METHOD), SEARCH)
PIXELS = option(
    "--pixels",
    "those in a box about the start (near), the whole photo, or what the model covers (clip: the "
    "paper's clipped loss; its default)",
    CHOICES["pixels"],
)
REFLECTANCE = option("--colour-reflectance", "RGB reflectance of the model (m = 12)")
MASK = option("--mask MASK.png", "weights: white counts")
IN_FRONT = option(
    "--in-front",
    "what may hide the model: the mask and what the search finds (find), the mask, or nothing",
    CHOICES["in_front"],
)
OUT = "a part to leave out (of a scene: ID:PART); again for more"
WITHOUT = option("--without PART", OUT, action="append")
COMPARED = (
    option("--chart", None, CHOICES["chart"]),
    option("--free-focal", "find the focal length as well"),
    option("--grey", "compare grey, not RGB"),
    REFLECTANCE,
    PIXELS,
    option(f"--region {RECTANGLE}", "in px"),
    MASK,
    IN_FRONT,
    WITHOUT,
    option("--renderer", "(software); gpu is experimental", CHOICES["renderer"]),
)
EVALUATIONS = option("--evaluations N", f"limit ({Limits().evaluations})")
LIMITS = (EVALUATIONS, option("--seconds SECONDS", f"limit ({Limits().seconds:g})"))
ESTIMATE = "the start is an estimate: give it back where the end is not sure to be better"
KEEP_START = option("--keep-start", ESTIMATE)
SETS = "in place of PHOTO: SET.json, COLMAP's folder, transforms.json, a BOP scene"
OF_VIEWS = (
    option("--view NAME", "the photo of --pose (the one that its file names)"),
    option("--photos NAME,...", "which of the set's photos (all)"),
    option("--scale LENGTHS", "of the model's unit in one of the set's"),
    option("--photo-folder FOLDER", "of COLMAP's photos", dest="folder"),
    option("--rig-object N", "the object of a BOP scene that tells how its camera moved"),
)
CAMERAS = (
    "camera and lens, from OpenCV's YAML, XML or JSON, COLMAP's cameras.txt or .bin, BOP's "
    "camera.json or scene_camera.json; the photo is undistorted by it"
)
CALIBRATION = option("--calibration FILE", CAMERAS)
FISHEYE = "the lens is of OpenCV's fisheye model, where the file does not say so"
OF_CALIBRATION = (
    option("--calibration-camera NAME", "which of the file's cameras"),
    option("--calibration-fisheye", FISHEYE),
)
CAMERA: Options = {"the photo's camera": (CALIBRATION, *OF_CALIBRATION)}
VIEWS: Options = {"several photos, one pose": (option("--views SET", SETS), *OF_VIEWS)}
SCENE: Options = {**CAMERA, **VIEWS, "what is compared": COMPARED}
"""Options that ``case.open_scene`` reads besides ``FILES`` and a pose."""
OTHERS = "serve other machines as well"
SERVER = (
    option("--port PORT", "(the first free one from 8080 on)"),
    option("--host HOST", OTHERS, default="127.0.0.1"),
    option("--no-browser", "do not open the browser", action="store_false", dest="browser"),
)
OBJECT = option("--object ID", "of the scene: which one")
POSE = option("--pose POSE.json", "a pose file")
BOX = option(f"--box {RECTANGLE}", "about the object, px")
INSTANCES = option("--instances N", "that the photo shows of the model: each one is looked for")
FOCAL = option("--focal PX", "where no pose file says it (EXIF's)")
STARTS = (
    POSE,
    option("--pairs FILE", "CSV, rows x,y,z,u,v: model, photo point"),
    option(
        "--wheels REAR;FRONT", "their ellipses, each cx,cy,a,b,angle (half axes in px, degrees)"
    ),
    option(f"--find-wheels {RECTANGLE}", "look for both in a rectangle about the car, px"),
    option("--start", "look for one: in the --box, the --region, or the whole photo", ("auto",)),
)
"""Options that say where the model starts."""
OF_A_PHOTO = (MASK, CALIBRATION, BOX, INSTANCES, FOCAL)
"""Options that a set of photos, or a scene, says itself."""


def each(group: Group) -> Iterator[Option]:
    """Yield the options of a group, and of the groups in it."""
    for item in group:
        yield from (item,) if isinstance(item, Option) else each(item)


def inputs(options: Namespace, of_command: Options) -> list[Path]:
    """The paths that are to be read; none for a command that writes no file by its options."""
    every = [item for group in of_command.values() for item in each(group)]
    given = [(item, getattr(options, item.name, None)) for item in every]
    paths = [
        value if isinstance(value, list) else [value] for item, value in given if not item.is_output
    ]
    reads = any(item.is_output for item in every)
    return [path for group in paths for path in group if isinstance(path, Path)] if reads else []


def values(options: Namespace, group: Iterable[Option]) -> dict[str, Any]:
    """The values of the options of a group by their names; None: not given."""
    return {item.name: getattr(options, item.name, None) for item in group}


def refuse(options: Namespace, group: Iterable[Option], why: str) -> None:
    """Refuse the options of a group, where they are given."""
    for item in group:
        if getattr(options, item.name, None) not in (None, False):
            raise SettingsError(f"{item.flag} {why}")


def made(of: Callable[..., T], options: Namespace, /, **more: Any) -> T:
    """The dataclass of what was typed; the other fields have their defaults."""
    given = {field.name: getattr(options, field.name, None) for field in fields(of)}  # pyright: ignore[reportArgumentType]
    return of(**{name: value for name, value in given.items() if value is not None} | more)
