"""What is measured: the bundled car before a photo of any size, covering any share of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseviewer.bench.triangles import in_triangles
from poseviewer.files.demo import demo_case
from poseviewer.files.pose import load_pose
from poseviewer.fit.problem import FitProblem, make_problem
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.photo import Photo
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.starts.registration import load_registration

Size = tuple[int, int]
"""Width and height of a photo, px."""
USUAL_SHARE = 48_600 / (640 * 480)
"""Share of the photo that the model covers, unless another one is asked for."""
POSES = 8
JITTER = 0.01
"""Measured poses lie about the true one, within this share of each parameter's scale."""


@dataclass(frozen=True, slots=True, eq=False)
class Demo:
    """The bundled demo, with its true pose and how large it is in its photo."""

    registration: Registration
    truth: Pose
    middle: FloatArray
    """(2,): centre of the model's bounding box in the photo, px."""
    covered_px: int


class Model(NamedTuple):
    """The car in some number of triangles; mesh and renderer go with photos of any size."""

    triangles: int
    """As asked for; the mesh may have a few more or less."""
    mesh: Mesh
    renderer: SoftwareRenderer


@dataclass(frozen=True, slots=True, eq=False)
class Workload:
    """One model before one photo, and the poses that are evaluated."""

    model: Model
    poses: tuple[Pose, ...]
    parameters: tuple[FloatArray, ...]
    """The same poses in the problems' chart."""
    paper: FitProblem
    """The paper's loss: grey, over the pixels that the model covers."""
    usual: FitProblem
    """Lit colours over the whole photo, see ``lit_problem``."""
    covered_px: int
    """At the true pose."""

    @property
    def width(self) -> int:
        """Of the photo, px."""
        return self.poses[0].camera.width

    @property
    def height(self) -> int:
        """Of the photo, px."""
        return self.poses[0].camera.height


def load_demo() -> Demo:
    """Read the demo's files, and look where its model is."""
    files = demo_case()
    registration = load_registration(files.photo, files.model, files.start)
    photo = registration.photo
    truth = load_pose(files.truth, photo.width, photo.height).pose
    covered = SoftwareRenderer(registration.mesh).covers(truth)
    rows, columns = np.nonzero(covered)
    middle = 0.5 + np.array([columns.min() + columns.max(), rows.min() + rows.max()]) / 2.0
    return Demo(registration, truth, middle, int(covered.sum()))


def make_model(demo: Demo, triangles: int) -> Model:
    """The demo's car in about ``triangles`` triangles."""
    mesh = in_triangles(demo.registration.mesh, triangles)
    return Model(triangles, mesh, SoftwareRenderer(mesh))


def make_workload(demo: Demo, model: Model, size: Size, share: float = USUAL_SHARE) -> Workload:
    """The model at the demo's true pose, covering a ``share`` of a photo of this size.

    The photo is the demo's, enlarged and cut to match. What it shows does not matter for the time,
    but it makes the losses those of a real search.
    """
    width, height = size
    zoom = math.sqrt(share * width * height / demo.covered_px)
    camera = demo.truth.camera
    assert isinstance(camera, Perspective)
    # Zoomed about the model's middle, which comes to the middle of the photo.
    cx, cy = zoom * (np.array([camera.cx, camera.cy]) - demo.middle) + [width / 2, height / 2]
    zoomed = Perspective(zoom * camera.fx, zoom * camera.fy, float(cx), float(cy), width, height)
    truth = Pose(zoomed, demo.truth.camera_from_model)
    photo = demo.registration.photo
    registration = replace(
        demo.registration,
        photo=replace(photo, pixels=_zoomed(photo, demo.middle, zoom, size)),
        mesh=model.mesh,
        start=truth,
    )
    usual = lit_problem(registration)
    paper = make_problem(registration, FitSettings(grey=True, pixels="clip"))[0]
    offsets = np.random.default_rng(0).uniform(-JITTER, JITTER, (POSES, len(usual.start)))
    parameters = tuple(usual.start + offset * usual.chart.scales(usual.start) for offset in offsets)
    poses = tuple(usual.chart.to_pose(at) for at in parameters)
    covered_px = int(model.renderer.covers(truth).sum())
    return Workload(model, poses, parameters, paper, usual, covered_px)


def lit_problem(registration: Registration, limits: Limits | None = None) -> FitProblem:
    """Lit colours over the whole photo: what all paths can compute, the plain ones too."""
    settings = FitSettings(pixels="clip", limits=limits or Limits())
    problem = make_problem(registration, settings)[0]
    return replace(problem, photo=replace(problem.photo, clipped=False))


def _zoomed(
    photo: Photo, middle: FloatArray, zoom: float, size: Size
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """(height, width, 3): the photo zoomed about ``middle``; its border goes on beyond it."""
    columns, rows = (
        np.clip((np.arange(n) + 0.5 - n / 2) / zoom + at, 0, last - 1).astype(int)
        for n, at, last in zip(size, middle, (photo.width, photo.height), strict=True)
    )
    pixels = photo.pixels[rows[:, None], columns]
    pixels.flags.writeable = False
    return pixels
