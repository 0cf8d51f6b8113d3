"""Silence the libraries that parse files: error messages are our own."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from cv2.utils import logging as cv2_logging

SILENT = logging.CRITICAL + 1


@contextmanager
def quiet_libraries() -> Iterator[None]:
    """No warnings and no log lines of trimesh, Pillow and OpenCV inside the ``with`` block.

    What libjpeg itself prints about a slightly damaged JPEG cannot be reached from here.
    """
    levels = {logging.getLogger(name): logging.getLogger(name).level for name in ("trimesh", "PIL")}
    cv2_level = cv2_logging.getLogLevel()
    cv2_logging.setLogLevel(cv2_logging.LOG_LEVEL_SILENT)
    for logger in levels:
        logger.setLevel(SILENT)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        cv2_logging.setLogLevel(cv2_level)
        for logger, level in levels.items():
            logger.setLevel(level)
