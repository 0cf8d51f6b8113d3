"""Weights of a network: a safetensors file, which holds names and numbers alone."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load

from poseviewer.errors import SettingsError
from poseviewer.files.checks import InputFile

WANTED_WEIGHTS = "wanted model.safetensors of facebook/dinov2-small or dinov2-base"
"""Demand of errors."""
MAX_FILE_BYTES = 400_000_000
"""Largest file: that of DINOv2's base has 350 MB."""


def load_weights(path: Path) -> tuple[dict[str, NDArray[np.float32]], bytes]:
    """Return the arrays of a file by their names, and its SHA-256.

    Raises:
        SettingsError: the file cannot be read.
    """
    file = InputFile(path, [], SettingsError, "file of weights (safetensors)", MAX_FILE_BYTES)
    with file.naming_errors(), file.open() as opened:
        data = opened.read()
        try:
            arrays: dict[str, NDArray[Any]] = load(data)
        except (SafetensorError, KeyError, TypeError):  # or numbers that NumPy does not have
            raise file.error("no safetensors file that NumPy can read", WANTED_WEIGHTS) from None
        weights = {name: np.asarray(array, np.float32) for name, array in arrays.items()}
    return weights, hashlib.sha256(data).digest()
