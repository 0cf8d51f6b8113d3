"""The moments that a loss needs, the plain way: pictures of attributes, summed up by NumPy."""

from __future__ import annotations

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.colour import GREY_WEIGHTS
from poseviewer.render.structure import (
    MARGIN_PX,
    MODEL_NOISE,
    PhotoStructure,
    bounding_slices,
    edge_agreement,
    orientation_field,
)
from poseviewer.render.types import AttributeImage, Moments, PhotoAttributes


def model_attributes(image: AttributeImage, photo: PhotoAttributes) -> FloatArray:
    """M (..., m): ``(k, k n_x, k n_y, k n_z)`` of the grey, or of each RGB, reflectance.

    k_a = k_d = the reflectance of the model file, as in the paper. With colour classes and grey
    reflectance it is ``(k_R, k_G, k_B, k n_x, k n_y, k n_z)``: the colours, and the shading of the
    grey k. Where P is not clipped to the model, the last attribute is 1 on it and 0 beside it.
    """
    reflectance = image.reflectance.astype(float)
    grey = (reflectance @ GREY_WEIGHTS)[..., None]
    if photo.colour_reflectance:
        channels = np.split(reflectance, 3, axis=-1)
        parts = [part for k in channels for part in (k, k * image.normals)]
    else:
        parts = [grey if photo.structure is None else reflectance, grey * image.normals]
    if not photo.clipped:
        parts.append(image.mask[..., None])
    return np.concatenate(parts, axis=-1, dtype=float)


def moments_of_images(image: AttributeImage, photo: PhotoAttributes) -> Moments:
    """The plain path: pictures of all attributes, then sums over P. The measure for fast paths."""
    if photo.structure is not None:
        return _moments_of_classes(image, photo, photo.structure)
    covered = np.nonzero(image.mask & (photo.weights > 0.0))
    model = model_attributes(image.at(covered), photo)
    w, seen = photo.weights[covered].astype(float), photo.channels[covered].astype(float)
    if not photo.clipped:
        return moments_of_region(w, seen, model, photo)
    total, n = float(w.sum()), seen.shape[1]
    if total <= 0.0:
        size = n + photo.model_channels
        return Moments(0, 0.0, np.zeros(size), np.zeros((size, size)), n)
    joint = np.concatenate([seen, model], axis=1)
    mean = w @ joint / total
    centred = joint - mean
    return Moments(len(w), total, mean, (w[:, None] * centred).T @ centred / total, n)


def moments_of_region(
    w: FloatArray, seen: FloatArray, model: FloatArray, photo: PhotoAttributes
) -> Moments:
    """The moments over the whole region, of weights ``w`` (N,), F (N, n) and M (N, m) on the model.

    Beside the model M is 0, and what F adds there is the same for all poses.
    """
    n, region = seen.shape[1], photo.region_sums
    joint = np.concatenate([seen - photo.origin, model], axis=1)
    weighted = w[:, None] * joint
    first, second = weighted.sum(axis=0), weighted.T @ joint
    first[:n], second[:n, :n] = region.first, region.second
    return Moments.from_sums(len(w), region.weight, first, second, photo.origin)


def _moments_of_classes(
    image: AttributeImage, photo: PhotoAttributes, structure: PhotoStructure
) -> Moments:
    """F is the colours and the memberships in the classes, over the whole region."""
    covered = np.nonzero(image.mask & (photo.weights > 0.0))
    model = model_attributes(image.at(covered), photo)
    weighted = photo.weights[covered].astype(float)[:, None] * model
    memberships = np.eye(len(structure.shares))[structure.labels[covered]]
    seen = np.concatenate([photo.channels[covered], memberships], axis=1)
    rows, columns = bounding_slices(image.mask, MARGIN_PX)
    grey = image.reflectance @ GREY_WEIGHTS
    shown = np.dstack([grey, image.normals, image.mask])[rows, columns].astype(np.float32)
    field = orientation_field(shown, MODEL_NOISE)
    cosine = edge_agreement(structure, photo.weights, field, rows, columns) if shown.size else 0.0
    n, m = seen.shape[1], model.shape[1]
    weight = float(structure.shares.sum())
    if weight <= 0.0:
        return Moments(0, 0.0, np.zeros(n + m), np.zeros((n + m, n + m)), n, cosine)
    mean = np.concatenate([structure.first, weighted.sum(axis=0)]) / weight
    photo_model = seen.T @ weighted
    joint = np.block([[structure.second, photo_model], [photo_model.T, weighted.T @ model]])
    covariance = joint / weight - np.outer(mean, mean)
    return Moments(len(model), weight, mean, covariance, n, cosine)
