"""The seam of the program: the moments that a loss needs, and the plain way to get them."""

from __future__ import annotations

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.colour import GREY_WEIGHTS
from poseviewer.render.structure import (
    MARGIN_PX,
    MODEL_NOISE,
    PhotoStructure,
    counted,
    edge_agreement,
    orientation_field,
)
from poseviewer.render.types import AttributeImage, Moments, PhotoAttributes


def model_attributes(image: AttributeImage, photo: PhotoAttributes) -> FloatArray:
    """M (height, width, m): ``(k, k n_x, k n_y, k n_z)`` of the grey, or of each RGB, reflectance.

    k_a = k_d = the reflectance of the model file, as in the paper. With classes of colour, and grey
    asked for, it is ``(k_R, k_G, k_B, k n_x, k n_y, k n_z)``: all the model's colours, and one
    shade, that of the grey k. Where P is not clipped to the model, the last attribute is 1 on it
    and 0 beside it.
    """
    reflectance = image.reflectance.astype(float)
    if photo.structure is not None and not photo.colour_reflectance:
        shade = (reflectance @ GREY_WEIGHTS)[..., None] * image.normals
        parts = reflectance, shade, image.mask[..., None]
        return np.concatenate(parts, axis=-1).astype(np.float64)
    if not photo.colour_reflectance:
        reflectance = reflectance @ GREY_WEIGHTS[:, None]
    ambient_and_normal = np.concatenate(
        [np.ones((*image.normals.shape[:2], 1)), image.normals.astype(float)], axis=-1
    )
    blocks = reflectance[..., :, None] * ambient_and_normal[..., None, :]
    attributes = blocks.reshape(*image.normals.shape[:2], -1)
    if photo.clipped:
        return attributes
    return np.concatenate([attributes, image.mask[..., None].astype(float)], axis=-1)


def moments_of_classes(
    structure: PhotoStructure,
    pixels: int,
    photo_model: FloatArray,
    model: tuple[FloatArray, FloatArray],
    edge_cosine: float,
) -> Moments:
    """Of colours and memberships F (n) and attributes M (m), from sums over P.

    ``photo_model`` (n, m) is that of ``F M^T``; ``model`` those of M (m,) and ``M M^T`` (m, m).
    """
    n, m = photo_model.shape
    weight = float(structure.shares.sum())
    if weight <= 0.0:
        return Moments(0, 0.0, np.zeros(n + m), np.zeros((n + m, n + m)), n, edge_cosine)
    mean = np.concatenate([structure.first, model[0]]) / weight
    joint = np.empty((n + m, n + m))
    joint[:n, :n] = structure.second
    joint[:n, n:], joint[n:, :n] = photo_model, photo_model.T
    joint[n:, n:] = model[1]
    return Moments(pixels, weight, mean, joint / weight - np.outer(mean, mean), n, edge_cosine)


def moments_of_images(image: AttributeImage, photo: PhotoAttributes) -> Moments:
    """The plain path: pictures of all attributes, then sums over P. The measure for fast paths."""
    if photo.structure is not None:
        return _classes_of_images(image, photo, photo.structure)
    weights = photo.weights.astype(float)
    covered = image.mask & (weights > 0.0)
    region = covered if photo.clipped else weights > 0.0
    w = weights[region]
    channels = photo.channels.shape[2]
    total = float(w.sum())
    pixels = int(covered.sum())
    if total <= 0.0:
        size = channels + photo.model_channels
        return Moments(0, 0.0, np.zeros(size), np.zeros((size, size)), channels)
    joint = np.concatenate(
        [photo.channels[region].astype(float), model_attributes(image, photo)[region]], axis=1
    )
    mean = w @ joint / total
    centred = joint - mean
    return Moments(pixels, total, mean, (w[:, None] * centred).T @ centred / total, channels)


def _classes_of_images(
    image: AttributeImage, photo: PhotoAttributes, structure: PhotoStructure
) -> Moments:
    covered = image.mask & (photo.weights > 0.0)
    weights = photo.weights[covered].astype(float)[:, None]
    model = model_attributes(image, photo)[covered]
    memberships = np.eye(len(structure.shares))[structure.labels[covered]]
    seen = np.concatenate([photo.channels[covered], memberships], axis=1)
    rows, columns = counted(image.mask, MARGIN_PX)
    grey = image.reflectance @ GREY_WEIGHTS
    shown = np.dstack([grey, image.normals, image.mask])[rows, columns].astype(np.float32)
    field = orientation_field(shown, MODEL_NOISE)
    cosine = edge_agreement(structure, photo.weights, field, rows, columns) if shown.size else 0.0
    sums = (weights * model).sum(axis=0), (weights * model).T @ model
    pixels = int(covered.sum())
    return moments_of_classes(structure, pixels, seen.T @ (weights * model), sums, cosine)
