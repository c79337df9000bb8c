# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Where bodies want to be: the match of the whole body with those of its regions, pins and dents.

Every goal is a nearest shape of some kind (turned, fitted, of the rest volume), or a mean of such:
so the pull towards it has a potential, and a body left alone comes to rest.
"""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from dataclasses import dataclass

import numpy as np

from softbody_ros.core import matching, plasticity, regions
from softbody_ros.core.pins import Pins
from softbody_ros.core.regions import RegionMatch, Regions
from softbody_ros.core.rest_shape import LINEAR
from softbody_ros.core.sums import weighted
from softbody_ros.core.tick import Particles, SimulationError, Tick

LARGEST_MOMENT = 1e100
"""Beyond it squares leave the finite numbers."""


@dataclass(frozen=True)
class Match:
    """
    Where the goals of B bodies are.

    Attributes
    ----------
    centre : (B, 3) float
        centre of mass, m
    goals : (2, B, 3, n) float
        for positions, and for velocities, m
    strayed : (B,) float
        from 0, anything that a goal can follow, to 1, a state that only the rest shape leads out
        of
    place : (B, P, 3) float
        where the P pieces of a body are: its regions, or the body as the only one; centres, m
    origin : (B, P, 3) float
        where they are in the rest shape, m
    posture : (B, P, 3, 3) float
        how they lie: the linear transforms from offsets in the rest shape to those now
    plastic : (B, 1 + K, 3, 3) float or None
        plastic state after the tick: of the whole body and of its K regions

    """

    centre: np.ndarray
    goals: np.ndarray
    strayed: np.ndarray
    place: np.ndarray
    origin: np.ndarray
    posture: np.ndarray
    plastic: np.ndarray | None


def find(particles: Particles, pinned: Mapping[int, Pins], tick: Tick) -> Match:
    """Match all bodies: those that hang on pins with the weights that these give them."""
    hanging = [row for row in pinned if not tick.gains.rigid[row]]
    if not hanging:
        return of_bodies(particles, tick)
    x, before = particles.x, particles.plastic
    plastic = intact(len(x), tick.regions) if before is None else before.copy()
    pieces = tick.regions.count if tick.regions else 1
    match = Match(
        weighted(x, tick.rest.weights),
        np.empty((2, *x.shape), x.dtype),
        np.zeros(len(x)),
        np.empty((len(x), pieces, 3)),
        np.empty((len(x), pieces, 3)),
        np.empty((len(x), pieces, 3, 3)),
        plastic,
    )
    free = np.setdiff1d(np.arange(len(x)), hanging)
    groups = [(np.array([row]), pinned[row].rest, pinned[row].regions) for row in hanging]
    if len(free):
        groups.append((free, tick.rest, tick.regions))
    flows = before is not None
    for rows, rest, parts in groups:
        part_tick = dataclasses.replace(tick, rest=rest, regions=parts, gains=tick.gains.of(rows))
        part = of_bodies(particles.of(rows), part_tick)
        match.goals[:, rows], match.strayed[rows] = part.goals, part.strayed
        match.place[rows], match.origin[rows] = part.place, part.origin
        match.posture[rows] = part.posture
        if part.plastic is not None:
            plastic[rows] = part.plastic
            flows = True
    return match if flows else dataclasses.replace(match, plastic=None)


def of_bodies(particles: Particles, tick: Tick) -> Match:
    """Match the rest shape with the particles: where they want to be."""
    rest, gains, plastic = tick.rest, tick.gains, particles.plastic
    centre, moment = matching.moments(particles.x, rest, gains.features)
    require_finite(moment)
    stretch = None if plastic is None else plastic[:, 0]
    undeformed = plasticity.undeformed(moment, stretch)
    fits = fit_of_each_mode(moment, undeformed, stretch, tick)
    deformation = gains.deformation * (1.0 - fits.strayed)
    transforms = matching.blended(fits.followed, undeformed, deformation)
    parts = None
    if tick.regions is None:
        place, origin = centre[:, None], rest.centre[None]
        posture = of_whole(fits, undeformed)[:, None]
        places = matching.goals(centre, transforms, rest)
    else:
        stretch = None if plastic is None else plastic[:, 1:]
        parts = regions.match(particles.x, tick.regions, rest, stretch)
        place, posture = parts.centre, parts.undeformed
        origin = rest.centre + rest.scale * tick.regions.centre
        whole = gains.whole_body[:, None]
        places = matching.goals(whole * centre, whole[..., None] * transforms, rest)
        of_regions = regions.goals(parts, tick.regions, rest)
        of_regions *= (1.0 - whole[..., None]).astype(of_regions.dtype)
        places += of_regions
    flow = flowed(plastic, fits, parts, tick)
    origin = np.broadcast_to(origin, place.shape)
    return Match(centre, places, fits.strayed, place, origin, posture, flow)


def of_whole(fits: Fits, undeformed: np.ndarray) -> np.ndarray:
    """Return how bodies without regions lie, (B, 3, 3): as they fit, if they have not strayed."""
    return np.where((fits.strayed > 0.0)[:, None, None], undeformed, fits.nearest[..., :LINEAR])


def intact(bodies: int, regions: Regions | None) -> np.ndarray:
    """Return the plastic state (B, 1 + K, 3, 3) of bodies that are as they were made."""
    return np.tile(np.eye(3), (bodies, 1 + (regions.count if regions else 0), 1, 1))


def flowed(
    plastic: np.ndarray | None, fits: Fits, parts: RegionMatch | None, tick: Tick
) -> np.ndarray | None:
    """Return the plastic state after the tick; what has strayed comes back, it does not flow."""
    gains = tick.gains
    creeping = gains.creeping * (fits.strayed < 1.0)
    if not creeping.any():
        return plastic
    transforms = fits.nearest[:, None, :, :LINEAR]
    if tick.regions is not None and parts is not None:
        transforms = np.concatenate([transforms, regions.fits(parts, tick.regions)], axis=1)
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
    moment: np.ndarray, undeformed: np.ndarray, stretch: np.ndarray | None, tick: Tick
) -> Fits:
    """Return the quadratic fits of quadratic bodies, the linear ones of the others."""
    fits = find_fits(moment, undeformed, stretch, tick)
    quadratic = tick.gains.quadratic
    if tick.gains.features == LINEAR or quadratic.all():
        return fits
    linear = find_fits(moment[..., :LINEAR], undeformed, stretch, tick)
    chosen = quadratic[:, None, None]
    return Fits(
        np.where(chosen, fits.nearest, matching.padded(linear.nearest)),
        np.where(chosen, fits.followed, matching.padded(linear.followed)),
        np.where(quadratic, fits.strayed, linear.strayed),
    )


def find_fits(
    moment: np.ndarray, undeformed: np.ndarray, stretch: np.ndarray | None, tick: Tick
) -> Fits:
    """Fit as many features as the moments (B, 3, F) have."""
    nearest = matching.fit(moment, undeformed, tick.rest)
    kept, volume = matching.of_rest_volume(nearest, tick.rest)
    strayed = matching.strayed(plasticity.elastic(nearest, stretch), volume)
    kept = np.where((strayed < 1.0)[:, None, None], kept, nearest)
    conserved = tick.gains.volume_conservation[..., None, None]
    return Fits(nearest, nearest + conserved * (kept - nearest), strayed)


def require_finite(moment: np.ndarray) -> None:
    """Raise if any position or velocity was not finite: the moments are sums over all of them."""
    if not np.abs(moment).max() < LARGEST_MOMENT:
        raise SimulationError('a position or velocity is not finite any more')
