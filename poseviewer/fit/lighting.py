"""The lighting that explains the photo best; the loss takes it without asking for it."""

from dataclasses import replace

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.linear_algebra import whiten
from poseviewer.render.moments import model_attributes
from poseviewer.render.types import AttributeImage, Moments, PhotoAttributes, Renderer


def recover_lighting(moments: Moments) -> tuple[FloatArray, FloatArray]:
    """``A = C_FM C_MM^+`` (n, m) and ``b = mean(F) - A mean(M)`` (n,), light that is there without
    the model (haze, sensor offset): the map ``F = A M + b`` of least squared residual.

    Where the model cannot tell parts of the lighting apart (constant reflectance, a flat model),
    the pseudo-inverse gives the least such lighting. Attributes that are constant get none.
    """
    n = moments.photo_channels
    model = whiten(moments.covariance[n:, n:], moments.mean[n:])
    gain = moments.covariance[:n, n:] @ model.T @ model
    return gain, moments.mean[:n] - gain @ moments.mean[n:]


def relit(
    photo: PhotoAttributes, renderer: Renderer, pose: Pose, image: AttributeImage
) -> FloatArray:
    """Colours (h, w, n) of the model in a picture, by the light that explains best the pixels that
    it covers in the ``photo`` at a ``pose``, with all its colours.
    """
    coloured = photo.channels.shape[2] == 3
    shown = replace(photo, clipped=True, colour_reflectance=coloured, structure=None)
    gain, offset = recover_lighting(renderer.moments(pose, shown))
    return model_attributes(image, shown) @ gain.T + offset
