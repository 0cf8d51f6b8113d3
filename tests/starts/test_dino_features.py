"""The backbone against plain formulas, against OpenCV where a trained one is there, and files."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from safetensors.numpy import save_file
from scipy.signal import correlate
from scipy.special import erf, softmax

from poseviewer.errors import SettingsError
from poseviewer.starts.dino_features import PatchEncoder
from tests.starts.backbone import D, save_random_backbone, trained_backbone


def encode_plainly(weights: dict[str, np.ndarray], picture: np.ndarray) -> np.ndarray:
    """Encode a picture of 3x3 patches, where positions need no interpolation, as in the papers."""

    def get(name: str) -> np.ndarray:
        return weights[name].astype(float)

    def linear(x: np.ndarray, name: str) -> np.ndarray:
        return np.einsum("od,nd->no", get(f"{name}.weight"), x) + get(f"{name}.bias")

    def normalise(x: np.ndarray, name: str) -> np.ndarray:
        y = (x - x.mean(1)[:, None]) / np.sqrt(x.var(1)[:, None] + 1e-6)
        return y * get(f"{name}.weight") + get(f"{name}.bias")

    scaled = (picture / 255.0 - [0.485, 0.456, 0.406]) / [0.229, 0.224, 0.225]
    kernels = get("embeddings.patch_embeddings.projection.weight").transpose(0, 2, 3, 1)
    planes = [correlate(scaled, kernel, "valid")[::14, ::14, 0] for kernel in kernels]
    tokens = np.stack(planes, axis=2).reshape(9, D)
    tokens += get("embeddings.patch_embeddings.projection.bias")
    x = np.concatenate([get("embeddings.cls_token")[0], tokens])
    x += get("embeddings.position_embeddings")[0]
    for layer in (f"encoder.layer.{number}." for number in range(9)):
        y = normalise(x, f"{layer}norm1")
        q, k, v = (linear(y, f"{layer}attention.attention.{p}") for p in ("query", "key", "value"))
        y = linear(softmax(q @ k.T / 8.0, axis=1) @ v, f"{layer}attention.output.dense")
        x = x + get(f"{layer}layer_scale1.lambda1") * y
        y = linear(normalise(x, f"{layer}norm2"), f"{layer}mlp.fc1")
        y = linear(y * (1.0 + erf(y / np.sqrt(2.0))) / 2.0, f"{layer}mlp.fc2")
        x = x + get(f"{layer}layer_scale2.lambda1") * y
    return x[1:].reshape(3, 3, D)


def test_the_backbone_computes_what_the_papers_say(tmp_path: Path):
    weights = save_random_backbone(tmp_path / "model.safetensors")
    picture = np.random.default_rng(1).integers(0, 256, (42, 42, 3)).astype(np.uint8)
    plain = encode_plainly(weights, picture)
    plain /= np.linalg.norm(plain, axis=2, keepdims=True)
    quick = PatchEncoder.load(tmp_path / "model.safetensors").encode(picture)
    np.testing.assert_allclose(quick, plain, atol=3e-3)  # by an approximate GELU


@pytest.mark.slow
def test_a_trained_backbone_gives_what_opencv_gives(tmp_path: Path):
    path, source = trained_backbone(tmp_path)
    if source is None:
        pytest.skip("POSEVIEWER_FEATURES names weights alone: nothing to compare with")
    onnx = pytest.importorskip("onnx")
    model, name = onnx.load(source), "/backbone/encoder/layer.8/Add_1_output_0"
    model.graph.output.append(onnx.helper.make_tensor_value_info(name, 1, ("b", "n", "d")))
    data = np.frombuffer(model.SerializeToString(), np.uint8)
    network = cv2.dnn.readNetFromONNX(data, engine=cv2.dnn.ENGINE_NEW)
    coarse = np.random.default_rng(1).integers(0, 256, (10, 12, 3)).astype(np.uint8)
    picture = np.asarray(
        cv2.resize(coarse, (14 * 12, 14 * 10), interpolation=cv2.INTER_CUBIC), np.uint8
    )
    scaled = (picture / 255.0 - [0.485, 0.456, 0.406]) / [0.229, 0.224, 0.225]
    network.setInput(np.ascontiguousarray(scaled.transpose(2, 0, 1)[None], np.float32))
    outputs = network.forward(network.getUnconnectedOutLayersNames())
    tokens = outputs[-1][0, 1:].reshape(10, 12, -1)
    tokens /= np.linalg.norm(tokens, axis=2, keepdims=True)
    quick = PatchEncoder.load(path).encode(picture)
    np.testing.assert_allclose(quick, tokens, atol=2e-3)  # by an approximate GELU


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda weights: weights.pop("encoder.layer.8.mlp.fc2.bias"), "no weights of DINOv2"),
        (
            lambda weights: weights.update({"encoder.layer.0.mlp.fc2.bias": np.zeros(3)}),
            "no weights of DINOv2",
        ),
        (lambda weights: weights["encoder.layer.0.norm1.bias"].fill(np.nan), "weights of another"),
        (
            lambda weights: weights.update({"embeddings.register_tokens": np.zeros((1, 4, D))}),
            "weights of another",
        ),
    ],
)
def test_weights_of_another_network_are_refused(tmp_path: Path, change, words: str):
    path = tmp_path / "model.safetensors"
    weights = save_random_backbone(path)
    change(weights)
    save_file(weights, path)
    with pytest.raises(SettingsError, match=f"model.safetensors: {words}"):
        PatchEncoder.load(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no such file"),
        (b"", "an empty file"),
        (b"text" * 9, "no safetensors file"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes | None, words: str):
    path = tmp_path / "network.onnx"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SettingsError, match=words):
        PatchEncoder.load(path)
