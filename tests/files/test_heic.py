import sys
from io import BytesIO

import numpy as np
import pytest
from PIL import ExifTags, Image

from poseviewer.errors import PhotoFileError
from poseviewer.files.photo import load_photo
from poseviewer.geometry.camera import Perspective
from tests.writing import write

RGB = (np.arange(48 * 64 * 3) % 251).reshape(48, 64, 3).astype(np.uint8)
LOSSLESS = {"quality": -1, "chroma": 444, "matrix_coefficients": 0}
HEAD = b"\x00\x00\x00\x1cftypheic\x00\x00\x00\x00mif1heic"


def heic(pixels: np.ndarray, mode: str, **options: object) -> bytes:
    pillow_heif = pytest.importorskip("pillow_heif")
    file = pillow_heif.from_bytes(mode, pixels.shape[1::-1], pixels.tobytes())
    memory = BytesIO()
    file.save(memory, **LOSSLESS, **options)
    return memory.getvalue()


def test_a_heic_photo_is_read_with_its_focal_length(tmp_path):
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 28
    photo = load_photo(write(tmp_path / "p.heic", heic(RGB, "RGB", exif=exif.tobytes())))
    np.testing.assert_array_equal(photo.pixels, RGB)
    assert not photo.pixels.flags.writeable
    assert photo.default_camera() == Perspective.from_focal_length_35mm(28.0, 64, 48)


def test_ten_bits_are_kept(tmp_path):
    deep = np.random.default_rng(0).integers(0, 65535, (48, 64, 3), dtype=np.uint16)
    photo = load_photo(write(tmp_path / "p.heic", heic(deep, "RGB;16")))
    assert photo.pixels.dtype == np.uint16
    assert np.abs(photo.pixels.astype(int) - deep).max() < 64  # the lower 6 of 16 bits


@pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
def test_a_cut_file_is_refused_with_one_sentence(tmp_path, share):
    data = heic(RGB, "RGB")
    path = write(tmp_path / "p.heic", data[: int(len(data) * share)])
    with pytest.raises(PhotoFileError, match=r"^p\.heic: not a readable photo.*\.$"):
        load_photo(path)


def test_without_its_extra_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pillow_heif", None)  # as Python has what cannot be imported
    with pytest.raises(PhotoFileError, match=r"pip install 'poseviewer\[heic\]'"):
        load_photo(write(tmp_path / "p.heic", HEAD))
