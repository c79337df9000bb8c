# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
One tick of the flight, against the formulas written down in NumPy, particle by particle.

Bodies are so small that all of it also runs as plain Python, with NUMBA_DISABLE_JIT=1.
"""

import itertools

from core_helpers import body, cloud, random_rotation, rank_deficient_shapes, sheet
from flights import Flying, disturb, inertia, inverse_inertia, nearest_rotation, pebble
from kernels import of_rest_volume
import numpy as np
import pytest

from softbody_ros.core import make_surface
from softbody_ros.core.shape_matching import flight, moments
from softbody_ros.core.shape_matching.gains import put_gains
from softbody_ros.core.shape_matching.pins import make_pins
from softbody_ros.core.shape_matching.regions import make_regions
from softbody_ros.core.shape_matching.rest_shape import make_rest_shape
from softbody_ros.core.state import Body

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
        for record, config in zip(self.state.bodies, configs, strict=True):
            put_gains(record, config, h, REFERENCE)

    def fly(self, awake=None):
        """Compute a tick of all bodies, or of some; the state stays."""
        state = self.state
        return flight.predict_and_match(
            state.bodies, self.chosen(awake), state.shapes, state.weights, state.q, state.regions,
            state.member, state.features, state.weighted_features, state.x, state.v,
            state.region_goals,
            state.stretch, state.match_centre, state.match_posture, self.gravity, self.h,
        )  # fmt: skip


# ------------------------------------------------------------------------ the formulas, in NumPy
def angular_velocity(w, arms, angular_momentum):
    return inverse_inertia(w, arms) @ angular_momentum


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
    What a tick does to one body, written down.

    Predict, match, blend, pull (eq. 7, 9–12, sections 3.3, 4.2–4.4), damp; then the rigid rotation
    that angular momentum lacks. `x` and `v` are the result, `goals` those for velocities, of
    particles at `y`.
    """

    def __init__(self, flights, index=0):
        own, gains, h = flights.bodies[index], flights.state.bodies[index], flights.h
        x, v, g = flights.positions(index), flights.velocities(index), flights.gravity
        w, rest, regions = own.rest.weights, own.rest, own.regions
        pinned = own.pins is not None
        if pinned:
            rest, regions = own.pins.rest, own.pins.regions
        stretch = flights.state.plastic_state(index)
        if stretch is None:
            stretch = np.broadcast_to(np.eye(3), (1 + int(gains['regions']), 3, 3))

        self.y = y = x + h * v + h * h / 2 * g
        self.stretch = stretch[0]
        (s, k), beta, conserved = gains['pull'], gains['deformation'], gains['volume_conservation']
        b, share = gains['kept_velocity'], gains['whole_body_weight'] if gains['regions'] else 1.0
        self.match(own.config, rest, y)
        places = 0.0 if regions is None else goals_of_regions(rest, regions, y, stretch[1:])
        goal_x, self.goals = (
            share * self.goal(rest, beta[i], conserved[i]) + (1.0 - share) * places
            for i in range(2)
        )

        self.x = y + s * (goal_x - y)
        velocity, arms = w @ v, y - w @ y
        spin = w @ np.cross(arms, v)
        rigid = velocity + np.cross(angular_velocity(w, arms, spin), arms)
        if own.config.mode == 'rigid':
            self.v = np.broadcast_to(velocity, v.shape) + h * g
        else:
            self.v = rigid + b * (v - rigid) + h * g + k * (self.goals - y)
        if not pinned:
            arms = self.x - w @ self.x
            lacking = spin - w @ np.cross(arms, self.v)
            self.v = self.v + np.cross(angular_velocity(w, arms, lacking), arms)

    def match(self, config, rest, y):
        self.centre = rest.weights @ y
        p, root = y - self.centre, np.sqrt(rest.weights)[:, None]
        self.undeformed = undeformed((p * root**2).T @ rest.q.T, self.stretch)
        if config.mode != 'rigid':
            f = rest.features[1:4] if config.mode == 'linear' else rest.features[1:]
            self.fit = np.linalg.lstsq(root * f.T, root * p, rcond=1e-9)[0].T / rest.scale

    def goal(self, rest, beta, conserved):
        transform = np.zeros((3, 9))
        transform[:, :3] = (1.0 - beta) * self.undeformed
        if beta:
            kept = self.fit
            if conserved:
                kept = of_rest_volume(self.fit[None], rest)[0][0]
            transform[:, : kept.shape[1]] += beta * (self.fit + conserved * (kept - self.fit))
        return self.centre + rest.scale * (transform @ rest.features[1:]).T


def assert_as_written(flights, index=0, tolerance=EXACT):
    """Compute a tick of one body, which must be the one written down."""
    written, record = Written(flights, index), flights.state.bodies[index]
    rest = flights.bodies[index].rest
    record['received'], record['load'] = 1.0, 1.0  # of the tick before
    assert flights.fly() == 0
    assert record['degeneracy'] == 0.0
    flights.state.fill_goals(np.array([index]))
    goals = flights.state.goals[:, flights.state.columns(index)].T
    flights.accept(np.array([index]))
    x, v = flights.positions(index), flights.velocities(index)
    size, speed = np.abs(written.x).max(), np.abs(written.v).max()
    assert np.abs(x - written.x).max() < tolerance * size
    assert np.abs(v - written.v).max() < tolerance * (speed + size / flights.h)
    assert np.abs(goals - written.goals).max() < tolerance * size

    arms = x - rest.weights @ x
    assert record['centre'] == pytest.approx(rest.weights @ x, abs=EXACT * size)
    assert record['velocity'] == pytest.approx(rest.weights @ v, abs=EXACT * speed)
    spin = rest.weights @ np.cross(arms, v)
    assert record['angular_momentum'] == pytest.approx(spin, abs=tolerance * size * speed)
    expected = np.linalg.pinv(inertia(rest.weights, arms), rcond=1e-12, hermitian=True)
    error = np.abs(record['inverse_inertia'] - expected).max()
    assert error < 10 * tolerance * np.abs(expected).max()
    assert not record['received'].any() and not record['load'].any()


# ---------------------------------------------------------------------------- the published scheme
@pytest.mark.parametrize('beta', [0.0, 0.5, 0.9])
@pytest.mark.parametrize('mode', SOFT)
def test_a_tick_is_the_published_scheme(mode, beta):
    """Eq. 7 and 9–12 in their own terms: moments, inverses, the goal g, and v += α (g − x) / h."""
    values = {'stiffness': 0.4, 'bounciness': 1.0, 'volume_conservation': 0.0}
    flights = Flights(
        body(pebble(), mode=mode, deformation=beta, **values), h=REFERENCE, gravity=GRAVITY
    )
    disturb(flights, seed=3)
    h, w, surface = REFERENCE, flights.bodies[0].rest.weights, pebble()
    x, v = flights.positions(), flights.velocities()
    x = x + h * (v + h / 2 * GRAVITY)  # half of the gravity before, half after: a parabola

    q, p = surface.vertices - w @ surface.vertices, x - w @ x
    A_pq, A_qq = (w[:, None] * p).T @ q, np.linalg.inv((w[:, None] * q).T @ q)
    R, A = nearest_rotation(A_pq), A_pq @ A_qq
    goal = q @ (beta * A + (1 - beta) * R).T
    if mode == 'quadratic':
        a, b, c = q.T
        products = np.stack([a * a, b * b, c * c, a * b, b * c, c * a], axis=1)
        # about their mean: the published features move the centre of mass
        q = np.hstack([q, products - w @ products])
        A = (w[:, None] * p).T @ q @ np.linalg.inv((w[:, None] * q).T @ q)
        goal = q @ (beta * A + (1 - beta) * np.hstack([R, np.zeros((3, 6))])).T
    v = v + 0.4 * (goal + w @ x - x) / h + h * GRAVITY

    flights.step()
    assert flights.positions() == pytest.approx(x, abs=EXACT)
    assert flights.velocities() == pytest.approx(v, abs=1e3 * EXACT)


def test_a_rigid_tick_goes_to_the_goal_of_the_published_scheme():
    flights = Flights(body(pebble(), mode='rigid'), gravity=GRAVITY)
    disturb(flights, seed=4)
    h, w, surface = flights.h, flights.bodies[0].rest.weights, pebble()
    x = flights.positions() + h * flights.velocities() + h * h / 2 * GRAVITY
    q = surface.vertices - w @ surface.vertices
    R = nearest_rotation((w[:, None] * (x - w @ x)).T @ q)
    flights.step()
    assert flights.positions() == pytest.approx(q @ R.T + w @ x, abs=EXACT)
    v = flights.velocities() - w @ flights.velocities()
    gap = np.einsum('ni,ni->n', v, flights.positions() - w @ flights.positions())
    assert np.abs(gap).max() < EXACT


# --------------------------------------------------------------------------- any tick, as written
CASES = {
    'soft': {},
    'damped': {'damping': 0.3, 'volume_conservation': 0.0},
    'follows': {'deformation': 0.9, 'volume_conservation': 0.6, 'bounciness': 0.1},
    'stiff': {'stiffness': 1.0, 'deformation': 0.0, 'bounciness': 0.9},
    'free': {'stiffness': 0.0},
    'regions': {'regions_count': 5, 'damping': 0.2, 'regions_whole_body_weight': 0.4},
    'only regions': {'regions_count': 12, 'regions_whole_body_weight': 0.0},
    'pinned': {'pins_indices': (3, 4, 17), 'damping': 0.1},
    'pinned regions': {'pins_indices': (5,), 'regions_count': 6},
}


@pytest.mark.parametrize('case', CASES)
@pytest.mark.parametrize('mode', SOFT)
def test_a_tick_is_what_the_formulas_say(mode, case):
    flights = Flights(body(pebble(), mode=mode, **CASES[case]), gravity=GRAVITY)
    disturb(flights, seed=7, shape=0.05)
    # pins weigh a hundred times the body: what they do not hold is known less exactly
    assert_as_written(flights, tolerance=EXACT if 'pin' not in case else 1e-11)


@pytest.mark.parametrize('values', [{}, {'regions_count': 5}, {'damping': 0.5}])
def test_a_rigid_tick_is_what_the_formulas_say(values):
    flights = Flights(body(pebble(), mode='rigid', **values), gravity=GRAVITY)
    disturb(flights, seed=8, shape=0.1)
    assert_as_written(flights)


@pytest.mark.parametrize('name', rank_deficient_shapes())
@pytest.mark.parametrize('mode', SOFT)
def test_shapes_that_span_little_do_what_the_formulas_say(mode, name):
    surface = rank_deficient_shapes()[name]
    flights = Flights(body(surface, mode=mode, volume_conservation=0.0), gravity=GRAVITY)
    disturb(flights, seed=9, shape=0.05)
    assert_as_written(flights, tolerance=1e-11)


@pytest.mark.parametrize('mode', SOFT)
def test_a_body_of_several_tiles_does_what_the_formulas_say(mode):
    surface = make_surface('icosphere', 0.5, 3)
    assert len(surface.vertices) > moments.TILE
    flights = Flights(body(surface, mode=mode, regions_count=3), gravity=GRAVITY)
    disturb(flights, seed=10, shape=0.05)
    assert_as_written(flights)


@pytest.mark.parametrize('count', [0, 4])
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
    flights = Flights(body(pebble(), mode='quadratic'))
    rest, record = flights.bodies[0].rest, flights.state.bodies[0]
    x = (random_rotation(1) @ np.diag([1.0, 1.0, 0.02]) @ (rest.scale * rest.q)).T
    flights.put(x, np.zeros_like(x))
    assert flights.fly() == 0
    assert record['degeneracy'] == 1.0
    moment = (rest.weights[:, None] * x).T @ rest.q.T
    goal = rest.scale * rest.q.T @ nearest_rotation(moment).T
    flights.step()
    s = record['critical_pull'][0]
    assert s > record['pull'][0]
    assert flights.positions() == pytest.approx(x + s * (goal - x), abs=EXACT)


# -------------------------------------------------------------------------------- plastic flow
@pytest.mark.parametrize('mode', SOFT)
def test_what_flows_is_a_share_of_the_strain_without_its_volume(mode):
    """S_p becomes [I + c (S − I)] S_p, of which the rotation and the volume are taken away."""
    values = {'plasticity_yield': 0.01, 'plasticity_creep': 30.0, 'plasticity_max': 0.9}
    flights = Flights(body(pebble(), mode=mode, **values))
    disturb(flights, seed=12, shape=0.1)
    stretch = np.eye(3)
    share = 1.0 - np.exp(-30.0 * flights.h)
    for _ in range(3):
        elastic = Written(flights).fit[:, :3] @ np.linalg.inv(stretch)
        _, sizes, axes = np.linalg.svd(elastic)
        grown = (axes.T * (1.0 + share * (sizes - 1.0))) @ axes @ stretch
        _, sizes, axes = np.linalg.svd(grown)
        stretch = (axes.T * sizes / np.cbrt(sizes.prod())) @ axes
        flights.step()
        assert flights.state.plastic_state(0)[0] == pytest.approx(stretch, abs=1e-12)
    assert np.abs(stretch - np.eye(3)).max() > 0.01


def test_what_flows_counts_from_the_next_tick_and_not_if_the_tick_fails():
    values = {'plasticity_yield': 0.01, 'plasticity_creep': 30.0}
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
        {},
        {'regions_count': 7},
        {'damping': 0.3},
        {'regions_count': 5, 'damping': 1.0, 'regions_whole_body_weight': 0.0},
        {'plasticity_yield': 0.0, 'plasticity_creep': 50.0},
        {'plasticity_yield': 0.0, 'plasticity_creep': 50.0, 'regions_count': 5},
        {'deformation': 1.0, 'stiffness': 1.0, 'bounciness': 0.0},
    ],
)
@pytest.mark.parametrize('mode', MODES)
def test_each_tick_keeps_momentum_and_angular_momentum(mode, values):
    flights = Flights(body(pebble(), mode=mode, **values))
    disturb(flights, seed=20, speed=3.0)
    for _ in range(4):
        linear, spin = flights.momenta()
        flights.step()
        for before, after in zip((linear, spin), flights.momenta(), strict=True):
            assert np.linalg.norm(after - before) < EXACT * np.linalg.norm(before)


@pytest.mark.parametrize('in_body_axes', [False, True])
@pytest.mark.parametrize('count', [0, 5])
@pytest.mark.parametrize('mode', MODES)
def test_a_wrench_gives_its_impulse_and_its_moment_in_a_tick(mode, count, in_body_axes):
    flights = Flights(body(pebble(), mode=mode, regions_count=count), gravity=GRAVITY)
    disturb(flights, seed=21, speed=2.0)
    rest, h = flights.bodies[0].rest, flights.h
    force, torque = np.array([30.0, -20.0, 10.0]), np.array([4.0, 5.0, -6.0])
    record = flights.state.bodies[0]
    record['has_wrench'], record['wrench'][int(in_body_axes)] = True, (force, torque)
    for _ in range(3):
        linear, spin = flights.momenta()
        if in_body_axes:
            # its axes are those of the middle of the tick
            middle = flights.positions() + h / 2 * flights.velocities()
            arms = rest.weights[:, None] * (middle - rest.weights @ middle)
            rotation = nearest_rotation(arms.T @ rest.q.T)
        else:
            rotation = np.eye(3)
        flights.step()
        after = flights.momenta()
        expected = linear + h * (rotation @ force + GRAVITY), spin + h * rotation @ torque
        for now, wanted in zip(after, expected, strict=True):
            assert np.linalg.norm(now - wanted) < EXACT * np.linalg.norm(wanted)


def rigid_state(rest, seed):
    """Return the rest shape (n, 3), rotated and moved, and a rigid motion of it."""
    random = np.random.default_rng(seed)
    x = rest.scale * rest.q.T @ random_rotation(seed).T
    return x + random.normal(size=3), np.cross(random.normal(size=3), x) + random.normal(size=3)


@pytest.mark.parametrize('mode', MODES)
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
DEGENERATE = {
    'sheet': sheet(),
    'rod': cloud(np.linspace((-0.5, 0.0, 0.2), (0.5, 0.3, 0.4), 9)),
    'two points': cloud([(0.0, 0.0, 0.0), (1.0, 0.5, 0.0)]),
}


@pytest.mark.parametrize('count', [0, 'one each'])
@pytest.mark.parametrize('name', DEGENERATE)
@pytest.mark.parametrize('mode', MODES)
def test_degenerate_shapes_at_rest_stay_and_moving_ones_keep_their_momentum(mode, name, count):
    surface = DEGENERATE[name]
    regions = len(surface.vertices) if count else 0
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
    values = [{'mode': mode} for mode in MODES]
    values += [{'regions_count': 5}, {'pins_indices': (1, 2, 3)}, {'plasticity_creep': 9.0}]
    flights = Flights(*[body(pebble(), **each) for each in values], gravity=GRAVITY)
    for index in range(len(values)):
        disturb(flights, index, seed=index)
    return flights


def halves(state):
    """Return copies of what is now of positions and velocities of all bodies, and what is not."""
    return [
        [np.stack([a[n ^ half, :, state.columns(i)] for a in (state.x, state.v)])
         for i, n in enumerate(state.bodies['now'])]
        for half in (0, 1)
    ]  # fmt: skip


def test_bodies_fly_side_by_side_as_alone_to_the_last_bit():
    together = several()
    together.step(2)
    for index, own in enumerate(together.bodies):
        alone = Flights(own.config, gravity=GRAVITY)
        disturb(alone, seed=index)
        alone.step(2)
        assert np.array_equal(alone.positions(), together.positions(index))
        assert np.array_equal(alone.velocities(), together.velocities(index))


def test_a_tick_writes_the_other_half_of_those_that_are_awake_and_nothing_else():
    flights = several()
    flights.step()
    flights.state.bodies['now'][[1, 4]] ^= 1  # as if they had slept
    flights.put(*rigid_state(flights.bodies[1].rest, 1), index=1)
    flights.put(*rigid_state(flights.bodies[4].rest, 1), index=4)
    now, other = halves(flights.state)
    awake = [0, 2, 3]
    assert flights.fly(awake) == 0
    now_after, other_after = halves(flights.state)
    assert all(map(np.array_equal, now, now_after))
    changed = [not np.array_equal(*each) for each in zip(other, other_after, strict=True)]
    assert changed == [index in awake for index in range(6)]
    flights.fly([])
    assert all(map(np.array_equal, other_after, halves(flights.state)[1]))


@pytest.mark.parametrize('values', [{}, {'pins_indices': (0,)}, {'regions_count': 3}])
@pytest.mark.parametrize('mode', MODES)
def test_numbers_that_are_not_finite_are_refused(mode, values):
    for field, bad in itertools.product('xv', (np.nan, np.inf, -1e300)):
        flights = Flights(*[body(pebble(), mode=mode, **values)] * 3)
        for index in range(3):
            disturb(flights, index, seed=index)
        first = flights.state.bodies['first'][1]
        getattr(flights.state, field)[0, 1, first + 7] = bad
        now = halves(flights.state)[0]
        with np.errstate(all='ignore'):
            assert flights.fly() == 2
        assert not flights.state.bodies['now'].any()
        for before, after in zip(now, halves(flights.state)[0], strict=True):
            assert np.array_equal(before, after, equal_nan=True)
        assert flights.fly([0, 2]) == 0


def test_a_wrench_that_is_not_finite_is_refused():
    flights = Flights(body(pebble()))
    disturb(flights)
    flights.state.bodies['has_wrench'], flights.state.bodies['wrench'][0, 0, 1, 0] = True, np.inf
    now = halves(flights.state)[0]
    with np.errstate(all='ignore'):
        assert flights.fly() == 1
    assert np.array_equal(now, halves(flights.state)[0])
