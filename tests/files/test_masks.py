"""Masks as pictures, and beside pose files."""

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from msgspec import structs
from PIL import Image

from poseviewer.errors import PhotoFileError
from poseviewer.files.masks import (
    load_mask,
    mask_as_png,
    mask_note,
    masks_beside,
    save_pose_and_masks,
)
from poseviewer.files.photo import save_image
from poseviewer.files.pose import PoseRecord, load_pose
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.transform import RigidTransform

WIDTH, HEIGHT = 64, 48
CAMERA = Perspective(100.0, 100.0, 32.0, 24.0, WIDTH, HEIGHT)
RECORD = PoseRecord.of(Pose(CAMERA, RigidTransform(np.eye(3), np.array([0.0, 0.0, 5.0]))))
COUNTS = np.ones((HEIGHT, WIDTH))
COUNTS[10:20, 30:40] = 0.0
MASK = Mask.of(COUNTS)


def test_a_mask_is_weights(tmp_path: Path) -> None:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[10:20, 30:40] = 255
    mask[0, 0] = 51
    save_image(tmp_path / "mask.png", np.repeat(mask[..., None], 3, axis=2))
    weights = load_mask(tmp_path / "mask.png", (WIDTH, HEIGHT)).weights
    np.testing.assert_allclose(weights, mask / 255.0, atol=1e-6)
    assert set(np.unique(weights[10:20, 30:40])) == {1.0}  # white, of three colours as of one
    with pytest.raises(PhotoFileError, match=r"mask\.png: the mask has 64x48 px.*640x480 px"):
        load_mask(tmp_path / "mask.png", (640, 480))


@pytest.mark.parametrize(("is_painted", "kind"), [(True, np.uint8), (False, np.uint16)])
def test_a_mask_comes_back_from_its_picture(tmp_path: Path, is_painted, kind) -> None:
    shades = np.linspace(0.0, 1.0, WIDTH * HEIGHT).reshape(HEIGHT, WIDTH)
    mask = MASK if is_painted else Mask.of(shades)
    (tmp_path / "mask.png").write_bytes(mask_as_png(mask))
    assert np.asarray(cv2.imread(str(tmp_path / "mask.png"), cv2.IMREAD_UNCHANGED)).dtype == kind
    found = load_mask(tmp_path / "mask.png", (WIDTH, HEIGHT)).weights
    np.testing.assert_allclose(found, mask.weights, atol=0.0 if is_painted else 1e-5)


@pytest.mark.parametrize("ending", [".png", ".tif", ".webp"])
def test_the_mask_of_a_cut_out_is_its_transparency(tmp_path: Path, ending: str) -> None:
    colours = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)
    alpha = (255 * COUNTS).astype(np.uint8)
    path = tmp_path / f"cut{ending}"
    Image.fromarray(np.dstack([colours, alpha])).save(path, lossless=True)
    assert np.array_equal(load_mask(path).weights, COUNTS)
    opaque = np.dstack([np.repeat(alpha[..., None], 3, axis=2), np.full_like(alpha, 255)])
    Image.fromarray(opaque).save(path, lossless=True)
    assert np.array_equal(load_mask(path).weights, COUNTS)
    black = np.dstack([np.zeros_like(colours), 255 - alpha])  # painted on a layer of its own
    Image.fromarray(black).save(path, lossless=True)
    with pytest.raises(PhotoFileError, match="black where it is opaque"):
        load_mask(path)


@pytest.mark.parametrize("values", [
    COUNTS.astype(bool), COUNTS, COUNTS.astype(np.uint8), (255 * COUNTS).astype(np.uint8),
    (65535 * COUNTS).astype(np.uint16), (255 * COUNTS[..., None]).astype(np.float32),
])  # fmt: skip
def test_arrays_and_pictures_of_two_values_are_masks(tmp_path: Path, values) -> None:
    np.save(tmp_path / "mask.npy", values)
    assert np.array_equal(load_mask(tmp_path / "mask.npy").weights, COUNTS)
    if values.dtype == np.uint8:
        cv2.imwrite(str(tmp_path / "mask.png"), values)
        assert np.array_equal(load_mask(tmp_path / "mask.png").weights, COUNTS)


@pytest.mark.parametrize("values", [
    np.zeros((2, 3, 4)), np.array(["a"]), -COUNTS, 300.0 * COUNTS, np.full((2, 2), np.nan),
    np.full((2, 2), 1e308), np.array([[0.0, np.inf]]),
])  # fmt: skip
def test_an_array_that_is_no_mask_is_said(tmp_path: Path, values) -> None:
    np.save(tmp_path / "mask.npy", values)
    with pytest.raises(PhotoFileError, match=r"mask\.npy: an array of .*; wanted"):
        load_mask(tmp_path / "mask.npy")


def test_the_head_of_an_array_takes_no_memory(tmp_path: Path) -> None:
    np.save(tmp_path / "mask.npy", COUNTS)
    data = (tmp_path / "mask.npy").read_bytes()
    lie = data.replace(b"(48, 64)" + b", }" + b" " * 8, b"(999999999, 64), } ")
    assert lie != data
    (tmp_path / "mask.npy").write_bytes(lie)
    with pytest.raises(PhotoFileError, match=r"mask\.npy: not a readable mask"):
        load_mask(tmp_path / "mask.npy")


def test_a_mask_that_hides_nothing_or_all_is_said() -> None:
    assert mask_note(MASK, "m.png") == ""
    assert "hides nothing" in mask_note(Mask.of(np.ones((2, 3))), "m.png")
    assert "hides the whole photo" in mask_note(Mask.of(np.zeros((2, 3))), "m.png")


def test_a_pose_file_names_its_mask_and_what_was_found_in_front_apart(tmp_path: Path) -> None:
    path, found = tmp_path / "car.pose.json", Mask.of(COUNTS[:, ::-1])
    save_pose_and_masks(path, RECORD, MASK, found)
    named = json.loads(path.read_text())
    assert (named["mask"], named["occluders"]) == ("car.mask.png", "car.occluders.png")
    *masks, notes = masks_beside(path, load_pose(path, WIDTH, HEIGHT), (WIDTH, HEIGHT))
    assert notes == ()
    for mask, own in zip(masks, (MASK, found), strict=True):
        assert np.array_equal(mask.weights, own.weights)
    save_pose_and_masks(path, RECORD)
    record = load_pose(path, WIDTH, HEIGHT)
    assert masks_beside(path, record, (WIDTH, HEIGHT)) == (None, None, ())


@pytest.mark.parametrize(("name", "said"), [
    ("gone.mask.png", r"Nothing of the photo is hidden: gone\.mask\.png: no such file"),
    ("small.png", r"Nothing of the photo is hidden: small\.png: the mask has 8x8 px"),
    ("../secret.png", r"secret\.png: no such file"),
])  # fmt: skip
def test_a_mask_that_cannot_be_used_is_said(tmp_path: Path, name: str, said: str) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    for path in (folder / "small.png", tmp_path / "secret.png"):
        cv2.imwrite(str(path), np.zeros((8, 8), np.uint8))
    record = structs.replace(RECORD, mask=name)
    mask, _, (note,) = masks_beside(folder / "p.json", record, (WIDTH, HEIGHT))
    assert mask is None
    assert re.search(said, note)
