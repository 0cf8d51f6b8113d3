"""Off-screen OpenGL renderer, in pyrender's context (EGL, or what PYOPENGL_PLATFORM names).

It shares only the texture pyramid with the software renderer.
"""

import ctypes
import os
import threading
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import RendererUnavailableError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import Mesh, hull_points
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.attributes import AttributeImage, Moments, PhotoAttributes, Renderer
from poseviewer.render.moments import moments_of_images
from poseviewer.render.texture import TexturePyramid, double_areas, mip_levels

NEAR_PER_DIAMETER = 1e-3
"""Depth of the near plane, in the model's diameter, as in the software renderer."""
OPENGL_ADVICE = "install EGL (Debian: libegl1 libgl1-mesa-dri), or use the software renderer"
"""End of messages where OpenGL cannot be used."""
MAX_FACES = (1 << 24) - 1
"""Largest index of a face that a float32 holds exactly."""
VERTEX_SHADER = """#version 330 core
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec3 colour;
layout(location = 3) in vec2 uv;
uniform mat4 clip_from_world;
uniform mat3 camera_from_world;
out vec3 seen_normal;
out vec3 seen_colour;
out vec2 seen_uv;

void main() {
    gl_Position = clip_from_world * vec4(position, 1.0);
    seen_normal = camera_from_world * normal;
    seen_colour = colour;
    seen_uv = uv;
}
"""
FRAGMENT_SHADER = """#version 330 core
in vec3 seen_normal;
in vec3 seen_colour;
in vec2 seen_uv;
layout(location = 0) out vec4 normal_and_face;  // on the side that is seen; 0 where there is none
layout(location = 1) out vec4 reflectance;
layout(location = 2) out vec4 uv;

void main() {
    vec3 normal = seen_normal / max(length(seen_normal), 1e-30) * (gl_FrontFacing ? 1.0 : -1.0);
    normal_and_face = vec4(normal, float(gl_PrimitiveID + 1));
    reflectance = vec4(seen_colour, 1.0);
    uv = vec4(seen_uv, 0.0, 0.0);
}
"""

_context: Any = None
_thread = 0


def opengl() -> Any:
    """Return PyOpenGL's functions. The first call makes the context, for its own thread alone.

    Raises:
        RendererUnavailableError: this machine gives no context; the message says what to install.
        RuntimeError: another thread made the context.
    """
    global _context, _thread
    if _context is None:
        platform = os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                import pyrender

                _context = pyrender.OffscreenRenderer(1, 1)
        except Exception as error:
            raise RendererUnavailableError(
                f"OpenGL by {platform} gave no context ({type(error).__name__}: {error}); "
                f"{OPENGL_ADVICE}."
            ) from error
        _thread = threading.get_ident()
    if _thread != threading.get_ident():
        raise RuntimeError("the OpenGL context belongs to the thread that made it")
    from OpenGL import GL

    return GL


def opengl_renderer_name() -> str | None:
    """Return the name of the graphics card or Mesa's rasteriser; None without OpenGL."""
    try:
        gl = opengl()
    except RendererUnavailableError:
        return None
    return gl.glGetString(gl.GL_RENDERER).decode(errors="replace")


class OpenGLRenderer(Renderer):
    """Renderer of a mesh by OpenGL, with textures sampled by NumPy; for one thread alone."""

    def __init__(self, mesh: Mesh) -> None:
        """Upload nothing yet.

        Raises:
            RendererUnavailableError: there is no OpenGL context.
        """
        opengl()
        if len(mesh.faces) > MAX_FACES:
            raise ValueError(f"{len(mesh.faces)} faces; OpenGL here numbers at most {MAX_FACES}")
        self.mesh = mesh
        self._textures = TexturePyramid.of(mesh.textures)
        self._texel_areas = self._textures.texel_areas(mesh)
        # Texture coordinates are read back only for a model with textures.
        self._targets = 3 if mesh.textures else 2
        self._size = 0, 0
        self._objects: dict[str, Any] = {}
        self._program = 0

    def render(self, pose: Pose) -> AttributeImage:
        """Draw face indices, reflectance and normals (camera frame) at every pixel centre."""
        size = pose.camera.width, pose.camera.height
        clip = clip_from_world(self.mesh, pose)
        if clip is None:
            nothing = np.zeros((2, size[1], size[0], 3), np.float32)
            return AttributeImage(np.full((size[1], size[0]), -1, np.int32), *nothing)
        pictures = self._draw(pose, clip, size)
        face_ids = pictures[0][..., 3].astype(np.int32) - 1
        normals, reflectance = (np.ascontiguousarray(p[..., :3]) for p in pictures[:2])
        if self.mesh.textures:
            self._apply_textures(pose, face_ids, pictures[2][..., :2], reflectance)
        return AttributeImage(face_ids, reflectance, normals)

    def level_moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """Compute joint moments by the plain path."""
        return moments_of_images(self.render(pose), photo)

    def close(self) -> None:
        """Free the graphics memory; the next picture allocates it again."""
        if not self._objects:
            return
        gl = opengl()
        for kind, names in self._objects.items():
            getattr(gl, f"glDelete{kind}")(len(names), names)
        gl.glDeleteProgram(self._program)
        self._size = 0, 0
        self._objects.clear()

    def _draw(self, pose: Pose, clip: FloatArray, size: tuple[int, int]) -> list[NDArray]:
        """(height, width, 4) float32 each, from the targets of the fragment shader."""
        gl = opengl()
        if not self._objects:
            self._upload(gl)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._objects["Framebuffers"][0])
        gl.glBindVertexArray(self._objects["VertexArrays"][0])
        targets = [gl.GL_COLOR_ATTACHMENT0 + k for k in range(self._targets)]
        if size != self._size:
            self._size = size
            points = [*targets, gl.GL_DEPTH_ATTACHMENT]
            for buffer, point in zip(self._objects["Renderbuffers"], points, strict=True):
                kind = gl.GL_RGBA32F if point in targets else gl.GL_DEPTH_COMPONENT24
                gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, buffer)
                gl.glRenderbufferStorage(gl.GL_RENDERBUFFER, kind, *size)
                gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, point, gl.GL_RENDERBUFFER, buffer)
            gl.glDrawBuffers(len(targets), targets)
        gl.glUseProgram(self._program)
        for name, matrix, set_uniform in (
            ("clip_from_world", clip, gl.glUniformMatrix4fv),
            ("camera_from_world", pose.camera_from_model.rotation, gl.glUniformMatrix3fv),
        ):
            location = gl.glGetUniformLocation(self._program, name)
            set_uniform(location, 1, True, matrix.astype(np.float32))
        gl.glViewport(0, 0, *size)
        gl.glFrontFace(gl.GL_CW)  # the photo's first row is OpenGL's lowest
        gl.glEnable(gl.GL_DEPTH_TEST)
        gl.glDisable(gl.GL_CULL_FACE)
        gl.glClearColor(0.0, 0.0, 0.0, 0.0)
        gl.glClear(gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT)
        gl.glDrawElements(gl.GL_TRIANGLES, self.mesh.faces.size, gl.GL_UNSIGNED_INT, None)
        pictures = []
        for target in targets:
            pictures.append(np.empty((size[1], size[0], 4), np.float32))
            gl.glReadBuffer(target)
            gl.glReadPixels(0, 0, *size, gl.GL_RGBA, gl.GL_FLOAT, pictures[-1])
        return pictures

    def _upload(self, gl: Any) -> None:
        from OpenGL.GL import shaders

        vertex = shaders.compileShader(VERTEX_SHADER, gl.GL_VERTEX_SHADER)
        fragment = shaders.compileShader(FRAGMENT_SHADER, gl.GL_FRAGMENT_SHADER)
        buffers = ("Renderbuffers", self._targets + 1), ("Buffers", 2)
        for kind, count in (("Framebuffers", 1), ("VertexArrays", 1), *buffers):
            self._objects[kind] = np.atleast_1d(getattr(gl, f"glGen{kind}")(count))
        mesh = self.mesh
        columns = mesh.vertices - mesh.centre, mesh.normals, mesh.colours, mesh.uvs
        vertices = np.column_stack(columns).astype(np.float32)
        gl.glBindVertexArray(self._objects["VertexArrays"][0])
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._objects["Framebuffers"][0])
        kinds = gl.GL_ARRAY_BUFFER, gl.GL_ELEMENT_ARRAY_BUFFER
        data = vertices, mesh.faces.astype(np.uint32)
        for kind, buffer, values in zip(kinds, self._objects["Buffers"], data, strict=True):
            gl.glBindBuffer(kind, buffer)
            gl.glBufferData(kind, values.nbytes, values, gl.GL_STATIC_DRAW)
        for location, (length, offset) in enumerate(((3, 0), (3, 12), (3, 24), (2, 36))):
            gl.glEnableVertexAttribArray(location)
            start = ctypes.c_void_p(offset)
            gl.glVertexAttribPointer(location, length, gl.GL_FLOAT, False, 44, start)
        self._program = shaders.compileProgram(vertex, fragment)

    def _apply_textures(
        self, pose: Pose, face_ids: NDArray[np.int32], uv: NDArray, colours: NDArray[np.float32]
    ) -> None:
        """Multiply ``colours`` (height, width, 3) by the textures at ``uv``."""
        mesh = self.mesh
        textured = (face_ids >= 0) & (mesh.face_texture[face_ids] >= 0)
        faces = face_ids[textured]
        pixel_areas = double_areas(pose.project(mesh.vertices)[mesh.faces])
        levels = mip_levels(self._texel_areas, pixel_areas, self._textures.table.shape[1])
        texels = self._textures.sample(mesh.face_texture[faces], levels[faces], uv[textured])
        colours[textured] *= texels


def clip_from_world(mesh: Mesh, pose: Pose) -> FloatArray | None:
    """Return the matrix (4, 4) from the model's frame, about its centre, to clip space.

    v points downwards, and the model's depths fill the clip space. The product is in double
    precision, so that distant models and long lenses keep their accuracy. Pixel centres are at
    i + 0.5, without a shift. None if all of the model is too near or behind the camera.
    """
    camera, size = pose.camera, np.array([pose.camera.width, pose.camera.height])
    depths = pose.camera_from_model.apply(hull_points(mesh))[:, 2]
    margin, nearest = 1e-3 * mesh.diameter, NEAR_PER_DIAMETER * mesh.diameter
    near, far = float(depths.min()) - margin, float(depths.max()) + margin
    clip_from_camera = np.zeros((4, 4))
    if isinstance(camera, Perspective):
        if far - margin <= nearest:
            return None
        near = max(near, nearest)
        focal = np.array([camera.fx, camera.fy])
        of_w = 2
        clip_from_camera[2, 2:] = far + near, -2.0 * far * near
    else:
        focal, of_w = np.full(2, camera.scale), 3
        clip_from_camera[2, 2:] = 2.0, -far - near
    clip_from_camera[2] /= far - near
    clip_from_camera[[0, 1], [0, 1]] = 2.0 * focal / size
    clip_from_camera[:2, of_w] = 2.0 * np.array([camera.cx, camera.cy]) / size - 1.0
    clip_from_camera[3, of_w] = 1.0
    centred = RigidTransform(
        pose.camera_from_model.rotation, pose.camera_from_model.apply(mesh.centre)
    )
    return clip_from_camera @ centred.as_matrix()
