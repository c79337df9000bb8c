# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The rotation nearest to A_pq, by its polar decomposition (Müller et al. 2005, section 3.3).

By a closed formula, FOAM, wherever A is well conditioned:

    Markley: Attitude determination using vector observations: a fast optimal matrix algorithm,
    Journal of the Astronautical Sciences 41(2), 1993, 261–280.

With A = Q S, S symmetric, and singular values σ, the last one negative if det A is, it is

    R = [(κ + |A|²) A + λ cof A − A Aᵀ A] / ζ,
    λ = σ₁ + σ₂ + σ₃,  κ = σ₁σ₂ + σ₂σ₃ + σ₃σ₁,  ζ = κ λ − det A.

Whatever λ is, this is Q times a function of S: an error of λ stretches R, but does not rotate it.
So Newton's method need not find λ to full precision: a final step makes R orthonormal. Lines,
points and inverted states use a one-sided Jacobi singular value decomposition.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.geometry.vectors import (
    IDENTITY,
    NO_MATRIX,
    Matrix,
    Vector,
    added,
    cofactors,
    combined,
    cross,
    cross_matrix,
    dot,
    matrix_of,
    minus,
    norm,
    outer,
    plus,
    product,
    put_matrix,
    scaled,
    square,
    times,
    transposed,
)

LAMBDA_STEPS = 2
"""Newton steps for λ: they leave an error of 1e-10, which the last step on R squares."""
LEAST_AREA = 0.01
"""|cof A| / |A|² (√(1/3) at most) below which A is nearly of rank 1: the rotation about that
line is too ill-conditioned for a formula with squares and cubes."""
LARGEST_INVERSION = 0.01
"""−det A |A| / |cof A|² up to which the formula is used: rounding inverts flat shapes."""
LEAST_SQUARE, LARGEST_SQUARE = 1e-200, 1e200
"""Range of |A|² by which it is safe to divide."""
LEAST_ENTRY = 1e-290
"""Largest entry below which its reciprocal may be no finite number."""
JACOBI_SWEEPS = 12
ORTHOGONAL = 1e-15
"""Cosine of columns that count as orthogonal."""
ON_A_LINE = 1e-14
"""Second singular value, relative to the first, up to which it is rounding."""
LEAST_DETERMINANT = 1e-4
"""Of a symmetric matrix of trace 1, (1/3)³ at most: below it eigenvalues are computed."""


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

    """
    matrices = np.ascontiguousarray(moment[..., :3], dtype=np.float64)
    result = np.empty_like(matrices)
    rotate_all(matrices.reshape(-1, 3, 3), result.reshape(-1, 3, 3))
    return result


@kernel
def rotate_all(matrices: np.ndarray, result: np.ndarray) -> None:
    """Write the rotations (k, 3, 3) nearest to matrices (k, 3, 3)."""
    for index in range(len(matrices)):
        put_matrix(result[index], rotation_of(matrix_of(matrices[index])))


@helper
def rotation_of(m: Matrix) -> Matrix:
    """Return the proper rotation nearest to a matrix: by the formula, else by singular values."""
    size = square(m)
    if not LEAST_SQUARE < size < LARGEST_SQUARE:
        return rotation_by_singular_values(m)
    a = times(1.0 / math.sqrt(size), m)
    cofactor = cofactors(a)
    volume, area_square = dot(a[0], cofactor[0]), square(cofactor)
    area = math.sqrt(area_square)
    if not (area > LEAST_AREA and volume > -LARGEST_INVERSION * area_square):
        return rotation_by_singular_values(m)
    total = sum_of_singular_values(volume, area_square, area)
    kappa = 0.5 * (total * total - 1.0)
    zeta = kappa * total - volume
    r = combined((kappa + 1.0) / zeta, a, total / zeta, cofactor)
    r = combined(1.0, r, -1.0 / zeta, product(product(a, transposed(a)), a))
    # a step of Newton and Schulz to orthonormal columns
    return combined(1.5, r, -0.5, product(product(r, transposed(r)), r))


@helper
def sum_of_singular_values(volume: float, area_square: float, area: float) -> float:
    """
    Return λ for |A| = 1 with det A = `volume` and |cof A| = `area`.

    λ² = 1 + 2 κ and κ² = |cof A|² + 2 λ det A: λ is the fixed point of the composition g of both.
    For det A > 0 g is concave with a slope of at most 1/9, so that Newton's method converges from
    above; it starts at the largest possible κ, √3 |cof A|. (Combined, the two equations are
    Markley's quartic, for which Newton's method needs twice as many steps.)
    """
    total = math.sqrt(1.0 + 2.0 * math.sqrt(3.0) * area)
    for _ in range(LAMBDA_STEPS):
        kappa = math.sqrt(area_square + 2.0 * volume * total)
        mapped = math.sqrt(1.0 + 2.0 * kappa)
        total -= (total - mapped) / (1.0 - volume / (mapped * kappa))
    return total


# ------------------------------------------------------------------------------- singular values
@helper
def rotated_pair(columns: Matrix, i: int, j: int, cosine: float, sine: float) -> Matrix:
    """Return three vectors of which i and j, i < j, are rotated into each other."""
    a, b = columns[i], columns[j]
    one = minus(scaled(cosine, a), scaled(sine, b))
    two = plus(scaled(sine, a), scaled(cosine, b))
    if i == 1:
        return (columns[0], one, two)
    if j == 1:
        return (one, two, columns[2])
    return (one, columns[1], two)


@helper
def orthogonal_columns(m: Matrix) -> tuple[Matrix, Matrix]:
    """
    Return the columns of M V, which are orthogonal, and those of the rotation V.

    The lengths of the columns are the singular values (one-sided Jacobi method: Hestenes, Journal
    of SIAM 6(1), 1958). Squares of the entries must be finite numbers.
    """
    columns, v = transposed(m), IDENTITY
    for _ in range(JACOBI_SWEEPS):
        largest = 0.0
        for pair in range(3):
            i, j = (0 if pair < 2 else 1), (1 if pair == 0 else 2)
            a, b = dot(columns[i], columns[i]), dot(columns[j], columns[j])
            c = dot(columns[i], columns[j])
            size = math.sqrt(a) * math.sqrt(b)
            if c == 0.0 or abs(c) <= 0.01 * ORTHOGONAL * size:
                continue
            largest = max(largest, abs(c) / size if size > 0.0 else 0.0)
            zeta = (b - a) / (2.0 * c)
            # beyond it the square overflows, and the rotation is negligible
            tangent = 0.5 / zeta if abs(zeta) > 1e150 else 0.0
            if abs(zeta) <= 1e150:
                root = abs(zeta) + math.sqrt(1.0 + zeta * zeta)
                tangent = math.copysign(1.0, zeta) / root
            cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
            columns = rotated_pair(columns, i, j, cosine, cosine * tangent)
            v = rotated_pair(v, i, j, cosine, cosine * tangent)
        if largest < ORTHOGONAL:
            break
    return columns, v


@helper
def largest_entry(m: Matrix) -> float:
    """Return max |Mᵢⱼ|."""
    result = 0.0
    for row in range(3):
        for column in range(3):
            result = max(result, abs(m[row][column]))
    return result


@helper
def rotation_by_singular_values(m: Matrix) -> Matrix:
    """
    Return the proper rotation nearest to any finite matrix.

    The direction of the smallest singular value is the cross product of the other two: so
    det R = +1 whatever the rank and the sign of det M. A line is not rotated about itself.
    """
    largest = largest_entry(m)
    if not 0.0 < largest < math.inf:
        return IDENTITY
    if largest < LEAST_ENTRY:
        m = times(1.0 / LEAST_ENTRY, m)
        largest = largest_entry(m)
    columns, v = orthogonal_columns(times(1.0 / largest, m))
    weakest = 0
    for k in range(1, 3):
        if dot(columns[k], columns[k]) < dot(columns[weakest], columns[weakest]):
            weakest = k
    i, j = (weakest + 1) % 3, (weakest + 2) % 3
    if dot(columns[j], columns[j]) > dot(columns[i], columns[i]):
        i, j = j, i
    first = scaled(1.0 / norm(columns[i]), columns[i])
    second = minus(columns[j], scaled(dot(first, columns[j]), first))
    length = norm(second)
    if length < ON_A_LINE * norm(columns[i]):
        return least_rotation(v[i], first)
    second = scaled(1.0 / length, second)
    # again: for nearly parallel columns the difference is inexact
    second = minus(second, scaled(dot(first, second), first))
    second = scaled(1.0 / norm(second), second)
    # R = Σ u vᵀ, the third pair by cross products: proper on both sides
    result = added(outer(first, v[i]), outer(second, v[j]))
    return added(result, outer(cross(first, second), cross(v[i], v[j])))


@helper
def least_rotation(a: Vector, b: Vector) -> Matrix:
    """Return the rotation by the least angle that takes a unit vector to another."""
    middle = plus(a, b)
    if norm(middle) < 1e-12:
        middle = cross(a, (1.0, 0.0, 0.0) if abs(a[0]) < 0.6 else (0.0, 1.0, 0.0))
    middle = scaled(1.0 / norm(middle), middle)
    # two rotations by π, about the first vector and about the middle
    return product(
        combined(2.0, outer(middle, middle), -1.0, IDENTITY),
        combined(2.0, outer(a, a), -1.0, IDENTITY),
    )


@helper
def symmetric_of(sizes: Vector, axes: Matrix) -> Matrix:
    """Return Σ sizeₖ aₖ aₖᵀ of orthonormal axes."""
    result = NO_MATRIX
    for k in range(3):
        result = added(result, times(sizes[k], outer(axes[k], axes[k])))
    return result


@helper
def symmetric_inverse(m: Matrix, cut: float, least: float) -> Matrix:
    """
    Return the pseudo-inverse of a positive semidefinite matrix.

    By the adjugate where no eigenvalue is near zero, by eigenvectors elsewhere.

    Parameters
    ----------
    m : matrix
    cut : float
        eigenvalues up to this fraction of the largest one count as zero; less than
        `LEAST_DETERMINANT`
    least : float
        a largest eigenvalue below it counts as this large; positive

    """
    cofactor = cofactors(m)
    volume = dot(m[0], cofactor[0])
    trace = m[0][0] + m[1][1] + m[2][2]
    if volume > LEAST_DETERMINANT * trace * trace * trace and trace > 3.0 * least:
        return times(1.0 / volume, cofactor)
    largest = largest_entry(m)
    if not 0.0 < largest < math.inf:
        return NO_MATRIX
    columns, v = orthogonal_columns(times(1.0 / largest, m))
    values = (largest * norm(columns[0]), largest * norm(columns[1]), largest * norm(columns[2]))
    limit = cut * max(max(max(values[0], values[1]), values[2]), least)
    result = NO_MATRIX
    for k in range(3):
        if values[k] > limit:
            result = added(result, times(1.0 / values[k], outer(v[k], v[k])))
    return result


@helper
def rotation_by_vector(a: Vector) -> Matrix:
    """Return the rotation about a by |a| radians (Rodrigues' formula)."""
    square_angle = dot(a, a)
    if square_angle < 1e-16:
        s, c = 1.0, 0.5
    else:
        angle = math.sqrt(square_angle)
        half = math.sin(0.5 * angle)
        s, c = math.sin(angle) / angle, 2.0 * half * half / square_angle
    k = cross_matrix(a)
    return added(IDENTITY, combined(s, k, c, product(k, k)))
