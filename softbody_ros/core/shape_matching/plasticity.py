# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Plastic flow: permanent deformation of the rest shape beyond its yield strain.

Müller, Heidelberger, Teschner, Gross 2005, section 4.5. The plastic state is a symmetric stretch
S_p of determinant 1 for each match, by which the rest shape is multiplied before it is rotated.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.vectors import Matrix, determinant, inverse, norm, product
from softbody_ros.core.shape_matching.polar_decomposition import (
    orthogonal_columns,
    rotation_of,
    symmetric_of,
)

LEAST_GROWTH, LARGEST_GROWTH = 0.8, 1.2
"""Bounds of the stretch that becomes permanent in one tick."""


@helper
def undeformed_of(moment: Matrix, stretch: Matrix, is_plastic: bool) -> Matrix:
    """
    Return the linear transform of the goal without elastic deformation: R, or R S_p.

    Parameters
    ----------
    moment : matrix
        A_pq
    stretch : matrix
        S_p, symmetric
    is_plastic : bool
        whether S_p may differ from the identity

    """
    if is_plastic:
        return product(rotation_of(product(moment, stretch)), stretch)
    return rotation_of(moment)


@helper
def elastic_of(fit: Matrix, stretch: Matrix, is_plastic: bool) -> Matrix:
    """Return a fit relative to the permanently deformed shape: A S_p⁻¹."""
    return product(fit, inverse(stretch)) if is_plastic else fit


@helper
def flowed(
    stretch: Matrix,
    elastic: Matrix,
    yield_strain: float,
    creep: float,
    largest_strain: float,
) -> tuple[bool, Matrix]:
    """
    Return whether a shape flows, and S_p after the tick: [I + c (S − I)] S_p without rotation.

    The strain S − I is symmetric: S is of the polar decomposition of the elastic fit, not of A_pq.
    An inverted shape does not flow.

    Parameters
    ----------
    stretch : matrix
        S_p
    elastic : matrix
        the elastic fit
    yield_strain, creep, largest_strain : float
        strain below which nothing flows, share of the strain that becomes permanent in this tick,
        and largest permanent strain

    """
    columns, axes = orthogonal_columns(elastic)
    sizes = (norm(columns[0]), norm(columns[1]), norm(columns[2]))
    strain = max(max(abs(sizes[0] - 1.0), abs(sizes[1] - 1.0)), abs(sizes[2] - 1.0))
    if not (strain > yield_strain and creep > 0.0 and determinant(elastic) > 0.0):
        return False, stretch
    growth = (
        bounded_growth(sizes[0], creep),
        bounded_growth(sizes[1], creep),
        bounded_growth(sizes[2], creep),
    )
    columns, axes = orthogonal_columns(product(symmetric_of(growth, axes), stretch))
    # in logarithms the constraint on the volume and the limit are independent
    a, b, c = math.log(norm(columns[0])), math.log(norm(columns[1])), math.log(norm(columns[2]))
    mean = (a + b + c) / 3.0
    a, b, c = a - mean, b - mean, c - mean
    if not largest_strain > 0.0:
        return True, symmetric_of((1.0, 1.0, 1.0), axes)
    beyond = max(beyond_limit(a, largest_strain), beyond_limit(b, largest_strain))
    beyond = max(max(beyond, beyond_limit(c, largest_strain)), 1.0)
    sizes = (math.exp(a / beyond), math.exp(b / beyond), math.exp(c / beyond))
    return True, symmetric_of(sizes, axes)


@helper
def bounded_growth(size: float, creep: float) -> float:
    """Return the share of a stretch that becomes permanent in this tick, as a stretch."""
    return min(max(1.0 + creep * (size - 1.0), LEAST_GROWTH), LARGEST_GROWTH)


@helper
def beyond_limit(logarithm: float, largest_strain: float) -> float:
    """Return the logarithm of a stretch as a multiple of its limit in that direction."""
    return logarithm / math.log1p(largest_strain if logarithm > 0.0 else -largest_strain)


def permanent_strains(stretch: np.ndarray) -> np.ndarray:
    """Return the largest |σ − 1| of each of some plastic states (…, 3, 3)."""
    return np.abs(np.linalg.eigvalsh(stretch) - 1.0).max(axis=-1)


def largest_permanent_strain(stretch: np.ndarray) -> float:
    """Return the largest permanent strain |σ − 1| among plastic states (…, 3, 3)."""
    return float(permanent_strains(stretch).max())
