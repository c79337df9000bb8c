# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies that nothing touches, for tests of the kernels that move them, and matches in NumPy."""

import itertools

from core_helpers import random_rotation
import numpy as np

from softbody_ros.core import Surface, make_surface
from softbody_ros.core.collision.obstacles import OBSTACLE
from softbody_ros.core.state import State
from softbody_ros.core.step import accept

NO_OBSTACLES = np.zeros(0, OBSTACLE)


def pebble():
    """Return a closed surface of 42 particles without any symmetry."""
    ball = make_surface('icosphere', 0.5, 1)
    shear = np.array([[1.0, 0.3, -0.2], [0.0, 0.8, 0.2], [0.1, 0.0, 1.2]])
    bent = ball.vertices @ shear.T
    return Surface(bent + 0.2 * bent**2 + (0.2, -0.1, 0.3), ball.faces)


class Flying:
    """Bodies that nothing touches; `fly` of a subclass computes a tick of some, or of all."""

    def __init__(self, bodies, h, gravity):
        self.bodies, self.h, self.gravity = bodies, h, np.array(gravity)
        self.state = State(bodies)

    def chosen(self, awake):
        """Return indices of bodies as kernels read them; all for None."""
        return np.arange(len(self.bodies)) if awake is None else np.array(awake, np.int64)

    def step(self, ticks=1):
        for _ in range(ticks):
            assert self.fly() == 0
            self.accept()

    def accept(self, awake=None):
        state = self.state
        accept(
            state.bodies, self.chosen(awake), state.shapes, state.weights, state.x, state.v,
            self.h, NO_OBSTACLES, state.reaction, state.normal_impulse, state.obstacle_impulse,
            state.holding, state.holder_impulse, state.obstacle_total,
        )  # fmt: skip

    def put(self, x, v, index=0):
        self.state.positions(index)[:], self.state.velocities(index)[:] = x.T, v.T

    def positions(self, index=0):
        return self.state.positions(index).T.copy()

    def velocities(self, index=0):
        return self.state.velocities(index).T.copy()

    def momenta(self, index=0):
        """Return Σ w v and Σ w (x − centre) × v."""
        w, x, v = self.bodies[index].rest.weights, self.positions(index), self.velocities(index)
        return w @ v, w @ np.cross(x - w @ x, v)


def disturb(flights, index=0, seed=0, shape=0.1, speed=1.0):
    """Rotate, deform and bend a body, and let its particles move."""
    random, rest = np.random.default_rng(seed), flights.bodies[index].rest
    linear = random_rotation(seed) @ (np.eye(3) + shape * random.normal(size=(3, 3)))
    bend = shape * random.normal(size=(3, 6))
    x = rest.scale * (linear @ rest.features[1:4] + bend @ rest.features[4:])
    x += 0.2 * shape * rest.scale * random.normal(size=x.shape)
    v = speed * rest.scale * random.normal(size=(len(rest.weights), 3))
    v += np.cross(speed * random.normal(size=3), x.T) + random.normal(size=3)
    flights.put(x.T + random.normal(size=3), v, index)


def nearest_rotation(moment):
    """Return the proper rotation nearest to a matrix (section 3.3)."""
    u, _, vt = np.linalg.svd(moment)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt


def inertia(w, arms):
    """Return the inertia of particles of weights w at arms from their centre, (3, 3)."""
    return np.einsum('n,ni,ni->', w, arms, arms) * np.eye(3) - (arms * w[:, None]).T @ arms


def inverse_inertia(w, arms):
    """Return its pseudo-inverse."""
    return np.linalg.pinv(inertia(w, arms), rcond=1e-12, hermitian=True)


# --------------------------------------------------------------------------------- of any flight
def assert_as_alone(together, alone_of, ticks):
    """Bodies side by side fly as alone, to the last bit; `alone_of` makes the flight of one."""
    together.step(ticks)
    for index, own in enumerate(together.bodies):
        alone = alone_of(own.config)
        disturb(alone, seed=index)
        alone.step(ticks)
        assert np.array_equal(alone.positions(), together.positions(index))
        assert np.array_equal(alone.velocities(), together.velocities(index))


def assert_writes_the_other_half(flights, awake):
    """A tick writes the other half of those that are awake, and nothing else."""
    x, v = flights.state.x.copy(), flights.state.v.copy()
    assert flights.fly(awake) == 0
    for index, record in enumerate(flights.state.bodies):
        columns = flights.state.columns(index)
        for field, before in ((flights.state.x, x), (flights.state.v, v)):
            same = [np.array_equal(field[k, :, columns], before[k, :, columns]) for k in range(2)]
            assert same[record['now']]
            assert same[1 - record['now']] == (index not in awake)


def assert_refuses_what_is_not_finite(three):
    """Numbers that are not finite are refused, with their body; `three` makes three bodies."""
    for field, bad in itertools.product('xv', (np.nan, np.inf, -1e300)):
        flights = three()
        for index in range(3):
            disturb(flights, index, seed=index)
        first = flights.state.bodies['first'][1]
        getattr(flights.state, field)[0, 1, first + 7] = bad
        with np.errstate(all='ignore'):
            assert flights.fly() == 2
        assert not flights.state.bodies['now'].any()
        assert flights.fly([0, 2]) == 0
