"""The pieces of pyrender that both OpenGL renderers are made of. Importing it makes the context.

The scene's world is the model's frame, moved so that the model's centre is the origin. The way
from there to the picture is one matrix, multiplied in double precision before OpenGL's floats see
it: far-off models and long lenses keep their sub-pixel and their depth accuracy.
"""

from __future__ import annotations

import ctypes
from pathlib import Path

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
"""As many as a float32 can number."""
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


class AttributeCanvas:
    """A mesh on the graphics card, drawn without light as pictures of its attributes."""

    def __init__(self, mesh: Mesh, two_sided: bool) -> None:
        if len(mesh.faces) > MOST_FACES:
            raise ValueError(f"{len(mesh.faces)} faces; OpenGL here numbers at most {MOST_FACES}")
        make_current()
        self._two_sided = two_sided
        self._corners = 3 * len(mesh.faces)
        # Texture coordinates are read back only where they are needed.
        self._targets = 3 if mesh.textures else 2
        self._size = 0, 0
        self._framebuffer = GL.glGenFramebuffers(1)
        self._renderbuffers = GL.glGenRenderbuffers(self._targets + 1)
        self._program = ShaderProgramCache(str(SHADERS / "attributes")).get_program(
            "mesh.vert", "mesh.frag"
        )
        self._program._add_to_context()
        columns = mesh.vertices - mesh.centre, mesh.normals, mesh.colours, mesh.uvs
        vertices = np.ascontiguousarray(np.column_stack(columns), np.float32)
        self._vertex_array = GL.glGenVertexArrays(1)
        self._buffers = GL.glGenBuffers(2)
        GL.glBindVertexArray(self._vertex_array)
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, self._buffers[0])
        GL.glBufferData(GL.GL_ARRAY_BUFFER, vertices.nbytes, vertices, GL.GL_STATIC_DRAW)
        faces = np.ascontiguousarray(mesh.faces, np.uint32)
        GL.glBindBuffer(GL.GL_ELEMENT_ARRAY_BUFFER, self._buffers[1])
        GL.glBufferData(GL.GL_ELEMENT_ARRAY_BUFFER, faces.nbytes, faces, GL.GL_STATIC_DRAW)
        for location, (size, offset) in enumerate(((3, 0), (3, 12), (3, 24), (2, 36))):
            GL.glEnableVertexAttribArray(location)
            pointer = ctypes.c_void_p(offset)
            GL.glVertexAttribPointer(location, size, GL.GL_FLOAT, False, 44, pointer)
        GL.glBindVertexArray(0)

    def draw(
        self,
        size: tuple[int, int],
        part: tuple[slice, slice],
        clip_from_world: FloatArray,
        camera_from_world: FloatArray,
    ) -> list[NDArray[np.float32]]:
        """Pictures (height, width, 4) of the ``size`` (width, height), in float32; only the
        ``part`` of these rows and columns is drawn, the rest is 0.

        They hold the colours and the number of the visible face from 1, or 0 for none; the unit
        normals on the side that is seen and u; and, where the mesh has textures, v. Normals are
        turned by ``camera_from_world`` (3, 3).
        """
        make_current()
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._framebuffer)
        attachments = [int(GL.GL_COLOR_ATTACHMENT0) + k for k in range(self._targets)]
        if size != self._size:
            kinds = [GL.GL_RGBA32F] * self._targets + [GL.GL_DEPTH_COMPONENT24]
            places = [*attachments, GL.GL_DEPTH_ATTACHMENT]
            for buffer, kind, place in zip(self._renderbuffers, kinds, places, strict=True):
                GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
                GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, kind, *size)
                GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, place, GL.GL_RENDERBUFFER, buffer)
            GL.glDrawBuffers(self._targets, attachments)
            self._size = size
        rows, columns = part
        box = columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start
        GL.glViewport(0, 0, *size)
        GL.glEnable(GL.GL_SCISSOR_TEST)
        GL.glScissor(*box)
        GL.glClearColor(0.0, 0.0, 0.0, 0.0)
        GL.glEnable(GL.GL_DEPTH_TEST)
        GL.glDepthMask(True)
        GL.glDisable(GL.GL_BLEND)
        (GL.glDisable if self._two_sided else GL.glEnable)(GL.GL_CULL_FACE)
        GL.glCullFace(GL.GL_BACK)
        GL.glClear(int(GL.GL_COLOR_BUFFER_BIT) | int(GL.GL_DEPTH_BUFFER_BIT))
        # OpenGL's first row is the lowest: it draws upside down, where faces wind the other way.
        GL.glFrontFace(GL.GL_CW)
        self._program._bind()
        flip = np.diag([1.0, -1.0, 1.0, 1.0])
        self._program.set_uniform("clip_from_world", flip @ clip_from_world)
        turned = np.eye(4)  # pyrender gives matrices of 3 x 3 to the wrong function
        turned[:3, :3] = camera_from_world
        self._program.set_uniform("camera_from_world", turned)
        GL.glBindVertexArray(self._vertex_array)
        GL.glDrawElements(GL.GL_TRIANGLES, self._corners, GL.GL_UNSIGNED_INT, None)
        GL.glBindVertexArray(0)
        GL.glFrontFace(GL.GL_CCW)
        GL.glPixelStorei(GL.GL_PACK_ROW_LENGTH, size[0])
        GL.glPixelStorei(GL.GL_PACK_SKIP_ROWS, rows.start)
        GL.glPixelStorei(GL.GL_PACK_SKIP_PIXELS, columns.start)
        pictures = []
        for attachment in attachments:
            GL.glReadBuffer(attachment)
            picture = np.zeros((size[1], size[0], 4), np.float32)
            GL.glReadPixels(*box, GL.GL_RGBA, GL.GL_FLOAT, picture)
            pictures.append(picture)
        GL.glPixelStorei(GL.GL_PACK_ROW_LENGTH, 0)
        GL.glPixelStorei(GL.GL_PACK_SKIP_ROWS, 0)
        GL.glPixelStorei(GL.GL_PACK_SKIP_PIXELS, 0)
        GL.glDisable(GL.GL_SCISSOR_TEST)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, 0)
        return pictures

    def delete(self) -> None:
        """Free the graphics memory."""
        make_current()
        GL.glDeleteFramebuffers(1, [self._framebuffer])
        GL.glDeleteRenderbuffers(len(self._renderbuffers), self._renderbuffers)
        GL.glDeleteVertexArrays(1, [self._vertex_array])
        GL.glDeleteBuffers(2, self._buffers)
        self._program.delete()


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
