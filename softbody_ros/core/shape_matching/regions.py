# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Overlapping regions of a body, each matched by itself, so that it bends locally.

Müller, Heidelberger, Teschner, Gross 2005, section 4.4. Each particle shares its corrections among
the regions it belongs to (weights that sum to 1), and the same shares are its masses in their
matches: so the pull of all regions together has a potential and keeps momentum. Regions keep their
shape, each turned as it fits: what bends, twists and stretches is their arrangement. The goal of
the whole body, which follows deformation according to its mode, has a weight beside theirs:
without it a hollow shell of local patches caves in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from softbody_ros.core.shape_matching import plasticity
from softbody_ros.core.shape_matching.rest_shape import LINEAR, RestShape, pseudo_inverse
from softbody_ros.core.sums import mapped, sums

FLAT = 0.01
"""Squared extent, relative to the largest, below which a region has no stretch across itself."""
POINT = 1e-8
"""Squared extent, relative to the body's, below which a region has no stretch at all."""


@dataclass(frozen=True, eq=False)
class Regions:
    """
    Constants of the K regions of a rest shape of n particles.

    Attributes
    ----------
    members : (K, m) int
        particles of each region; the smaller regions' rows are filled up with particle 0
    places : (overlap, n) int
        where in `members`, as one list, each particle is
    features : (K, 4, m) float
        ω [1 q] for each particle of each region: ω is the share that the particle has in the
        region, q its offset from the region's centre of mass in the rest shape, divided by the
        scale of the shape; zero where a row is filled up
    weighted_features : (K, 4, m) float
        times the weights of the particles
    centre : (K, 3) float
        centres of mass in the rest shape, as its features q
    home : (n,) int
        the region in which each particle has its largest share
    belongs : (n, K) sparse
        1 where a particle has a share
    mass : (K,) float
        what the regions weigh
    inverse : (K, 3, 3) float
        pseudo-inverse of Σ w ω q qᵀ
    unspanned : (K, 3, 3) float
        projection on the directions in which a region has no extent

    """

    members: np.ndarray
    places: np.ndarray
    features: np.ndarray
    weighted_features: np.ndarray
    centre: np.ndarray
    home: np.ndarray
    belongs: csr_array
    mass: np.ndarray
    inverse: np.ndarray
    unspanned: np.ndarray

    @property
    def count(self) -> int:
        """Number of regions, K."""
        return len(self.mass)


def make_regions(
    rest: RestShape, count: int, overlap: int, weights: np.ndarray | None = None
) -> Regions:
    """
    Return the regions around `count` particles that are as far from each other as can be.

    Parameters
    ----------
    rest : RestShape
    count : int
        K, at most the number of particles; fewer are made if there are fewer places
    overlap : int
        regions that each particle belongs to: those of its nearest seeds, with shares that
        vanish where the next one comes nearer
    weights : (n,) float, optional
        what the particles weigh in the matches, by default their masses

    """
    # not the features, which may be float32: which of two equally far seeds it is must not differ
    points = (rest.surface.vertices - rest.centre) / rest.scale
    seeds = farthest_points(points, count)
    count = len(seeds)
    # a region of vertices that belong to no face must have a centre, too
    weights = rest.weights if weights is None else weights
    weights = np.maximum(weights.astype(np.float64), 1e-12)
    member, shares = _shares(points, points[seeds], overlap)
    particle = np.repeat(np.arange(len(points)), member.shape[1])
    region, share = member.ravel(), shares.ravel()

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
    # of a single particle only rounding would be left
    gram[np.einsum('kii->k', gram) < POINT * mass] = 0.0
    pairs = [pseudo_inverse(each, FLAT) for each in gram]

    order = np.argsort(region, kind='stable')
    sizes = np.bincount(region, minlength=count)
    place = np.arange(len(order)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    members = np.zeros((count, sizes.max()), dtype=np.int64)
    members[region[order], place] = particle[order]
    places = np.empty_like(order)
    places[order] = region[order] * members.shape[1] + place
    features = np.zeros((count, 4, members.shape[1]))
    features[region[order], :, place] = affine[order]
    weighted_features = features * weights[members][:, None]
    # where next to nothing is beside a heavy particle, rounding of what that one adds to the
    # moments would turn the region, the more the farther it is from where positions count from
    rows, heaviest = np.arange(count), weighted_features[:, 0].argmax(axis=1)
    weighted_features[rows, 1:, heaviest] -= weighted_features[:, 1:].sum(axis=2)
    dtype = rest.features.dtype
    return Regions(
        members=members,
        places=places.reshape(member.shape).T.copy(),
        features=features.astype(dtype),
        weighted_features=weighted_features.astype(dtype),
        centre=centre,
        home=member[np.arange(len(points)), shares.argmax(axis=1)],
        belongs=csr_array((np.ones(len(region)), (particle, region)), shape=(len(points), count)),
        mass=mass,
        inverse=np.stack([inverse for inverse, _ in pairs]),
        unspanned=np.stack([unspanned for _, unspanned in pairs]),
    )


def farthest_points(points: np.ndarray, count: int) -> np.ndarray:
    """
    Return the indices of `count` points (n, 3), each as far as can be from those before.

    Fewer if there are fewer places: points that coincide are chosen once.
    """
    chosen = np.empty(count, dtype=np.int64)
    # the first is the one farthest from the centre: a tip, not some vertex that happens to be 0
    distance = np.linalg.norm(points, axis=1)
    for index in range(count):
        chosen[index] = np.argmax(distance)
        if index and distance[chosen[index]] == 0.0:
            return chosen[:index]
        apart = np.linalg.norm(points - points[chosen[index]], axis=1)
        distance = np.minimum(distance, apart) if index else apart
    return chosen


def _shares(points: np.ndarray, seeds: np.ndarray, overlap: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (n, m) int: the nearest seeds, and (n, m) float: shares that sum to 1."""
    kept = min(overlap, len(seeds))
    distance, member = cKDTree(seeds).query(points, k=np.arange(1, min(kept + 1, len(seeds)) + 1))
    if kept < len(seeds):
        reach = distance[:, kept:]
    else:
        # all seeds are near: the farthest of them counts least
        reach = 2.0 * distance[:, -1:]
    distance, member = distance[:, :kept], member[:, :kept]
    closeness = np.maximum(1.0 - distance / np.where(reach > 0.0, reach, 1.0), 0.0) ** 2
    closeness[:, 0] = np.maximum(closeness[:, 0], 1e-6)  # between seeds equally far from it
    return member, closeness / closeness.sum(axis=1, keepdims=True)


@dataclass(frozen=True)
class RegionMatch:
    """
    How the K regions of B bodies fit the particles.

    Attributes
    ----------
    centre : (B, K, 3) float
        centres of mass, m
    moment : (B, K, 3, 3) float
        A_pq of each
    undeformed : (B, K, 3, 3) float
        R, or R S_p

    """

    centre: np.ndarray
    moment: np.ndarray
    undeformed: np.ndarray


def match(
    x: np.ndarray, regions: Regions, rest: RestShape, stretch: np.ndarray | None
) -> RegionMatch:
    """
    Match each region with the particles.

    Parameters
    ----------
    x : (B, 3, n) float
        positions, m
    regions : Regions
    rest : RestShape
    stretch : (B, K, 3, 3) float or None
        plastic state

    """
    # a few times faster than a sparse matrix: products of a vector with a small dense matrix
    members = x.take(regions.members.ravel(), axis=2).reshape(*x.shape[:2], regions.count, -1)
    total = sums(members.swapaxes(1, 2), regions.weighted_features)
    moment = total[..., 1:] / rest.scale
    centre = total[..., 0] / regions.mass[:, None]
    return RegionMatch(centre, moment, plasticity.undeformed(moment, stretch))


def goals(matched: RegionMatch, regions: Regions, rest: RestShape) -> np.ndarray:
    """Return (B, 3, n) float: what the regions of each particle make of its place, m."""
    bodies = len(matched.centre)
    transforms = np.empty((bodies, 3, regions.count, 4), rest.features.dtype)
    transforms[..., 0] = matched.centre.swapaxes(1, 2)
    transforms[..., 1:] = rest.scale * matched.undeformed.swapaxes(1, 2)
    # as above: first all members of all regions, then which of them each particle is
    members = mapped(transforms[..., None, :], regions.features).reshape(bodies, 3, -1)
    result = members.take(regions.places[0], axis=2)
    for places in regions.places[1:]:
        result += members.take(places, axis=2)
    return result


def fits(matched: RegionMatch, regions: Regions) -> np.ndarray:
    """Return (B, K, 3, 3) float: the linear transforms that come nearest to the particles, A."""
    return matched.moment @ regions.inverse + matched.undeformed @ regions.unspanned
