"""What is measured: the bundled car before a photo of any size, covering any share of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from poseviewer.bench.models import in_triangles
from poseviewer.files.demo import demo_case
from poseviewer.files.pose.file import load_pose
from poseviewer.fit.problem import FitProblem, make_problem, pose_loss
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.photo import Photo
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.starts.registration import load_registration

USUAL_SHARE = 48_600 / (640 * 480)
"""How much of the picture the model covers, unless another share is wanted."""
POSES = 8
JITTER = 0.01
"""The poses that are measured lie about the true one, by this share of each number's span."""


@dataclass(frozen=True, slots=True, eq=False)
class Demo:
    """The bundled demo, with its true pose and how large it is in its photo."""

    registration: Registration
    truth: Pose
    middle: FloatArray
    """(2,): of the model's box in the photo, px."""
    covered_px: int


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One model before one photo."""

    triangles: int
    """As wanted; the mesh may have some more or less."""
    mesh: Mesh
    renderer: SoftwareRenderer
    poses: tuple[Pose, ...]
    parameters: tuple[FloatArray, ...]
    """The poses in the problems' chart."""
    paper: FitProblem
    """The paper's loss: grey, over the pixels that the model covers."""
    usual: FitProblem
    """The default of a search: colour, over a fixed box, the surroundings counted."""
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

    def loss(self) -> float:
        """The paper's loss at the first pose, for checks."""
        return pose_loss(self.paper, self.renderer, self.parameters[0])


def load_demo() -> Demo:
    """Read the demo's files, and look at where its model is."""
    files = demo_case()
    registration = load_registration(files.photo, files.model, files.start)
    photo = registration.photo
    truth = load_pose(files.truth, photo.width, photo.height).pose
    covered = SoftwareRenderer(registration.mesh).covers(truth)
    rows, columns = np.nonzero(covered)
    middle = 0.5 + np.array([columns.min() + columns.max(), rows.min() + rows.max()]) / 2.0
    return Demo(registration, truth, middle, int(covered.sum()))


def make_case(
    demo: Demo, triangles: int, width: int, height: int, share: float = USUAL_SHARE
) -> Case:
    """The demo's car in so many triangles, covering a ``share`` of a photo of this size."""
    return place(demo, make_model(demo, triangles), width, height, share)


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A mesh with its renderer; both take time to make and go with photos of any size."""

    triangles: int
    mesh: Mesh
    renderer: SoftwareRenderer


def make_model(demo: Demo, triangles: int) -> Model:
    """The demo's car in so many triangles."""
    mesh = in_triangles(demo.registration.mesh, triangles)
    return Model(triangles, mesh, SoftwareRenderer(mesh))


def place(demo: Demo, model: Model, width: int, height: int, share: float = USUAL_SHARE) -> Case:
    """The model at the demo's true pose, covering a ``share`` of a photo of this size.

    The photo is the demo's, enlarged and cut to match; what it shows is of no account for the
    time, but it makes the losses those of a real search.
    """
    zoom = math.sqrt(share * width * height / demo.covered_px)
    truth = Pose(_camera(demo, zoom, width, height), demo.truth.camera_from_model)
    photo = demo.registration.photo
    registration = replace(
        demo.registration,
        photo=replace(photo, pixels=_zoomed(photo, demo.middle, zoom, width, height)),
        mesh=model.mesh,
        start=truth,
    )
    usual = lit_problem(registration)
    paper = make_problem(registration, FitSettings(grey=True, pixels="clip"))[0]
    offsets = np.random.default_rng(0).uniform(-JITTER, JITTER, (POSES, len(usual.start)))
    parameters = tuple(usual.start + offset * usual.chart.scales(usual.start) for offset in offsets)
    return Case(
        model.triangles,
        model.mesh,
        model.renderer,
        tuple(usual.chart.to_pose(n) for n in parameters),
        parameters,
        paper,
        usual,
        int(model.renderer.covers(truth).sum()),
    )


def lit_problem(registration: Registration, limits: Limits | None = None) -> FitProblem:
    """Lit colours over the whole photo: what all paths can compute, the plain ones too."""
    settings = FitSettings(pixels="clip", limits=limits or Limits())
    problem = make_problem(registration, settings)[0]
    return replace(problem, photo=replace(problem.photo, clipped=False))


def _camera(demo: Demo, zoom: float, width: int, height: int) -> Perspective:
    """The demo's camera, zoomed about the model's middle, which comes to the picture's."""
    camera = demo.truth.camera
    assert isinstance(camera, Perspective)
    cx, cy = zoom * (np.array([camera.cx, camera.cy]) - demo.middle) + [width / 2, height / 2]
    return Perspective(zoom * camera.fx, zoom * camera.fy, float(cx), float(cy), width, height)


def _zoomed(
    photo: Photo, middle: FloatArray, zoom: float, width: int, height: int
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """(height, width, 3): the photo zoomed about ``middle``; beyond its border, the border."""
    columns = (np.arange(width) + 0.5 - width / 2) / zoom + middle[0]
    rows = (np.arange(height) + 0.5 - height / 2) / zoom + middle[1]
    inside = np.clip(rows, 0, photo.height - 1), np.clip(columns, 0, photo.width - 1)
    pixels = photo.pixels[inside[0].astype(int)[:, None], inside[1].astype(int)]
    pixels.flags.writeable = False
    return pixels
