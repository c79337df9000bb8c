# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies of several batches as one list of particles, for a stage that involves them all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softbody_ros.core.collision.collision_surface import Skin
from softbody_ros.core.collision.point_obstacles import PointObstacles
from softbody_ros.core.shape_matching import rigid_motion
from softbody_ros.core.shape_matching.dynamics import Flight

ALL = slice(None)
LEAST_WEIGHT = 1e-12
"""Share of its body's mass that a particle without area has when it touches something."""


@dataclass(frozen=True)
class Source:
    """
    Where some bodies of a crowd come from.

    Attributes
    ----------
    flight : Flight
    skin : Skin
        of all its bodies
    rows : (b,) int
        which of them
    first : int
        number of the first in the crowd

    """

    flight: Flight
    skin: Skin
    rows: np.ndarray
    first: int

    @property
    def bodies(self) -> slice:
        """Numbers in the crowd."""
        return slice(self.first, self.first + len(self.rows))

    def listed(self, field: np.ndarray) -> np.ndarray:
        """Return a field (B, 3, n) of the flight as (b n, 3) float64, in the order of the skin."""
        part = field[self.rows]
        if self.skin.pieces > 1:
            part = part.take(self.skin.order, axis=2)
        return part.swapaxes(1, 2).reshape(-1, 3).astype(np.float64, copy=False)

    def put(self, field: np.ndarray, values: np.ndarray) -> None:
        """Write back what `listed` has returned."""
        part = values.reshape(len(self.rows), -1, 3)
        if self.skin.pieces > 1:
            unordered = np.empty_like(part)
            unordered[:, self.skin.order] = part
            part = unordered
        field[self.rows] = part.swapaxes(1, 2)


@dataclass(frozen=True)
class Fixed:
    """
    Points of something that does not give way.

    Attributes
    ----------
    points : PointObstacles
    centre : (3,) float
        m
    twist : (6,) float
        velocity there, m/s, and angular velocity, rad/s
    is_spiky : bool
        whether they are the spikes of an obstacle, which carries weight by its surface

    """

    points: PointObstacles
    centre: np.ndarray
    twist: np.ndarray
    is_spiky: bool

    @property
    def velocity(self) -> np.ndarray:
        """(k, 3) float: of the points, m/s."""
        return self.twist[:3] + np.cross(self.twist[3:], self.points.points - self.centre)


@dataclass(frozen=True)
class Crowd:
    """
    C bodies with N particles in all; the last of them are what does not give way.

    Attributes
    ----------
    sources : sequence of Source
    source : (C,) int
        which of them each body comes from; beyond them for what does not give way
    first : (C + 1,) int
        where the particles of each body begin
    body : (N,) int
        whose each particle is
    x, v : (N, 3) float64
        positions, m, and velocities, m/s: the stages change them in place
    start, goals : (N, 3) float64
        where the particles were at the tick before, and where they want to be, m
    lightness : (N,) float
        of the particles: 1 / mass, 1/kg
    mass : (C,) float
        of the bodies, kg; infinite for what does not give way
    mobility : (C, 6, 6) float
        what an impulse and a turning impulse do to the twist, as far as pins allow, 1/kg …
    pinned, spiky : (C,) bool
        whether pins hold them; whether they are spikes of obstacles
    rigid, elasticity, bounciness, friction, coulomb, thickness, scale : (C,)
        of the bodies, see `Gains` and `RestShape`
    centre : (C, 3) float
        m
    twist : (C, 6) float
        velocity of the centre of mass, m/s, and angular velocity, rad/s
    spin : (C, 3) float
        angular momentum about the centre of mass per mass, m²/s

    """

    sources: Sequence[Source]
    source: np.ndarray
    first: np.ndarray
    body: np.ndarray
    x: np.ndarray
    v: np.ndarray
    start: np.ndarray
    goals: np.ndarray
    lightness: np.ndarray
    mass: np.ndarray
    mobility: np.ndarray
    pinned: np.ndarray
    spiky: np.ndarray
    rigid: np.ndarray
    elasticity: np.ndarray
    bounciness: np.ndarray
    friction: np.ndarray
    coulomb: np.ndarray
    thickness: np.ndarray
    scale: np.ndarray
    centre: np.ndarray
    twist: np.ndarray
    spin: np.ndarray

    def __len__(self) -> int:
        return len(self.mass)

    @cached_property
    def body_lightness(self) -> np.ndarray:
        """(C,) float: of the bodies as wholes, 1/kg; none of one that pins do not let move."""
        return np.einsum('cii->c', self.mobility[:, :3, :3]) / 3.0

    def field(self, twist: np.ndarray, particle: np.ndarray | slice = ALL) -> np.ndarray:
        """Return the velocities (n, 3) that rigid motions (C, 6) give to particles."""
        body = self.body[particle]
        offset = twist[:, :3] - rigid_motion.cross(twist[:, 3:], self.centre)
        return offset[body] + rigid_motion.cross(twist[body, 3:], self.x[particle])


def make_crowd(sources: Sequence[Source], fixed: Sequence[Fixed], h: float) -> Crowd:
    """
    Return bodies, and points that do not give way, as a crowd: copies.

    Parameters
    ----------
    sources : sequence of Source
    fixed : sequence of Fixed
    h : float
        s

    """

    def particles(name: str) -> list[np.ndarray]:
        return [each.listed(getattr(each.flight.particles, name)) for each in sources]

    def of_gains(name: str, of_fixed: float) -> np.ndarray:
        rows = [getattr(each.flight.tick.gains, name)[each.rows] for each in sources]
        return np.concatenate([*rows, np.full(len(fixed), of_fixed, rows[0].dtype)])

    def of_motion(name: str) -> np.ndarray:
        rows = [getattr(each.flight.motion, name)[each.rows] for each in sources]
        return np.concatenate([*rows, np.zeros((len(fixed), *rows[0].shape[1:]))])

    points = [each.points.points for each in fixed]
    velocities = [each.velocity for each in fixed]
    bodies = [len(each.rows) for each in sources]
    spiky = np.array([*[False] * sum(bodies), *(each.is_spiky for each in fixed)])
    sizes = np.repeat([each.skin.rest.particle_count for each in sources], bodies)
    counts = np.concatenate([sizes, [len(each) for each in points]]).astype(np.int64)
    body = np.repeat(np.arange(len(counts)), counts)
    # shares of the mass
    weights = [
        np.tile(np.maximum(each.skin.rest.weights[each.skin.order], LEAST_WEIGHT), count)
        for each, count in zip(sources, bodies, strict=True)
    ]
    shares = np.concatenate([*weights, *(np.ones(len(each)) for each in points)])
    mass = of_gains('mass', np.inf)
    first_fixed = sum(bodies)
    centre, spin = of_motion('centre'), of_motion('spin')
    inverse_inertia = of_motion('inverse_inertia')
    twist = np.hstack([of_motion('velocity'), rigid_motion.applied(inverse_inertia, spin)])
    thickness = of_gains('thickness', 0.0)
    for number, each in enumerate(fixed, first_fixed):
        thickness[number] = each.points.radius
        centre[number], twist[number] = each.centre, each.twist
    ends = [each - h * velocity for each, velocity in zip(points, velocities, strict=True)]
    return Crowd(
        sources=sources,
        source=np.repeat(np.arange(len(sources) + 1), [*bodies, len(fixed)]),
        first=np.concatenate([[0], np.cumsum(counts)]),
        body=body,
        x=np.concatenate([*particles('x'), *points]),
        v=np.concatenate([*particles('v'), *velocities]),
        start=np.concatenate([*particles('start'), *ends]),
        goals=np.concatenate(
            [*(each.listed(each.flight.match.goals) for each in sources), *points]
        ),
        lightness=1.0 / (mass[body] * shares),
        mass=mass,
        mobility=_mobility(sources, centre, inverse_inertia / mass[:, None, None], 1.0 / mass),
        pinned=np.concatenate(
            [
                *(np.isin(each.rows, list(each.flight.pinned)) for each in sources),
                np.zeros(len(fixed), dtype=bool),
            ]
        ),
        spiky=spiky,
        rigid=of_gains('rigid', True),
        elasticity=of_gains('elasticity', np.nan),
        bounciness=of_gains('bounciness', np.nan),
        friction=of_gains('friction', np.nan),
        coulomb=of_gains('coulomb', False),
        thickness=thickness,
        scale=np.concatenate(
            [
                np.repeat([each.skin.rest.scale for each in sources], bodies),
                np.full(len(fixed), np.inf),
            ]
        ),
        centre=centre,
        twist=twist,
        spin=spin,
    )


def _mobility(
    sources: Sequence[Source], centre: np.ndarray, turning: np.ndarray, lightness: np.ndarray
) -> np.ndarray:
    """Return the mobilities (C, 6, 6) of bodies: where they hang on pins, of what is left free."""
    mobility = np.zeros((len(centre), 6, 6))
    mobility[:, [0, 1, 2], [0, 1, 2]] = lightness[:, None]
    mobility[:, 3:, 3:] = turning
    for source in sources:
        for number, row in enumerate(source.rows.tolist(), source.first):
            pins = source.flight.pinned.get(row)
            if pins is not None:
                places = source.flight.particles.x[row][:, pins.particle].T - centre[number]
                mobility[number] = pins.left_free(mobility[number], places)
    return mobility
