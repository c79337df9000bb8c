# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The particles of bodies in the middle of a tick."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from softbody_ros.core.basis import POSITION, VELOCITY, Basis
from softbody_ros.core.shape_matching import rigid_motion
from softbody_ros.core.sums import blocks, mapped

_AXES = np.arange(3)[:, None]


@dataclass
class Particles:
    """
    The particles of B bodies in the middle of a tick.

    A flight ends with coefficients in a basis. The ground only has to know how high most particles
    are, and then moves the body as a whole; so they are not written before somebody asks for
    them, or for one after the other.

    Attributes
    ----------
    room : (B, 6, n) float
        where positions and velocities are written
    start : (B, 3, n) float
        positions at the tick before, m
    unwritten : (Basis, (B, 6, C) float) or None
        a basis and their coefficients in it, while nothing is written
    received : (B, 2, 3) float
        impulse, m/s, and turning impulse about the centre of mass, m²/s, that contacts have given
        in this tick, per mass: the stages change them in place
    pressed : (B, 3) float
        what others that lie on a body add to its weight, m/s²: the same

    """

    room: np.ndarray
    start: np.ndarray
    unwritten: tuple[Basis, np.ndarray] | None = None
    received: np.ndarray = field(init=False)
    pressed: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.received = np.zeros((len(self.room), 2, 3))
        self.pressed = np.zeros((len(self.room), 3))

    @property
    def x(self) -> np.ndarray:
        """(B, 3, n) float: positions, m; the stages change them in place."""
        self.write()
        return self.room[:, POSITION]

    @property
    def v(self) -> np.ndarray:
        """(B, 3, n) float: velocities, m/s; the stages change them in place."""
        self.write()
        return self.room[:, VELOCITY]

    def write(self) -> None:
        """Write positions and velocities, if that has not been done."""
        if self.unwritten is not None:
            basis, coefficients = self.unwritten
            basis.evaluate(coefficients, self.room)
            self.unwritten = None

    def heights(self, normal: np.ndarray) -> np.ndarray:
        """Return how far particles are along a normal (3,), (B, n), m."""
        if self.unwritten is None:
            return np.matmul(normal.astype(self.room.dtype, copy=False), self.x)
        basis, coefficients = self.unwritten
        along = np.matmul(normal, basis.in_world(coefficients[:, POSITION]))[:, None]
        return mapped(along.astype(self.room.dtype, copy=False), basis.functions)[:, 0]

    def places(self, body: np.ndarray, particle: np.ndarray) -> np.ndarray:
        """Return the positions (k, 3) of particles (k,) of bodies (k,), m."""
        if self.unwritten is None:
            return picked(self.x, body, particle)
        basis, coefficients = self.unwritten
        return basis.at(coefficients[:, POSITION], body, particle)

    def move(
        self,
        bodies: np.ndarray,
        centre: np.ndarray,
        velocity: np.ndarray,
        angular_velocity: np.ndarray,
        time: float,
    ) -> None:
        """
        Give bodies a rigid motion besides the one that they have, as if for some time.

        Parameters
        ----------
        bodies : (b,) int
            those whose motion is not zero
        centre, velocity, angular_velocity : (B, 3) float
            m, m/s, rad/s
        time : float
            s

        """
        if self.unwritten is not None:
            basis, coefficients = self.unwritten
            moving = rigid_motion.combination(
                basis, coefficients, centre - basis.origin, velocity, angular_velocity
            )
            coefficients[:, VELOCITY] += moving
            coefficients[:, POSITION] += time * moving
            return
        # copies of many bodies would cost more than bodies that stay
        rows = bodies if 2 * len(bodies) < len(self.room) else slice(None)
        for part in blocks(self.room.shape[2]):
            x, v = self.x[..., part], self.v[..., part]
            moving = rigid_motion.field(
                x[rows], centre[rows], velocity[rows], angular_velocity[rows]
            )
            v[rows] += moving
            if time:
                moving *= time
                x[rows] += moving


def picked(field: np.ndarray, body: np.ndarray, particle: np.ndarray) -> np.ndarray:
    """Return what a (B, 3, n) field is at particles (k,) of bodies (k,): (k, 3)."""
    # axis by axis: what is done with all of them is several times faster then
    if len(field) == 1:
        return field[0].take(particle, axis=1).T
    return field[body, _AXES, particle].T


def put(field: np.ndarray, body: np.ndarray, particle: np.ndarray, values: np.ndarray) -> None:
    """Write what `picked` returns."""
    if len(field) == 1:
        field[0][:, particle] = values.T
    else:
        field[body, _AXES, particle] = values.T
