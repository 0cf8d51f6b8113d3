"""OpenGL as a ``Renderer``: the second one, with which the software renderer is compared."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.camera import Pose
from poseviewer.geometry.hull import hull_points
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.moments import moments_of_images
from poseviewer.render.opengl.context import opengl_unavailable_reason
from poseviewer.render.overlay.window import model_window
from poseviewer.render.pyramid.level_pose import level_pose
from poseviewer.render.texture import TexturePyramid, doubled_areas, mip_levels
from poseviewer.render.types import AttributeImage, Moments, PhotoAttributes

if TYPE_CHECKING:
    from poseviewer.render.opengl.scene import AttributeCanvas

__all__ = ["OpenGLRenderer", "opengl_unavailable_reason"]


class OpenGLRenderer:
    """A mesh drawn by OpenGL, off screen. To be used by one thread of the process, always the same.

    The graphics card interpolates normals, colours and texture coordinates in float32; textures
    are sampled here.
    """

    def __init__(self, mesh: Mesh, two_sided: bool = True) -> None:
        """``two_sided=False`` leaves out faces seen from behind (closed, well-wound meshes).

        OpenGL itself is first touched by the first picture.
        """
        self.mesh = mesh
        self.two_sided = two_sided
        self._textures = TexturePyramid.from_textures(mesh.textures)
        self._texel_areas = self._textures.texel_areas(mesh)
        self._canvas: AttributeCanvas | None = None

    def render(self, pose: Pose) -> AttributeImage:
        """Visibility, reflectance and normals at every pixel centre.

        Raises:
            RendererUnavailableError: no OpenGL on this machine; the message says what to install.
            RuntimeError: another thread made the process's OpenGL context.
        """
        # Importing it makes the context, which must not happen before it is wanted.
        from poseviewer.render.opengl import scene

        if self._canvas is None:
            self._canvas = scene.AttributeCanvas(self.mesh, self.two_sided)
        size = pose.camera.width, pose.camera.height
        depths = pose.camera_from_model.apply(hull_points(self.mesh))[:, 2]
        planes = scene.depth_range(pose.camera, depths, self.mesh.diameter)
        window = model_window(self.mesh, pose, margin=1)
        if planes is None or window is None:
            nothing = np.zeros((*size[::-1], 3), np.float32)
            return AttributeImage(np.full(size[::-1], -1, np.int32), nothing, nothing)
        matrix = scene.clip_from_world(self.mesh, pose, *planes)
        rotation = pose.camera_from_model.rotation
        seen, shaped, *v = self._canvas.draw(size, window.of_photo(*size), matrix, rotation)
        face_ids = seen[..., 3].astype(np.int32) - 1
        if v:
            uv = np.stack([shaped[..., 3], v[0][..., 0]], axis=-1)
            self._apply_textures(pose, face_ids, uv, seen)
        return AttributeImage(face_ids, seen[..., :3], shaped[..., :3])

    def covers(self, pose: Pose) -> NDArray[np.bool_]:
        """(height, width): where the model is seen."""
        return self.render(pose).mask

    def moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """The joint moments of the photo's and the model's attributes, from pictures of both."""
        return moments_of_images(self.render(level_pose(pose, photo.factor)), photo)

    def close(self) -> None:
        """Free the graphics memory; the next picture takes it again."""
        if self._canvas is not None:
            self._canvas.delete()
            self._canvas = None

    def _apply_textures(
        self, pose: Pose, face_ids: NDArray[np.int32], uv: NDArray, seen: NDArray[np.float32]
    ) -> None:
        """Multiply the colours in ``seen`` (height, width, 4) by the textures at ``uv``."""
        mesh = self.mesh
        textured = (face_ids >= 0) & (mesh.face_texture[face_ids] >= 0)
        faces = face_ids[textured]
        pixel_areas = doubled_areas(pose.project(mesh.vertices)[mesh.faces])
        levels = mip_levels(self._texel_areas, pixel_areas, self._textures.table.shape[1])
        colours = self._textures.sample(mesh.face_texture[faces], levels[faces], uv[textured])
        seen[textured, :3] *= colours
