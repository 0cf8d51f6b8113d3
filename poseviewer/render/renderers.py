"""The renderers by their names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from poseviewer.errors import RendererUnavailableError

if TYPE_CHECKING:  # the command line asks for the names alone
    from poseviewer.geometry.mesh import Mesh
    from poseviewer.render.types import Renderer

RendererName = Literal["software", "opengl"]


def make_renderer(mesh: Mesh, name: RendererName = "software") -> Renderer:
    """The renderer called ``name``; the first one on a machine takes the time of compiling.

    Raises:
        RendererUnavailableError: ``opengl`` on a machine without it.
    """
    if name == "software":
        from poseviewer.render.software.compiled import compile_kernels
        from poseviewer.render.software.renderer import SoftwareRenderer

        compile_kernels()
        return SoftwareRenderer(mesh)
    from poseviewer.render.opengl.context import opengl_unavailable_reason
    from poseviewer.render.opengl.renderer import OpenGLRenderer

    reason = opengl_unavailable_reason()
    if reason:
        raise RendererUnavailableError(reason)
    return OpenGLRenderer(mesh)
