# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
One tick of bodies with regions or pins, against the formulas in NumPy, particle by particle.

Bodies are so small that all of it also runs as plain Python, with NUMBA_DISABLE_JIT=1.
"""

import itertools

from core_helpers import body, cloud, random_rotation, sheet
from flights import (
    NO_OBSTACLES,
    Flying,
    assert_as_alone,
    assert_refuses_what_is_not_finite,
    assert_writes_the_other_half,
    disturb,
    inertia,
    inverse_inertia,
    nearest_rotation,
    pebble,
)
from kernels import of_rest_volume
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softbody_ros.core import make_surface
from softbody_ros.core.shape_matching import goal_flight, moments, pins
from softbody_ros.core.shape_matching.gains import DEGENERATE, REGULAR, RESIDUAL, put_gains
from softbody_ros.core.shape_matching.material import make_material
from softbody_ros.core.shape_matching.pins import make_pins
from softbody_ros.core.shape_matching.regions import make_regions
from softbody_ros.core.shape_matching.rest_shape import make_rest_shape
from softbody_ros.core.state import Body

pytestmark = pytest.mark.plain

MODES = ('rigid', 'linear', 'quadratic')
SOFT = ('linear', 'quadratic')
REFERENCE = 1 / 120
GRAVITY = np.array([1.0, -2.0, -9.0])
EXACT = 1e-13


class Flights(Flying):
    """Bodies that nothing touches, as `World` prepares them for the kernel."""

    def __init__(self, *configs, h=1 / 240, gravity=(0.0, 0.0, 0.0)):
        bodies = []
        for config in configs:
            rest, regions = make_rest_shape(config.mesh), None
            if config.regions_count:
                regions = make_regions(rest, config.regions_count, config.regions_overlap)
            bodies.append(Body(config, rest, regions, make_pins(config, rest)))
        super().__init__(bodies, h, gravity)
        for record, each in zip(self.state.bodies, bodies, strict=True):
            has_goals = each.regions is not None or each.pins is not None
            material = make_material(each.config, each.rest, REFERENCE, has_goals)
            put_gains(record, each.config, material, h, REFERENCE)

    def fly(self, awake=None):
        """Compute a tick of all bodies, or of some; the state stays."""
        state = self.state
        return goal_flight.fly_to_goals(
            state.bodies, self.chosen(awake), state.shapes, state.weights, state.q, state.x,
            state.v, state.stretch, state.match_centre, state.match_posture, state.regions,
            state.member, state.features, state.weighted_features, state.pinned, self.gravity,
            self.h,
        )  # fmt: skip

    def accept(self, awake=None):
        """Make the tick the state, with pinned particles where they are prescribed to be."""
        state, chosen = self.state, self.chosen(awake)
        pinned = chosen[state.bodies['pins'][chosen] > 0]
        pins.hold(
            state.bodies, pinned, state.pinned, state.pin_offset, NO_OBSTACLES, state.x, state.v,
            self.h,
        )  # fmt: skip
        super().accept(awake)


# ------------------------------------------------------------------------ the formulas, in NumPy
def undeformed(moment, stretch):
    """Return R, or R S_p, with R the rotation nearest to A_pq S_p."""
    return nearest_rotation(moment @ stretch) @ stretch


def goals_of_regions(rest, regions, y, stretch):
    """Return the goals (n, 3) of all regions together (section 4.4)."""
    weights, goals = np.maximum(rest.weights, 1e-12), np.zeros_like(y)
    for k in range(regions.count):
        members = slice(regions.first[k], regions.first[k + 1])
        share = np.zeros(len(y))
        share[regions.particle[members]] = regions.features[0, members]
        mass = share * weights
        q, centre = rest.q.T - mass @ rest.q.T / mass.sum(), mass @ y / mass.sum()
        transform = undeformed(((y - centre) * mass[:, None]).T @ q, stretch[k])
        goals += share[:, None] * (centre + rest.scale * q @ transform.T)
    return goals


class Written:
    """
    What a tick does to one body, written down: `x` and `v` are the result.

    Rigid motion, within pins; goals of the shape ahead (eq. 7, 9–12, sections 3.3, 4.2–4.4);
    oscillators about them; the rotation of the whole; the velocity that angular momentum lacks.
    """

    def __init__(self, flights, index=0):
        own, record, h = flights.bodies[index], flights.state.bodies[index], flights.h
        x, v, gravity = flights.positions(index), flights.velocities(index), flights.gravity
        w, rest, regions = own.rest.weights, own.rest, own.regions
        self.flights, self.w, self.scale = flights, w, rest.scale
        held = np.zeros(0, int) if own.pins is None else own.pins.particle
        if own.pins is not None and own.config.mode != 'rigid':
            rest, regions = own.pins.rest, own.pins.regions
        self.stretch = flights.state.plastic_state(index)
        if self.stretch is None:
            self.stretch = np.broadcast_to(np.eye(3), (1 + int(record['regions']), 3, 3))
        stiffness = record['stiffnesses'][0]

        # the motion of the pins, or of the centre of mass, and rotation about what it allows
        pivot, velocity, carried, self.axes = w @ x, w @ v, np.zeros(3), np.eye(3)
        if len(held):
            pivot, velocity = x[held].mean(axis=0), np.array(own.config.pins_velocity_linear)
            _, spread, axes = np.linalg.svd(x[held] - pivot)
            rank = int(np.sum(spread > 1e-6))
            self.axes = (axes[:1], np.zeros((0, 3)))[rank - 1] if rank else np.eye(3)
            if rank:
                carried = np.array(own.config.pins_velocity_angular)
        r, free = x - pivot, v - velocity
        spin = w @ np.cross(r, free - np.cross(carried, r))
        rate = carried + self.inverse(r) @ spin
        u = record['kept_velocity'] * (free - np.cross(rate, r))

        # what deforms: the centrifugal acceleration, and what pins withstand
        size = rate @ rate
        b = min(1.0, 0.5 * stiffness / max(size, 1e-300)) * (size * r - np.outer(r @ rate, rate))
        b = b + gravity * bool(len(held))
        b = b - np.cross(self.inverse(r) @ (w @ np.cross(r, b)), r)

        a, b_u, c, d, given, given_v, kept = record['responses'][REGULAR, RESIDUAL]
        ahead = record['look_ahead'][REGULAR]
        goal = self.goals(own.config, record, rest, regions, r + ahead * u, 0)
        if kept < 1.0:
            before, after = (
                self.goals(own.config, record, rest, regions, r + time * u, 1)
                for time in (0.0, ahead)
            )
            u_g = (after - before) / ahead
            follows, size = w @ np.sum(u * u_g, axis=1), w @ np.sum(u_g**2, axis=1)
            share = 1.0 if follows >= size else max(follows / size, 0.0)
            u = kept * u + (1.0 - kept) * share * u_g
        p = goal + a * (r - goal) + b_u * u + given * b
        s = c * (r - goal) + d * u + given_v * b
        p[held], s[held] = r[held], 0.0
        if not len(held):
            p, s = p - w @ p, s - w @ s

        # the rotation of the free rigid body, by the midpoint rule
        middle = self.inverse(r, p)
        omega = middle @ spin
        for _ in range(60):
            half = exponential(h / 2 * omega)
            torque = np.cross(half @ (w @ (r + p) / 2), gravity) if len(held) else np.zeros(3)
            omega = half @ middle @ half.T @ (spin + h / 2 * torque)
        turn = exponential(h * omega)
        spin = turn.T @ (spin + h * torque)
        after = self.inverse(p, cut=pins.THIN if len(held) else 1e-12) @ (
            spin - w @ np.cross(p, s)
        )
        carry = exponential(h * carried)
        turn = carry @ turn
        rate = carried + turn @ after
        arms = p @ turn.T
        acceleration = np.zeros(3) if len(held) else gravity
        self.x = pivot + h * velocity + h**2 / 2 * acceleration + arms
        self.v = velocity + h * acceleration + s @ turn.T + np.cross(rate, arms)

    def inverse(self, one, two=None, cut=pins.THIN):
        """Return the inverse inertia about the allowed axes, of the mean of two shapes."""
        both = [inertia(self.w, each) for each in (one, one if two is None else two)]
        mean = self.axes @ (both[0] + both[1]) @ self.axes.T / 2
        values, vectors = np.linalg.eigh(mean) if len(mean) else (np.zeros(0), np.zeros((0, 0)))
        inverses = np.where(values > cut * self.scale**2, 1.0 / np.maximum(values, 1e-300), 0.0)
        return self.axes.T @ (vectors * inverses) @ vectors.T @ self.axes

    def goals(self, config, record, rest, regions, y, which):
        """Return the goals (n, 3) of a shape, of the pull (0) or for damping (1)."""
        share = record['whole_body_weight'] if record['regions'] else 1.0
        whole = share * self.goal(config, rest, y, record, which)
        if regions is None:
            return whole
        return whole + (1.0 - share) * goals_of_regions(rest, regions, y, self.stretch[1:])

    def goal(self, config, rest, y, record, which):
        centre, beta = rest.weights @ y, record['deformation'][which]
        p, root = y - centre, np.sqrt(rest.weights)[:, None]
        f = rest.features[1:4] if config.mode == 'linear' else rest.features[1:]
        fit = np.linalg.lstsq(root * f.T, root * p, rcond=1e-9)[0].T / rest.scale
        transform, conserved = np.zeros((3, 9)), record['volume_conservation'][which]
        moment = (p * root**2).T @ rest.q.T
        transform[:, :3] = (1.0 - beta) * undeformed(moment, self.stretch[0])
        kept = of_rest_volume(fit[None], rest)[0][0] if conserved else fit
        transform[:, : kept.shape[1]] += beta * (fit + conserved * (kept - fit))
        return centre + rest.scale * (transform @ rest.features[1:]).T


def exponential(a):
    return Rotation.from_rotvec(a).as_matrix()


def assert_as_written(flights, index=0, tolerance=1e-12):
    """Compute a tick of one body, which must be the one written down."""
    written, record = Written(flights, index), flights.state.bodies[index]
    rest, own = flights.bodies[index].rest, np.array([index])
    record['received'] = 1.0  # of the tick before
    assert flights.fly(own) == 0
    assert record['degeneracy'] == 0.0
    goals = flights.state.q[:, record['first_goal'] : record['first_goal'] + record['count']]
    assert np.isfinite(goals).all()
    flights.accept(own)
    x, v = flights.positions(index), flights.velocities(index)
    size, speed = np.abs(written.x).max(), np.abs(written.v).max()
    assert np.abs(x - written.x).max() < tolerance * size
    assert np.abs(v - written.v).max() < tolerance * (speed + size / flights.h)
    assert not record['received'].any()
    if not record['pins']:
        arms = x - rest.weights @ x
        assert record['centre'] == pytest.approx(rest.weights @ x, abs=tolerance * size)
        assert record['velocity'] == pytest.approx(rest.weights @ v, abs=tolerance * speed)
        spin = rest.weights @ np.cross(arms, v)
        assert record['angular_momentum'] == pytest.approx(spin, abs=tolerance * size * speed)


# --------------------------------------------------------------------------- any tick, as written
CASES = {
    'regions': {'regions_count': 5, 'damping': 0.2, 'regions_whole_body_weight': 0.4},
    'only regions': {'regions_count': 12, 'regions_whole_body_weight': 0.0},
    'one region': {'regions_count': 1, 'regions_whole_body_weight': 1.0, 'damping': 0.3},
    'follows': {'regions_count': 4, 'deformation': 0.9, 'volume_conservation': 0.6},
    'stiff': {'regions_count': 4, 'stiffness': 1.0, 'deformation': 0.0, 'bounciness': 0.9},
    'free': {'regions_count': 4, 'stiffness': 0.0},
    'pinned': {'pins_indices': (3, 4, 17), 'damping': 0.1},
    'two pins': {'pins_indices': (3, 17)},
    'one pin and regions': {'pins_indices': (5,), 'regions_count': 6},
    'moved': {
        'pins_indices': (3, 4, 17), 'regions_count': 3, 'pins_velocity_linear': (0.5, -0.2, 0.1),
        'pins_velocity_angular': (1.0, -2.0, 0.5),
    },
    'moved axis': {'pins_indices': (3, 17), 'pins_velocity_angular': (1.0, -2.0, 0.5)},
}  # fmt: skip


@pytest.mark.parametrize('case', CASES)
@pytest.mark.parametrize('mode', SOFT)
def test_a_tick_is_what_the_formulas_say(mode, case):
    flights = Flights(body(pebble(), mode=mode, **CASES[case]), gravity=GRAVITY)
    disturb(flights, seed=7, shape=0.05)
    # pins weigh a hundred times the body: what they do not hold is known less exactly
    assert_as_written(flights, tolerance=1e-12 if 'pin' not in case else 1e-10)


@pytest.mark.parametrize('mode', SOFT)
def test_a_body_of_several_tiles_does_what_the_formulas_say(mode):
    surface = make_surface('icosphere', 0.5, 3)
    assert len(surface.vertices) > moments.TILE
    flights = Flights(body(surface, mode=mode, regions_count=3), gravity=GRAVITY)
    disturb(flights, seed=10, shape=0.05)
    assert_as_written(flights)


@pytest.mark.parametrize('count', [1, 4])
@pytest.mark.parametrize('mode', SOFT)
def test_a_dented_body_does_what_the_formulas_say(mode, count):
    flights = Flights(body(pebble(), mode=mode, regions_count=count), gravity=GRAVITY)
    disturb(flights, seed=11, shape=0.03)
    random, stretch = np.random.default_rng(0), []
    for _ in range(1 + count):
        axes = random_rotation(random.integers(1000))
        sizes = np.exp(0.1 * random.normal(size=3))
        stretch.append((axes * sizes / np.cbrt(sizes.prod())) @ axes.T)
    flights.state.set_plastic_state(0, np.array(stretch))
    # the dent is where it would be after long: in what the particles show
    flights.put(flights.positions() @ stretch[0], flights.velocities())
    assert_as_written(flights)
    assert flights.state.plastic_state(0) == pytest.approx(np.array(stretch), abs=0.0)


def test_a_body_that_no_goal_can_follow_is_led_back_by_its_rest_shape():
    flights = Flights(body(pebble(), mode='quadratic', regions_count=1,
                           regions_whole_body_weight=1.0))  # fmt: skip
    rest, record = flights.bodies[0].rest, flights.state.bodies[0]
    x = (random_rotation(1) @ np.diag([1.0, 1.0, 0.02]) @ (rest.scale * rest.q)).T
    flights.put(x, np.zeros_like(x))
    assert flights.fly() == 0
    assert record['degeneracy'] == 1.0
    moment = (rest.weights[:, None] * x).T @ rest.q.T
    goal = rest.scale * rest.q.T @ nearest_rotation(moment).T
    flights.step()
    kept = record['responses'][DEGENERATE, RESIDUAL, 0]
    assert kept != record['responses'][REGULAR, RESIDUAL, 0]
    assert flights.positions() == pytest.approx(goal + kept * (x - goal), abs=EXACT)


# -------------------------------------------------------------------------------- plastic flow
def shape_ahead(flights):
    """Return the offsets (n, 3) that are matched."""
    x, v, w = flights.positions(), flights.velocities(), flights.bodies[0].rest.weights
    r, u = x - w @ x, v - w @ v
    u = u - np.cross(inverse_inertia(w, r) @ (w @ np.cross(r, u)), r)
    return r + flights.state.bodies[0]['look_ahead'][0] * u


def fit_of_whole(flights, mode):
    """Return the fit (3, F) of the shape that is matched."""
    rest, y = flights.bodies[0].rest, shape_ahead(flights)
    root = np.sqrt(rest.weights)[:, None]
    f = rest.features[1:4] if mode == 'linear' else rest.features[1:]
    return np.linalg.lstsq(root * f.T, root * y, rcond=1e-9)[0].T / rest.scale


@pytest.mark.parametrize('mode', SOFT)
def test_what_flows_is_a_share_of_the_strain_without_its_volume(mode):
    """S_p becomes [I + c (S − I)] S_p, of which the rotation and the volume are taken away."""
    values = {'plasticity_yield': 0.01, 'plasticity_creep': 30.0, 'plasticity_max': 0.9}
    flights = Flights(body(pebble(), mode=mode, regions_count=1, **values))
    disturb(flights, seed=12, shape=0.1)
    stretch = np.eye(3)
    share = 1.0 - np.exp(-30.0 * flights.h)
    for _ in range(3):
        elastic = fit_of_whole(flights, mode)[:, :3] @ np.linalg.inv(stretch)
        _, sizes, axes = np.linalg.svd(elastic)
        grown = (axes.T * (1.0 + share * (sizes - 1.0))) @ axes @ stretch
        _, sizes, axes = np.linalg.svd(grown)
        stretch = (axes.T * sizes / np.cbrt(sizes.prod())) @ axes
        flights.step()
        assert flights.state.plastic_state(0)[0] == pytest.approx(stretch, abs=1e-12)
    assert np.abs(stretch - np.eye(3)).max() > 0.01


def test_what_flows_counts_from_the_next_tick_and_not_if_the_tick_fails():
    values = {'plasticity_yield': 0.01, 'plasticity_creep': 30.0, 'regions_count': 3}
    flowing = body(pebble(), **values)
    flights = Flights(flowing, flowing)
    for index in range(2):
        disturb(flights, index, seed=12, shape=0.1)
    flights.state.velocities(1)[2, 5] = np.inf
    with np.errstate(all='ignore'):
        assert flights.fly() == 2
    assert flights.state.bodies['flowed'].tolist() == [True, False]
    assert flights.state.plastic_state(0) is None and flights.state.plastic_state(1) is None


# ----------------------------------------------------------------------------------- conservation
@pytest.mark.parametrize(
    'values',
    [
        {'regions_count': 1},
        {'regions_count': 7},
        {'regions_count': 2, 'damping': 0.3},
        {'regions_count': 5, 'damping': 1.0, 'regions_whole_body_weight': 0.0},
        {'regions_count': 1, 'plasticity_yield': 0.0, 'plasticity_creep': 50.0},
        {'plasticity_yield': 0.0, 'plasticity_creep': 50.0, 'regions_count': 5},
        {'regions_count': 3, 'deformation': 1.0, 'stiffness': 1.0, 'bounciness': 0.0},
    ],
)
@pytest.mark.parametrize('mode', SOFT)
def test_each_tick_keeps_momentum_and_angular_momentum(mode, values):
    flights = Flights(body(pebble(), mode=mode, **values))
    disturb(flights, seed=20, speed=3.0)
    for _ in range(4):
        linear, spin = flights.momenta()
        flights.step()
        for before, after in zip((linear, spin), flights.momenta(), strict=True):
            assert np.linalg.norm(after - before) < EXACT * np.linalg.norm(before)


@pytest.mark.parametrize('in_body_axes', [False, True])
@pytest.mark.parametrize('count', [1, 5])
@pytest.mark.parametrize('mode', SOFT)
def test_a_wrench_gives_its_impulse_and_its_moment_in_a_tick(mode, count, in_body_axes):
    flights = Flights(body(pebble(), mode=mode, regions_count=count), gravity=GRAVITY)
    disturb(flights, seed=21, speed=2.0)
    rest, h = flights.bodies[0].rest, flights.h
    force, torque = np.array([30.0, -20.0, 10.0]), np.array([4.0, 5.0, -6.0])
    record = flights.state.bodies[0]
    record['has_wrench'], record['wrench'][int(in_body_axes)] = True, (force, torque)
    for _ in range(3):
        linear, spin = flights.momenta()
        arms = rest.weights[:, None] * shape_ahead(flights)
        posture = nearest_rotation(arms.T @ rest.q.T)
        flights.step()
        rotation = np.eye(3)
        if in_body_axes:
            # as they are at the middle of the tick
            half = Rotation.from_matrix(record['turn']).as_rotvec() / 2
            rotation = exponential(half) @ posture
        after = flights.momenta()
        assert after[0] == pytest.approx(linear + h * (rotation @ force + GRAVITY), rel=1e-12)
        tolerance = 1e-5 if in_body_axes else 1e-12
        assert after[1] == pytest.approx(spin + h * rotation @ torque, rel=tolerance)


def rigid_state(rest, seed):
    """Return the rest shape (n, 3), rotated and moved, and a rigid motion of it."""
    random = np.random.default_rng(seed)
    x = rest.scale * rest.q.T @ random_rotation(seed).T
    return x + random.normal(size=3), np.cross(random.normal(size=3), x) + random.normal(size=3)


@pytest.mark.parametrize('mode', SOFT)
def test_free_fall_is_a_parabola_and_deforms_nothing(mode):
    flights = Flights(body(pebble(), mode=mode, regions_count=4), gravity=GRAVITY, h=1 / 30)
    rest = flights.bodies[0].rest
    x, _ = rigid_state(rest, seed=1)
    v = np.broadcast_to([3.0, 2.0, 1.0], x.shape)
    flights.put(x, v)
    flights.step(6)
    t = 6 / 30
    assert flights.positions() == pytest.approx(x + v * t + GRAVITY * t**2 / 2, abs=EXACT)
    assert flights.velocities() == pytest.approx(v + GRAVITY * t, abs=100 * EXACT)


# ------------------------------------------------------------------------------ degenerate shapes
FLAT = {
    'sheet': sheet(),
    'rod': cloud(np.linspace((-0.5, 0.0, 0.2), (0.5, 0.3, 0.4), 9)),
    'two points': cloud([(0.0, 0.0, 0.0), (1.0, 0.5, 0.0)]),
}


@pytest.mark.parametrize('count', [1, 'one each'])
@pytest.mark.parametrize('name', FLAT)
@pytest.mark.parametrize('mode', SOFT)
def test_degenerate_shapes_at_rest_stay_and_moving_ones_keep_their_momentum(mode, name, count):
    surface = FLAT[name]
    regions = len(surface.vertices) if count == 'one each' else count
    values = {'mode': mode, 'regions_count': regions, 'plasticity_creep': 10.0}
    flights = Flights(body(surface, **values), body(surface, **values))
    x, v = rigid_state(flights.bodies[0].rest, seed=2)
    flights.put(x, np.zeros_like(x), 0)
    flights.put(x, v, 1)
    linear, spin = flights.momenta(1)
    flights.step(3)
    assert flights.positions(0) == pytest.approx(x, abs=EXACT)
    assert flights.velocities(0) == pytest.approx(np.zeros_like(x), abs=100 * EXACT)
    after = flights.momenta(1)
    assert after[0] == pytest.approx(linear, abs=EXACT)
    assert after[1] == pytest.approx(spin, abs=10 * EXACT)


# ------------------------------------------------------------------------------------- the arrays
def several():
    """Return bodies of all kinds side by side."""
    values = [{'mode': mode, 'pins_indices': (1, 2)} for mode in MODES]
    values += [{'regions_count': 5}, {'pins_indices': (1, 2, 3)}]
    values += [{'regions_count': 2, 'plasticity_creep': 9.0}]
    flights = Flights(*[body(pebble(), **each) for each in values], gravity=GRAVITY)
    for index in range(len(values)):
        disturb(flights, index, seed=index)
    return flights


def test_bodies_fly_side_by_side_as_alone_to_the_last_bit():
    assert_as_alone(several(), lambda config: Flights(config, gravity=GRAVITY), ticks=2)


def test_a_tick_writes_the_other_half_of_those_that_are_awake_and_nothing_else():
    flights = several()
    flights.step()
    flights.state.bodies['now'][[1, 4]] ^= 1  # as if they had slept
    flights.put(*rigid_state(flights.bodies[1].rest, 1), index=1)
    flights.put(*rigid_state(flights.bodies[4].rest, 1), index=4)
    assert_writes_the_other_half(flights, [0, 2, 3])
    assert_writes_the_other_half(several(), [])


VALUES = {'pins_indices': (0,)}, {'regions_count': 3}


@pytest.mark.parametrize(
    ('mode', 'values'),
    [('rigid', {'pins_indices': (0,)}), *itertools.product(SOFT, VALUES)],
)
def test_numbers_that_are_not_finite_are_refused(mode, values):
    assert_refuses_what_is_not_finite(lambda: Flights(*[body(pebble(), mode=mode, **values)] * 3))


def test_a_wrench_that_is_not_finite_is_refused():
    flights = Flights(body(pebble(), regions_count=2))
    disturb(flights)
    flights.state.bodies['has_wrench'], flights.state.bodies['wrench'][0, 0, 1, 0] = True, np.inf
    with np.errstate(all='ignore'):
        assert flights.fly() == 1
