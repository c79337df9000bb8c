# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Overlapping regions of a body (clusters), each matched by itself, for local deformation.

Müller, Heidelberger, Teschner, Gross 2005, section 4.4. The goal of a particle is a weighted mean
over its regions (weights that sum to 1), and the same weights are its masses in their matches: so
the pull of all regions together is conservative and keeps momentum. Each region is matched
rigidly; the body bends, twists and stretches by their arrangement. The goal of the whole body,
which deforms according to its mode, is averaged in: a hollow shell of local patches alone
collapses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.vectors import Matrix, added, matrix_of, product
from softbody_ros.core.shape_matching.rest_shape import LINEAR, RestShape, pseudo_inverse

FLAT = 0.01
"""Squared extent, relative to the largest, below which a region has no stretch that way."""
POINT = 1e-8
"""Squared extent, relative to the body's, below which a region has no stretch at all."""

EQUALLY_FAR = 1e-9
"""Relative difference of equal distances up to rounding: symmetric meshes have many."""

REGION = np.dtype(
    [
        ('first', np.int64),  # its members, in the arrays of all regions of a world
        ('count', np.int64),
        ('mass', np.float64),
        ('inverse', np.float64, (LINEAR, LINEAR)),
        ('unspanned', np.float64, (LINEAR, LINEAR)),
    ],
    align=True,
)
"""One region as kernels read it, see `Regions`."""


@dataclass(frozen=True, eq=False)
class Regions:
    """
    Constants of the K regions of a rest shape of N particles, with m members in all.

    Attributes
    ----------
    first : (K + 1,) int
        index in `particle` of the first member of each region
    particle : (m,) int
        members, region after region
    features : (4, m) float
        ω [1 q] of each member: ω is the weight of the region for the particle, q its offset from
        the centre of mass of the region at rest, divided by the scale of the shape
    weighted_features : (4, m) float
        times the weights of the particles
    centre : (K, 3) float
        centres of mass at rest, in the coordinates q of the shape
    main_region : (N,) int
        the region with the largest weight for each particle
    membership : (N, K) sparse
        1 where a particle is a member
    mass : (K,) float
        mass shares of the regions
    inverse : (K, 3, 3) float
        pseudo-inverse of Σ w ω q qᵀ
    unspanned : (K, 3, 3) float
        projection on the directions in which a region has no extent
    spread : float
        Σ w ω |q|² of all members

    """

    first: np.ndarray
    particle: np.ndarray
    features: np.ndarray
    weighted_features: np.ndarray
    centre: np.ndarray
    main_region: np.ndarray
    membership: csr_array
    mass: np.ndarray
    inverse: np.ndarray
    unspanned: np.ndarray
    spread: float

    @property
    def count(self) -> int:
        """Number of regions, K."""
        return len(self.mass)

    def mean_at_particles(self, values: np.ndarray) -> np.ndarray:
        """Return (N,) float: the weighted mean of values (K,) over each one's regions."""
        shares = self.features[0] * np.repeat(values, np.diff(self.first))
        return np.bincount(self.particle, shares, len(self.main_region))

    def records(self) -> np.ndarray:
        """Return the regions as (K,) REGION; members count from 0."""
        records = np.zeros(self.count, REGION)
        records['first'], records['count'] = self.first[:-1], np.diff(self.first)
        records['mass'] = self.mass
        records['inverse'], records['unspanned'] = self.inverse, self.unspanned
        return records


def make_regions(
    rest: RestShape, count: int, overlap: int, weights: np.ndarray | None = None
) -> Regions:
    """
    Return regions around `count` seeds chosen by farthest point sampling.

    Parameters
    ----------
    rest : RestShape
    count : int
        K, at most the number of vertices; coinciding ones make fewer
    overlap : int
        regions that each vertex belongs to: those of its nearest seeds, with weights that vanish
        where the next seed is as near; an inner particle belongs to all regions up to twice as
        far as the nearest, so that the one in the centre of a ball leans to none
    weights : (N,) float, optional
        of the particles in the matches, by default their masses

    """
    points = (rest.particles - rest.centre) / rest.scale
    at_surface = points[: rest.surface_count]
    seeds = farthest_points(at_surface, count)
    count = len(seeds)
    # vertices without faces have no mass, but a region of them needs a centre
    weights = rest.weights if weights is None else weights
    weights = np.maximum(weights.astype(np.float64), 1e-12)
    member, shares = _shares(at_surface, points[seeds], overlap)
    particle = np.repeat(np.arange(len(at_surface)), member.shape[1])
    region, share, main_region = member.ravel(), shares.ravel(), member[:, 0].copy()
    if len(rest.inner):
        inner, of_inner, its_share = _inner_shares(points[rest.surface_count :], points[seeds])
        particle = np.concatenate([particle, rest.surface_count + inner])
        region, share = np.concatenate([region, of_inner]), np.concatenate([share, its_share])
        nearest = cKDTree(points[seeds]).query(points[rest.surface_count :])[1]
        main_region = np.concatenate([main_region, nearest])

    mass = np.bincount(region, share * weights[particle], count)
    centre = (
        np.stack(
            [np.bincount(region, share * (weights * axis)[particle], count) for axis in points.T],
            axis=-1,
        )
        / mass[:, None]
    )
    offsets = points[particle] - centre[region]
    affine = share[:, None] * np.column_stack([np.ones(len(share)), offsets])
    gram = np.zeros((count, LINEAR, LINEAR))
    np.add.at(
        gram,
        region,
        (share * weights[particle])[:, None, None] * offsets[:, :, None] * offsets[:, None, :],
    )
    # the offsets of a single particle are rounding errors
    gram[np.einsum('kii->k', gram) < POINT * mass] = 0.0
    pairs = [pseudo_inverse(each, FLAT) for each in gram]

    order = np.argsort(region, kind='stable')
    region, particle = region[order], particle[order]
    first = np.searchsorted(region, np.arange(count + 1))
    features = np.ascontiguousarray(affine[order].T)
    weighted_features = features * weights[particle]
    # rows must sum to zero exactly: beside a heavy particle, rounding errors in its contribution
    # to the moments, which grow with the distance from the origin, would rotate the region
    for start, end in zip(first[:-1].tolist(), first[1:].tolist(), strict=True):
        heaviest = start + int(weighted_features[0, start:end].argmax())
        weighted_features[1:, heaviest] -= weighted_features[1:, start:end].sum(axis=1)
    return Regions(
        first=first,
        particle=particle,
        features=features,
        weighted_features=weighted_features,
        centre=centre,
        main_region=main_region,
        membership=csr_array((np.ones(len(particle)), (particle, region)), (len(points), count)),
        mass=mass,
        inverse=np.stack([inverse for inverse, _ in pairs]),
        unspanned=np.stack([unspanned for _, unspanned in pairs]),
        spread=float(np.einsum('kii->', gram)),
    )


def farthest_points(points: np.ndarray, count: int) -> np.ndarray:
    """
    Return the indices of `count` points (n, 3) by farthest point sampling.

    Points that coincide are chosen once, so there may be fewer.
    """
    chosen = np.empty(count, dtype=np.int64)
    # start with the point farthest from the centre, not with an arbitrary vertex
    distance = np.linalg.norm(points, axis=1)
    for index in range(count):
        # the first of equally distant ones, independent of rounding
        chosen[index] = np.argmax(distance >= (1.0 - EQUALLY_FAR) * distance.max())
        if index and distance[chosen[index]] == 0.0:
            return chosen[:index]
        apart = np.linalg.norm(points - points[chosen[index]], axis=1)
        distance = np.minimum(distance, apart) if index else apart
    return chosen


def _shares(points: np.ndarray, seeds: np.ndarray, overlap: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (n, m) int: the nearest seeds, and (n, m) float: weights that sum to 1."""
    kept = min(overlap, len(seeds))
    distance, member = cKDTree(seeds).query(points, k=np.arange(1, min(kept + 1, len(seeds)) + 1))
    if kept < len(seeds):
        reach = distance[:, kept:]
    else:
        # there is no next seed: the weight decreases up to twice the farthest one
        reach = 2.0 * distance[:, -1:]
    distance, member = distance[:, :kept], member[:, :kept]
    closeness = np.maximum(1.0 - distance / np.where(reach > 0.0, reach, 1.0), 0.0) ** 2
    closeness[:, 0] = np.maximum(closeness[:, 0], 1e-6)  # if the next seed is as near
    return member, closeness / closeness.sum(axis=1, keepdims=True)


def _inner_shares(
    points: np.ndarray, seeds: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (m,) inner points, the regions that they belong to, and weights that sum to 1."""
    distance = np.linalg.norm(points[:, None] - seeds[None], axis=2)
    reach = 2.0 * distance.min(axis=1, keepdims=True)
    closeness = np.maximum(1.0 - distance / np.where(reach > 0.0, reach, 1.0), 0.0) ** 2
    closeness[(reach == 0.0) & (distance > 0.0)] = 0.0
    share = closeness / closeness.sum(axis=1, keepdims=True)
    point, region = np.nonzero(share)
    return point, region, share[point, region]


@helper
def region_moment(
    region: np.void, particle: np.ndarray, weighted: np.ndarray, y: np.ndarray, first: int
) -> tuple[Matrix, tuple[float, float, float]]:
    """
    Return A_pq, m, and Σ w ω y of a region (eq. 7).

    Parameters
    ----------
    region : REGION
    particle : (m,) int
        members of all regions of a world, as particles of their bodies
    weighted : (4, m) float
        w ω [1 q]
    y : (3, N) float
        positions, m
    first : int
        first particle of the body

    """
    start, stop = region['first'], region['first'] + region['count']
    one, q0, q1, q2 = (
        weighted[0, start:stop],
        weighted[1, start:stop],
        weighted[2, start:stop],
        weighted[3, start:stop],
    )
    member = particle[start:stop]
    c0 = c1 = c2 = 0.0
    a00 = a01 = a02 = a10 = a11 = a12 = a20 = a21 = a22 = 0.0
    for k in range(len(member)):
        i = first + member[k]
        y0, y1, y2 = y[0, i], y[1, i], y[2, i]
        c0 += one[k] * y0
        c1 += one[k] * y1
        c2 += one[k] * y2
        a00 += q0[k] * y0
        a01 += q1[k] * y0
        a02 += q2[k] * y0
        a10 += q0[k] * y1
        a11 += q1[k] * y1
        a12 += q2[k] * y1
        a20 += q0[k] * y2
        a21 += q1[k] * y2
        a22 += q2[k] * y2
    return ((a00, a01, a02), (a10, a11, a12), (a20, a21, a22)), (c0, c1, c2)


@helper
def add_region_goals(
    region: np.void,
    particle: np.ndarray,
    features: np.ndarray,
    centre: tuple[float, float, float],
    transform: Matrix,
    goals: np.ndarray,
    first: int,
) -> None:
    """
    Add the weighted goals of the members of a region, ω (centre + T q).

    Parameters
    ----------
    region : REGION
    particle : (m,) int
        members of all regions of a world, as particles of their bodies
    features : (4, m) float
        ω [1 q]
    centre : vector
        m
    transform : matrix
        scale · R, or scale · R S_p, m
    goals : (3, N) float
        m
    first : int
        first particle of the body

    """
    start, stop = region['first'], region['first'] + region['count']
    one, q0, q1, q2 = (
        features[0, start:stop],
        features[1, start:stop],
        features[2, start:stop],
        features[3, start:stop],
    )
    member = particle[start:stop]
    (t00, t01, t02), (t10, t11, t12), (t20, t21, t22) = transform
    c0, c1, c2 = centre
    for k in range(len(member)):
        i, w, a, b, c = first + member[k], one[k], q0[k], q1[k], q2[k]
        goals[0, i] += w * c0 + (t00 * a + t01 * b + t02 * c)
        goals[1, i] += w * c1 + (t10 * a + t11 * b + t12 * c)
        goals[2, i] += w * c2 + (t20 * a + t21 * b + t22 * c)


@helper
def region_fit(region: np.void, moment: Matrix, undeformed: Matrix) -> Matrix:
    """Return the best linear fit A of a region from A_pq and R."""
    inverse, unspanned = matrix_of(region['inverse']), matrix_of(region['unspanned'])
    return added(product(moment, inverse), product(undeformed, unspanned))
