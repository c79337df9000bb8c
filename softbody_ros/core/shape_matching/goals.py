# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Where bodies want to be: the match of the whole body with those of its regions, pins and dents.

Every goal is a nearest shape of some kind (turned, fitted, of the rest volume), or a mean of such:
so the pull towards it has a potential, and a body left alone comes to rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softbody_ros.core.basis import POSITION, REGIONS, Basis
from softbody_ros.core.shape_matching import matching, plasticity, regions
from softbody_ros.core.shape_matching.gains import Gains
from softbody_ros.core.shape_matching.pins import Pins
from softbody_ros.core.shape_matching.regions import RegionMatch, Regions
from softbody_ros.core.shape_matching.rest_shape import LINEAR, RestShape
from softbody_ros.core.sums import mapped, sums
from softbody_ros.core.tick import SimulationError, Tick

LARGEST_MOMENT = 1e100
"""Beyond it squares leave the finite numbers."""


@dataclass(frozen=True)
class Match:
    """
    Where the goals of B bodies are.

    Attributes
    ----------
    basis : Basis
    groups : sequence of Group
        bodies that have been matched together
    coefficients : (B, 2, 3, C) float
        of the goals for positions, and for velocities
    strayed : (B,) float
        from 0, anything that a goal can follow, to 1, a state that only the rest shape leads out
        of
    plastic : (B, 1 + K, 3, 3) float or None
        plastic state after the tick: of the whole body and of its K regions

    """

    basis: Basis
    groups: Sequence[Group]
    coefficients: np.ndarray
    strayed: np.ndarray
    plastic: np.ndarray | None

    def goals_of(self, body: np.ndarray, particle: np.ndarray) -> np.ndarray:
        """Return the goals for velocities of particles (k,) of bodies (k,): (k, 3), m."""
        return self.basis.at(self.coefficients[:, 1], body, particle)

    @cached_property
    def goals(self) -> np.ndarray:
        """(B, 3, n) float: the goals of all particles for velocities, m."""
        functions = self.basis.functions
        coefficients = self.basis.in_world(self.coefficients[:, 1])
        return mapped(coefficients.astype(functions.dtype, copy=False), functions)

    @cached_property
    def place(self) -> np.ndarray:
        """(B, P, 3) float: centres of the P pieces of bodies: regions, or the whole; m."""
        places = [group.place for group in self.groups]
        return self.basis.origin[:, None] + merged(self.groups, places)

    @cached_property
    def origin(self) -> np.ndarray:
        """(B, P, 3) float: where the pieces are in the rest shape, m."""
        return merged(self.groups, [group.origin for group in self.groups])

    @cached_property
    def posture(self) -> np.ndarray:
        """(B, P, 3, 3) float: how the pieces lie: from offsets in the rest shape to those now."""
        return merged(self.groups, [group.posture for group in self.groups])


@dataclass(frozen=True)
class Group:
    """
    How b bodies of a batch fit a rest shape.

    Attributes
    ----------
    rows : (b,) int
        which of the batch
    gains : Gains
    rest : RestShape
        with the weights that the particles have in the match
    regions : Regions or None
    pins : Pins or None
        that give particles other weights than the bodies do
    centre : (b, 3) float
        of mass, with those weights, m from the origin of the basis
    undeformed : (b, 3, 3) float
        R, or R S_p
    fits : Fits
    parts : RegionMatch or None
        the match of the regions, m from the origin of the basis
    plastic : (b, 1 + K, 3, 3) float or None
        plastic state after the tick

    """

    rows: np.ndarray
    gains: Gains
    rest: RestShape
    regions: Regions | None
    pins: Pins | None
    centre: np.ndarray
    undeformed: np.ndarray
    fits: Fits
    parts: RegionMatch | None
    plastic: np.ndarray | None

    @property
    def place(self) -> np.ndarray:
        """(b, P, 3) float: see `Match`, but from the origin of the basis."""
        return self.centre[:, None] if self.parts is None else self.parts.centre

    @property
    def origin(self) -> np.ndarray:
        """(b, P, 3) float: see `Match`."""
        origin = self.rest.centre[None]
        if self.regions is not None:
            origin = origin + self.rest.scale * self.regions.centre
        return np.repeat(origin[None], len(self.rows), axis=0)

    @property
    def posture(self) -> np.ndarray:
        """(b, P, 3, 3) float: see `Match`; whole bodies lie as they fit, unless they strayed."""
        if self.parts is not None:
            return self.parts.undeformed
        strays = (self.fits.strayed > 0.0)[:, None, None]
        return np.where(strays, self.undeformed, self.fits.nearest[..., :LINEAR])[:, None]

    @property
    def places_by_regions(self) -> np.ndarray:
        """(b, 3, n) float: what regions make of the positions, m from the origin of the basis."""
        assert self.parts is not None
        assert self.regions is not None
        return regions.goals(self.parts, self.regions, self.rest)

    @property
    def plastic_or_intact(self) -> np.ndarray:
        """(b, 1 + K, 3, 3) float: plastic state after the tick."""
        return intact(len(self.rows), self.regions) if self.plastic is None else self.plastic

    def coefficients(self, basis: Basis) -> np.ndarray:
        """Return the coefficients (b, 2, 3, C) of the goals, see `Match`."""
        deformation = self.gains.deformation * (1.0 - self.fits.strayed)
        transforms = matching.blended(self.fits.followed, self.undeformed, deformation)
        of_features = matching.affine(self.centre, transforms, self.rest)
        if self.pins is not None:
            count = of_features.shape[-1]
            of_features = of_features @ self.pins.features[:count, :count]
        result = np.zeros((len(self.rows), 2, 3, basis.functions.shape[1]))
        if self.regions is None:
            result[..., basis.one :] = of_features.swapaxes(0, 1)
        else:
            whole = self.gains.whole_body[:, None, None]
            result[..., basis.one :] = whole[..., None] * of_features.swapaxes(0, 1)
            result[..., range(3), range(REGIONS.start, REGIONS.stop)] = 1.0 - whole
        return result


def merged(groups: Sequence[Group], values: Sequence[np.ndarray]) -> np.ndarray:
    """Return values (b, …) of each group as those of the batch (B, …)."""
    if len(groups) == 1:
        return values[0]
    result = np.empty((sum(len(group.rows) for group in groups), *values[0].shape[1:]))
    for group, part in zip(groups, values, strict=True):
        result[group.rows] = part
    return result


def find(
    basis: Basis, plastic: np.ndarray | None, pinned: Mapping[int, Pins], tick: Tick
) -> Match:
    """
    Match all bodies: those that hang on pins with the weights that these give them.

    Parameters
    ----------
    basis : Basis
        what regions make of the positions is put into it
    plastic : (B, 1 + K, 3, 3) float or None
        plastic state at the tick before, see `plasticity`
    pinned : mapping of int to Pins
        by row
    tick : Tick

    """
    hanging = [row for row in pinned if not tick.gains.rigid[row]]
    free = np.arange(len(basis))
    if hanging:
        free = np.setdiff1d(free, hanging)
    groups = [of_bodies(basis, np.array([row]), plastic, pinned[row], tick) for row in hanging]
    if len(free):
        groups.append(of_bodies(basis, free, plastic, None, tick))
    if tick.regions is not None:
        basis.use_regions(merged(groups, [group.places_by_regions for group in groups]))
    if any(group.plastic is not None for group in groups):
        plastic = merged(groups, [group.plastic_or_intact for group in groups])
    return Match(
        basis,
        groups,
        merged(groups, [group.coefficients(basis) for group in groups]),
        merged(groups, [group.fits.strayed for group in groups]),
        plastic,
    )


def of_bodies(
    basis: Basis, rows: np.ndarray, plastic: np.ndarray | None, pins: Pins | None, tick: Tick
) -> Group:
    """Match some bodies (b,), given as indices, with the weights that pins give, or their own."""
    rest, parted = (tick.rest, tick.regions) if pins is None else (pins.rest, pins.regions)
    everyone = len(rows) == len(basis)
    gains = tick.gains if everyone else tick.gains.of(rows)
    chosen = slice(None) if everyone else rows
    if pins is None:
        total = basis.gram[chosen, POSITION, basis.one :]
    else:
        x = basis.functions[chosen, POSITION]
        total = sums(x, rest.weighted_features[: 1 + tick.gains.features])
    require_finite(total)
    centre, moment = total[..., 0], total[..., 1:] / rest.scale
    plastic = None if plastic is None else plastic[rows]
    stretch = None if plastic is None else plastic[:, 0]
    undeformed = plasticity.undeformed(moment, stretch)
    fits = fit_of_each_mode(moment, undeformed, stretch, rest, gains)
    parts = None
    if parted is not None:
        stretch = None if plastic is None else plastic[:, 1:]
        x = basis.functions[chosen, POSITION]
        parts = regions.match(x, parted, rest, stretch)
    after = flowed(plastic, fits, parts, parted, gains)
    return Group(rows, gains, rest, parted, pins, centre, undeformed, fits, parts, after)


def intact(bodies: int, regions: Regions | None) -> np.ndarray:
    """Return the plastic state (B, 1 + K, 3, 3) of bodies that are as they were made."""
    return np.tile(np.eye(3), (bodies, 1 + (regions.count if regions else 0), 1, 1))


def flowed(
    plastic: np.ndarray | None,
    fits: Fits,
    parts: RegionMatch | None,
    parted: Regions | None,
    gains: Gains,
) -> np.ndarray | None:
    """Return the plastic state after the tick; what has strayed comes back, it does not flow."""
    if not gains.creeps:
        return plastic
    creeping = gains.creeping * (fits.strayed < 1.0)
    transforms = fits.nearest[:, None, :, :LINEAR]
    if parted is not None and parts is not None:
        transforms = np.concatenate([transforms, regions.fits(parts, parted)], axis=1)
    if plastic is None:
        plastic = np.broadcast_to(np.eye(3), transforms.shape)
    limits = (gains.yield_strain, creeping, gains.largest_strain)
    return plasticity.flowed(
        plastic,
        plasticity.elastic(transforms, plastic),
        *(np.broadcast_to(limit[:, None], transforms.shape[:2]) for limit in limits),
    )


@dataclass(frozen=True)
class Fits:
    """
    What the shapes of B bodies come nearest to the particles with.

    Attributes
    ----------
    nearest : (B, 3, F) float
    followed : (2, B, 3, F) float
        what the goals of positions and of velocities follow of it: their volume is conserved
    strayed : (B,) float
        see `Match`

    """

    nearest: np.ndarray
    followed: np.ndarray
    strayed: np.ndarray


def fit_of_each_mode(
    moment: np.ndarray,
    undeformed: np.ndarray,
    stretch: np.ndarray | None,
    rest: RestShape,
    gains: Gains,
) -> Fits:
    """Return the quadratic fits of quadratic bodies, the linear ones of the others."""
    if gains.all_rigid and moment.shape[-1] == LINEAR:
        # their goals follow no deformation, so it need not be known
        followed = np.stack([undeformed, undeformed])
        return Fits(undeformed, followed, np.zeros(len(undeformed)))
    conserved, quadratic = gains.volume_conservation, gains.quadratic
    fits = find_fits(moment, undeformed, stretch, rest, conserved)
    if moment.shape[-1] == LINEAR or gains.all_quadratic:
        return fits
    linear = find_fits(moment[..., :LINEAR], undeformed, stretch, rest, conserved)
    chosen = quadratic[:, None, None]
    return Fits(
        np.where(chosen, fits.nearest, matching.padded(linear.nearest)),
        np.where(chosen, fits.followed, matching.padded(linear.followed)),
        np.where(quadratic, fits.strayed, linear.strayed),
    )


def find_fits(
    moment: np.ndarray,
    undeformed: np.ndarray,
    stretch: np.ndarray | None,
    rest: RestShape,
    conserved: np.ndarray,
) -> Fits:
    """Fit as many features as the moments (B, 3, F) have."""
    nearest = matching.fit(moment, undeformed, rest)
    kept, volume = matching.of_rest_volume(nearest, rest)
    strayed = matching.strayed(plasticity.elastic(nearest, stretch), volume)
    conserved = np.where(strayed < 1.0, conserved, 0.0)[..., None, None]
    return Fits(nearest, nearest + conserved * (kept - nearest), strayed)


def require_finite(moment: np.ndarray) -> None:
    """Raise if any position or velocity was not finite: the moments are sums over all of them."""
    if not np.abs(moment).max() < LARGEST_MOMENT:
        raise SimulationError('a position or velocity is not finite any more')
