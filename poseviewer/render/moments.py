"""Moments for the loss by the plain path: pictures of attributes, summed by NumPy."""

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.image import GREY_WEIGHTS
from poseviewer.render.attributes import AttributeImage, Moments, PhotoAttributes
from poseviewer.render.structure import (
    MARGIN_PX,
    MODEL_NOISE,
    bounding_slices,
    edge_agreement,
    orientation_field,
)


def model_attributes(image: AttributeImage, photo: PhotoAttributes) -> FloatArray:
    """Return the attributes M (..., m): ``(k, k n_x, k n_y, k n_z)`` of the reflectance k.

    k_a = k_d = the reflectance of the model file, as in the paper: grey, or each of R, G and B.
    With colour classes and grey reflectance, M is ``(k_R, k_G, k_B, k n_x, k n_y, k n_z)``: the
    colours, and the shading of the grey k. If P is not clipped to the model, one more attribute is
    1 on the model and 0 beside it.
    """
    colours, normals = (np.moveaxis(a, -1, 0) for a in (image.reflectance, image.normals))
    colours = colours.astype(float)
    grey = np.tensordot(GREY_WEIGHTS, colours, 1)
    if photo.colour_reflectance:
        planes = [plane for k in colours for plane in (k, *(k * normals))]
    else:
        planes = [*([grey] if photo.structure is None else colours), *(grey * normals)]
    if not photo.clipped:
        planes.append(image.mask)
    # Planar in memory: sums over pixels are faster.
    return np.moveaxis(np.stack(planes, dtype=float), 0, -1)


def moments_of_images(image: AttributeImage, photo: PhotoAttributes) -> Moments:
    """Sum pictures of all attributes over P; faster paths must give the same moments."""
    weights, cosine = photo.weights, None
    covered = np.flatnonzero(image.mask & (weights > 0.0))
    model = model_attributes(image.at(covered), photo)
    w = weights.ravel()[covered].astype(float)
    channels = np.stack([plane.ravel()[covered] for plane in photo.planar], dtype=float).T
    if photo.structure is not None:
        classes = photo.structure.labels.ravel()[covered]
        memberships = np.eye(len(photo.structure.class_weights))[classes]
        channels = np.concatenate([channels, memberships], axis=1)
        cosine = _edge_cosine(image, photo.structure.field, weights)
    n, size = channels.shape[1], channels.shape[1] + model.shape[1]
    total = float(w.sum()) if photo.clipped else photo.photo_sums.weight
    if total <= 0.0:
        return Moments(0, 0.0, np.zeros(size), np.zeros((size, size)), n, cosine)
    joint = np.concatenate([channels, model], axis=1)
    origin = w @ joint / total if photo.clipped else np.append(photo.origin, np.zeros(size - n))
    joint -= origin
    first, second = w @ joint, (w[:, None] * joint).T @ joint
    if not photo.clipped:
        first[:n], second[:n, :n] = photo.photo_sums.first, photo.photo_sums.second
    mean = first / total
    covariance = second / total - np.outer(mean, mean)
    covariance = 0.5 * (covariance + covariance.T)
    return Moments(len(w), total, mean + origin, covariance, n, cosine)


def _edge_cosine(
    image: AttributeImage, photo_field: NDArray[np.float32], weights: NDArray[np.float32]
) -> float:
    """Cosine between the orientation fields; the model's is 0 away from the model."""
    box = bounding_slices(image.mask, MARGIN_PX)
    grey = image.reflectance[box] @ GREY_WEIGHTS
    attributes = np.dstack([grey, image.normals[box], image.mask[box]]).astype(np.float32)
    if not attributes.size:
        return 0.0
    return edge_agreement(
        photo_field[box], weights[box], orientation_field(attributes, MODEL_NOISE)
    )
