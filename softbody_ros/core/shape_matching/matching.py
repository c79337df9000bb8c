# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Shape matching: moments → rotation and fit → goal transform.

Müller, Heidelberger, Teschner, Gross: Meshless Deformations Based on Shape Matching,
SIGGRAPH 2005. All functions work on a stack of B bodies that share one rest shape; transforms are
(B, 3, F) and dimensionless, F = 3 features for linear and 9 for quadratic goals.
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.shape_matching.rest_shape import LINEAR, QUADRATIC, RestShape
from softbody_ros.core.sums import blocks, mapped, sums

LEAST_ROUNDNESS = 0.3, 0.15
"""2 det A / |A|² at which a body begins to be too flat for a goal to follow, and where it is."""
LARGEST_STRETCH = 4.0, 6.0
"""The same for |A|, where a rest shape has √3."""
LARGEST_BEND = 0.7, 1.2
"""The same for the norm of the quadratic block: beyond it surfaces turn inside out."""
LEAST_VOLUME, LARGEST_VOLUME = (0.4, 0.25), (2.5, 4.0)
"""The same for the relative volume."""
VOLUME_STEPS = 2
"""Each squares the error of the volume."""
LEAST_SLOPE = 1e-3
"""Squared volume gradient below which a volume does not tell where to go."""
PREVIOUS, FOLLOWING = np.array([2, 0, 1]), np.array([1, 2, 0])
"""Rows in a cycle."""


def moments(x: np.ndarray, rest: RestShape, features: int) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the centres of mass and the moments of the offsets with the features.

    Parameters
    ----------
    x : (B, 3, n) float
        positions, m
    rest : RestShape
    features : int
        3 or 9

    Returns
    -------
    centre : (B, 3) float
        Σ w x, m
    moment : (B, 3, features) float
        Σ w (x − centre) fᵀ / scale; its first three columns are A_pq (eq. 7)

    """
    total = sums(x, rest.weighted_features[: 1 + features])
    return total[..., 0], total[..., 1:] / rest.scale


def fit(moment: np.ndarray, undeformed: np.ndarray, rest: RestShape) -> np.ndarray:
    """
    Return the transform of F features that comes nearest to the particles: A, or Ã (eq. 9–12).

    Combinations of features that the shape does not span are taken from the undeformed goal.

    Parameters
    ----------
    moment : (B, 3, F) float
    undeformed : (B, 3, 3) float
        the rotation R
    rest : RestShape

    Returns
    -------
    (B, 3, F) float

    """
    if moment.shape[-1] == LINEAR:
        inverse, unspanned = rest.inverse_linear, rest.unspanned_linear
    else:
        inverse, unspanned = rest.inverse_quadratic, rest.unspanned_quadratic
    spanned = moment @ inverse
    return spanned if unspanned is None else spanned + undeformed @ unspanned[:LINEAR]


def strayed(fits: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """
    Return how far bodies are beyond what a goal can follow: inverted, flat, huge, crumpled.

    Parameters
    ----------
    fits : (B, 3, F) float
    volume : (B,) float
        relative volumes of the fits

    Returns
    -------
    (B,) float
        0 within, 1 where only the rest shape can be the goal

    """
    block = fits[..., :LINEAR]
    square = _product(block, block)
    # the least stretch is at least det / (product of the others) >= 2 det / square
    roundness = 2.0 * np.linalg.det(block) / np.maximum(square, 1e-300)
    beyond = np.maximum(_ramp(roundness, LEAST_ROUNDNESS), 0.0)
    beyond = np.maximum(beyond, _ramp(np.sqrt(square), LARGEST_STRETCH))
    beyond = np.maximum(beyond, _ramp(volume, LEAST_VOLUME))
    beyond = np.maximum(beyond, _ramp(volume, LARGEST_VOLUME))
    if fits.shape[-1] > LINEAR:
        bend = fits[..., LINEAR:]
        norm = np.sqrt(_product(bend, bend))
        beyond = np.maximum(beyond, _ramp(norm, LARGEST_BEND))
    return np.minimum(beyond, 1.0)


def _ramp(value: np.ndarray, limits: tuple[float, float]) -> np.ndarray:
    """Return 0 at the first limit and 1 at the second, without clipping."""
    start, end = limits
    return (value - start) * (1.0 / (end - start))


def blended(fits: np.ndarray, undeformed: np.ndarray, deformation: np.ndarray) -> np.ndarray:
    """
    Return β · fit + (1 − β) [R 0 0] (Müller et al. 2005, sections 4.2 and 4.3).

    Parameters
    ----------
    fits : (…, B, 3, F) float
    undeformed : (B, 3, 3) float
        R
    deformation : (…, B) float
        β

    Returns
    -------
    (…, B, 3, F) float

    """
    beta = deformation[..., None, None]
    transform = beta * fits
    transform[..., :LINEAR] += (1.0 - beta) * undeformed
    return transform


def volume_gradient(transform: np.ndarray, rest: RestShape) -> np.ndarray:
    """
    Return the derivative of the relative volume that the goals enclose, by the transform.

    Exact in every mode, at a cost that does not depend on the mesh: the volume of T f is a cubic
    form in T whose coefficients are constants of the rest shape. Being cubic, the volume is a
    third of the product of its gradient with T.

    Parameters
    ----------
    transform : (B, 3, F) float
    rest : RestShape

    Returns
    -------
    (B, 3, F) float

    """
    count = transform.shape[-1]
    # the form is antisymmetric: it stays as it is when the three rows change places in a cycle
    previous, following = transform.take(PREVIOUS, axis=1), transform.take(FOLLOWING, axis=1)
    by_previous = previous @ rest.volume_forms[count]
    return np.matmul(by_previous.reshape(*transform.shape, count), following[..., None])[..., 0]


def relative_volume(transform: np.ndarray, rest: RestShape) -> np.ndarray:
    """Return the volumes (B,) that goals enclose, as multiples of the rest volume."""
    return _product(volume_gradient(transform, rest), transform) / 3.0


def of_rest_volume(transform: np.ndarray, rest: RestShape) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the transforms of relative volume 1 that are nearest, and the volumes before.

    Nearest for the particles: like the fit and the rotation, such a goal pulls with the gradient
    of half the squared distance, so that the pull has a potential. Scaling a goal to its volume
    (the published A / ∛det A is of that kind) has none, and pumps energy into oscillations.

    Parameters
    ----------
    transform : (B, 3, F) float
    rest : RestShape

    Returns
    -------
    nearest : (B, 3, F) float
        exact to the square of the error of the volume for each of `VOLUME_STEPS`; means nothing
        for bodies that have strayed
    volume : (B,) float
        1 for shapes that cannot have any, a sheet or a rod: they stay as they are

    """
    if not rest.has_volume:
        return transform, np.ones(len(transform))
    inverse = rest.inverse_linear if transform.shape[-1] == LINEAR else rest.inverse_quadratic
    nearest, volumes = transform, []
    for _ in range(VOLUME_STEPS):
        gradient = volume_gradient(nearest, rest)
        volume = _product(gradient, nearest) / 3.0
        volumes.append(volume)
        direction = gradient @ inverse
        slope = np.maximum(_product(gradient, direction), LEAST_SLOPE)
        # ∛V − 1 is nearly linear, and linear for a goal that is only too large or too small
        root = np.cbrt(np.maximum(volume, LEAST_VOLUME[1]))
        way = 3.0 * root**2 * (1.0 - root) + _product(gradient, nearest - transform)
        nearest = transform + (way / slope)[:, None, None] * direction
    return nearest, volumes[0]


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the scalar products (B,) of transforms (B, 3, F)."""
    return np.add.reduce((a * b).reshape(len(a), -1), axis=1)


def affine(centre: np.ndarray, transform: np.ndarray, rest: RestShape) -> np.ndarray:
    """
    Return the coefficients of the one and the features in goals: centre, scale · transform.

    Parameters
    ----------
    centre : (B, 3) float
        m
    transform : (…, B, 3, F) float
    rest : RestShape

    Returns
    -------
    (…, B, 3, 1 + F) float
        m

    """
    result = np.empty((*transform.shape[:-1], 1 + transform.shape[-1]))
    result[..., 0] = centre
    result[..., 1:] = rest.scale * transform
    return result


def goals(centre: np.ndarray, transform: np.ndarray, rest: RestShape) -> np.ndarray:
    """Return the goal positions (…, B, 3, n), m, of a transform, see `affine`."""
    coefficients = affine(centre, transform, rest).astype(rest.features.dtype, copy=False)
    return mapped(coefficients, rest.features[: coefficients.shape[-1]])


def distances(
    x: np.ndarray, centre: np.ndarray, transform: np.ndarray, rest: RestShape
) -> np.ndarray:
    """Return how far particles at x (B, 3, n) are from `goals`, (B, n), m, block by block."""
    coefficients = affine(centre, transform, rest).astype(x.dtype, copy=False)
    result = np.empty((len(x), x.shape[2]), x.dtype)
    for part in blocks(x.shape[2]):
        apart = mapped(coefficients, rest.features[: coefficients.shape[-1], part])
        apart -= x[..., part]
        apart *= apart
        np.sqrt(np.add.reduce(apart, axis=1), out=result[:, part])
    return result


def padded(transform: np.ndarray) -> np.ndarray:
    """Return a linear transform (B, 3, 3) as one of all nine features."""
    wide = np.zeros((*transform.shape[:-1], QUADRATIC))
    wide[..., : transform.shape[-1]] = transform
    return wide
