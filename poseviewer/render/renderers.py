"""The renderers by their names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from poseviewer.errors import RendererUnavailableError

if TYPE_CHECKING:  # the command line asks for the names alone
    from poseviewer.geometry.mesh import Mesh
    from poseviewer.render.software.renderer import SoftwareRenderer
    from poseviewer.render.types import Renderer

RendererName = Literal["auto", "software", "gpu", "opengl"]


def make_renderer(mesh: Mesh, name: RendererName = "auto") -> Renderer:
    """The renderer called ``name``; the first one on a machine takes the time of compiling.

    Raises:
        RendererUnavailableError: ``gpu`` or ``opengl`` on a machine without it.
    """
    if name != "opengl":
        from poseviewer.render.software.compiled import compile_kernels

        compile_kernels()
        return compiled_renderer(mesh, name)
    from poseviewer.render.opengl.context import opengl_unavailable_reason
    from poseviewer.render.opengl.renderer import OpenGLRenderer

    reason = opengl_unavailable_reason()
    if reason:
        raise RendererUnavailableError(reason)
    return OpenGLRenderer(mesh)


def compiled_renderer(
    mesh: Mesh, name: Literal["auto", "software", "gpu"] = "auto"
) -> SoftwareRenderer:
    """Of our own rasterisers, whose kernels are compiled: ``auto`` is that on the GPU where there
    is one and the extra ``gpu`` is installed, else the software renderer.

    Raises:
        RendererUnavailableError: ``gpu`` on a machine without it.
    """
    from poseviewer.render.gpu.device import has_gpu

    if name == "gpu" or (name == "auto" and has_gpu()):
        from poseviewer.render.gpu.renderer import GpuRenderer

        return GpuRenderer(mesh)
    from poseviewer.render.software.renderer import SoftwareRenderer

    return SoftwareRenderer(mesh)
