"""The renderers of the models that were at hand lately: to make one takes a moment."""

from __future__ import annotations

from poseviewer.geometry.mesh import Mesh
from poseviewer.render.software.renderer import SoftwareRenderer

KEPT = 6
"""They fill the memory."""


class Renderers:
    """The ``KEPT`` newest ones; whoever draws in a thread of its own clones what it gets."""

    def __init__(self) -> None:
        self._kept: tuple[SoftwareRenderer, ...] = ()

    def keep(self, renderer: SoftwareRenderer) -> None:
        """For the next time that its model is wanted; from any thread."""
        others = [one for one in self._kept if one.mesh is not renderer.mesh]
        self._kept = (*others, renderer)[-KEPT:]  # one assignment: who reads meanwhile is not hurt

    def of(self, mesh: Mesh) -> SoftwareRenderer:
        """The one of a model, made where there is none; from any thread."""
        known = (one for one in self._kept if one.mesh is mesh)
        found = next(known, None) or SoftwareRenderer(mesh)
        self.keep(found)
        return found
