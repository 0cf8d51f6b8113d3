"""Compiling the kernels, which an earlier run on this machine has mostly done.

The compiler works on one kernel at a time in each
process; so where machine code can be kept, another process compiles half of it.
"""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np

from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.pool import processors
from poseviewer.render.software import rasterise, shade, sums
from poseviewer.render.software.renderer import Box, SoftwareRenderer
from poseviewer.render.structure import make_structure
from poseviewer.render.types import PhotoAttributes

BY_US: tuple[Any, ...] = (rasterise.rasterise, shade.shade)
BY_HELPER: tuple[Any, ...] = (sums.moments, sums.structure_sums)
SIDE = 16
"""Of the picture that kernels are compiled with, px."""


def kernels_are_compiled() -> bool:
    """Whether an earlier run left machine code for this version of the kernels."""
    return all(_is_compiled(kernel) for kernel in (*BY_US, *BY_HELPER))


def compile_kernels() -> None:
    """Compile what is not compiled yet and can be kept, with the help of another process."""
    if kernels_are_compiled() or not all(kernel.stats.cache_path for kernel in BY_HELPER):
        return
    helper = None
    if processors() > 1 and sys.executable:
        command = [sys.executable, "-c", f"import {__name__} as it; it.compile_moments()"]
        quiet = subprocess.DEVNULL
        helper = subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet)
    try:
        compile_rasteriser()
        if helper is not None:
            helper.wait()
    finally:
        if helper is not None and helper.poll() is None:
            helper.kill()
    compile_moments()  # what the helper did is only read; what it did not is done now


def compile_rasteriser() -> None:
    """Compile the kernels that draw; or load them, if they are compiled."""
    SoftwareRenderer(_triangle()).render(_pose())


def compile_moments() -> None:
    """The same for those that add up what the rasteriser finds."""
    renderer = _Blank(_triangle())
    grey = np.zeros((SIDE, SIDE, 1), np.float32)
    weights, colours = np.ones((SIDE, SIDE), np.float32), np.tile(grey, 3)
    renderer.moments(_pose(), PhotoAttributes(grey, weights))
    structure = make_structure(colours, weights)
    renderer.moments(_pose(), PhotoAttributes(colours, weights, False, structure=structure))


class _Blank(SoftwareRenderer):
    """A renderer that draws nothing, and so needs no rasteriser."""

    def _rasterise(self, pose: Pose) -> Box:
        self._make_picture(pose.camera.width, pose.camera.height)
        self._camera = np.zeros(17)
        return (0, 0, 0, 0)


def _triangle() -> Mesh:
    return Mesh(
        vertices=np.eye(3),
        faces=np.array([[0, 1, 2]], np.int32),
        normals=np.tile((0.0, 0.0, 1.0), (3, 1)),
        colours=np.ones((3, 3), np.float32),
        uvs=np.zeros((3, 2), np.float32),
        face_texture=np.array([-1], np.int32),
        face_part=np.array([0], np.int32),
    )


def _pose() -> Pose:
    return Pose(Parallel(1.0, 0.5 * SIDE, 0.5 * SIDE, SIDE, SIDE), RigidTransform.identity())


def _is_compiled(kernel: Any) -> bool:
    if not kernel.stats.cache_path:  # there is no place to keep it
        return False
    return bool(kernel._cache._cache_file._load_index())
