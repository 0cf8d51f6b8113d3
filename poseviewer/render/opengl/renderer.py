"""OpenGL as a ``Renderer``: pyrender says which face is where, NumPy does the rest exactly."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.interpolation import AttributeInterpolator
from poseviewer.render.moments import moments_of_images
from poseviewer.render.opengl.context import opengl_unavailable_reason
from poseviewer.render.pyramid.level_pose import level_pose
from poseviewer.render.types import AttributeImage, Moments, PhotoAttributes

if TYPE_CHECKING:
    from poseviewer.render.opengl.scene import FaceIdCanvas

__all__ = ["OpenGLRenderer", "opengl_unavailable_reason"]


class OpenGLRenderer:
    """A mesh drawn by OpenGL, off screen. To be used by one thread of the process, always the same.

    The graphics card only decides visibility; attributes follow in double precision from the
    visible faces, so that results differ between cards by single boundary pixels at most.
    """

    def __init__(self, mesh: Mesh, two_sided: bool = True) -> None:
        """``two_sided=False`` leaves out faces seen from behind (closed, well-wound meshes).

        OpenGL itself is first touched by the first picture.
        """
        self.mesh = mesh
        self.two_sided = two_sided
        self._interpolator = AttributeInterpolator(mesh)
        self._canvas: FaceIdCanvas | None = None

    def render(self, pose: Pose) -> AttributeImage:
        """Visibility, reflectance and normals at every pixel centre.

        Raises:
            RendererUnavailableError: no OpenGL on this machine; the message says what to install.
            RuntimeError: another thread made the process's OpenGL context.
        """
        return self._interpolator.attributes(pose, self.face_ids(pose))

    def covers(self, pose: Pose) -> NDArray[np.bool_]:
        """(height, width): where the model is seen."""
        return self.face_ids(pose) >= 0

    def moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """The joint moments of the photo's and the model's attributes, from pictures of both."""
        return moments_of_images(self.render(level_pose(pose, photo.factor)), photo)

    def face_ids(self, pose: Pose) -> NDArray[np.int32]:
        """(height, width): the visible face of each pixel centre, -1 for none; raises as above."""
        # Importing it makes the context, which must not happen before it is wanted.
        from poseviewer.render.opengl import scene as gl_scene

        if self._canvas is None:
            self._canvas = gl_scene.FaceIdCanvas(self.mesh, self.two_sided)
        camera = pose.camera
        depths = pose.camera_from_model.apply(self.mesh.vertices)[:, 2]
        planes = gl_scene.depth_range(camera, depths, self.mesh.diameter)
        if planes is None:
            return np.full((camera.height, camera.width), -1, np.int32)
        matrix = gl_scene.clip_from_world(self.mesh, pose, *planes)
        return self._canvas.draw(camera.width, camera.height, matrix)

    def close(self) -> None:
        """Free the graphics memory; the next picture takes it again."""
        if self._canvas is not None:
            self._canvas.delete()
            self._canvas = None
