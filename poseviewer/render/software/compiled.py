"""Compiling the kernels, which an earlier run on this machine has mostly done.

The compiler holds the interpreter: so other processes compile, each a part, and this one loads.
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
from poseviewer.render.software.kernel import KERNELS, is_compiled
from poseviewer.render.software.software_renderer import Box, SoftwareRenderer
from poseviewer.render.structure import make_structure
from poseviewer.render.types import PhotoAttributes

HELPERS = ("compile_drawing", "compile_sums")
"""Functions by which other processes compile, in the order of need; they take as long."""
SIDE, LOOK_S = 16, 0.2
"""Side (px) of the image that kernels are compiled with; pause between looks at the helpers."""


def compiled_share() -> float:
    """Share of this version's kernels whose machine code earlier runs left, in [0, 1]."""
    return sum(map(is_compiled, KERNELS)) / len(KERNELS)


def kernels_are_compiled() -> bool:
    """Whether an earlier run left machine code for this version of the kernels."""
    return compiled_share() == 1.0


def compile_kernels() -> None:
    """Compile what is not compiled yet."""
    if not kernels_are_compiled():
        deque(compiling(), maxlen=0)


def compiling() -> Iterator[float]:
    """Compile what is not compiled yet, and load it all; yields the compiled share, at last 1."""
    helpers: list[subprocess.Popen[bytes]] = []
    try:
        if sys.executable and not kernels_are_compiled():
            helpers = [_helper(work) for work in HELPERS]
        while any(helper.poll() is None for helper in helpers):
            yield compiled_share()
            time.sleep(LOOK_S)
    finally:
        for helper in helpers:
            helper.kill()
            helper.wait()
    # What the others did is only read; what they did not is done now.
    compile_drawing()
    compile_sums()
    yield 1.0


def compile_drawing() -> None:
    """Compile the kernels that draw; or load them, if they are compiled."""
    SoftwareRenderer(_triangle()).render(_pose())


def compile_sums() -> None:
    """Compile or load the kernels that add up moments."""
    renderer = _Blank(_triangle())
    grey = np.zeros((SIDE, SIDE, 1), np.float32)
    weights, colours = np.ones((SIDE, SIDE), np.float32), np.tile(grey, 3)
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
    return Pose(Parallel(1.0, 0.5 * SIDE, 0.5 * SIDE, SIDE, SIDE), RigidTransform.identity())
