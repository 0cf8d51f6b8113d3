"""Speed of this machine: evaluations on each path, a fit by each method, fifteen maps.

The paths from a pose to its loss are a: pyrender's picture, read back and summed by NumPy, as in
the paper; d: the software renderer, which draws and sums in one kernel, on one thread; e: the
software renderer on all cores; f: the GPU, many poses in one submission.
"""

import math
import os
import platform
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np

from poseviewer.errors import RendererUnavailableError
from poseviewer.figures.text_table import Table
from poseviewer.files.demo import demo_case
from poseviewer.files.pose import load_pose
from poseviewer.fit.problem import make_problem
from poseviewer.fit.slices import landscape
from poseviewer.fit.stages import fit_pose, make_stages
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.image import GREY_WEIGHTS
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.losses.known_losses import LOSSES
from poseviewer.losses.loss import LossName
from poseviewer.losses.paper_loss import lighting_loss
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from poseviewer.render.attributes import PhotoAttributes, Renderer
from poseviewer.render.opengl import opengl_renderer_name
from poseviewer.render.pool import ITEMS_PER_CHUNK, RendererPool, processors
from poseviewer.render.pyramid.simplified import simplify
from poseviewer.render.renderers import RendererName, make_renderer
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.settings import FitSettings, Limits
from poseviewer.scene.types import Scene

PACKAGES = ("poseviewer", "numpy", "numba", "scipy", "pyrender")
"""Packages whose versions are told."""
PATHS: dict[str, tuple[RendererName, str]] = {
    "a": ("opengl", "pyrender, read back, NumPy"),
    "d": ("software", "software, one thread"),
    "e": ("software", "software, all cores"),
    "f": ("gpu", "GPU, many poses at once"),
}
"""Renderers and labels of the paths, by their letters."""
POSES = 8
"""Different poses that are evaluated in turn."""
JITTER = 0.01
"""Largest distance of a measured pose from the true one, as a share of each parameter's scale."""
BURST = 4
"""Counted runs of a path before the next path's turn."""
GPU_POSES = 512
"""Poses of one submission to a GPU."""
TRIANGLES = 50_000
"""Triangles of the model."""
WIDTH_PX = 640
"""Width of the photo."""
MAP_SIZE = 41
"""Points along a side of a map."""
PAPER_MS = 210.0
"""ms of the paper's authors on their machine of 2010, in C: OpenGL's 170, the loss's 40."""


class Workload(NamedTuple):
    """A decimated model, poses about the true one, and the grey photo."""

    mesh: Mesh
    poses: tuple[Pose, ...]
    photo: PhotoAttributes


@dataclass(frozen=True, slots=True)
class Timing:
    """Seconds of each run on a path, or of a whole search."""

    name: str
    """A letter of ``PATHS``, of which a run is one evaluation; or a label."""
    threads: int
    seconds: tuple[float, ...]
    end: str = ""
    """End of the run."""


@dataclass(frozen=True, slots=True)
class SpeedReport:
    """Timings of this machine."""

    machine: str
    """Processor, cores, load, adapters of OpenGL and of the GPU, versions of packages."""
    workload: str
    paths: tuple[Timing, ...]
    wholes: tuple[Timing, ...]
    """Fits, and fifteen maps."""

    def as_markdown(self) -> str:
        """Write machine, versions and tables."""
        times = {path.name: 1e3 * np.array(path.seconds) for path in self.paths}
        first, rows = np.median(times.get("a", math.nan)), []
        for name, ms in times.items():
            median, span = np.median(ms), f"{ms.min():.3g} to {ms.max():.3g}"
            ratio = f"{first / median:.1f}"
            rows.append((f"{name}  {PATHS[name][1]}", f"{median:.3g}", span, ratio))
        rows.append(("the paper's own, on its machine of 2010", f"{PAPER_MS:.0f}", "-", "-"))
        title = f"One evaluation, ms: {self.workload}; medians"
        paths = Table(title, ("path", "total", "least to most", "a / this"), tuple(rows))
        ends = tuple(
            (f"{w.name}, {w.threads} core{'s' * (w.threads > 1)}", f"{w.seconds[0]:.3g}", w.end)
            for w in self.wholes
        )
        wholes = Table("Searches and maps", ("what", "seconds", "end"), ends)
        return f"{self.machine}\n\n{paths.as_markdown()}\n\n{wholes.as_markdown()}"


class Demo(NamedTuple):
    """The bundled demo and its true pose."""

    scene: Scene
    truth: Pose


def load_demo() -> Demo:
    """Load the bundled demo and its true pose."""
    files = demo_case()
    scene = open_scene(Sources(files.photo, model=files.model, start=files.start))
    photo = scene.views[0].photo
    return Demo(scene, load_pose(files.truth, photo.width, photo.height).pose)


def measure_speed(
    quick: bool, tell: Callable[[str], None], map_size: int = MAP_SIZE
) -> SpeedReport:
    """Measure; ``tell`` takes news. ``quick``: fewer runs, and fits are cut short."""
    load = f", load {os.getloadavg()[0]:.1f} at the start" if hasattr(os, "getloadavg") else ""
    opengl, gpu = opengl_renderer_name(), _gpu_name()
    adapters = f"OpenGL: {opengl or 'none'}; GPU: {gpu or 'none'}"
    versions = [f"python {platform.python_version()}", *(f"{p} {version(p)}" for p in PACKAGES)]
    machine = f"{_cpu()}, {processors()} cores{load}; {adapters}.\n{', '.join(versions)}."
    demo = load_demo()
    tell(f"timing the paths: {TRIANGLES:,} triangles, {WIDTH_PX} px")
    work = make_workload(demo, TRIANGLES, WIDTH_PX)
    letters = "a" * bool(opengl) + "de" + "f" * bool(gpu)
    paths = tuple(time_paths(work, letters, 4 if quick else 12))
    tell(f"making maps of {map_size}x{map_size}")
    maps, fits = time_maps(demo, map_size), []
    for loss in LOSSES:
        limit_s = 15.0 if quick else 30.0
        tell(f"fitting by loss {loss}, for {limit_s:.0f} s at most")
        fits.append(time_fit(demo, loss, limit_s))
    covered = SoftwareRenderer(work.mesh).render_mask(work.poses[0])
    size = f"{covered.shape[1]}x{covered.shape[0]}"
    about = f"{TRIANGLES:,} triangles, {size}, {covered.sum():,} covered pixels"
    return SpeedReport(machine, about, paths, (*fits, maps))


def _cpu() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _gpu_name() -> str | None:
    from poseviewer.render.gpu.device import gpu_device

    with suppress(RendererUnavailableError):
        return gpu_device().name
    return None


def make_workload(demo: Demo, triangles: int, width: int) -> Workload:
    """Decimate the demo's model to about ``triangles``, and scale its photo to a width."""
    mesh, image = simplify(demo.scene.objects[0].mesh, triangles), demo.scene.views[0].photo
    truth = demo.truth.rescale(width / image.width)
    width, height = truth.camera.width, truth.camera.height
    grey = image.as_rgb8(width, height) @ (GREY_WEIGHTS / 255.0)
    photo = PhotoAttributes(grey[..., None].astype(np.float32), np.ones(grey.shape, np.float32))
    chart = FreeBodyChart.near(mesh, truth)
    middle = chart.from_pose(truth)
    offsets = np.random.default_rng(0).uniform(-JITTER, JITTER, (POSES, len(middle)))
    offsets[0] = 0.0
    poses = (chart.to_pose(middle + offset * chart.scales(middle)) for offset in offsets)
    return Workload(mesh, tuple(poses), photo)


def time_paths(work: Workload, letters: str, rounds: int) -> list[Timing]:
    """Time paths in turn; each turn's first run, which refills the caches, does not count."""

    def loss(renderer: Renderer, pose: Pose) -> float:
        return lighting_loss(renderer.moments(pose, work.photo))

    seconds: dict[str, list[float]] = {letter: [] for letter in letters}
    with ExitStack() as stack:
        paths = {}
        for letter in letters:
            renderer = make_renderer(work.mesh, PATHS[letter][0])
            pool = stack.enter_context(RendererPool(renderer, 1 if letter == "d" else None))
            count, device = ITEMS_PER_CHUNK * pool.threads, getattr(renderer, "device", None)
            if device is not None:
                count = 1 if device.is_software else GPU_POSES
            paths[letter] = pool, count
        for turn in range(rounds):
            for letter, (pool, count) in paths.items():
                for k in range(turn * BURST, turn * BURST + BURST + 1):
                    poses = [work.poses[(k + i) % POSES] for i in range(count)]
                    began = perf_counter()
                    list(pool.map(loss, poses))
                    if k > turn * BURST:
                        seconds[letter].append((perf_counter() - began) / count)
    return [Timing(name, paths[name][0].threads, tuple(each)) for name, each in seconds.items()]


def time_fit(demo: Demo, loss: LossName, limit_s: float) -> Timing:
    """Time a fit from the demo's start, 8 % off in each parameter, without the verdict."""
    scene = demo.scene
    settings = FitSettings(loss, limits=Limits(seconds=limit_s))
    problem, _ = make_problem(scene.with_object(0, settings=settings))
    renderer = SoftwareRenderer(scene.objects[0].mesh)
    threads = 1 if settings.searched_by == "simplex" else processors()
    make_stages(problem, renderer)  # simplifies the model, which is then kept
    *_, end = fit_pose(problem, renderer, threads)
    error = pose_error(scene.objects[0].mesh, end.pose, demo.truth).percent
    status = end.status.name.lower().replace("_", " ")
    words = f"{end.evaluations:,} evaluations, {status}, {error:.2f} % off"
    return Timing(f"fit of the demo, loss {loss}", threads, (end.seconds,), words)


def time_maps(demo: Demo, size: int) -> Timing:
    """Time the maps of all pairs of parameters about the true pose, on all cores."""
    scene, truth = demo.scene.with_pose(0, demo.truth), demo.truth
    problem, _ = make_problem(scene)
    with RendererPool(SoftwareRenderer(scene.objects[0].mesh)) as pool:
        # A thread's first picture of a size takes its buffers.
        count = 2 * ITEMS_PER_CHUNK * pool.threads
        list(pool.map(lambda own, _: own.moments(truth, problem.photo), range(count)))
        began = perf_counter()
        pieces = list(landscape(problem, pool, problem.start, size=size, smooth=True))
        seconds = perf_counter() - began
    known = {(piece.first, piece.second): piece.losses.size for piece in pieces}
    error = pieces[-1].error
    good = "" if error is None else f", good to {error:.1%} of their range"
    words = f"{sum(known.values()):,} points{good}"
    return Timing(f"{len(known)} maps of {size}x{size}", pool.threads, (seconds,), words)
