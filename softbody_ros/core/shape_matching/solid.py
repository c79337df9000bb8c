# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Solids: mass inside a closed surface, as a few inner particles besides those of the surface.

A ball's shell has the inertia 2/3 m R², the ball itself 2/5 m R²: no masses ≥ 0 at the surface
give the latter. So the surface keeps a share t of the mass, spread by area, and inner particles
have the rest, such that mass, centre of mass and second moments, hence the inertia tensor, are
those of the enclosed volume.

In coordinates y = L⁻¹ (p − c) of the solid, with its centre of mass c and its second moments per
mass S = L Lᵀ, these moments are 1, 0 and the identity. With the mean d and the second moments
B = Σ a y yᵀ of the surface, of shares a of its area, what the inner particles must have is

    mass 1 − t, mean −t d / (1 − t), central moments M = 1 − t B − t² d dᵀ / (1 − t).

t is the largest share at which M has no negative eigenvalue, since particles yield to contacts by
their own masses. The inner particles are at the mean ± r e for each eigenvector e of M with an
eigenvalue λ > 0; all have the same distance r = √(Σ λ / (1 − t)) in these coordinates, the least
one possible, and masses (1 − t) λ / (2 Σ λ). Where M vanishes (a ball, a cube) there is one, at
the centre. For t → 0, r is √3: a bound on r, for bodies with much area and little mass in the
middle, has solutions too.

A thin fin has much area and little mass. No point of a convex body has |y|² > 15 (the corners of a
tetrahedron do; Kannan, Lovász, Simonovits, Discrete Comput. Geom. 13, 1995, theorem 4.1); area
beyond counts by (15 / |y|²)², so that fins do not take the mass from all of the surface.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from softbody_ros.core.geometry.solid_moments import solid_moments
from softbody_ros.core.geometry.surface import MeshError, Surface

FARTHEST = 2.0
"""Bound on r: distance of inner particles from their mean, in RMS extents of the solid."""
CONVEX = 15.0
"""Largest |y|² in a convex body."""
LEAST = 1e-11
"""Eigenvalue of M below which inner particles do not extend that way."""
THINNEST = 1e-9
"""Volume, in cubes of the RMS radius, up to which a surface is a sheet."""
BISECTIONS = 60
SWEEPS = 12
"""Most Jacobi sweeps: they converge quadratically."""


@dataclass(frozen=True, eq=False)
class Inside:
    """
    How the mass of a solid is distributed over its surface and k inner particles.

    Attributes
    ----------
    surface : (n,) float
        share of the mass that each particle of the surface has; they sum to t
    points : (k, 3) float
        inner particles in the body's own frame, m
    weights : (k,) float
        their shares of the mass, 1 − t in all

    """

    surface: np.ndarray
    points: np.ndarray
    weights: np.ndarray


def fill(surface: Surface, shares: np.ndarray, scale: float) -> Inside:
    """
    Return inner particles such that the mass is spread over the enclosed volume.

    Parameters
    ----------
    surface : Surface
    shares : (n,) float
        of the area, that each vertex has; they sum to 1
    scale : float
        RMS radius of the surface, m

    Raises
    ------
    MeshError
        if the surface encloses no volume.

    """
    if not surface.closed:
        raise MeshError(
            'mass_distribution is volume, but the surface is open and encloses none: close it, '
            'or choose surface'
        )
    solid = solid_moments(surface.vertices, surface.faces)
    root = None
    if solid.volume > THINNEST * scale**3:
        root = _cholesky(solid.second / scale**2)
    if root is None:
        raise MeshError(
            'mass_distribution is volume, but the surface is folded or inside out, and encloses '
            'none: repair it, or choose surface'
        )
    offsets = (surface.vertices - solid.centre).T / scale
    y = _solved(root, offsets)
    shares = shares * (CONVEX / np.maximum((y * y).sum(axis=0), CONVEX)) ** 2
    shares /= shares.sum()
    mean = np.array([(shares * axis).sum() for axis in y])
    second = np.empty((3, 3))
    for i in range(3):
        for j in range(i, 3):
            second[i, j] = second[j, i] = (shares * y[i] * y[j]).sum()
    share, values, axes = _largest_share(mean, second)
    rest = 1.0 - share
    # written out, not as products of matrices, whose rounding depends on the processor
    inner, weights = [-share / rest * mean], [rest]
    if values.any():
        total = float(values.sum())
        arms = [math.sqrt(total / rest) * axes[:, k] for k in np.flatnonzero(values)]
        masses = [0.5 * rest * value / total for value in values[values > 0.0]]
        inner = [inner[0] + sign * arm for arm in arms for sign in (1.0, -1.0)]
        weights = [mass for mass in masses for _ in range(2)]
    offset = [[sum(root[i, k] * y[k] for k in range(3)) for i in range(3)] for y in inner]
    return Inside(share * shares, solid.centre + scale * np.array(offset), np.array(weights))


def _largest_share(mean: np.ndarray, second: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """
    Return the share t of the surface, and eigenvalues, ≥ 0, and eigenvectors of M.

    Parameters
    ----------
    mean, second : (3,), (3, 3) float
        d and B

    """
    square = np.outer(mean, mean)

    def left(share: float) -> tuple[np.ndarray, np.ndarray]:
        rest = 1.0 - share
        return _eigen(np.eye(3) - share * second - share * share / rest * square)

    least, most = 0.0, 1.0
    for _ in range(BISECTIONS):
        share = 0.5 * (least + most)
        if share >= 1.0 - LEAST:
            break
        values, _ = left(share)
        if values.min() >= 0.0 and values.sum() <= FARTHEST**2 * (1.0 - share):
            least = share
        else:
            most = share
    values, axes = left(least)
    return least, np.where(values > LEAST, values, 0.0), axes


def _cholesky(matrix: np.ndarray) -> np.ndarray | None:
    """Return the lower triangle L of matrix = L Lᵀ (3, 3), or None if it is not positive."""
    root = np.zeros((3, 3))
    for i in range(3):
        for j in range(i + 1):
            left = float(matrix[i, j]) - sum(float(root[i, k] * root[j, k]) for k in range(j))
            if i > j:
                root[i, j] = left / root[j, j]
            elif left > 0.0:
                root[i, i] = math.sqrt(left)
            else:
                return None
    return root


def _solved(root: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Return y (3, n) with L y = offsets (3, n)."""
    y = np.empty_like(offsets)
    for i in range(3):
        y[i] = (offsets[i] - sum(root[i, k] * y[k] for k in range(i))) / root[i, i]
    return y


def _eigen(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return eigenvalues (3,) and eigenvectors (3, 3), columns, of a symmetric matrix.

    By Jacobi rotations (Golub, Van Loan: Matrix Computations, 8.5): the axes of equal eigenvalues,
    which are any, are the same on all processors, unlike those of LAPACK.
    """
    a, axes = matrix.copy(), np.eye(3)
    for _ in range(SWEEPS):
        for p, q in ((0, 1), (0, 2), (1, 2)):
            if abs(a[p, q]) <= 1e-18 * (abs(a[p, p]) + abs(a[q, q])):
                a[p, q] = a[q, p] = 0.0
                continue
            ratio = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
            t = math.copysign(1.0, ratio) / (abs(ratio) + math.sqrt(ratio * ratio + 1.0))
            c = 1.0 / math.sqrt(t * t + 1.0)
            s, k, change = t * c, 3 - p - q, t * a[p, q]
            a[p, p], a[q, q] = a[p, p] - change, a[q, q] + change
            a[p, q] = a[q, p] = 0.0
            a[p, k], a[q, k] = c * a[p, k] - s * a[q, k], s * a[p, k] + c * a[q, k]
            a[k, p], a[k, q] = a[p, k], a[q, k]
            for row in axes:
                row[p], row[q] = c * row[p] - s * row[q], s * row[p] + c * row[q]
    return np.diagonal(a).copy(), axes
