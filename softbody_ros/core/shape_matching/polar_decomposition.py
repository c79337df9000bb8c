# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The rotation nearest to A_pq, by its polar decomposition (Müller et al. 2005, section 3.3).

Large stacks go through a closed formula, FOAM:

    Markley: Attitude determination using vector observations: a fast optimal matrix algorithm,
    Journal of the Astronautical Sciences 41(2), 1993, 261–280.

With A = Q S, S symmetric, and singular values σ, the last one negative if det A is, it is

    R = [(κ + |A|²) A + λ cof A − A Aᵀ A] / ζ,
    λ = σ₁ + σ₂ + σ₃,  κ = σ₁σ₂ + σ₂σ₃ + σ₃σ₁,  ζ = κ λ − det A.

Whatever λ is, this is Q times a function of S: an error of λ stretches R, but does not turn it. So
Newton's method need not find λ to the last digit: the step that makes R orthonormal sees to it.
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.shape_matching.rest_shape import LINEAR
from softbody_ros.core.small_matrices import cofactors, entries, expanded, product, stacked

LEAST_STACK = 20
"""Matrices from which on the closed formula is faster than LAPACK: with 100, 3.5 times."""
LAMBDA_STEPS = 2
"""Of Newton's method: an error of 1e-10 is left of λ, which the last step on R squares."""
LEAST_AREA = 0.01
"""|cof A| / |A|² (√(1/3) at most) below which A is near to a line: what it says of the turn about
that line is too little for a formula with squares and cubes in it."""
LARGEST_INVERSION = 0.01
"""−det A |A| / |cof A|² up to which λ is found: flat shapes are inverted by rounding."""
SQUARES = 1e-200, 1e200
"""|A|² between which it can be divided by."""


def rotation(moment: np.ndarray) -> np.ndarray:
    """
    Return the rotation R of the polar decomposition of A_pq, det R = +1 always.

    For an inverted state the direction of the smallest singular value is flipped: that is the
    proper rotation nearest to A_pq.

    Parameters
    ----------
    moment : (…, 3, F) float
        its first three columns are A_pq

    Returns
    -------
    (…, 3, 3) float
        in a stack of at least `LEAST_STACK` the bits of each do not depend on the others

    """
    matrices = moment[..., :LINEAR]
    if matrices.size < LEAST_STACK * LINEAR**2:
        return by_singular_values(matrices)
    result, found = by_formula(matrices)
    if not found.all():
        result[~found] = by_singular_values(matrices[~found])
    return result


def by_singular_values(matrices: np.ndarray) -> np.ndarray:
    """Return the rotations (…, 3, 3) nearest to any finite matrices (…, 3, 3)."""
    u, _, vt = np.linalg.svd(matrices)
    result = u @ vt
    reflected = np.linalg.det(result) < 0.0
    if reflected.any():
        u[reflected, :, 2] *= -1.0
        result = u @ vt
    return result


def by_formula(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the rotations nearest to matrices that are neither nearly lines nor inverted.

    Parameters
    ----------
    matrices : (…, 3, 3) float

    Returns
    -------
    rotation : (…, 3, 3) float
        means nothing, and may not be finite, where none was found
    found : (…) bool

    """
    A = entries(matrices)
    # division by zero and the like only where nothing is found
    with np.errstate(all='ignore'):
        square = _square(A)
        A /= np.sqrt(square)
        cofactor = cofactors(A)
        volume, area_square = expanded(A, cofactor), _square(cofactor)
        area = np.sqrt(area_square)
        found = (area > LEAST_AREA) & (volume > -LARGEST_INVERSION * area_square)
        found &= (square > SQUARES[0]) & (square < SQUARES[1])
        sum_of_values = _sum_of_singular_values(volume, area_square, area)
        kappa = 0.5 * (sum_of_values**2 - 1.0)
        R = (kappa + 1.0) * A + sum_of_values * cofactor - product(_gram(A), A)
        R /= kappa * sum_of_values - volume
        # a step of Newton and Schulz to orthonormal columns
        R = 1.5 * R - 0.5 * product(_gram(R), R)
    return stacked(R, matrices.shape), found.reshape(matrices.shape[:-2])


def _sum_of_singular_values(
    volume: np.ndarray, area_square: np.ndarray, area: np.ndarray
) -> np.ndarray:
    """
    Return λ for |A| = 1 with det A = `volume` and |cof A| = `area`.

    λ² = 1 + 2 κ and κ² = |cof A|² + 2 λ det A: λ is where the composition g of both maps it to
    itself. For det A > 0 g is concave with a slope of 1/9 at most, so that Newton's method comes
    down to λ from above; it begins with the largest κ there can be, √3 |cof A|. (Together the two
    equations are Markley's quartic, of which Newton's method needs twice as many steps.)
    """
    total = np.sqrt(1.0 + 2.0 * np.sqrt(3.0) * area)
    for _ in range(LAMBDA_STEPS):
        kappa = np.sqrt(area_square + 2.0 * volume * total)
        mapped = np.sqrt(1.0 + 2.0 * kappa)
        slope = volume / (mapped * kappa)
        total = total - (total - mapped) / (1.0 - slope)
    return total


def _square(rows: np.ndarray) -> np.ndarray:
    """Return the squared Frobenius norms (N,) of entries (3, 3, N)."""
    return (rows**2).reshape(9, -1).sum(axis=0)


def _gram(rows: np.ndarray) -> np.ndarray:
    """Return M Mᵀ of entries (3, 3, N)."""
    return product(rows, rows.swapaxes(0, 1))
