"""The textures' definition: orientation, wrapping, levels."""

import numpy as np
import pytest

from poseviewer.render.texture import MAX_TEXTURE_SIDE_PX, TexturePyramid, mip_levels
from tests.meshes import make_mesh


def make_textures(*sizes, seed=0):
    random = np.random.default_rng(seed)
    return [random.integers(0, 256, (h, w, 3), dtype=np.uint8) for w, h in sizes]


def test_every_level_keeps_the_mean_and_halves_the_size():
    textures = make_textures((64, 32), (7, 5), (1, 1))
    texels, table = TexturePyramid.of(textures)
    assert texels.dtype == np.float32
    assert table.shape == (3, 7, 3)
    for texture, levels in zip(textures, table, strict=True):
        for k, (offset, width, height) in enumerate(levels):
            assert (width, height) == (max(1, texture.shape[1] >> k), max(1, texture.shape[0] >> k))
            level = texels[offset : offset + width * height]
            assert level.mean(axis=0) == pytest.approx(texture.mean(axis=(0, 1)) / 255, abs=1e-5)
    assert (table[1, 3:] == table[1, 2]).all()


def test_large_textures_are_reduced_first():
    _, table = TexturePyramid.of([np.zeros((4, 2 * MAX_TEXTURE_SIDE_PX, 3), np.uint8)])
    assert table[0, 0].tolist() == [0, MAX_TEXTURE_SIDE_PX, 2]


def test_between_texels_is_bilinear_also_across_the_border():
    texture = np.zeros((1, 4, 3), np.uint8)
    texture[0, 0] = 100
    texture[0, 3] = 200
    pyramid = TexturePyramid.of([texture])
    value = pyramid.sample([0, 0], [0, 0], [[0.0, 0.3], [0.25, 0.7]])
    assert value[:, 0] * 255 == pytest.approx([150.0, 50.0], abs=1e-4)


def test_level_makes_texels_as_large_as_pixels():
    sizes = 4.0 ** np.arange(6)
    assert mip_levels(sizes, 1.0, 10).tolist() == [0, 1, 2, 3, 4, 5]
    assert mip_levels(1.9, 1.0, 10) == 0
    assert mip_levels(2.1, 1.0, 10) == 1
    assert mip_levels(0.01, 1.0, 10) == 0
    assert mip_levels(4.0**8, 1.0, 4) == 3
    assert mip_levels(5.0, 0.0, 4) == 3
    assert mip_levels(5.0, np.nan, 4) == 0
    assert mip_levels(0.0, 0.0, 4) == 0


def test_texel_areas_count_texels():
    mesh = make_mesh(
        np.zeros((3, 3)),
        [[0, 1, 2]],
        normals=np.tile([0.0, 0.0, 1.0], (3, 1)),
        uvs=[[0, 0], [0.5, 0], [0, 1]],
        face_texture=[0],
        textures=tuple(make_textures((8, 16))),
    )
    areas = TexturePyramid.of(mesh.textures).texel_areas(mesh)
    assert areas == pytest.approx([4 * 16])
