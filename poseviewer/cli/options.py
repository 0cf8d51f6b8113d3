"""Options of the commands as tables, and parsers of their values.

A command's ``OPTIONS`` map titles to groups of options; the title "" is printed without a heading.
Options of several commands are here. An option that sets a field of a dataclass has the field's
name, by which ``make`` finds its value.
"""

from argparse import ArgumentTypeError, Namespace, _ActionsContainer
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from poseviewer.errors import SettingsError, in_words
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.losses.known_losses import LOSSES
from poseviewer.render.overlay import LOOKS
from poseviewer.scene.settings import CHOICES, Limits

T = TypeVar("T")


def _value(
    read: Callable[[str], T], wanted: str, allowed: Callable[[T], bool] = lambda _: True
) -> Callable[[str], T]:
    """Return a parser of a value, whose error says what is ``wanted``."""

    def value(text: str) -> T:
        try:
            result = read(text)
        except (ValueError, TypeError):
            result = None
        if result is None or not allowed(result):
            raise ArgumentTypeError(f"{text or repr(text)} is not {wanted}")
        return result

    return value


def list_of(kind: Callable[[str], T]) -> Callable[[str], tuple[T, ...]]:
    """Return a parser of values separated by commas."""
    return lambda text: tuple(kind(part.strip()) for part in text.split(","))


def some_of(names: Iterable[str]) -> Callable[[str], tuple[str, ...]]:
    """Return a parser of some of these names, separated by commas."""
    return list_of(_value(str, f"one of {', '.join(names)}", lambda name: name in names))


def numbered_path(text: str) -> int | tuple[int, Path] | Path:
    """Parse a number, a number and a file as ``N=FILE``, or a folder."""
    number, is_pair, name = text.partition("=")
    if number.isdecimal() and (name or not is_pair):
        return (whole(number), Path(name)) if is_pair else whole(number)
    if is_pair and not Path(text).exists():
        raise ArgumentTypeError(f"{text} is not a number of a frame and a pose file, N=POSE.json")
    return Path(text)


positive = _value(float, "a number above 0", lambda value: 0.0 < value < float("inf"))
"""Parser of a finite number above 0."""
whole = _value(int, "a whole number above 0", lambda value: value > 0)
"""Parser of a whole number above 0."""
RECTANGLE = "LEFT,TOP,WIDTH,HEIGHT"
"""Name of a rectangle's value in usages, in px."""
READERS: Mapping[str, Callable[[str], Any]] = {
    **dict.fromkeys(("ADDRESS", "HOST", "PART", "PATTERN", "REAR;FRONT"), str),
    **dict.fromkeys(
        ("ID", "ID|NUMBER|ID=NUMBER", "NAME", "NAME|NUMBER"),
        _value(str, "a name of at most 255 characters", lambda text: len(text) < 256),
    ),
    **dict.fromkeys(("LENGTHS", "PX", "SECONDS", "SHARE"), positive),
    "N": whole,
    "N|N=POSE.json|FOLDER": numbered_path,
    "N,...": list_of(whole),
    "NAME,...": lambda text: tuple(name for part in text.split(",") if (name := part.strip())),
    "PERCENT,...": list_of(_value(float, "a number from 0 to 100", lambda value: 0 < value <= 100)),
    "PORT": _value(int, "a port, from 0 to 65535", lambda value: 0 <= value <= 65535),
    "POINTS": _value(int, "an odd number from 3 to 401", lambda value: value in range(3, 402, 2)),
    "SEED": _value(int, "a whole number of 0 or more", lambda value: value >= 0),
    "WIDTHxHEIGHT": _value(
        lambda text: tuple(int(side) for side in text.lower().split("x")),
        "a size, such as 1920x1080",
        lambda sides: len(sides) == 2 and min(sides) > 0,
    ),
    RECTANGLE: _value(
        lambda text: Rectangle(*list_of(int)(text)), "four whole numbers, left,top,width,height"
    ),
}
"""Parsers of values, by the values' names in usages; values of other names are paths."""


class Option(NamedTuple):
    """An option of a command, or a positional argument."""

    flag: str
    settings: Mapping[str, Any]
    """Settings of ``add_argument``."""
    is_output: bool = False
    """Whether it names a file to write, which must not be one of the files to read."""

    @property
    def name(self) -> str:
        """Name of its attribute among the parsed options."""
        return self.settings.get("dest") or self.flag.lstrip("-").replace("-", "_")

    def usage(self, value: str = "") -> str:
        """Return how it is written, with a value or the value's name: ``--name VALUE``."""
        shown = value or self.settings.get("metavar", "")
        return f"{self.flag} {shown}".strip() if self.flag.startswith("-") else shown


Group = Sequence["Option | Group"]
"""Options; those of an inner group exclude each other."""
Options = Mapping[str, Group]
"""Groups of options by their titles."""


def option(
    usage: str,
    text: str,
    choices: Collection[str] | None = None,
    *,
    is_output: bool = False,
    **more: Any,
) -> Option:
    """Make an option.

    Args:
        usage: ``--name VALUE``, whose value's name chooses the parser of ``READERS``; ``--name``, a
            choice or a flag; or ``name SHOWN``, a positional argument.
        text: help text.
        choices: values of a choice; by default those of the setting of this name, if there is one.
        is_output: whether the option names a file to write.
        more: further settings of ``add_argument``.
    """
    flag, _, shown = usage.partition(" ")
    choices = choices or CHOICES.get(flag[2:].replace("-", "_"))
    if choices is not None:
        more["choices"] = choices  # losses may still be added
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


SCHEDULER = option("--scheduler ADDRESS", "run on this Dask cluster (default: this machine)")
QUIET = option("--quiet", "print neither progress nor notes")
PHOTO = option("photo PHOTO|SCENE.json", "photo, or a scene file without MODEL", nargs="?")
MODEL = option("model MODEL", "3D model of the object", nargs="?")
FILES = (PHOTO, MODEL, QUIET)
LOOK = option(
    "--look", "draw the model so (default: %(default)s)", list(LOOKS), default=next(iter(LOOKS))
)
HINTS = " ".join(loss.hint for loss in LOSSES.values())
LOSS = option("--loss", f"minimise this loss. {HINTS} (default: default)")
SEARCH = option("--search", "minimise by simplex or by CMA-ES and models (default: auto, by loss)")
METHOD = option("--method", "set --loss (default: default)", CHOICES["loss"], dest="loss")
METHODS = ((LOSS, METHOD), SEARCH)
PIXELS = option(
    "--pixels",
    "compare a box about the start (near), the full image (whole) or the model's silhouette (clip) "
    "(default: near; clip for the paper's loss)",
)
REFLECTANCE = option(
    "--colour-reflectance", "use the model's RGB reflectance: 12 attributes, not 4"
)
MASK = option(
    "--mask MASK.png",
    "count white pixels, not black ones, or an object of COCO's or Labelme's file "
    "(default: the pose file's mask)",
)
MASK_LABEL = option(
    "--mask-label NAME", "choose this object of --mask (default: the only one)", dest="label"
)
IN_FRONT = option(
    "--in-front",
    "leave out occluded pixels by mask and search (find), by the mask alone (painted), or none "
    "(nothing) (default: find)",
)
WITHOUT = option(
    "--without PART",
    "leave out a part, in a scene ID:PART; repeat for more (default: the pose file's parts)",
    action="append",
)
COMPARED = (
    option(
        "--chart", "set the pose parameters searched (default: auto, a vehicle's if it has wheels)"
    ),
    option("--free-focal", "search for the focal length, too"),
    option(
        "--free-principal-point",
        "search for the principal point, too, as of a cropped photo (several photos, or a car)",
    ),
    option("--grey", "compare grey instead of RGB"),
    REFLECTANCE,
    PIXELS,
    option(f"--region {RECTANGLE}", "compare no pixel outside, in px (default: by --pixels)"),
    MASK,
    MASK_LABEL,
    IN_FRONT,
    WITHOUT,
    option("--renderer", "choose the renderer; gpu is experimental (default: auto, the software)"),
)
EVALUATIONS = option(
    "--evaluations N", f"stop after N evaluations of the loss (default: {Limits().evaluations})"
)
SECONDS = option("--seconds SECONDS", f"stop after this time, in s (default: {Limits().seconds:g})")
LIMITS = (EVALUATIONS, SECONDS)
KEEP_START = option("--keep-start", "keep the start unless the pose found is sure to be better")
OF_VIEWS = (
    option("--view NAME", "take --pose in this photo of the set (default: the one in its file)"),
    option("--photos NAME,...", "use these photos of the set (default: all)"),
    option("--scale LENGTHS", "set how many model units a unit of the set is (default: by both)"),
    option("--photo-folder FOLDER", "find COLMAP's photos here (default: images)", dest="folder"),
    option("--rig-object N", "take a BOP camera's motion from object N (default: its own poses)"),
)
LENS_MODELS = ("opencv", "fisheye")
"""OpenCV lens models that a file may leave unsaid."""
CAMERAS = (
    "read camera and lens, as of OpenCV, COLMAP, BOP and others (poseviewer info --calibration "
    "--help lists them), and undistort the photo (default: a pinhole, by EXIF or with a view of 50 "
    "degrees)"
)
CALIBRATION = option("--calibration FILE", CAMERAS)
LENS_MODEL = option(
    "--lens-model", "read a lens as of this OpenCV model (default: the file's)", LENS_MODELS
)
OF_CALIBRATION = (
    option(
        "--calibration-camera NAME",
        "choose this camera of the file (default: the photo's)",
        dest="camera",
    ),
    LENS_MODEL,
)
CAMERA: Options = {"the photo's camera": (CALIBRATION, *OF_CALIBRATION)}
SEQUENCE = (
    option("--every N", "take every N-th frame of a video or a folder of frames (default: 1)"),
    option("--frames FOLDER", "keep a video's frames here (default: VIDEO.frames beside it)"),
)
SETS = option(
    "--views SET",
    "fit one pose to several photos, not PHOTO: SET.json, a COLMAP folder, transforms.json or a "
    "BOP scene (default: none)",
)
VIEWS: Options = {"several photos, one pose": (SETS, *OF_VIEWS)}
SCENE: Options = {**CAMERA, **VIEWS, "comparison": COMPARED}
"""Options of ``case.load_named``, besides ``FILES`` and a pose."""
ADDRESS = "listen here, at 0.0.0.0 for other machines, too (default: %(default)s)"
SERVER = (
    option("--port PORT", "serve the page at this port (default: the first free from 8080 on)"),
    option("--host HOST", ADDRESS, default="127.0.0.1"),
    option("--no-browser", "do not open the browser", action="store_false", dest="browser"),
)
APP_RENDERER = option(
    "--renderer",
    "search and map by this renderer; gpu is experimental (default: auto, which is software)",
    ("auto", "software", "gpu"),
)
OBJECT = option("--object ID", "choose this object of the scene (default: all, or the only one)")
POSE = option("--pose POSE.json", "take the pose from this file (default: none)")
BOX = option(f"--box {RECTANGLE}", "find the start in here, in px (default: the full image)")
FEATURES = option(
    "--features FILE.safetensors",
    "find untextured models in the full image by these weights of DINOv2 (default: none)",
)
INSTANCES = option("--instances N", "find N instances of the model in the photo (default: 1)")
FOCAL = option("--focal PX", "set a focal length that no pose file gives, in px (default: EXIF's)")
STARTS = (
    POSE,
    option("--pairs FILE", "start from rows x,y,z,u,v of model points and pixels (default: none)"),
    option(
        "--wheels REAR;FRONT",
        "start from two ellipses cx,cy,a,b,angle in px, angle in degrees (default: none)",
    ),
    option(f"--find-wheels {RECTANGLE}", "find both wheels in here, in px (default: none)"),
    option("--start", "find it in --box, --region or the full image (default: none)", ("auto",)),
)
"""Options that give the start pose."""
OF_A_PHOTO = (MASK, MASK_LABEL, CALIBRATION, BOX, INSTANCES, FOCAL)
"""Options refused with a set of photos or a scene, whose files have these values."""


def each(group: Group) -> Iterator[Option]:
    """Yield the options of a group, and of the groups in it."""
    for item in group:
        yield from (item,) if isinstance(item, Option) else each(item)


def inputs(options: Namespace, of_command: Options) -> list[Path]:
    """Return the paths to read; empty for a command that writes no named file."""
    every = [item for group in of_command.values() for item in each(group)]
    given = [(item, getattr(options, item.name, None)) for item in every]
    paths = [
        value if isinstance(value, list) else [value] for item, value in given if not item.is_output
    ]
    reads = any(item.is_output for item in every)
    return [path for group in paths for path in group if isinstance(path, Path)] if reads else []


def in_options(sentence: str, of_command: Options) -> str:
    """Name a command's options where a sentence of the library names its settings."""
    own: dict[str, Option] = {}
    for item in (item for group in of_command.values() for item in each(group)):
        own.setdefault(item.name, item)  # of an option and its alias, the option

    def word(name: str, value: str) -> str | None:
        return own[name].usage(value) if name in own else None

    return in_words(sentence, word)


def values(options: Namespace, group: Iterable[Option]) -> dict[str, Any]:
    """Return the values of a group's options by their names; None for options not given."""
    return {item.name: getattr(options, item.name, None) for item in group}


def refuse(options: Namespace, group: Iterable[Option], why: str) -> None:
    """Raise ``SettingsError`` if an option of the group is given."""
    for item in group:
        if getattr(options, item.name, None) not in (None, False):
            raise SettingsError(f"{item.flag} {why}")


def make(of: Callable[..., T], options: Namespace, /, **more: Any) -> T:
    """Make a dataclass from the options named as its fields; other fields have their defaults."""
    given = {field.name: getattr(options, field.name, None) for field in fields(of)}  # pyright: ignore[reportArgumentType]
    return of(**{name: value for name, value in given.items() if value is not None} | more)
