# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Shape matching: moments → fit, volume and blend → goal transform.

Müller, Heidelberger, Teschner, Gross: Meshless Deformations Based on Shape Matching,
SIGGRAPH 2005. A transform is an array (F, 3): the image of each feature, F = 3 for linear and 9
for quadratic goals, dimensionless; a goal is centre + scale · Σ_f transform_f · feature_f.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.vectors import (
    NO_MATRIX,
    ZERO,
    Matrix,
    Vector,
    added,
    cross,
    determinant,
    outer,
    plus,
    square,
    vector_of,
)

LINEAR = 3
LEAST_CONDITIONING = 0.3, 0.15
"""2 det A / |A|² of flat states: degeneracy begins at the first value, and is 1 at the second."""
LARGEST_STRETCH = 4.0, 6.0
"""The same for |A|, which is √3 for a rest shape."""
LARGEST_BEND = 0.7, 1.2
"""The same for the norm of the quadratic block: beyond it surfaces invert. Coefficients of what a
shape barely spans, as nearly a ball does x² + y² + z², are large, but bend nothing: if less, it is
the RMS of the gradient of its displacements along the surface."""
LEAST_VOLUME, LARGEST_VOLUME = (0.4, 0.25), (2.5, 4.0)
"""The same for the relative volume."""
VOLUME_STEPS = 2
"""Newton steps, each of which squares the error of the volume."""
LEAST_SLOPE = 1e-3
"""Squared volume gradient below which it gives no direction."""


# --------------------------------------------------------------------------------------- features
@helper
def squares(q: Vector) -> Vector:
    """Return the features 3 … 5 of a point q, without their means."""
    return (q[0] * q[0], q[1] * q[1], q[2] * q[2])


@helper
def mixed_products(q: Vector) -> Vector:
    """Return the features 6 … 8 of a point q, without their means."""
    return (q[0] * q[1], q[1] * q[2], q[2] * q[0])


# ------------------------------------------------------------------------------------- transforms
@helper
def copy(source: np.ndarray, target: np.ndarray) -> None:
    """Copy a transform; assignments of slices take seconds to compile."""
    for f in range(len(source)):
        for axis in range(3):
            target[f, axis] = source[f, axis]


@helper
def fill(target: np.ndarray, value: float) -> None:
    """Fill a transform."""
    for f in range(len(target)):
        for axis in range(3):
            target[f, axis] = value


@helper
def linear_block(transform: np.ndarray) -> Matrix:
    """Return the linear block of a transform as a matrix."""
    t = transform
    return (
        (t[0, 0], t[1, 0], t[2, 0]),
        (t[0, 1], t[1, 1], t[2, 1]),
        (t[0, 2], t[1, 2], t[2, 2]),
    )


@helper
def scalar_product(a: np.ndarray, b: np.ndarray) -> float:
    """Return Σ a_f · b_f of two transforms."""
    total = 0.0
    for f in range(len(a)):
        total += a[f, 0] * b[f, 0] + a[f, 1] * b[f, 1] + a[f, 2] * b[f, 2]
    return total


@helper
def multiply(matrix: np.ndarray, transform: np.ndarray, result: np.ndarray) -> None:
    """Write the product of a symmetric matrix (F, F) with a transform."""
    for f in range(len(transform)):
        x = y = z = 0.0
        for g in range(len(transform)):
            x += matrix[f, g] * transform[g, 0]
            y += matrix[f, g] * transform[g, 1]
            z += matrix[f, g] * transform[g, 2]
        result[f, 0], result[f, 1], result[f, 2] = x, y, z


@helper
def multiply_gram(shape: np.void, transform: np.ndarray, result: np.ndarray) -> None:
    """Write the product of the moments of features, Σ w f fᵀ, with a transform."""
    if len(transform) == LINEAR:
        multiply(shape['gram'][:LINEAR, :LINEAR], transform, result)
    else:
        multiply(shape['gram'], transform, result)


@helper
def multiply_inverse_gram(shape: np.void, moment: np.ndarray, result: np.ndarray) -> None:
    """Write the product of the inverse of these, where they span space, with a moment."""
    if len(moment) == LINEAR:
        multiply(shape['inverse_linear'], moment, result)
    else:
        multiply(shape['inverse_quadratic'], moment, result)


@helper
def summed_outer(a: np.ndarray, b: np.ndarray) -> Matrix:
    """Return Σ_f a_f b_fᵀ of two transforms."""
    total = NO_MATRIX
    for f in range(len(a)):
        total = added(total, outer(vector_of(a[f]), vector_of(b[f])))
    return total


@helper
def summed_cross(a: np.ndarray, b: np.ndarray) -> Vector:
    """Return Σ_f a_f × b_f of two transforms."""
    total = ZERO
    for f in range(len(a)):
        total = plus(total, cross(vector_of(a[f]), vector_of(b[f])))
    return total


@helper
def scale_transform(transform: np.ndarray, factor: float) -> None:
    """Multiply a transform by a number."""
    for f in range(len(transform)):
        for axis in range(3):
            transform[f, axis] *= factor


# -------------------------------------------------------------------------------------------- fit
@helper
def fit(moment: np.ndarray, undeformed: Matrix, shape: np.void, result: np.ndarray) -> None:
    """
    Write the transform that fits the particles best: A, or Ã (eq. 9–12).

    Combinations of features that the shape does not span come from the undeformed goal.

    Parameters
    ----------
    moment : (F, 3) float
        Σ w f (x − centre) / scale; its first three rows are A_pqᵀ (eq. 7)
    undeformed : matrix
        R, or R S_p
    shape : SHAPE
    result : (F, 3) float

    """
    multiply_inverse_gram(shape, moment, result)
    if len(moment) == LINEAR:
        if not shape['spanned_linear']:
            add_unspanned(shape['unspanned_linear'], undeformed, result)
    elif not shape['spanned_quadratic']:
        add_unspanned(shape['unspanned_quadratic'], undeformed, result)


@helper
def add_unspanned(unspanned: np.ndarray, undeformed: Matrix, result: np.ndarray) -> None:
    """Add the undeformed goal of unspanned features to a transform."""
    for f in range(len(result)):
        for axis in range(3):
            row = undeformed[axis]
            result[f, axis] += (
                row[0] * unspanned[0, f] + row[1] * unspanned[1, f] + row[2] * unspanned[2, f]
            )


@helper
def ramp(value: float, start: float, end: float) -> float:
    """Return 0 at the start and 1 at the end, without clipping."""
    return (value - start) * (1.0 / (end - start))


@helper
def mean_square(transform: np.ndarray, gram: np.ndarray) -> float:
    """Return tr(Tᵀ G T), the mean square of T f for G the mean of f fᵀ."""
    total = 0.0
    for i in range(len(transform)):
        for j in range(len(transform)):
            product = transform[i, 0] * transform[j, 0] + transform[i, 1] * transform[j, 1]
            total += gram[i, j] * (product + transform[i, 2] * transform[j, 2])
    return max(total, 0.0)


@helper
def degeneracy_of(
    transform: np.ndarray, elastic: Matrix, volume: float, bend_gram: np.ndarray
) -> float:
    """
    Return the degeneracy of a fit: whether it is inverted, flat, overstretched or folded.

    Parameters
    ----------
    transform : (F, 3) float
        the fit
    elastic : matrix
        its linear block, relative to the permanently deformed shape
    volume : float
        relative volume of the fit
    bend_gram : (6, 6) float
        of the rest shape

    Returns
    -------
    float
        0 for regular states, 1 where the goal must be the rest shape

    """
    size = square(elastic)
    # the least singular value is det / (product of the others) >= 2 det / size
    conditioning = 2.0 * determinant(elastic) / max(size, 1e-300)
    beyond = max(ramp(conditioning, LEAST_CONDITIONING[0], LEAST_CONDITIONING[1]), 0.0)
    beyond = max(beyond, ramp(math.sqrt(size), LARGEST_STRETCH[0], LARGEST_STRETCH[1]))
    beyond = max(beyond, ramp(volume, LEAST_VOLUME[0], LEAST_VOLUME[1]))
    beyond = max(beyond, ramp(volume, LARGEST_VOLUME[0], LARGEST_VOLUME[1]))
    if len(transform) > LINEAR:
        bend = scalar_product(transform[LINEAR:], transform[LINEAR:])
        if bend > LARGEST_BEND[0] * LARGEST_BEND[0]:
            bend = min(bend, mean_square(transform[LINEAR:], bend_gram))
        beyond = max(beyond, ramp(math.sqrt(bend), LARGEST_BEND[0], LARGEST_BEND[1]))
    return min(beyond, 1.0)


# ----------------------------------------------------------------------------------------- volume
@helper
def volume_gradient(transform: np.ndarray, form: np.ndarray, result: np.ndarray) -> None:
    """
    Write the gradient of the relative volume enclosed by the goals with respect to the transform.

    Exact in every mode, at a cost independent of the mesh: the volume of T f is a cubic form in T
    whose coefficients, antisymmetric (F, F, F), are constants of the rest shape. Therefore the
    volume is a third of the product of its gradient with T.
    """
    fill(result, 0.0)
    for i in range(1, len(transform)):
        for j in range(i):
            normal = cross(vector_of(transform[i]), vector_of(transform[j]))
            for k in range(len(transform)):
                result[k, 0] += form[i, j, k] * normal[0]
                result[k, 1] += form[i, j, k] * normal[1]
                result[k, 2] += form[i, j, k] * normal[2]


@helper
def relative_volume(transform: np.ndarray, shape: np.void, gradient: np.ndarray) -> float:
    """Return the volume of goals relative to that at rest, and write its gradient."""
    if len(transform) == LINEAR:
        volume_gradient(transform, shape['volume_linear'], gradient)
    else:
        volume_gradient(transform, shape['volume_quadratic'], gradient)
    return scalar_product(gradient, transform) / 3.0


@helper
def move_to_rest_volume(
    transform: np.ndarray,
    shape: np.void,
    nearest: np.ndarray,
    gradient: np.ndarray,
    direction: np.ndarray,
    rest_volume: float,
) -> float:
    """
    Write the nearest transform of the rest volume, and return the volume before.

    Nearest in the metric of the particles: as for the fit and the rotation, the pull towards such
    a goal is the gradient of half the squared distance, hence conservative. Scaling a goal to its
    volume (like the published A / ∛det A) is not, and feeds energy into oscillations.

    Parameters
    ----------
    transform : (F, 3) float
    shape : SHAPE
    nearest : (F, 3) float
        written: after `VOLUME_STEPS` Newton steps; meaningless for degenerate states
    gradient, direction : (F, 3) float
        scratch
    rest_volume : float
        that the transform is to have, relative to that of the rest shape

    Returns
    -------
    float
        1 for shapes without volume, a sheet or a rod, which are unchanged

    """
    copy(transform, nearest)
    if not shape['has_volume']:
        return 1.0
    before, target = 1.0, cube_root(rest_volume)
    for step in range(VOLUME_STEPS):
        volume = relative_volume(nearest, shape, gradient)
        multiply_inverse_gram(shape, gradient, direction)
        if step == 0:
            before = volume
        slope = max(scalar_product(gradient, direction), LEAST_SLOPE)
        # ∛V is nearly linear, and exactly so for a uniformly scaled goal
        root = cube_root(max(volume, LEAST_VOLUME[1]))
        distance = 3.0 * root * root * (target - root)
        distance += scalar_product(gradient, nearest) - scalar_product(gradient, transform)
        for f in range(len(transform)):
            for axis in range(3):
                nearest[f, axis] = transform[f, axis] + distance / slope * direction[f, axis]
    return before


@helper
def cube_root(value: float) -> float:
    """Return ∛value of a positive number, by operations with the same rounding everywhere."""
    value, exponent = min(value, 1e300), 0
    while value >= 8.0:
        value *= 0.125
        exponent += 1
    while value < 1.0:
        value *= 8.0
        exponent -= 1
    # a line within 4 % for 1 … 8, then Newton's method
    root = 0.9 + 0.145 * value
    for _ in range(6):
        root = (2.0 * root + value / (root * root)) / 3.0
    while exponent > 0:
        root *= 2.0
        exponent -= 1
    while exponent < 0:
        root *= 0.5
        exponent += 1
    return root


# ------------------------------------------------------------------------------------------- goal
@helper
def blend(
    fitted: np.ndarray,
    volume_fit: np.ndarray,
    conservation: float,
    beta: float,
    undeformed: Matrix,
    result: np.ndarray,
) -> None:
    """
    Write β · fit + (1 − β) [R 0 0] (sections 4.2, 4.3), with a share of volume conservation.

    Parameters
    ----------
    fitted, volume_fit : (F, 3) float
        the fit, and the nearest transform of the rest volume
    conservation, beta : float
        volume conservation, deformation β
    undeformed : matrix
        R, or R S_p
    result : (F, 3) float

    """
    for f in range(len(fitted)):
        for axis in range(3):
            deformed = fitted[f, axis] + conservation * (volume_fit[f, axis] - fitted[f, axis])
            result[f, axis] = beta * deformed
    for f in range(LINEAR):
        for axis in range(3):
            result[f, axis] += (1.0 - beta) * undeformed[axis][f]
