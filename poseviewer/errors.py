"""Errors that a user can cause."""

import re
from collections.abc import Callable, Sequence

MAX_MESSAGE = 1000
"""Characters: sentences take some hundreds, and paths in them some hundreds more."""


def printable(text: str, longest: int | None = None) -> str:
    """The text on one line, a question mark for each control or format character and each lone
    surrogate, which do harm on a terminal; the middle left out of more than ``longest`` characters.
    """
    shown = " ".join(text.split()) if not text.isprintable() else text
    if not shown.isprintable():
        shown = "".join(c if c.isprintable() else "?" for c in shown)
    if longest is not None and len(shown) > longest:
        half = longest // 2 - 1
        shown = f"{shown[:half]}…{shown[-half:]}"
    return shown


def percent(share: float, decimals: int = 0) -> str:
    """A share as text."""
    return f"{100.0 * share:.{decimals}f} %"


def list_names(names: Sequence[str], limit: int = 8) -> str:
    """List the first ``limit`` names, and say how many more there are."""
    more = f" and {len(names) - limit:,} more" if len(names) > limit else ""
    return ", ".join(names[:limit]) + more


SETTING = re.compile(r"`(?:\w+\.)?(\w+)(?:=([^`]+))?`")
"""A setting in a sentence, alone or with its value: `seed`, `Limits.seconds`, `pixels="whole"`."""


def in_words(sentence: str, word: Callable[[str, str], str | None]) -> str:
    """Say an error or a note, written in the library's words, in those of another place.

    Args:
        sentence: has settings in backticks.
        word: gives the place's word for the setting of a name with a value ("": with none); None
            for what is no setting there, and stays.
    """

    def own(setting: re.Match[str]) -> str:
        return word(setting[1], (setting[2] or "").strip("'\"")) or setting[0]

    return SETTING.sub(own, sentence)


class PoseViewerError(Exception):
    """Something a user can mend: one clear sentence, made ``printable``, without a traceback.

    Sentences name settings as the library does, in backticks; ``in_words`` says them elsewhere.
    """

    def __init__(self, sentence: str = "") -> None:
        super().__init__(printable(sentence, MAX_MESSAGE))


class MeshFileError(PoseViewerError):
    """A model file that cannot be used as a surface mesh."""


class PhotoFileError(PoseViewerError):
    """A photo (or mask) file that cannot be used as an image."""


class PoseFileError(PoseViewerError):
    """A pose file that cannot be used."""


class CalibrationFileError(PoseViewerError):
    """A file of cameras that cannot be used, or not with this photo."""


class FileSetError(PoseViewerError):
    """Files that came together (a drop, a zip, a folder) and cannot be used."""


class AutosaveError(PoseViewerError):
    """A session that could not be kept for later, or cannot be taken up again."""


class QuickStartError(PoseViewerError):
    """Marks on a photo (point pairs, wheels) from which no start pose follows."""


class SettingsError(PoseViewerError):
    """A combination of settings that cannot work."""


class BatchError(PoseViewerError):
    """A batch that cannot be run, or not continued."""


class SingularChartError(PoseViewerError):
    """A pose at which the vehicle chart has no well-defined numbers (a car seen head-on)."""


class RendererUnavailableError(PoseViewerError):
    """A renderer whose libraries are not on this machine."""


def sentence_of(error: BaseException) -> str:
    """Sentence about any error for its user: its own sentence, or one that says what kind it is."""
    if isinstance(error, PoseViewerError):
        return str(error)
    if isinstance(error, MemoryError):
        return "There is not enough memory for it; close other programs, or take smaller files."
    if isinstance(error, OSError) and error.strerror:
        name = "" if error.filename is None else f"{error.filename}: "
        return printable(f"{name}{error.strerror}; check the path and the disk.", MAX_MESSAGE)
    cause = printable(f"{type(error).__name__}: {error}", 200)
    return f"Something went wrong inside ({cause}); {LOG_VARIABLE}=1 shows where. {REPORTING}"


LOG_VARIABLE = "POSEVIEWER_LOG"
"""The environment variable with which the log says more than warnings: tracebacks too."""
REPORTING = "Please report it: CONTRIBUTING.md of poseviewer's source says how (Reporting errors)."
"""Sentence that follows an error of poseviewer itself."""
EXIT_BUG = 1
"""Exit code of an error of poseviewer itself."""
EXIT_MENDABLE = 2
"""Exit code of an error that the user can mend."""
EXIT_INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it (128 + SIGINT)."""
