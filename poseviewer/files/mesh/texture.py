"""Textures of models."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from poseviewer.files.quiet import quiet_libraries

LARGEST_SIDE = 8192


def load_texture(folder: Path, name: str) -> NDArray[np.uint8]:
    """The picture ``name`` of a model in ``folder`` as RGB (h, w, 3).

    Models are often moved without the folders their textures lay in, so beside the path as
    written, the bare file name is looked for next to the model.

    Raises:
        OSError: there is no such picture, or it cannot be read; says which.
    """
    written = Path(name.strip().strip('"').replace("\\", "/"))
    for path in (folder / written, folder / written.name):
        if path.is_file():
            try:
                with quiet_libraries(), Image.open(path) as image:
                    return texture_from_image(image)
            except Image.DecompressionBombError as error:
                raise OSError(f"{path.name} has too many pixels") from error
    raise FileNotFoundError(f"{written.name} is not there")


def texture_from_image(image: Image.Image) -> NDArray[np.uint8]:
    """RGB (h, w, 3) of a picture, shrunk where a side is longer than ``LARGEST_SIDE``.

    Raises:
        OSError: the picture is damaged or larger than Pillow takes.
    """
    try:
        if max(image.size) > LARGEST_SIDE:
            image.thumbnail((LARGEST_SIDE, LARGEST_SIDE))
        return np.asarray(image.convert("RGB"))
    except (SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise OSError(str(error)) from error
