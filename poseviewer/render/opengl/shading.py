"""Pictures by pyrender: lit ones, for synthetic photographs. Importing it makes the OpenGL context.

Nothing of it is shared with the renderers that a fit uses, but the camera's projection: surfaces
are interpolated, textured, lit and shadowed on the graphics card. The scene's world is the model's
frame, moved so that the model's centre is the origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.opengl.context import opengl
from poseviewer.render.opengl.renderer import SHADERS

GL = opengl()

import pyrender  # noqa: E402 - its platform had to be chosen first
from pyrender.shader_program import ShaderProgramCache  # noqa: E402

Shading = Literal["diffuse", "phong", "physical"]
"""``diffuse``: Lambert's law, exactly, in display-encoded values. ``phong``: highlights on top.
``physical``: pyrender's metallic-roughness material, computed in linear light and then encoded."""

PHONG_STRENGTH = 0.4
HIGHLIGHT_ROUGHNESS = 0.45
DISPLAY_GAMMA = 2.2
"""What pyrender's shader encodes its result with."""


class PictureCamera(pyrender.Camera):
    """A pyrender camera that takes its projection matrix (4, 4) as it is given."""

    matrix: FloatArray = np.eye(4)

    def get_projection_matrix(self, width: int, height: int) -> FloatArray:  # noqa: ARG002
        """The matrix, whatever the size of the viewport."""
        return self.matrix


class BoundedMesh(pyrender.Mesh):
    """A pyrender mesh whose bounds do not ask for ``numpy.infty``, which NumPy 2 has no more."""

    @property
    def bounds(self) -> FloatArray:
        """(2, 3): the corners of the bounding box."""
        bounds = np.array([primitive.bounds for primitive in self.primitives])
        return np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])


class SingleSampleRenderer(pyrender.Renderer):
    """pyrender without its fourfold multisampling, which takes half of its time where no graphics
    card helps.
    """

    def _configure_main_framebuffer(self) -> None:
        before = self._main_fb_dims
        super()._configure_main_framebuffer()
        if self._main_fb_dims != before:
            kinds = GL.GL_RGBA, GL.GL_DEPTH_COMPONENT24
            for buffer, kind in zip((self._main_cb_ms, self._main_db_ms), kinds, strict=True):
                GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
                GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, kind, *self._main_fb_dims)


class ShadedCanvas:
    """A mesh on the graphics card, to be drawn lit."""

    def __init__(self, mesh: Mesh, shading: Shading) -> None:
        opengl()
        self._shading = shading
        # One primitive for each texture, and one for the faces without.
        textures = np.unique(mesh.face_texture)
        self._mesh = BoundedMesh([_primitive(mesh, texture, shading) for texture in textures])
        self._camera = PictureCamera()
        self._renderer = pyrender.Renderer(1, 1)
        if shading != "physical":
            self._renderer._program_cache = ShaderProgramCache(str(SHADERS / "diffuse"))

    def draw(
        self,
        size: tuple[int, int],
        clip_from_world: FloatArray,
        eye: FloatArray,
        ambient: FloatArray,
        lights: Sequence[tuple[FloatArray, FloatArray]],
        shadows: bool = False,
    ) -> NDArray[np.uint8]:
        """(height, width, 4): RGB times coverage, and coverage, each pixel from 4 samples.

        ``size`` is (width, height); ``eye`` (3,) and ``lights``, each a unit direction towards the
        light (3,) and its RGB, are in the world's frame.
        """
        opengl()
        scene = pyrender.Scene(bg_color=np.zeros(4), ambient_light=np.asarray(ambient))
        scene.add(self._mesh)
        at_eye = np.eye(4)
        at_eye[:3, 3] = eye
        scene.add(self._camera, pose=at_eye)
        # pyrender multiplies by the inverse of the camera's pose, which is in the matrix already.
        self._camera.matrix = clip_from_world @ at_eye
        # Lambert's factor 1 / pi, which our shader leaves out, is a matter of the light's unit.
        unit = np.pi if self._shading == "physical" else 1.0
        for towards, colour in lights:
            light = pyrender.DirectionalLight(color=np.asarray(colour), intensity=unit)
            scene.add(light, pose=_pose_shining_from(towards))
        self._renderer.viewport_width, self._renderer.viewport_height = size
        flags = pyrender.RenderFlags.RGBA | pyrender.RenderFlags.OFFSCREEN
        if shadows:
            flags |= pyrender.RenderFlags.SHADOWS_DIRECTIONAL
        pictures: Any = self._renderer.render(scene, flags)
        return pictures[0]

    def delete(self) -> None:
        """Free the graphics memory."""
        opengl()
        self._renderer.delete()


def _primitive(mesh: Mesh, texture: int, shading: Shading) -> pyrender.Primitive:
    """The faces of one texture, or those without (-1)."""
    used, indices = np.unique(mesh.faces[mesh.face_texture == texture], return_inverse=True)
    colours, picture = mesh.colours[used].astype(float), None
    if texture >= 0:
        picture = pyrender.Texture(source=mesh.textures[texture], source_channels="RGB")
    return pyrender.Primitive(
        mesh.vertices[used] - mesh.centre,
        normals=mesh.normals[used],
        color_0=colours**DISPLAY_GAMMA if shading == "physical" else colours,
        texcoord_0=mesh.uvs[used] if texture >= 0 else None,
        indices=indices.reshape(-1, 3),
        material=pyrender.MetallicRoughnessMaterial(
            baseColorFactor=(1.0, 1.0, 1.0, 1.0),
            baseColorTexture=picture,
            metallicFactor=PHONG_STRENGTH if shading == "phong" else 0.0,
            roughnessFactor=HIGHLIGHT_ROUGHNESS,
            doubleSided=True,
        ),
    )


def _pose_shining_from(towards: FloatArray) -> FloatArray:
    """(4, 4): a light's pose; it shines along its own -z, so z points towards where it is."""
    z = np.asarray(towards, dtype=float) / np.linalg.norm(towards)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    return matrix
