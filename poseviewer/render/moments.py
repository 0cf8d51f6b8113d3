"""The moments that a loss needs, the plain way: pictures of attributes, summed up by NumPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.photo import GREY_WEIGHTS
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
    colours, normals = (np.moveaxis(a, -1, 0) for a in (image.reflectance, image.normals))
    colours = colours.astype(float)
    grey = np.tensordot(GREY_WEIGHTS, colours, 1)
    if photo.colour_reflectance:
        planes = [plane for k in colours for plane in (k, *(k * normals))]
    else:
        planes = [*([grey] if photo.structure is None else colours), *(grey * normals)]
    if not photo.clipped:
        planes.append(image.mask)
    # One attribute after the other in memory: sums over pixels are quicker.
    return np.moveaxis(np.stack(planes, dtype=float), 0, -1)


def moments_of_images(image: AttributeImage, photo: PhotoAttributes) -> Moments:
    """The plain path: pictures of all attributes, then sums over P. The measure for fast paths."""
    weights = photo.weights
    covered = np.flatnonzero(image.mask & (weights > 0.0))
    model = model_attributes(image.at(covered), photo)
    w = weights.ravel()[covered].astype(float)
    planes = (plane.ravel() for plane in photo.planar)
    seen = np.stack([plane[covered] for plane in planes], dtype=float).T
    if photo.structure is not None:
        labels = photo.structure.labels.ravel()[covered]
        memberships = np.eye(len(photo.structure.shares))[labels]
        cosine = _edge_cosine(image, photo.structure.field, weights)
        seen = np.concatenate([seen, memberships], axis=1)
        return _moments_of_classes(w, seen, model, photo.structure, cosine)
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
    """Moments over the whole region, of weights ``w`` (N,), F (N, n) and M (N, m) on the model."""
    n, region = seen.shape[1], photo.photo_sums
    joint = np.concatenate([seen - photo.origin, model], axis=1)
    weighted = w[:, None] * joint
    first, second = w @ joint, weighted.T @ joint
    first[:n], second[:n, :n] = region.first, region.second
    return Moments.from_sums(len(w), region.weight, first, second, photo.origin)


def _moments_of_classes(
    w: FloatArray, seen: FloatArray, model: FloatArray, structure: PhotoStructure, cosine: float
) -> Moments:
    """F is the colours and the memberships in the classes, over the whole region."""
    weighted = w[:, None] * model
    n, m = seen.shape[1], model.shape[1]
    weight = float(structure.shares.sum())
    if weight <= 0.0:
        return Moments(0, 0.0, np.zeros(n + m), np.zeros((n + m, n + m)), n, cosine)
    mean = np.concatenate([structure.first, w @ model]) / weight
    photo_model = seen.T @ weighted
    joint = np.block([[structure.second, photo_model], [photo_model.T, weighted.T @ model]])
    covariance = joint / weight - np.outer(mean, mean)
    return Moments(len(model), weight, mean, covariance, n, cosine)


def _edge_cosine(
    image: AttributeImage, photo_field: NDArray[np.float32], weights: NDArray[np.float32]
) -> float:
    """Of the orientation fields; the model's is 0 but near the model."""
    box = bounding_slices(image.mask, MARGIN_PX)
    grey = image.reflectance[box] @ GREY_WEIGHTS
    shown = np.dstack([grey, image.normals[box], image.mask[box]]).astype(np.float32)
    if not shown.size:
        return 0.0
    return edge_agreement(photo_field[box], weights[box], orientation_field(shown, MODEL_NOISE))
