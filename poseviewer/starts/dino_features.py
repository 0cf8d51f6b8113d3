"""Features of a picture's patches by a DINOv2 backbone, from its published weights.

M. Oquab et al., *DINOv2: Learning Robust Visual Features without Supervision* (TMLR 2024): a vision
transformer (A. Dosovitskiy et al., ICLR 2021) whose layers are scaled. NumPy runs it: the file is
data alone, which runs nothing.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import SettingsError
from poseviewer.files.network_weights import WANTED_WEIGHTS, load_weights

PATCH_PX = 14
"""Side of a patch."""
LAYERS = 9
"""Layers that are run, of twelve: the ninth's features find more than the last's."""
HEAD_LENGTH = 64
"""Numbers of a query in each head of attention."""
MEAN = np.array([0.485, 0.456, 0.406], np.float32)
"""Mean RGB of the pictures that the network was trained on: ImageNet's."""
DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)
"""Standard deviation of RGB in these."""

Array = NDArray[Any]
"""Array of 32-bit floats; of sums NumPy states another type."""


@dataclass(frozen=True, slots=True, eq=False)
class PatchEncoder:
    """A backbone that gives a feature vector for each patch of a picture."""

    weights: Mapping[str, Array]
    """Arrays by the names that Hugging Face's ``Dinov2Model`` gives them."""
    digest: bytes = b""
    """Hash of the file."""

    @classmethod
    def load(cls, path: Path) -> "PatchEncoder":
        """Load a file of weights, and try them.

        Raises:
            SettingsError: the file cannot be used.
        """
        weights, digest = load_weights(path)
        encoder = cls(weights, digest)
        try:
            with np.errstate(all="ignore"):
                trial = encoder.encode(np.zeros((2 * PATCH_PX, PATCH_PX, 3), np.uint8))
        except (KeyError, ValueError):
            raise SettingsError(f"{path.name}: no weights of DINOv2; {WANTED_WEIGHTS}.") from None
        if "embeddings.register_tokens" in weights or not np.isfinite(trial).all():
            raise SettingsError(f"{path.name}: weights of another network; {WANTED_WEIGHTS}.")
        return encoder

    def encode_all(
        self, pictures: Sequence[NDArray[np.uint8]], watch: Callable[[], object]
    ) -> list[Array]:
        """Encode pictures; ``watch`` is called before each and may raise to stop."""
        grids = list[Array]()
        for picture in pictures:
            watch()
            grids.append(self.encode(picture))
        return grids

    def encode(self, picture: NDArray[np.uint8]) -> Array:
        """Return unit vectors (rows, columns, d) of the patches of a picture.

        Args:
            picture: (14 rows, 14 columns, 3), RGB.
        """
        rows, columns = (side // PATCH_PX for side in picture.shape[:2])
        scaled = (picture / np.float32(255.0) - MEAN) / DEVIATION
        patches = scaled.reshape(rows, PATCH_PX, columns, PATCH_PX, 3).transpose(0, 2, 4, 1, 3)
        kernel = self.weights["embeddings.patch_embeddings.projection.weight"]
        tokens = patches.reshape(rows * columns, -1) @ kernel.reshape(len(kernel), -1).T
        tokens += self.weights["embeddings.patch_embeddings.projection.bias"]
        positions = self.weights["embeddings.position_embeddings"][0]
        tokens += _interpolate(positions[1:], rows, columns)
        first = self.weights["embeddings.cls_token"][0] + positions[:1]
        x = np.concatenate([first, tokens])
        for layer in range(LAYERS):
            x = self._layer(x, f"encoder.layer.{layer}.")
        return unit(x[1:]).reshape(rows, columns, -1)

    def _layer(self, x: Array, name: str) -> Array:
        """Return tokens (n, d) after a layer: attention, then a perceptron, each added to them."""
        n, d = x.shape
        y = self._normalise(x, f"{name}norm1")
        query, key, value = (
            self._linear(y, f"{name}attention.attention.{part}")
            .reshape(n, d // HEAD_LENGTH, HEAD_LENGTH)
            .transpose(1, 0, 2)
            for part in ("query", "key", "value")
        )
        query *= np.float32(HEAD_LENGTH**-0.5)
        attention = query @ key.transpose(0, 2, 1)
        attention -= attention.max(axis=-1, keepdims=True)
        np.exp(attention, out=attention)
        y = (attention @ value) / attention.sum(axis=-1, keepdims=True)
        y = self._linear(y.transpose(1, 0, 2).reshape(n, d), f"{name}attention.output.dense")
        x = x + y * self.weights[f"{name}layer_scale1.lambda1"]
        y = _gelu(self._linear(self._normalise(x, f"{name}norm2"), f"{name}mlp.fc1"))
        y = self._linear(y, f"{name}mlp.fc2")
        return x + y * self.weights[f"{name}layer_scale2.lambda1"]

    def _linear(self, x: Array, name: str) -> Array:
        y = x @ self.weights[f"{name}.weight"].T
        y += self.weights[f"{name}.bias"]
        return y

    def _normalise(self, x: Array, name: str) -> Array:
        y = x - x.mean(axis=1, keepdims=True)
        y /= np.sqrt((y * y).mean(axis=1, keepdims=True) + np.float32(1e-6))
        return y * self.weights[f"{name}.weight"] + self.weights[f"{name}.bias"]


def unit(vectors: Array) -> Array:
    """Scale vectors (..., d) to length 1."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, np.float32(1e-6)), np.float32)


def _gelu(x: Array) -> Array:
    """Approximate GELU by a hyperbolic tangent, to 5e-4: a sixth of the time of the exact one.

    D. Hendrycks, K. Gimpel, *Gaussian Error Linear Units* (2016).
    """
    y = x * x
    y *= np.float32(0.044715 * math.sqrt(2.0 / math.pi))
    y += np.float32(math.sqrt(2.0 / math.pi))
    y *= x
    np.tanh(y, out=y)
    y += np.float32(1.0)
    y *= x
    y *= np.float32(0.5)
    return y


def _interpolate(positions: Array, rows: int, columns: int) -> Array:
    """Interpolate position vectors (n, d) of a square grid at (rows columns, d), as in training."""
    side, d = math.isqrt(len(positions)), positions.shape[1]
    planes = positions.reshape(side, side, d).transpose(2, 0, 1)
    resized = [cv2.resize(p, (columns, rows), interpolation=cv2.INTER_CUBIC) for p in planes]
    return np.array(resized).reshape(d, -1).T
