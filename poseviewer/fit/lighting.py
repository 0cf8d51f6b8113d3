"""The lighting that explains the photo best: the loss eliminates it, this recovers it."""

from dataclasses import replace

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.linear_algebra import whiten
from poseviewer.render.attributes import AttributeImage, Moments, PhotoAttributes, Renderer
from poseviewer.render.moments import model_attributes


def recover_lighting(moments: Moments) -> tuple[FloatArray, FloatArray]:
    """Return the lighting ``F = A M + b`` of least squared residual.

    Where the model cannot tell parts of the lighting apart (constant reflectance, a flat model),
    the pseudo-inverse gives the least such lighting; constant attributes get none.

    Returns:
        ``A = C_FM C_MM^+`` (n, m), and ``b = mean(F) - A mean(M)`` (n,), which is light that the
        model does not reflect (haze, sensor offset).
    """
    n = moments.photo_channels
    model = whiten(moments.covariance[n:, n:], moments.mean[n:])
    gain = moments.covariance[:n, n:] @ model.T @ model
    return gain, moments.mean[:n] - gain @ moments.mean[n:]


def render_relit(
    photo: PhotoAttributes, renderer: Renderer, pose: Pose, image: AttributeImage
) -> FloatArray:
    """Render the model in the light that explains best the pixels it covers in a photo.

    Args:
        photo: the photo; it is compared in all its colours.
        renderer: renderer of the model.
        pose: pose of the model in the photo.
        image: attributes of the model in the picture to make, (h, w).

    Returns:
        (h, w, n): colours.
    """
    coloured = photo.channels.shape[2] == 3
    shown = replace(photo, clipped=True, colour_reflectance=coloured, structure=None)
    gain, offset = recover_lighting(renderer.moments(pose, shown))
    return model_attributes(image, shown) @ gain.T + offset
