"""The errors a user can cause.

Each message says what, what was found, what was wanted and what to do.
"""


class PoseViewerError(Exception):
    """Something a user can mend; its text is one clear sentence, shown without a traceback."""


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
    """A batch that cannot be run, or not gone on with."""


class SingularChartError(PoseViewerError):
    """A pose at which the vehicle chart has no well-defined numbers (a car seen head-on)."""


class RendererUnavailableError(PoseViewerError):
    """A renderer whose libraries are not on this machine."""


EXIT_MENDABLE = 2
"""Exit code of a mistake that the user can mend."""
EXIT_INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it (128 + SIGINT)."""
