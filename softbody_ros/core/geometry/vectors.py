# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Vectors (x, y, z) and 3 × 3 matrices for kernels: tuples, and tuples of three rows.

Tuples are values in registers; small arrays would be allocated on the heap each time.
"""

from __future__ import annotations

import math

from softbody_ros.core.compiled import helper

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

ZERO = (0.0, 0.0, 0.0)
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
NO_MATRIX = (ZERO, ZERO, ZERO)


# ---------------------------------------------------------------------------------------- vectors
@helper
def dot(a: Vector, b: Vector) -> float:
    """Return a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@helper
def norm(a: Vector) -> float:
    """Return |a|."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@helper
def scaled(factor: float, a: Vector) -> Vector:
    """Return factor · a."""
    return (factor * a[0], factor * a[1], factor * a[2])


@helper
def plus(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@helper
def minus(a: Vector, b: Vector) -> Vector:
    """Return a − b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@helper
def cross(a: Vector, b: Vector) -> Vector:
    """Return a × b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@helper
def along(a: Vector, factor: float, b: Vector) -> Vector:
    """Return a + factor · b."""
    return (a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2])


@helper
def tangents_of(normal: Vector) -> tuple[Vector, Vector]:
    """Return two tangents, orthonormal with a normal."""
    axis = (1.0, 0.0, 0.0) if abs(normal[0]) < 0.6 else (0.0, 1.0, 0.0)
    one = cross(normal, axis)
    one = scaled(1.0 / norm(one), one)
    return one, cross(normal, one)


# ----------------------------------------------------------------------------------------- arrays
@helper
def vector_of(array):  # type: ignore[no-untyped-def]
    """Return an array (3,) as a vector."""
    return (array[0], array[1], array[2])


@helper
def matrix_of(array):  # type: ignore[no-untyped-def]
    """Return an array (3, 3) as a matrix."""
    return (
        (array[0, 0], array[0, 1], array[0, 2]),
        (array[1, 0], array[1, 1], array[1, 2]),
        (array[2, 0], array[2, 1], array[2, 2]),
    )


@helper
def put_vector(array, a):  # type: ignore[no-untyped-def]
    """Write a vector into an array (3,)."""
    array[0], array[1], array[2] = a[0], a[1], a[2]


@helper
def put_matrix(array, m):  # type: ignore[no-untyped-def]
    """Write a matrix into an array (3, 3)."""
    for row in range(3):
        for column in range(3):
            array[row, column] = m[row][column]


@helper
def column_of(field, i):  # type: ignore[no-untyped-def]
    """Return column i of a field (3, n): the vector of particle i."""
    return (field[0, i], field[1, i], field[2, i])


@helper
def put_column(field, i, a):  # type: ignore[no-untyped-def]
    """Write the vector of particle i into a field (3, n)."""
    field[0, i], field[1, i], field[2, i] = a[0], a[1], a[2]


# --------------------------------------------------------------------------------------- matrices
@helper
def applied(m: Matrix, a: Vector) -> Vector:
    """Return M a."""
    return (dot(m[0], a), dot(m[1], a), dot(m[2], a))


@helper
def applied_transposed(m: Matrix, a: Vector) -> Vector:
    """Return Mᵀ a."""
    return (
        m[0][0] * a[0] + m[1][0] * a[1] + m[2][0] * a[2],
        m[0][1] * a[0] + m[1][1] * a[1] + m[2][1] * a[2],
        m[0][2] * a[0] + m[1][2] * a[1] + m[2][2] * a[2],
    )


@helper
def transposed(m: Matrix) -> Matrix:
    """Return Mᵀ."""
    return (
        (m[0][0], m[1][0], m[2][0]),
        (m[0][1], m[1][1], m[2][1]),
        (m[0][2], m[1][2], m[2][2]),
    )


@helper
def product(a: Matrix, b: Matrix) -> Matrix:
    """Return A B."""
    columns = transposed(b)
    return (applied(columns, a[0]), applied(columns, a[1]), applied(columns, a[2]))


@helper
def times(factor: float, m: Matrix) -> Matrix:
    """Return factor · M."""
    return (scaled(factor, m[0]), scaled(factor, m[1]), scaled(factor, m[2]))


@helper
def added(a: Matrix, b: Matrix) -> Matrix:
    """Return A + B."""
    return (plus(a[0], b[0]), plus(a[1], b[1]), plus(a[2], b[2]))


@helper
def combined(p: float, a: Matrix, q: float, b: Matrix) -> Matrix:
    """Return p A + q B."""
    return (
        plus(scaled(p, a[0]), scaled(q, b[0])),
        plus(scaled(p, a[1]), scaled(q, b[1])),
        plus(scaled(p, a[2]), scaled(q, b[2])),
    )


@helper
def outer(a: Vector, b: Vector) -> Matrix:
    """Return a bᵀ."""
    return (scaled(a[0], b), scaled(a[1], b), scaled(a[2], b))


@helper
def cross_matrix(a: Vector) -> Matrix:
    """Return the matrix a ×."""
    return ((0.0, -a[2], a[1]), (a[2], 0.0, -a[0]), (-a[1], a[0], 0.0))


@helper
def cofactors(m: Matrix) -> Matrix:
    """Return det(M) M⁻ᵀ."""
    return (cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1]))


@helper
def determinant(m: Matrix) -> float:
    """Return det M."""
    return dot(m[0], cross(m[1], m[2]))


@helper
def inverse(m: Matrix) -> Matrix:
    """Return M⁻¹ of a regular matrix."""
    cofactor = cofactors(m)
    return times(1.0 / dot(m[0], cofactor[0]), transposed(cofactor))


@helper
def square(m: Matrix) -> float:
    """Return the squared Frobenius norm, |M|²."""
    return dot(m[0], m[0]) + dot(m[1], m[1]) + dot(m[2], m[2])


@helper
def axial(m: Matrix) -> Vector:
    """Return the axial vector Σ a × b of a matrix Σ a bᵀ."""
    return (m[1][2] - m[2][1], m[2][0] - m[0][2], m[0][1] - m[1][0])
