"""The GPU's moments are the software renderer's; and what is done where it cannot be used."""

import sys

import numpy as np
import pytest

from poseviewer.errors import RendererUnavailableError
from poseviewer.geometry.camera import Pose
from poseviewer.losses.default_loss import structure_loss
from poseviewer.losses.paper_loss import lighting_loss
from poseviewer.render.attributes import Moments, PhotoAttributes
from poseviewer.render.gpu import device as device_of
from poseviewer.render.gpu import gpu_renderer as gpu_renderer
from poseviewer.render.gpu.gpu_renderer import GpuRenderer
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import downsample
from poseviewer.render.renderers import make_renderer
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.render.structure import make_structure
from tests.render.software.test_software_renderer import MESHES, random_pose
from tests.renderers import require_gpu

WIDTH, HEIGHT = 96, 72
POSES = 100
AGREEMENT = 1e-4
LOSSES = {
    "clipped, grey": (1, {"clipped": True}),
    "clipped": (3, {"clipped": True}),
    "region, grey": (1, {"clipped": False}),
    "region": (3, {"clipped": False}),
    "classes and edges": (3, {"clipped": False}),
    "coloured, not on the GPU": (3, {"clipped": True, "colour_reflectance": True}),
}


@pytest.fixture(autouse=True)
def _gpu(monkeypatch):
    require_gpu(monkeypatch)


def make_photo(loss: str, random: np.random.Generator) -> PhotoAttributes:
    """Patches of noise, of which a fifth does not count; part of it lies outside the region."""
    n, settings = LOSSES[loss]
    patches = random.uniform(size=(HEIGHT // 8, WIDTH // 8, n)).repeat(8, axis=0).repeat(8, axis=1)
    channels = (0.8 * patches + 0.2 * random.uniform(size=(HEIGHT, WIDTH, n))).astype(np.float32)
    weights = random.uniform(size=(HEIGHT, WIDTH)) * (random.uniform(size=(HEIGHT, WIDTH)) > 0.2)
    weights[:, :10] = 0.0
    weights = weights.astype(np.float32)
    structure = make_structure(channels, weights) if "classes" in loss else None
    return PhotoAttributes(channels, weights, structure=structure, **settings)


def disagreement(one: Moments, other: Moments) -> float:
    """The greatest difference, as a share of the attributes' root mean squares."""
    if one.weight == 0.0:
        return abs(other.weight)
    scale = np.sqrt(one.covariance.diagonal() + one.mean**2).clip(1e-6)
    return max(
        abs(one.weight / other.weight - 1.0),
        float(np.max(np.abs(one.mean - other.mean) / scale)),
        float(np.max(np.abs(one.covariance - other.covariance) / np.outer(scale, scale))),
        abs((one.edge_cosine or 0.0) - (other.edge_cosine or 0.0)),
    )


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", MESHES)
def test_gpu_matches_software(name):
    random, mesh = np.random.default_rng(7), MESHES[name]
    software = SoftwareRenderer(mesh)
    on_gpu = GpuRenderer(mesh)
    seen = 0
    for loss in LOSSES:
        photo = make_photo(loss, random)
        judge = lighting_loss if photo.structure is None else structure_loss
        poses = [random_pose(random, k % 2 == 0) for k in range(POSES // len(LOSSES) + 1)]
        for pose, found in zip(poses, on_gpu.moments_at(poses, photo), strict=True):
            wanted = software.moments(pose, photo)
            seen += wanted.pixels > 100
            assert found.pixels == wanted.pixels
            assert found.photo_channels == wanted.photo_channels
            assert disagreement(wanted, found) < AGREEMENT
            assert judge(found) == pytest.approx(judge(wanted), abs=1e-3)
    assert seen > 0.5 * POSES
    assert on_gpu.callers > 0


def make_poses(count: int, seed: int = 3) -> list[Pose]:
    random = np.random.default_rng(seed)
    return [random_pose(random, parallel=True) for _ in range(count)]


def test_a_pool_judges_together_what_threads_ask_meanwhile(monkeypatch):
    sizes: list[int] = []
    judge = GpuRenderer.moments_at

    def counted(self, poses, photo):
        sizes.append(len(poses))
        return judge(self, poses, photo)

    monkeypatch.setattr(GpuRenderer, "moments_at", counted)
    photo = downsample(make_photo("region", np.random.default_rng(1)), 2)
    poses = make_poses(60)
    with RendererPool(GpuRenderer(MESHES["box"]), 2) as pool:
        found = list(pool.map(lambda own, pose: own.moments(pose, photo).weight, poses))
    assert sum(sizes) == 60
    assert max(sizes) > 4
    software = SoftwareRenderer(MESHES["box"])
    wanted = [software.moments(pose, photo).weight for pose in poses]
    assert found == pytest.approx(wanted, rel=1e-6)


def test_a_lost_gpu_is_said_once_and_nothing_is_lost(caplog, monkeypatch):
    device = device_of.Device(device_of.find_adapter(software=True))
    monkeypatch.setattr(gpu_renderer, "gpu_device", lambda: device)
    renderer, photo = GpuRenderer(MESHES["box"]), make_photo("region", np.random.default_rng(1))
    poses = make_poses(4)
    before = renderer.moments_at(poses, photo)
    device._device.destroy()
    with RendererPool(renderer) as pool:
        after = list(pool.map(lambda own, pose: own.moments(pose, photo), poses))
    for one, other in zip(before, after, strict=True):
        assert disagreement(one, other) < AGREEMENT
    renderer.moments_at(poses, photo)
    assert len(caplog.records) == 1
    assert "goes on without it" in caplog.text
    # From now on as if there were none: a thread for each processor, and no model sent to it.
    assert renderer.clone().callers == 0
    with RendererPool(renderer, 2) as pool:
        assert pool.threads == 2


def test_a_software_adapter_is_refused_in_a_sentence(monkeypatch):
    if device_of.find_adapter(software=True).info["adapter_type"] != "CPU":
        pytest.skip("a real GPU is here")
    monkeypatch.delenv(device_of.ADAPTER_VARIABLE)
    with pytest.raises(RendererUnavailableError, match='renderer="software"') as refused:
        make_renderer(MESHES["box"], "gpu")
    assert str(refused.value).count(".") <= 3


def test_without_wgpu_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "wgpu", None)
    with pytest.raises(RendererUnavailableError, match=r"pip install 'poseviewer\[gpu\]'"):
        device_of.find_adapter(software=True)
