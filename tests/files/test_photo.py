import hashlib
import math
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image, ImageSequence, TiffImagePlugin

from poseviewer.errors import PhotoFileError
from poseviewer.files.photo import load_photo, save_image
from poseviewer.geometry.camera import Perspective

RGB = np.random.default_rng(5).integers(0, 256, (48, 64, 3), dtype=np.uint8)
DEEP = np.random.default_rng(6).integers(0, 65536, (48, 64, 3), dtype=np.uint16)


def smooth_picture(width: int = 64, height: int = 48) -> np.ndarray:
    """Different at each corner, and hardly changed by JPEG."""
    y, x = np.mgrid[0:height, 0:width]
    red, green = 255 * x / max(width - 1, 1), 255 * y / max(height - 1, 1)
    return np.stack([red, green, 0 * x + 90], axis=2).astype(np.uint8)


def write(path: Path, rgb: np.ndarray) -> None:
    """By OpenCV, which writes 16 bits also."""
    picture = rgb[..., ::-1] if rgb.ndim == 3 else rgb
    path.write_bytes(cv2.imencode(path.suffix, picture)[1].tobytes())


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".bmp", ".webp"])
def test_colours_come_back(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"photo{suffix}"
    options: dict[str, Any] = {"lossless": True} if suffix == ".webp" else {}
    Image.fromarray(RGB).save(path, **options)
    photo = load_photo(path)
    np.testing.assert_array_equal(photo.pixels, RGB)
    assert (photo.width, photo.height, photo.name) == (64, 48, path.name)
    assert photo.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert photo.notes == ()


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
@pytest.mark.parametrize("grey", [False, True])
def test_16_bits_and_grey_are_kept(tmp_path: Path, suffix: str, grey: bool) -> None:
    deep = DEEP[..., :1] if grey else DEEP
    for pixels in (deep, (deep // 257).astype(np.uint8)):
        write(tmp_path / f"deep{suffix}", pixels[..., 0] if grey else pixels)
        photo = load_photo(tmp_path / f"deep{suffix}")
        np.testing.assert_array_equal(photo.pixels, pixels)
        expected = np.broadcast_to(pixels / float(np.iinfo(pixels.dtype).max), DEEP.shape)
        np.testing.assert_allclose(photo.as_float(), expected, atol=1e-6)


@pytest.mark.parametrize("mode", ["RGBA", "LA", "P", "1", "CMYK", "I;16"])
def test_other_kinds_of_pixels_are_understood(tmp_path: Path, mode: str) -> None:
    rgb = Image.fromarray(smooth_picture())
    image = rgb.convert("L").convert(mode) if mode in ("LA", "1", "I;16") else rgb.convert(mode)
    path = tmp_path / ("photo.jpg" if mode == "CMYK" else "photo.png")
    image.save(path)
    photo = load_photo(path)
    if mode == "I;16":
        expected = np.asarray(image)[..., None] / 65535.0
    else:
        expected = np.asarray(image.convert("RGB")) / 255.0
    np.testing.assert_allclose(photo.as_float(), np.broadcast_to(expected, (48, 64, 3)), atol=0.06)
    assert photo.notes == (("Its transparency is left out.",) if "A" in mode else ())


def upright(stored: np.ndarray, orientation: int) -> np.ndarray:
    """EXIF's orientations by their definition: where the 0th row and the 0th column are."""
    wanted = stored.swapaxes(0, 1) if orientation >= 5 else stored
    wanted = wanted[:, ::-1] if orientation in (2, 3, 6, 7) else wanted
    return wanted[::-1] if orientation in (3, 4, 7, 8) else wanted


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tiff", ".webp"])
def test_photos_are_upright(tmp_path: Path, orientation: int, suffix: str) -> None:
    path, exif = tmp_path / f"photo{suffix}", Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    options: dict[str, Any] = {} if suffix == ".tiff" else {"quality": 95}
    Image.fromarray(smooth_picture()).save(path, exif=exif, **options)
    wanted = upright(smooth_picture(), orientation)
    np.testing.assert_allclose(load_photo(path).pixels, wanted, atol=12)


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_photos_of_16_bits_are_upright(tmp_path: Path, suffix: str) -> None:
    path, exif = tmp_path / f"turned{suffix}", Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    Image.fromarray(DEEP[..., 0]).save(path, exif=exif)
    np.testing.assert_array_equal(load_photo(path).pixels, upright(DEEP[..., :1], 6))


RATIONAL = TiffImagePlugin.IFDRational
SENSOR = {"FocalLength": RATIONAL(45), "FocalPlaneXResolution": RATIONAL(6000 * 10, 36),
          "FocalPlaneResolutionUnit": 3, "ExifImageWidth": 6000}  # fmt: skip
"""A full-frame sensor of 36 x 27 mm with a 45 mm lens; the photo was shrunk afterwards."""
FALLBACK = 32.0 / math.tan(math.radians(25.0))
"""Focal length at which 64 px are 50 degrees."""


@pytest.mark.parametrize(("tags", "fx"), [
    ({"FocalLengthIn35mmFilm": 28}, Perspective.from_focal_length_35mm(28.0, 64, 48).fx),
    (SENSOR, 45.0 / 36.0 * 64),
    ({}, FALLBACK),
    ({"FocalLengthIn35mmFilm": 0}, FALLBACK),
    ({"FocalLength": RATIONAL(50)}, FALLBACK),
    ({"FocalLength": RATIONAL(50, 0), "FocalPlaneXResolution": 5}, FALLBACK),
    ({"FocalPlaneResolutionUnit": 9, "FocalPlaneXResolution": 5}, FALLBACK),
])  # fmt: skip
def test_the_camera_follows_exif(tmp_path: Path, tags: dict[str, Any], fx: float) -> None:
    exif = Image.Exif()
    inner = exif.get_ifd(ExifTags.IFD.Exif)
    inner.update({ExifTags.Base[name]: value for name, value in tags.items()})
    Image.fromarray(RGB).save(tmp_path / "photo.jpg", exif=exif)
    camera = load_photo(tmp_path / "photo.jpg").default_camera()
    assert camera.fx == pytest.approx(fx, rel=1e-4)
    assert (camera.cx, camera.cy) == (32.0, 24.0)


@pytest.mark.slow
def test_100_megapixels_are_a_photo(tmp_path: Path) -> None:
    large = np.zeros((10_000, 10_000), np.uint8)
    large[-1, -1] = 200
    write(tmp_path / "large.png", large)
    photo = load_photo(tmp_path / "large.png")
    assert photo.pixels.shape == (10_000, 10_000, 1)
    assert photo.pixels[-1, -1, 0] == 200


def test_what_is_no_photo_is_not_believed_about_its_lengths(tmp_path: Path) -> None:
    """A GIMP brush of 40 bytes that announces a comment of 1.4 GB."""
    path = tmp_path / "brush.webp"
    path.write_bytes(struct.pack(">5I", 0x52120003, 1, 8, 8, 1) + bytes(20))
    with pytest.raises(PhotoFileError, match="not a picture that can be read"):
        load_photo(path)


def test_floating_point_pixels_are_refused(tmp_path: Path) -> None:
    write(tmp_path / "float.tiff", np.zeros((48, 64), np.float32))
    with pytest.raises(PhotoFileError, match=r"^float\.tiff: pixels of type .*8 or 16 bits"):
        load_photo(tmp_path / "float.tiff")


def test_pictures_are_saved_whole_under_any_name(tmp_path: Path) -> None:
    path = tmp_path / "Bild 写真 ü.png"
    save_image(path, RGB[:5])
    save_image(path, RGB)
    np.testing.assert_array_equal(load_photo(path).pixels, RGB)
    assert list(tmp_path.iterdir()) == [path]
    (tmp_path / "plain").touch()
    assert path.stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize("name", ["picture", "picture.xyz"])
def test_pictures_of_unknown_kind_are_not_saved(tmp_path: Path, name: str) -> None:
    with pytest.raises(PhotoFileError, match=rf"^{name}: .*use \.png or \.jpg"):
        save_image(tmp_path / name, RGB)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a.dng", "a.nef", "a.cr2", "a.arw", "a.tif", "a.jpg"])
@pytest.mark.parametrize("tags", [{254: 1}, {50706: b"\1\4\0\0"}])
def test_a_raw_photo_is_not_opened_as_its_preview(tmp_path: Path, name: str, tags) -> None:
    info = TiffImagePlugin.ImageFileDirectory_v2()
    for tag, value in tags.items():
        info[tag] = value
        info.tagtype[tag] = 4 if tag == 254 else 1
    Image.fromarray(RGB).save(tmp_path / name, "TIFF", tiffinfo=info)
    with pytest.raises(PhotoFileError, match="a raw photo; develop it"):
        load_photo(tmp_path / name)


def tiff(data: bytes, lists: bytes, *entries: tuple[int, int, int, int]) -> bytes:
    """A TIFF 6.0 file by hand: pixels of 16 bits, what its entries point at, and these."""
    head = struct.pack("<2sHI", b"II", 42, 8 + len(data) + len(lists))
    table = struct.pack("<H", len(entries)) + b"".join(struct.pack("<HHII", *e) for e in entries)
    return head + data + lists + table + bytes(4)


def tiled_tiff(pixels: np.ndarray, orientation: int, photometric: int = 1) -> bytes:
    """A TIFF of tiles of 16 x 16 px."""
    height, width = pixels.shape
    corners = [(y, x) for y in range(0, height, 16) for x in range(0, width, 16)]
    tiles = [np.ascontiguousarray(pixels[y : y + 16, x : x + 16], "<u2") for y, x in corners]
    data, count = b"".join(tile.tobytes() for tile in tiles), len(tiles)
    at, size = 8 + len(data), len(data) // count
    lists = struct.pack(f"<{2 * count}I", *range(8, at, size), *[size] * count)
    return tiff(data, lists, (256, 4, 1, width), (257, 4, 1, height), (258, 3, 1, 16),
                (259, 3, 1, 1), (262, 3, 1, photometric), (274, 3, 1, orientation), (277, 3, 1, 1),
                (322, 3, 1, 16), (323, 3, 1, 16), (324, 4, count, at),
                (325, 4, count, at + 4 * count))  # fmt: skip


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_tiled_tiff_is_turned_upright(tmp_path: Path, orientation: int) -> None:
    (tmp_path / "a.tif").write_bytes(tiled_tiff(DEEP[..., 0], orientation))
    wanted = upright(DEEP[..., :1], orientation)
    np.testing.assert_array_equal(load_photo(tmp_path / "a.tif").pixels, wanted)


def test_white_may_be_zero_with_16_bits(tmp_path: Path) -> None:
    (tmp_path / "a.tif").write_bytes(tiled_tiff(DEEP[..., 0], 1, photometric=0))
    np.testing.assert_array_equal(load_photo(tmp_path / "a.tif").pixels, 65535 - DEEP[..., :1])


def test_16_bits_in_planes_are_refused(tmp_path: Path) -> None:
    data = b"".join(np.ascontiguousarray(DEEP[..., i], "<u2").tobytes() for i in range(3))
    at, size = 8 + len(data), len(data) // 3
    lists = struct.pack("<3H6I", 16, 16, 16, 8, 8 + size, 8 + 2 * size, size, size, size)
    path = tmp_path / "a.tif"
    path.write_bytes(tiff(data, lists, (256, 4, 1, 64), (257, 4, 1, 48), (258, 3, 3, at),
                          (259, 3, 1, 1), (262, 3, 1, 2), (273, 4, 3, at + 6), (277, 3, 1, 3),
                          (278, 4, 1, 48), (279, 4, 3, at + 18), (284, 3, 1, 2)))  # fmt: skip
    with pytest.raises(PhotoFileError, match=r"a plane of its own; save it with interleaved"):
        load_photo(path)


def test_a_jpeg_of_very_many_scans_is_refused_at_once(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    path = tmp_path / "scans.jpg"
    # An embedded preview holds markers of its own, in a segment that is passed over.
    Image.fromarray(noise).save(path, progressive=True, comment=b"\xff\xda" * 200)
    whole = path.read_bytes()
    assert load_photo(path).width == 64
    at = whole.rindex(b"\xff\xda")
    path.write_bytes(whole[:-2] + whole[at : at + 20] * 3000 + b"\xff\xd9")
    with pytest.raises(PhotoFileError, match="a JPEG of 101 scans or more"):
        load_photo(path)
    path.write_bytes(whole + b"\xff\xda" * 3000)  # behind its end cameras put films
    assert load_photo(path).width == 64


def test_libraries_print_nothing_about_a_damaged_photo(tmp_path: Path, capfd) -> None:
    path = tmp_path / "a.jpg"
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8)).save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] + b"\xff\xd3\x12\x34" + whole[len(whole) // 2 :])
    assert load_photo(path).width == 80
    Image.open(path).save(tmp_path / "a.png", icc_profile=b"bad" * 60)
    assert load_photo(tmp_path / "a.png").notes == ()
    assert capfd.readouterr().err == ""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="counts memory as Linux does")
def test_a_deep_photo_takes_about_twice_the_memory_of_its_pixels(tmp_path: Path) -> None:
    path = tmp_path / "deep.png"
    cv2.imwrite(str(path), np.zeros((5000, 6000, 4), np.uint16), [cv2.IMWRITE_PNG_COMPRESSION, 1])
    script = (
        "import re, sys; from pathlib import Path; from poseviewer.files.photo import load_photo\n"
        "status = Path('/proc/self/status')\n"
        "peak = lambda: 1024 * int(re.search(r'VmHWM:\\s+(\\d+)', status.read_text())[1])\n"
        "before = peak(); photo = load_photo(sys.argv[1])\n"
        "print((peak() - before) / photo.pixels.nbytes)"
    )
    line = [sys.executable, "-c", script, str(path)]
    done = subprocess.run(line, capture_output=True, text=True, check=True, cwd=Path.cwd())
    assert float(done.stdout) < 2.3


@pytest.mark.parametrize("name", ["stack.tif", "moving.png", "moving.webp"])
def test_the_first_of_several_pictures_is_used_and_this_is_said(tmp_path: Path, name) -> None:
    shown = [Image.new("RGB", (8, 6), (50 * index, 0, 0)) for index in range(3)]
    shown[0].save(tmp_path / name, save_all=True, append_images=shown[1:])
    photo = load_photo(tmp_path / name)
    assert photo.notes == ("The first of its 3 pictures is used.",)
    assert photo.pixels.max() == 0
    shown[0].save(tmp_path / name)
    assert not load_photo(tmp_path / name).notes


@pytest.mark.parametrize("cut", [20, 60, 100, 200])
def test_a_damaged_further_page_leaves_the_first(tmp_path: Path, cut) -> None:
    shown = [Image.new("RGB", (8, 6), (50 * index, 0, 0)) for index in range(2)]
    shown[0].save(tmp_path / "a.tif", save_all=True, append_images=shown[1:])
    data = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "a.tif").write_bytes(data[:-cut])
    assert load_photo(tmp_path / "a.tif").pixels.max() == 0


def test_previews_and_masks_of_a_tiff_are_no_further_pictures(tmp_path: Path) -> None:
    pages = [Image.new("L", (8, 6)), Image.new("L", (4, 3)), Image.new("1", (8, 6))]
    for page, kind in zip(pages, (0, 1, 4), strict=True):
        page.encoderinfo = {"tiffinfo": {ExifTags.Base.NewSubfileType: kind}}
    pages[0].save(tmp_path / "a.tif", save_all=True, append_images=pages[1:])
    with Image.open(tmp_path / "a.tif") as image:
        assert len([*ImageSequence.Iterator(image)]) == 3
    assert not load_photo(tmp_path / "a.tif").notes
