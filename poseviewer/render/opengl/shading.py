"""Lit pictures by pyrender, for synthetic photographs. Importing it makes the OpenGL context.

Nothing of it is shared with the renderers that a fit uses, but the camera's projection: surfaces
are interpolated, textured, lit and shadowed on the graphics card.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.opengl.scene import (
    SHADERS,
    BoundedMesh,
    PictureCamera,
    ShaderProgramCache,
    make_current,
    pyrender,
)

Shading = Literal["diffuse", "phong", "physical"]
"""``diffuse``: Lambert's law, exactly, in display-encoded values. ``phong``: highlights on top.
``physical``: pyrender's metallic-roughness material, computed in linear light and then encoded."""

PHONG_STRENGTH = 0.4
HIGHLIGHT_ROUGHNESS = 0.45
DISPLAY_GAMMA = 2.2
"""What pyrender's shader encodes its result with."""


class ShadedCanvas:
    """Meshes on the graphics card, to be drawn lit. World: as in ``gl_scene``."""

    def __init__(self, meshes: Iterable[Mesh], origin: FloatArray, shading: Shading) -> None:
        """``origin`` (3,), in the meshes' frame, becomes the world's."""
        make_current()
        self._shading = shading
        self._meshes = [_shaded_mesh(mesh, origin, shading) for mesh in meshes]
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
        make_current()
        scene = pyrender.Scene(bg_color=np.zeros(4), ambient_light=np.asarray(ambient))
        for mesh in self._meshes:
            scene.add(mesh)
        scene.add(self._camera, pose=_translation(eye))
        # pyrender multiplies by the inverse of the camera's pose, which is in the matrix already.
        self._camera.matrix = clip_from_world @ _translation(eye)
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
        make_current()
        self._renderer.delete()


def _shaded_mesh(mesh: Mesh, origin: FloatArray, shading: Shading) -> BoundedMesh:
    """One primitive for each texture, and one for the faces without."""
    return BoundedMesh(
        [
            _primitive(mesh, mesh.faces[mesh.face_texture == texture], texture, origin, shading)
            for texture in np.unique(mesh.face_texture)
        ]
    )


def _primitive(
    mesh: Mesh, faces: NDArray[np.int32], texture: int, origin: FloatArray, shading: Shading
) -> pyrender.Primitive:
    used, indices = np.unique(faces, return_inverse=True)
    colours = mesh.colours[used].astype(float)
    if shading == "physical":
        colours = colours**DISPLAY_GAMMA
    return pyrender.Primitive(
        mesh.vertices[used] - origin,
        normals=mesh.normals[used],
        color_0=colours,
        texcoord_0=mesh.uvs[used] if texture >= 0 else None,
        indices=indices.reshape(-1, 3),
        material=_material(mesh.textures[texture] if texture >= 0 else None, shading),
    )


def _material(
    texture: NDArray[np.uint8] | None, shading: Shading
) -> pyrender.MetallicRoughnessMaterial:
    picture = None
    if texture is not None:
        picture = pyrender.Texture(source=texture, source_channels="RGB")
    return pyrender.MetallicRoughnessMaterial(
        baseColorFactor=(1.0, 1.0, 1.0, 1.0),
        baseColorTexture=picture,
        metallicFactor=PHONG_STRENGTH if shading == "phong" else 0.0,
        roughnessFactor=HIGHLIGHT_ROUGHNESS,
        doubleSided=True,
    )


def _translation(offset: FloatArray) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def _pose_shining_from(towards: FloatArray) -> FloatArray:
    """(4, 4): a light's pose; it shines along its own -z, so z points towards where it is."""
    z = np.asarray(towards, dtype=float) / np.linalg.norm(towards)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    return matrix
