"""Renderers by their names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:  # help texts need the names alone
    from poseviewer.geometry.mesh import Mesh
    from poseviewer.render.attributes import Renderer

RendererName = Literal["auto", "software", "gpu", "opengl"]
"""Name of a renderer; ``auto`` is ``software``."""


def require_renderer(name: RendererName) -> None:
    """Raise ``RendererUnavailableError`` for ``gpu`` on a machine without a GPU."""
    if name == "gpu":
        from poseviewer.render.gpu.device import gpu_device

        gpu_device()


def make_renderer(mesh: Mesh, name: RendererName = "auto") -> Renderer:
    """Make the renderer called ``name``; ``auto`` is the software renderer, compiled at first use.

    Raises:
        RendererUnavailableError: this machine has no ``gpu`` or ``opengl``.
    """
    if name == "opengl":
        from poseviewer.render.opengl import OpenGLRenderer

        return OpenGLRenderer(mesh)
    from poseviewer.render.software.compiled import compile_kernels
    from poseviewer.render.software.software_renderer import SoftwareRenderer

    compile_kernels()
    if name == "gpu":
        from poseviewer.render.gpu.gpu_renderer import GpuRenderer

        return GpuRenderer(mesh)
    return SoftwareRenderer(mesh)
