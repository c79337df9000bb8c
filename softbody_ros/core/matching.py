# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Shape matching: moments → rotation and fit → goal transform.

Müller, Heidelberger, Teschner, Gross: Meshless Deformations Based on Shape Matching,
SIGGRAPH 2005. All functions work on a stack of B bodies that share one rest shape; transforms are
(B, 3, F) and dimensionless, F = 3 features for linear and 9 for quadratic goals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softbody_ros.core.rest_shape import LINEAR, QUADRATIC, RestShape

LEAST_STRETCH, LARGEST_STRETCH = 0.2, 5.0
"""The goal follows a stretch only this far, so a flattened or inverted body finds its way back."""
LARGEST_BEND = 1.0
"""Norm of the quadratic block up to which the goal follows; beyond it surfaces turn inside out."""
LEAST_VOLUME = 0.05
"""Goals of less relative volume are not inflated to the full one at once."""


@dataclass(frozen=True)
class Match:
    """
    Where the goals of B bodies are.

    Attributes
    ----------
    centre : (B, 3) float
        centre of mass, m
    transforms : (2, B, 3, F) float
        goal = centre + scale · transform @ features: for positions, and for velocities

    """

    centre: np.ndarray
    transforms: np.ndarray


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
    sums = np.matmul(x, rest.weighted_features[: 1 + features].T).astype(np.float64, copy=False)
    return sums[..., 0], sums[..., 1:] / rest.scale


def rotation(moment: np.ndarray) -> np.ndarray:
    """
    Return the rotation R of the polar decomposition of A_pq, det R = +1 always.

    For an inverted state the direction of the smallest singular value is flipped: that is the
    proper rotation nearest to A_pq.

    Parameters
    ----------
    moment : (B, 3, F) float
        its first three columns are A_pq

    Returns
    -------
    (B, 3, 3) float

    """
    u, _, vt = np.linalg.svd(moment[..., :LINEAR])
    u[..., 2] *= np.linalg.det(u @ vt)[..., None]
    return u @ vt


def fit(moment: np.ndarray, rotations: np.ndarray, rest: RestShape) -> np.ndarray:
    """
    Return the transform of F features that comes nearest to the particles: A, or Ã (eq. 9–12).

    Combinations of features that the shape does not span are taken from the rotation, and the
    stretches of the linear block are clamped.

    Parameters
    ----------
    moment : (B, 3, F) float
    rotations : (B, 3, 3) float
    rest : RestShape

    Returns
    -------
    (B, 3, F) float

    """
    if moment.shape[-1] == LINEAR:
        inverse, unspanned = rest.inverse_linear, rest.unspanned_linear
    else:
        inverse, unspanned = rest.inverse_quadratic, rest.unspanned_quadratic
    transform = moment @ inverse + rotations @ unspanned[:LINEAR]
    _clamp_stretch(transform)
    _clamp_bend(transform)
    return transform


def _clamp_stretch(transform: np.ndarray) -> None:
    """Bring the singular values of the linear block into range, in place; inverted ones too."""
    block = transform[..., :LINEAR]
    square = np.einsum('bij,bij->b', block, block)
    # least singular value >= det / (product of the others) >= 2 det / square
    with np.errstate(divide='ignore', invalid='ignore'):
        suspect = ~(2.0 * np.linalg.det(block) > LEAST_STRETCH * square)
    suspect |= square > LARGEST_STRETCH**2
    if not suspect.any():
        return
    u, stretch, vt = np.linalg.svd(block[suspect])
    sign = np.linalg.det(u @ vt)
    u[..., 2] *= sign[:, None]
    stretch[..., 2] *= sign
    stretch = np.clip(stretch, LEAST_STRETCH, LARGEST_STRETCH)
    block[suspect] = (u * stretch[:, None, :]) @ vt


def _clamp_bend(transform: np.ndarray) -> None:
    """Shrink quadratic blocks to their largest norm, in place."""
    block = transform[..., LINEAR:]
    norm = np.sqrt(np.einsum('bij,bij->b', block, block))
    block *= (LARGEST_BEND / np.maximum(norm, LARGEST_BEND))[:, None, None]


def blended(fits: np.ndarray, rotations: np.ndarray, deformation: np.ndarray) -> np.ndarray:
    """
    Return β · fit + (1 − β) [R 0 0] (Müller et al. 2005, sections 4.2 and 4.3).

    Parameters
    ----------
    fits : (B, 3, F) float
    rotations : (B, 3, 3) float
    deformation : (…, B) float
        β

    Returns
    -------
    (…, B, 3, F) float

    """
    beta = deformation[..., None, None]
    transform = beta * fits
    transform[..., :LINEAR] += (1.0 - beta) * rotations
    return transform


def relative_volume(transform: np.ndarray, rest: RestShape) -> np.ndarray:
    """
    Return the volume that the goals enclose, as a multiple of the rest volume.

    Exact in every mode, at a cost that does not depend on the mesh: the volume of T f is a cubic
    form in T whose coefficients are constants of the rest shape.

    Parameters
    ----------
    transform : (…, 3, F) float
    rest : RestShape

    Returns
    -------
    (…) float

    """
    count = transform.shape[-1]
    form = rest.volume_form[:count, :count, :count].reshape(count, -1)
    first, second, third = (transform[..., row, :] for row in range(3))
    by_first = (first @ form).reshape(*first.shape, count)
    by_second = np.matmul(second[..., None, :], by_first)
    return np.matmul(by_second, third[..., None])[..., 0, 0]


def with_volume(transform: np.ndarray, rest: RestShape, conservation: np.ndarray) -> np.ndarray:
    """
    Return the transforms scaled about their centres towards the rest volume.

    Parameters
    ----------
    transform : (…, 3, F) float
    rest : RestShape
    conservation : (…) float
        0 leaves the volume as it is, 1 restores it fully

    Returns
    -------
    (…, 3, F) float

    """
    volume = np.maximum(relative_volume(transform, rest), LEAST_VOLUME)
    factor = 1.0 + conservation * (np.cbrt(1.0 / volume) - 1.0)
    return factor[..., None, None] * transform


def goals(centre: np.ndarray, transform: np.ndarray, rest: RestShape) -> np.ndarray:
    """
    Return the goal positions: transform @ features about the centres.

    Parameters
    ----------
    centre : (B, 3) float
        m
    transform : (…, B, 3, F) float
    rest : RestShape

    Returns
    -------
    (…, B, 3, n) float
        m

    """
    affine = np.empty((*transform.shape[:-1], 1 + transform.shape[-1]), rest.features.dtype)
    affine[..., 0] = centre
    affine[..., 1:] = rest.scale * transform
    return np.matmul(affine, rest.features[: affine.shape[-1]])


def padded(transform: np.ndarray) -> np.ndarray:
    """Return a linear transform (B, 3, 3) as one of all nine features."""
    wide = np.zeros((*transform.shape[:-1], QUADRATIC))
    wide[..., : transform.shape[-1]] = transform
    return wide
