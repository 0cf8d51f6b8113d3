"""OpenGL as a ``Renderer``: the second one, with which the software renderer is compared."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose, level_pose
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV
from poseviewer.geometry.mesh import Mesh, hull_points
from poseviewer.render.moments import Part, moments_of_images
from poseviewer.render.opengl.context import opengl
from poseviewer.render.overlay.window import Window, model_window
from poseviewer.render.structure import MARGIN_PX
from poseviewer.render.texture import TexturePyramid, doubled_areas, mip_levels
from poseviewer.render.types import AttributeImage, Moments, PhotoAttributes

SHADERS = Path(__file__).parent / "shaders"
MOST_FACES = (1 << 24) - 1
"""As many as a float32 can number."""
NEAR_PER_DIAMETER = 1e-3
"""Nearer than this share of the model's diameter, nothing is drawn under perspective."""
SIZE_STEP = 64
"""px: sizes of the framebuffer are multiples of it, so that most poses find theirs made."""


class OpenGLRenderer:
    """A mesh drawn by OpenGL, off screen. To be used by one thread of the process, always the same.

    The graphics card interpolates normals, colours and texture coordinates in float32; textures
    are sampled here.
    """

    def __init__(self, mesh: Mesh, two_sided: bool = True) -> None:
        """``two_sided=False`` leaves out faces seen from behind (closed, well-wound meshes).

        OpenGL itself is first touched by the first picture.
        """
        if len(mesh.faces) > MOST_FACES:
            raise ValueError(f"{len(mesh.faces)} faces; OpenGL here numbers at most {MOST_FACES}")
        self.mesh = mesh
        self.two_sided = two_sided
        self._textures = TexturePyramid.from_textures(mesh.textures)
        self._texel_areas = self._textures.texel_areas(mesh)
        # Texture coordinates are read back only where they are needed.
        self._targets = 3 if mesh.textures else 2
        self._size = 0, 0
        self._programs: dict[bool, Any] = {}
        self._objects: dict[str, Any] = {}

    def render(self, pose: Pose) -> AttributeImage:
        """Visibility, reflectance and normals at every pixel centre.

        Raises:
            RendererUnavailableError: no OpenGL on this machine; the message says what to install.
            RuntimeError: another thread made the process's OpenGL context.
        """
        shape = pose.camera.height, pose.camera.width
        whole = AttributeImage(np.full(shape, -1, np.int32), *np.zeros((2, *shape, 3), np.float32))
        image, part = self.draw(pose, numbered=True)
        whole.face_ids[part], whole.reflectance[part] = image.face_ids, image.reflectance
        whole.normals[part] = image.normals
        return whole

    def covers(self, pose: Pose) -> NDArray[np.bool_]:
        """(height, width): where the model is seen."""
        mask = np.zeros((pose.camera.height, pose.camera.width), bool)
        image, part = self.draw(pose)
        mask[part] = image.mask
        return mask

    def moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """The joint moments of the photo's and the model's attributes, from pictures of both."""
        image, part = self.draw(level_pose(pose, photo.factor))
        return moments_of_images(image, photo, part)

    def draw(self, pose: Pose, numbered: bool = False) -> tuple[AttributeImage, Part]:
        """The model in those rows and columns of the photo that it is in, and a margin.

        If not ``numbered``, all faces have the number 0: that takes less time.
        """
        window = model_window(self.mesh, pose, MARGIN_PX)
        if window is not None:
            rows, columns = window.of_photo(pose.camera.width, pose.camera.height)
            size = columns.stop - columns.start, rows.stop - rows.start
            pose = Window(columns.start, rows.start, *size).pose(pose)
            clip = clip_from_world(self.mesh, pose)
            if clip is not None:
                return self._draw(pose, clip, numbered), (rows, columns)
        nothing = np.zeros((0, 0, 3), np.float32)
        nowhere = slice(0, 0), slice(0, 0)
        return AttributeImage(np.zeros((0, 0), np.int32), nothing, nothing), nowhere

    def close(self) -> None:
        """Free the graphics memory; the next picture takes it again."""
        if not self._objects:
            return
        gl = opengl()
        for kind, made in self._objects.items():
            getattr(gl, f"glDelete{kind}")(len(made), made)
        for program in self._programs.values():
            gl.glDeleteProgram(program)
        self._size = 0, 0
        self._objects.clear()
        self._programs.clear()

    def _draw(self, pose: Pose, clip: FloatArray, numbered: bool) -> AttributeImage:
        """Of the camera's size; textured faces are numbered in any case."""
        gl = opengl()
        if not self._objects:
            self._upload(gl)
        numbered |= bool(self.mesh.textures)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._objects["Framebuffers"][0])
        gl.glBindVertexArray(self._objects["VertexArrays"][0])
        size = pose.camera.width, pose.camera.height
        targets = [gl.GL_COLOR_ATTACHMENT0 + k for k in range(self._targets)]
        self._make_room(gl, size, targets)
        if numbered not in self._programs:
            self._programs[numbered] = _program(gl, numbered)
        program = self._programs[numbered]
        gl.glUseProgram(program)
        # OpenGL's first row is the lowest: it draws upside down, where faces wind the other way.
        flipped = np.diag([1.0, -1.0, 1.0, 1.0]) @ clip
        for name, matrix, put in (
            ("clip_from_world", flipped, gl.glUniformMatrix4fv),
            ("camera_from_world", pose.camera_from_model.rotation, gl.glUniformMatrix3fv),
        ):
            put(gl.glGetUniformLocation(program, name), 1, True, matrix.astype(np.float32))
        gl.glFrontFace(gl.GL_CW)
        gl.glViewport(0, 0, *size)
        gl.glEnable(gl.GL_DEPTH_TEST)
        gl.glDepthMask(True)
        gl.glDisable(gl.GL_BLEND)
        (gl.glDisable if self.two_sided else gl.glEnable)(gl.GL_CULL_FACE)
        gl.glCullFace(gl.GL_BACK)
        gl.glClearColor(0.0, 0.0, 0.0, 0.0)
        gl.glClear(gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT)
        gl.glDrawElements(gl.GL_TRIANGLES, self.mesh.faces.size, gl.GL_UNSIGNED_INT, None)
        pictures = np.empty((len(targets), size[1], size[0], 4), np.float32)
        for target, picture in zip(targets, pictures, strict=True):
            gl.glReadBuffer(target)
            gl.glReadPixels(0, 0, *size, gl.GL_RGBA, gl.GL_FLOAT, picture)
        # As pyrender expects to find it.
        gl.glFrontFace(gl.GL_CCW)
        gl.glBindVertexArray(0)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, 0)
        face_ids = pictures[0, ..., 3].astype(np.int32) - 1
        normals, reflectance = (
            np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGBA2RGB), np.float32)
            for picture in pictures[:2]
        )
        if self.mesh.textures:
            uv = np.dstack([pictures[1, ..., 3], pictures[2, ..., 0]])
            self._apply_textures(pose, face_ids, uv, reflectance)
        return AttributeImage(face_ids, reflectance, normals)

    def _upload(self, gl: Any) -> None:
        """The mesh to the graphics card."""
        counts = {"Framebuffers": 1, "Renderbuffers": self._targets + 1}
        for kind, count in (counts | {"VertexArrays": 1, "Buffers": 2}).items():
            self._objects[kind] = np.atleast_1d(getattr(gl, f"glGen{kind}")(count))
        mesh = self.mesh
        # In the order in which faces use them, vertices are found sooner.
        used, first, faces = np.unique(mesh.faces, return_index=True, return_inverse=True)
        order = np.argsort(first)
        columns = mesh.vertices - mesh.centre, mesh.normals, mesh.colours, mesh.uvs
        vertices = np.column_stack(columns)[used[order]].astype(np.float32)
        faces = np.argsort(order)[faces].astype(np.uint32)
        gl.glBindVertexArray(self._objects["VertexArrays"][0])
        kinds = gl.GL_ARRAY_BUFFER, gl.GL_ELEMENT_ARRAY_BUFFER
        for kind, buffer, data in zip(
            kinds, self._objects["Buffers"], (vertices, faces), strict=True
        ):
            gl.glBindBuffer(kind, buffer)
            gl.glBufferData(kind, data.nbytes, data, gl.GL_STATIC_DRAW)
        for location, (size, offset) in enumerate(((3, 0), (3, 12), (3, 24), (2, 36))):
            gl.glEnableVertexAttribArray(location)
            place = ctypes.c_void_p(offset)
            gl.glVertexAttribPointer(location, size, gl.GL_FLOAT, False, 44, place)

    def _make_room(self, gl: Any, size: tuple[int, int], targets: list[int]) -> None:
        """Let the framebuffer hold ``size`` (width, height), and hardly more: all is cleared."""
        width, height = (-(-side // SIZE_STEP) * SIZE_STEP for side in size)
        if (width, height) == self._size:
            return
        self._size = width, height
        places = [*targets, gl.GL_DEPTH_ATTACHMENT]
        for buffer, place in zip(self._objects["Renderbuffers"], places, strict=True):
            kind = gl.GL_RGBA32F if place in targets else gl.GL_DEPTH_COMPONENT24
            gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, buffer)
            gl.glRenderbufferStorage(gl.GL_RENDERBUFFER, kind, width, height)
            gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, place, gl.GL_RENDERBUFFER, buffer)
        gl.glDrawBuffers(len(targets), targets)

    def _apply_textures(
        self, pose: Pose, face_ids: NDArray[np.int32], uv: NDArray, seen: NDArray[np.float32]
    ) -> None:
        """Multiply the colours ``seen`` (height, width, 3) by the textures at ``uv``."""
        mesh = self.mesh
        textured = (face_ids >= 0) & (mesh.face_texture[face_ids] >= 0)
        faces = face_ids[textured]
        pixel_areas = doubled_areas(pose.project(mesh.vertices)[mesh.faces])
        levels = mip_levels(self._texel_areas, pixel_areas, self._textures.table.shape[1])
        colours = self._textures.sample(mesh.face_texture[faces], levels[faces], uv[textured])
        seen[textured] *= colours


def _program(gl: Any, numbered: bool) -> Any:
    from OpenGL.GL import shaders

    kinds = {"mesh.vert": gl.GL_VERTEX_SHADER, "mesh.frag": gl.GL_FRAGMENT_SHADER}
    head = "#version 330 core\n" + "#define NUMBERED\n" * numbered
    sources = [head + (SHADERS / "attributes" / name).read_text() for name in kinds]
    return shaders.compileProgram(*map(shaders.compileShader, sources, kinds.values()))


def clip_from_world(mesh: Mesh, pose: Pose) -> FloatArray | None:
    """(4, 4): from the model's frame, with its centre as the origin, to OpenGL's clip space.

    None if all of the model is too near, or behind the camera. It is multiplied in double precision
    before OpenGL's floats see it: far-off models and long lenses keep their sub-pixel and their
    depth accuracy. The viewport spans [-1, 1] as the picture spans [0, width] and [0, height]:
    pixel centres at i + 0.5, as everywhere inside, with no shift. Depths span it tightly.
    """
    camera = pose.camera
    depths = pose.camera_from_model.apply(hull_points(mesh))[:, 2]
    margin, nearest = 1e-3 * mesh.diameter, NEAR_PER_DIAMETER * mesh.diameter
    near, far = float(depths.min()) - margin, float(depths.max()) + margin
    off_x, off_y = 1.0 - 2.0 * camera.cx / camera.width, 2.0 * camera.cy / camera.height - 1.0
    clip_from_camera = np.zeros((4, 4))
    if isinstance(camera, Perspective):
        if far - margin <= nearest:
            return None
        near = max(near, nearest)
        scales = 2.0 * camera.fx / camera.width, 2.0 * camera.fy / camera.height
        clip_from_camera[:2, 2] = off_x, off_y
        clip_from_camera[2, 2:] = (far + near) / (near - far), 2.0 * far * near / (near - far)
        clip_from_camera[3, 2] = -1.0
    else:
        scales = 2.0 * camera.scale / camera.width, 2.0 * camera.scale / camera.height
        clip_from_camera[:2, 3] = -off_x, -off_y
        clip_from_camera[2, 2:] = 2.0 / (near - far), (far + near) / (near - far)
        clip_from_camera[3, 3] = 1.0
    clip_from_camera[0, 0], clip_from_camera[1, 1] = scales
    opengl_from_model = OPENGL_FROM_OPENCV @ pose.camera_from_model
    camera_from_world = np.eye(4)
    camera_from_world[:3, :3] = opengl_from_model.rotation
    camera_from_world[:3, 3] = opengl_from_model.apply(mesh.centre)
    return clip_from_camera @ camera_from_world
