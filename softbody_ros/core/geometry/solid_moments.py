# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Volume, centre and second moments of what a closed surface encloses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class SolidMoments:
    """
    Moments of the volume that a closed surface encloses.

    Attributes
    ----------
    volume : float
        m³; negative if the surface is inside out
    centre : (3,) float
        m
    second : (3, 3) float
        mean of p pᵀ at offsets p from the centre, m²

    """

    volume: float
    centre: np.ndarray
    second: np.ndarray


def solid_moments(vertices: np.ndarray, faces: np.ndarray) -> SolidMoments:
    """
    Return the moments of a polyhedron, exact but for rounding.

    By tetrahedra from the mean vertex o to each face a b c (D. Eberly, Polyhedral Mass Properties,
    2002): with V = det(a b c) / 6 and s = a + b + c, ∫ p = V s / 4 and
    ∫ p pᵀ = V (s sᵀ + a aᵀ + b bᵀ + c cᵀ) / 20. Sums are pairwise, in a fixed order.

    Parameters
    ----------
    vertices : (n, 3) float
        m
    faces : (m, 3) int
        of a closed surface, anticlockwise seen from outside

    """
    origin = np.array([axis.mean() for axis in np.ascontiguousarray(vertices.T)])
    corners = np.ascontiguousarray((vertices - origin).T)[:, faces.T]  # (axis, corner, face)
    a, b, c = (corners[:, corner] for corner in range(3))
    share = (np.cross(a, b, axis=0) * c).sum(axis=0) / 6.0
    volume = float(share.sum())
    if volume == 0.0:
        return SolidMoments(0.0, origin, np.zeros((3, 3)))
    total = a + b + c
    mean = np.array([(share * axis).sum() for axis in total]) / (4.0 * volume)
    second = np.empty((3, 3))
    for i in range(3):
        for j in range(i, 3):
            products = total[i] * total[j] + (corners[i] * corners[j]).sum(axis=0)
            second[i, j] = second[j, i] = (share * products).sum() / (20.0 * volume)
    return SolidMoments(volume, origin + mean, second - np.outer(mean, mean))
