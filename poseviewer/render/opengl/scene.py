"""The pieces of pyrender that both OpenGL renderers are made of. Importing it makes the context.

The scene's world is the model's frame, moved so that the model's centre is the origin. The way
from there to the picture is one matrix, multiplied in double precision before OpenGL's floats see
it: far-off models and long lenses keep their sub-pixel and their depth accuracy.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Perspective, Pose
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.opengl.context import current_context, import_pyrender

import_pyrender()

import pyrender  # noqa: E402 - its platform had to be chosen first
from OpenGL import GL  # noqa: E402
from pyrender.shader_program import ShaderProgramCache  # noqa: E402

SHADERS = Path(__file__).parent / "shaders"
MOST_FACES = (1 << 24) - 1
"""As many as an 8-bit RGB colour can number, and a float32 index of pyrender can address."""
NEAR_PER_DIAMETER = 1e-3
"""Nearer than this share of the model's diameter, nothing is drawn under perspective."""


class PictureCamera(pyrender.Camera):
    """A pyrender camera that takes its projection matrix as it is given."""

    def __init__(self) -> None:
        super().__init__()
        self.matrix: FloatArray = np.eye(4)

    def get_projection_matrix(self, width: int, height: int) -> FloatArray:  # noqa: ARG002
        """The matrix (4, 4) that was set, whatever the size of the viewport."""
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

    def __init__(self) -> None:
        super().__init__(1, 1)

    def _configure_main_framebuffer(self) -> None:
        before = self._main_fb_dims
        super()._configure_main_framebuffer()
        if self._main_fb_dims == before:
            return
        kinds = (self._main_cb_ms, GL.GL_RGBA), (self._main_db_ms, GL.GL_DEPTH_COMPONENT24)
        for buffer, kind in kinds:
            GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
            GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, kind, *self._main_fb_dims)


class FaceIdRenderer(pyrender.Renderer):
    """pyrender's segmentation pass (no multisampling), with face numbers for colours."""

    def __init__(self) -> None:
        super().__init__(1, 1)
        self._program_cache = ShaderProgramCache(str(SHADERS / "face_ids"))

    def _bind_and_draw_primitive(self, primitive, pose, program, flags) -> None:
        # The segmentation pass always culls; without its flag, the material says whether.
        flags &= ~pyrender.RenderFlags.SEG
        super()._bind_and_draw_primitive(primitive, pose, program, flags)


class FaceIdCanvas:
    """A mesh on the graphics card, to be drawn as the numbers of its faces."""

    def __init__(self, mesh: Mesh, two_sided: bool) -> None:
        if len(mesh.faces) > MOST_FACES:
            raise ValueError(f"{len(mesh.faces)} faces; OpenGL here numbers at most {MOST_FACES}")
        make_current()
        self._camera = PictureCamera()
        self._scene = pyrender.Scene()
        self._scene.add(self._camera)
        node = self._scene.add(_bare_mesh(mesh, two_sided))
        self._colours = {node: 0}  # the shader ignores it, but pyrender skips nodes without one
        self._renderer = FaceIdRenderer()

    def draw(self, width: int, height: int, clip_from_world: FloatArray) -> NDArray[np.int32]:
        """(height, width): the visible face of each pixel centre, -1 for none."""
        make_current()
        self._camera.matrix = clip_from_world
        self._renderer.viewport_width, self._renderer.viewport_height = width, height
        flags = pyrender.RenderFlags
        flags = flags.SEG | flags.OFFSCREEN | flags.RGBA
        rgba = rendered(self._renderer, self._scene, flags, self._colours)
        numbers = np.ascontiguousarray(rgba).view("<u4")[..., 0] & 0xFFFFFF
        return numbers.astype(np.int32) - 1

    def delete(self) -> None:
        """Free the graphics memory."""
        make_current()
        self._renderer.delete()


def rendered(renderer: pyrender.Renderer, scene: pyrender.Scene, *args: Any) -> NDArray[np.uint8]:
    """(height, width, 4) RGBA: what ``renderer`` draws off screen, without its depth picture."""
    picture: Any = renderer.render(scene, *args)
    return picture[0]


def make_current() -> None:
    """Let OpenGL calls go to the context of the process.

    Raises:
        RuntimeError: another thread made the context, and it alone may use it.
    """
    try:
        current_context().make_current()
    except Exception as error:
        raise RuntimeError("the OpenGL context belongs to the thread that made it") from error


def clip_from_world(mesh: Mesh, pose: Pose, near: float, far: float) -> FloatArray:
    """(4, 4): from the model's frame, with its centre as the origin, to OpenGL's clip space."""
    opengl_from_model = OPENGL_FROM_OPENCV @ pose.camera_from_model
    matrix = np.eye(4)
    matrix[:3, :3] = opengl_from_model.rotation
    matrix[:3, 3] = opengl_from_model.apply(mesh.centre)
    return projection_matrix(pose.camera, near, far) @ matrix


def projection_matrix(camera: Camera, near: float, far: float) -> FloatArray:
    """(4, 4): from OpenGL's camera frame to clip space, z = -near to -1 and z = -far to 1.

    The viewport spans [-1, 1] as the picture spans [0, width] and [0, height]: pixel centres at
    i + 0.5, as everywhere inside, with no shift.
    """
    matrix = np.zeros((4, 4))
    off_x, off_y = 1.0 - 2.0 * camera.cx / camera.width, 2.0 * camera.cy / camera.height - 1.0
    if isinstance(camera, Perspective):
        matrix[0, 0], matrix[1, 1] = 2.0 * camera.fx / camera.width, 2.0 * camera.fy / camera.height
        matrix[0, 2], matrix[1, 2] = off_x, off_y
        matrix[2, 2], matrix[2, 3] = (far + near) / (near - far), 2.0 * far * near / (near - far)
        matrix[3, 2] = -1.0
    else:
        matrix[0, 0], matrix[1, 1] = 2.0 * camera.scale / np.array([camera.width, camera.height])
        matrix[0, 3], matrix[1, 3] = -off_x, -off_y
        matrix[2, 2], matrix[2, 3] = 2.0 / (near - far), (far + near) / (near - far)
        matrix[3, 3] = 1.0
    return matrix


def depth_range(camera: Camera, depths: FloatArray, diameter: float) -> tuple[float, float] | None:
    """Near and far plane, tightly around points at these depths (N,); None: all are too near."""
    margin = 1e-3 * diameter
    near, far = float(depths.min()) - margin, float(depths.max()) + margin
    if isinstance(camera, Perspective):
        limit = NEAR_PER_DIAMETER * diameter
        if far - margin <= limit:
            return None
        near = max(near, limit)
    return near, far


def _bare_mesh(mesh: Mesh, two_sided: bool) -> BoundedMesh:
    """Nothing but positions and faces, in the mesh's own order."""
    material = pyrender.MetallicRoughnessMaterial(doubleSided=two_sided)
    positions = mesh.vertices - mesh.centre
    return BoundedMesh([pyrender.Primitive(positions, indices=mesh.faces, material=material)])
