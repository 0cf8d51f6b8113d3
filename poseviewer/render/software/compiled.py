"""Compile the kernels, as an earlier run on this machine has mostly done.

The compiler holds the interpreter's lock: other processes compile parts, and this one loads them.
"""

import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator

import numpy as np

from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.attributes import PhotoAttributes
from poseviewer.render.software.kernel import KERNELS, is_compiled
from poseviewer.render.software.software_renderer import Box, SoftwareRenderer
from poseviewer.render.structure import make_structure

HELPERS = ("compile_drawing", "compile_sums")
"""Functions by which other processes compile, which take about the same time."""
SIDE_PX = 16
"""Side of the image that kernels are compiled with."""
POLL_S = 0.2
"""Pause between looks at the helpers."""


def compilation_progress() -> float:
    """Return the share of kernels whose machine code earlier runs left, in [0, 1]."""
    return sum(map(is_compiled, KERNELS)) / len(KERNELS)


def kernels_are_compiled() -> bool:
    """Tell whether an earlier run left machine code for this version of the kernels."""
    return compilation_progress() == 1.0


def compile_kernels() -> None:
    """Compile what is not compiled yet."""
    if not kernels_are_compiled():
        deque(compile_steps(), maxlen=0)


def compile_steps() -> Iterator[float]:
    """Compile what is not compiled yet, and load it all; yields the compiled share, at last 1."""
    helpers: list[subprocess.Popen[bytes]] = []
    try:
        if sys.executable and not kernels_are_compiled():
            helpers = [_helper(work) for work in HELPERS]
        while any(helper.poll() is None for helper in helpers):
            yield compilation_progress()
            time.sleep(POLL_S)
    finally:
        for helper in helpers:
            helper.kill()
            helper.wait()
    # This loads what the helpers compiled, and compiles the rest.
    compile_drawing()
    compile_sums()
    yield 1.0


def compile_drawing() -> None:
    """Compile the kernels that draw; or load them, if they are compiled."""
    SoftwareRenderer(_triangle()).render(_pose())


def compile_sums() -> None:
    """Compile or load the kernels that add up moments."""
    renderer = _Blank(_triangle())
    grey = np.zeros((SIDE_PX, SIDE_PX, 1), np.float32)
    weights, colours = np.ones((SIDE_PX, SIDE_PX), np.float32), np.tile(grey, 3)
    structure = make_structure(colours, weights)
    renderer.moments(_pose(), PhotoAttributes(colours, weights, False, structure=structure))
    renderer.moments(_pose(), PhotoAttributes(grey, weights))


def _helper(work: str) -> subprocess.Popen[bytes]:
    same_path = f"import sys; sys.path[:] = {sys.path!r}"
    command = [sys.executable, "-c", f"{same_path}; from {__name__} import {work}; {work}()"]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet)


class _Blank(SoftwareRenderer):
    """A renderer that draws nothing, and so needs no rasteriser."""

    def _rasterise(self, pose: Pose) -> Box:
        self._make_picture(pose.camera.width, pose.camera.height)
        return (0, 0, 0, 0)


def _triangle() -> Mesh:
    none, colours = np.array([-1], np.int32), np.ones((3, 3), np.float32)
    uvs, faces = np.zeros((3, 2), np.float32), np.array([[0, 1, 2]], np.int32)
    return Mesh(np.eye(3), faces, np.tile((0.0, 0.0, 1.0), (3, 1)), colours, uvs, none, none + 1)


def _pose() -> Pose:
    return Pose(
        Parallel(1.0, 0.5 * SIDE_PX, 0.5 * SIDE_PX, SIDE_PX, SIDE_PX), RigidTransform.identity()
    )
