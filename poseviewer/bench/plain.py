"""The plain path, as in the paper: pyrender draws, the pictures are read back, NumPy sums.

It is made as quick as pyrender and NumPy let it be, to be a fair measure: one pass, without lights
and without multisampling, gives all four attributes; only the pixels of the model are looked at.
Importing it makes the OpenGL context.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.photo import GREY_WEIGHTS
from poseviewer.render.opengl.context import opengl
from poseviewer.render.opengl.renderer import clip_from_world
from poseviewer.render.opengl.shading import (
    BoundedMesh,
    PictureCamera,
    SingleSampleRenderer,
    pyrender,
)
from poseviewer.render.pyramid.simplified import simplify
from poseviewer.render.types import AttributeImage, Moments, PhotoAttributes

NOTHING = (0.5, 0.5, 0.5, 0.0)
"""The background's colour: all attributes 0."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What pyrender gives back."""

    colour: NDArray[np.uint8]
    """(height, width, 4): k n in the model's frame, from -1 to 1 in three channels, and k."""
    depth: NDArray[np.float32]
    """(height, width): 0 where the model is not."""
    pose: Pose


class PlainRenderer:
    """Grey reflectance from vertex colours, by pyrender's own pass for unlit colours.

    Attributes have 8 bits: by itself that moves losses by a few thousandths.
    Textures are left out. Normals between the vertices are blended, and not brought to unit length
    again; surfaces seen from behind have their front's. On a model of few triangles this moves the
    clipped loss by up to 0.015.
    """

    def __init__(self, mesh: Mesh) -> None:
        opengl()
        self._mesh = mesh
        self._camera = PictureCamera()
        self._scene = pyrender.Scene(bg_color=np.array(NOTHING))
        self._scene.add(self._camera)
        self._scene.add(_attribute_mesh(mesh))
        self._renderer = SingleSampleRenderer(1, 1)
        self._reduced: dict[int, PlainRenderer] = {}

    def reduced(self, faces: int) -> PlainRenderer:
        """The same path with the model simplified to ``faces`` triangles; kept for later."""
        if len(self._mesh.faces) <= faces:
            return self
        if faces not in self._reduced:
            self._reduced[faces] = PlainRenderer(simplify(self._mesh, faces))
        return self._reduced[faces]

    def picture(self, pose: Pose) -> Picture:
        """Draw the attributes and read them back, with the depth."""
        opengl()
        camera, shape = pose.camera, (pose.camera.height, pose.camera.width)
        clip = clip_from_world(self._mesh, pose)
        if clip is None:
            return Picture(np.zeros((*shape, 4), np.uint8), np.zeros(shape, np.float32), pose)
        self._camera.matrix = clip
        self._renderer.viewport_width, self._renderer.viewport_height = camera.width, camera.height
        flags = pyrender.RenderFlags
        flags = flags.FLAT | flags.RGBA | flags.OFFSCREEN
        pictures: Any = self._renderer.render(self._scene, flags)
        return Picture(pictures[0], pictures[1], pose)

    def covers(self, pose: Pose) -> NDArray[np.bool_]:
        """(height, width): where the model is seen."""
        return self.picture(pose).depth > 0.0

    def render(self, pose: Pose) -> AttributeImage:
        """The attributes; of the faces' numbers, which this path does not have, only the sign."""
        picture = self.picture(pose)
        attributes = _decoded(picture.colour.reshape(-1, 4), pose)
        shown = (picture.depth.reshape(-1) > 0.0) & (attributes[:, 0] > 0.0)
        attributes[~shown] = 0.0
        k = attributes[:, :1]
        normals = np.divide(attributes[:, 1:], k, where=k > 0.0, out=np.zeros((len(k), 3)))
        shape = picture.depth.shape
        return AttributeImage(
            np.where(shown, 0, -1).astype(np.int32).reshape(shape),
            np.repeat(k, 3, axis=1).astype(np.float32).reshape(*shape, 3),
            normals.astype(np.float32).reshape(*shape, 3),
        )

    def moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        """The joint moments, summed over the pictures by NumPy; of grey reflectance alone."""
        return moments_of_picture(self.picture(pose), photo)

    def close(self) -> None:
        """Free the graphics memory."""
        for smaller in self._reduced.values():
            smaller.close()
        opengl()
        self._renderer.delete()


def moments_of_picture(picture: Picture, photo: PhotoAttributes) -> Moments:
    """Sums over the pixels that the model covers, all that NumPy has to touch.

    What the photo alone adds beside the model does not change from pose to pose, and is added up
    once, as the fused path does.
    """
    weights = photo.weights.reshape(-1)
    pixels = np.flatnonzero((picture.depth.reshape(-1) > 0.0) & (weights > 0.0))
    n, m = photo.channels.shape[2], photo.model_channels
    w = weights[pixels].astype(float)
    joint = np.empty((len(pixels), n + m))
    joint[:, :n] = photo.channels.reshape(-1, n)[pixels] - photo.origin
    joint[:, n : n + 4] = _decoded(picture.colour.reshape(-1, 4)[pixels], picture.pose)
    joint[:, n + 4 :] = 1.0
    weighted = w[:, None] * joint
    first, second, weight = w @ joint, weighted.T @ joint, float(w.sum())
    if not photo.clipped:
        region = photo.photo_sums
        weight = region.weight
        first[:n], second[:n, :n] = region.first, region.second
    return Moments.from_sums(len(pixels), weight, first, second, photo.origin)


def _decoded(colour: NDArray[np.uint8], pose: Pose) -> FloatArray:
    """(N, 4): k, and k n in the camera's frame, of colours (N, 4)."""
    attributes = np.empty((len(colour), 4))
    attributes[:, 0] = colour[:, 3] * (1.0 / 255.0)
    turned = colour[:, :3] * (2.0 / 255.0) - 1.0
    attributes[:, 1:] = turned @ pose.camera_from_model.rotation.T
    return attributes


def _attribute_mesh(mesh: Mesh) -> BoundedMesh:
    """The attributes as the vertices' colours, which 8 bits hold evenly."""
    k = (mesh.colours @ GREY_WEIGHTS)[:, None]
    colours = np.concatenate([0.5 + 0.5 * k * mesh.normals, k], axis=1)
    material = pyrender.MetallicRoughnessMaterial(
        baseColorFactor=(1.0, 1.0, 1.0, 1.0), doubleSided=True
    )
    primitive = pyrender.Primitive(
        mesh.vertices - mesh.centre, indices=mesh.faces, color_0=colours, material=material
    )
    return BoundedMesh([primitive])
