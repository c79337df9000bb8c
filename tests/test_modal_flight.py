# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The flight of bodies as modal systems: modes, conservation, energy, and what contacts will need.

Bodies are so small that most of it also runs as plain Python, with NUMBA_DISABLE_JIT=1.
"""

import itertools

from compiled_code import vector_instructions
from core_helpers import (
    body,
    breathing,
    cad_mesh,
    frequency_and_decay,
    random_rotation,
    rank_deficient_shapes,
    sheared_box,
    stretch,
    wrinkle,
)
from flights import (
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
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from softbody_ros.core import Surface, make_surface
from softbody_ros.core.body import BODY
from softbody_ros.core.compiled import is_compiled, kernel
from softbody_ros.core.geometry.vectors import matrix_of, put_matrix, vector_of
from softbody_ros.core.lanes import LANES
from softbody_ros.core.shape_matching import flight_map, free_rotation, modal_flight
from softbody_ros.core.shape_matching.gains import (
    BREATHING,
    FOLLOWED,
    RESIDUAL,
    damping_ratio,
    oscillator_response,
    put_gains,
)
from softbody_ros.core.shape_matching.material import KAPPA, make_material, natural_frequency
from softbody_ros.core.shape_matching.plasticity import largest_permanent_strain
from softbody_ros.core.shape_matching.rest_shape import SHAPE, make_rest_shape
from softbody_ros.core.state import Body, State

MODES = ('rigid', 'linear', 'quadratic')
SOFT = ('linear', 'quadratic')
REFERENCE = 1 / 120
GRAVITY = np.array([1.0, -2.0, -9.0])
EXACT = 1e-13


def ticks(count):
    """Return a number of ticks, fewer of them in plain Python."""
    return count if is_compiled() else max(count // 100, 3)


class Flights(Flying):
    """Bodies that nothing touches."""

    def __init__(
        self, *configs, h=1 / 240, gravity=(0.0, 0.0, 0.0), kappa=KAPPA, reference=REFERENCE
    ):
        bodies = [
            Body(
                config,
                make_rest_shape(make_surface(config.mesh, config.size, config.subdivisions)),
            )
            if isinstance(config.mesh, str)
            else Body(config, make_rest_shape(config.mesh))
            for config in configs
        ]
        super().__init__(bodies, h, gravity)
        for record, each in zip(self.state.bodies, bodies, strict=True):
            material = make_material(each.config, each.rest, reference, False)
            put_gains(record, each.config, material, h, reference, kappa)

    def fly(self, awake=None):
        """Compute a tick of all bodies, or of some; the state stays."""
        state = self.state
        return modal_flight.fly(
            state.bodies, self.chosen(awake), state.shapes, state.weights, state.q, state.x,
            state.v, state.stretch, state.match_centre, state.match_posture, state.regions,
            state.member, state.weighted_features, state.faces, self.gravity,
            self.h,
        )  # fmt: skip

    def flown(self, index=0):
        """Return positions and velocities that `fly` has computed."""
        now, columns = self.state.bodies['now'][index], self.state.columns(index)
        return self.state.x[1 - now, :, columns].T.copy(), self.state.v[
            1 - now, :, columns
        ].T.copy()

    def features(self, index=0):
        """Return the features (F, n) of the mode of a body."""
        own = self.bodies[index]
        return own.rest.features[1 : 10 if own.config.mode == 'quadratic' else 4]

    def distortion(self, index=0):
        """Return the RMS distance from the nearest rigid pose, relative to the RMS radius."""
        rest, x = self.bodies[index].rest, self.positions(index)
        arms = x - rest.weights @ x
        turn = nearest_rotation((arms * rest.weights[:, None]).T @ rest.q.T)
        far = arms - rest.scale * rest.q.T @ turn.T
        return np.sqrt(rest.weights @ np.sum(far**2, axis=1)) / rest.scale


# -------------------------------------------------------------------------- the formulas, in NumPy
def exponential(a):
    return Rotation.from_rotvec(a).as_matrix()


class Match:
    """The match of a body as it is now: P, T, the nearest T of the rest volume; m."""

    def __init__(self, flights, index=0):
        own, self.f = flights.bodies[index], flights.features(index)
        self.rest, self.w = own.rest, own.rest.weights
        self.x, self.v = flights.positions(index), flights.velocities(index)
        self.r = self.x - self.w @ self.x
        plastic = flights.state.plastic_state(index)
        stretch = np.eye(3) if plastic is None else plastic[0]
        turn = nearest_rotation((self.r * self.w[:, None]).T @ self.rest.q.T @ stretch)
        self.turn = turn
        self.undeformed = np.zeros((3, len(self.f)))
        self.undeformed[:, :3] = self.rest.scale * turn @ stretch
        self.fit = self.fitted(self.r)
        self.kept = (
            self.rest.scale * of_rest_volume(self.fit[None] / self.rest.scale, self.rest)[0][0]
        )
        self.residual = self.r - self.f.T @ self.fit.T
        self.of_record = flights.state.bodies[index]

    def fitted(self, field):
        """Return the transform of the features nearest to a field (n, 3)."""
        root = np.sqrt(self.w)[:, None]
        return np.linalg.lstsq(root * self.f.T, root * field, rcond=1e-9)[0].T

    def product(self, a, b):
        """Return Σ w (A f) · (B f)."""
        return self.w @ np.sum((a @ self.f) * (b @ self.f), axis=0)

    def volume_direction(self):
        """Return the transform of size 1 along which the volume changes."""
        way = self.kept - self.fit
        return way / np.sqrt(self.product(way, way))

    def energy(self):
        """Return kinetic and elastic energy per mass."""
        followed, residual, breathing = self.of_record['stiffnesses']
        deviation, way = self.fit - self.undeformed, self.kept - self.fit
        return 0.5 * (
            self.w @ np.sum((self.v - self.w @ self.v) ** 2, axis=1)
            + followed * self.product(deviation, deviation)
            + (breathing - followed) * self.product(way, way)
            + residual * self.w @ np.sum(self.residual**2, axis=1)
        )


# ------------------------------------------------------------------------------------------- gains
@pytest.mark.parametrize('zeta', [0.0, 0.3, 0.999999, 1.0])
@pytest.mark.parametrize('phase', [0.0, 1e-5, 0.3, 0.499, 0.501, 3.0, 40.0])
def test_the_response_is_that_of_the_differential_equation(zeta, phase):
    h = 1 / 240
    omega = phase / h
    # of y / h², u / h, the force and its change in a tick: numbers of the size of 1
    generator = np.zeros((4, 4))
    generator[0, 1] = generator[1, 2] = generator[2, 3] = 1.0
    generator[1, :2] = -(phase**2), -2 * zeta * phase
    expected = expm(generator)[:2]
    a, b, c, d, e, f, g = oscillator_response(omega, zeta, h)
    found = np.array([[a, b / h, e / h**2, g / h**3], [c * h, d, f / h, e / h**2]])
    assert found == pytest.approx(expected, rel=1e-10, abs=1e-12)


@pytest.mark.parametrize('phase', [1e-9, 1e-3, 0.4, 2.0, 30.0])
def test_a_constant_force_holds_its_displacement_at_any_step(phase):
    h = 1 / 100
    omega = phase / h
    a, _, c, _, e, f, _ = oscillator_response(omega, 0.5, h)
    y = 3.0
    force = omega**2 * y
    assert a * y + e * force == pytest.approx(y, rel=1e-14)
    assert abs(c * y + f * force) < 1e-14 * (abs(c * y) + 1e-300) + 1e-300


def test_no_blend_of_responses_amplifies():
    """Degenerate states blend those of their own and of critical damping, linearly."""
    grid = (0.0, 0.05, 0.5, 1.0)
    rest = make_rest_shape(make_surface('box', 0.5, 0))
    for alpha, beta, bounciness, h in itertools.product(
        grid, (0.0, 0.5, 0.9, 1.0), (0.0, 0.5, 0.95, 1.0), (1e-3, 1 / 240, 1 / 60, 0.1)
    ):
        flights = body(stiffness=alpha, deformation=beta, bounciness=bounciness, elasticity=1.0)
        record = np.zeros(1, State([]).bodies.dtype)[0]
        material = make_material(flights, rest, REFERENCE, False)
        put_gains(record, flights, material, h, REFERENCE)
        for kind, share in itertools.product(range(3), np.linspace(0.0, 1.0, 11)):
            regular, degenerate, touching = record['responses'][:, kind]
            assert (touching == regular).all()  # as elasticity is 1
            stepped = (regular + share * (degenerate - regular))[:4].reshape(2, 2)
            largest = np.abs(np.linalg.eigvals(stepped)).max()
            assert largest <= 1.0 + 1e-7, (alpha, beta, bounciness, h, kind, share)


# ------------------------------------------------------------------------------- whitened features
@pytest.mark.parametrize('name', ['pebble', *rank_deficient_shapes()])
def test_whitened_features_have_unit_moments_where_the_shape_spans_them(name):
    surface = pebble() if name == 'pebble' else rank_deficient_shapes()[name]
    rest = make_rest_shape(surface)
    for count, matrix in ((3, rest.whitening_linear), (9, rest.whitening_quadratic)):
        psi = matrix @ rest.features[1 : 1 + count]
        spanned = matrix.any(axis=1)
        rank = np.linalg.matrix_rank(
            rest.features[1 : 1 + count] * np.sqrt(rest.weights), tol=1e-6
        )
        assert spanned.sum() == rank
        assert (psi * rest.weights) @ psi.T == pytest.approx(np.diag(spanned * 1.0), abs=1e-9)


@kernel
def all_whitened(body, shape, q, result):
    psi = np.zeros(9)
    for i in range(body['count']):
        for k in range(flight_map.whitened_features(body, shape, q, body['first'] + i, psi)):
            result[i, k] = psi[k]


@pytest.mark.parametrize('mode', MODES)
def test_features_of_single_particles_are_those_of_the_shape(mode):
    flights = Flights(body(mode='rigid'), body(pebble(), mode=mode))
    rest, state = flights.bodies[1].rest, flights.state
    result = np.zeros((len(rest.weights), 9))
    all_whitened(state.bodies[1], state.shapes[state.bodies['shape'][1]], state.q, result)
    expected = np.zeros_like(result)
    if mode == 'linear':
        expected[:, :3] = (rest.whitening_linear @ rest.features[1:4]).T
    if mode == 'quadratic':
        expected = (rest.whitening_quadratic @ rest.features[1:]).T
    assert result == pytest.approx(expected, abs=1e-12)


# ------------------------------------------------------------------------------------ conservation
MESHES = {
    'pebble': pebble(),
    'box': sheared_box(),
    'CAD': make_surface(cad_mesh('power_connector'), 0.5, 0),
}


@pytest.mark.parametrize(
    'values', [{}, {'volume_conservation': 0.0, 'damping': 0.05}, {'stiffness': 1.0}]
)
@pytest.mark.parametrize('mesh', MESHES)
@pytest.mark.parametrize('mode', MODES)
def test_momentum_and_angular_momentum_are_kept(mode, mesh, values):
    flights = Flights(body(MESHES[mesh], mode=mode, **values))
    disturb(flights, seed=4, speed=2.0)
    linear, spin = flights.momenta()
    for _ in range(10):
        flights.step(ticks(100))
        now = flights.momenta()
        # a rounding that is the same in each tick would be 1e-12
        assert np.linalg.norm(now[0] - linear) < 3e-13 * np.linalg.norm(linear)
        assert np.linalg.norm(now[1] - spin) < 1e-12 * np.linalg.norm(spin)


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('h', [1 / 30, 1 / 240])
def test_the_centre_of_mass_moves_on_a_parabola(mode, h):
    flights = Flights(body(pebble(), mode=mode), gravity=GRAVITY, h=h)
    disturb(flights, seed=5)
    w = flights.bodies[0].rest.weights
    start, velocity = w @ flights.positions(), flights.momenta()[0]
    flights.step(12)
    t = 12 * h
    assert w @ flights.positions() == pytest.approx(
        start + velocity * t + GRAVITY * t**2 / 2, abs=1e-12
    )
    assert flights.momenta()[0] == pytest.approx(velocity + GRAVITY * t, abs=1e-12)


def rigid_state(rest, seed):
    """Return the rest shape (n, 3), rotated and moved, and a rigid motion of it."""
    random = np.random.default_rng(seed)
    x = rest.scale * rest.q.T @ random_rotation(seed).T
    return x + random.normal(size=3), np.cross(random.normal(size=3), x) + random.normal(size=3)


@pytest.mark.parametrize('mode', MODES)
def test_falling_deforms_nothing(mode):
    flights = Flights(body(pebble(), mode=mode), gravity=GRAVITY, h=1 / 30)
    x, _ = rigid_state(flights.bodies[0].rest, seed=1)
    v = np.broadcast_to([3.0, 2.0, 1.0], x.shape)
    flights.put(x, v)
    flights.step(6)
    t = 6 / 30
    assert flights.positions() == pytest.approx(x + v * t + GRAVITY * t**2 / 2, abs=EXACT)
    assert flights.velocities() == pytest.approx(v + GRAVITY * t, abs=100 * EXACT)


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('in_body_axes', [False, True])
@pytest.mark.parametrize('values', [{}, {'plasticity_creep': 1.0, 'plasticity_yield': 0.0}])
def test_a_wrench_gives_its_impulse_and_its_moment_in_a_tick(mode, in_body_axes, values):
    flights = Flights(body(pebble(), mode=mode, **values), gravity=GRAVITY)
    disturb(flights, seed=6)
    flights.step(3)
    record, h = flights.state.bodies[0], flights.h
    force, torque = np.array([3.0, -1.0, 2.0]), np.array([0.5, 1.5, -1.0])
    record['has_wrench'], record['wrench'][int(in_body_axes)] = True, (force, torque)
    start, (linear, spin) = Match(flights), flights.momenta()
    flights.step()
    axes = np.eye(3)
    if in_body_axes:
        # as they are at the middle of the tick
        axes = exponential(Rotation.from_matrix(record['turn']).as_rotvec() / 2) @ start.turn
    after = flights.momenta()
    assert after[0] == pytest.approx(linear + h * (axes @ force + GRAVITY), rel=1e-12)
    assert after[1] == pytest.approx(spin + h * axes @ torque, rel=1e-5 if in_body_axes else 1e-12)
    centre = start.w @ start.x + h * linear + h * h / 2 * (axes @ force + GRAVITY)
    assert start.w @ flights.positions() == pytest.approx(centre, rel=1e-12)
    assert record['angular_momentum'] == pytest.approx(after[1], rel=1e-12)


@pytest.mark.parametrize('mode', MODES)
def test_a_torque_turns_a_body_at_rest_within_the_tick_as_a_force_moves_it(mode):
    flights = Flights(body(pebble(), mode=mode), h=1 / 60)
    x, _ = rigid_state(flights.bodies[0].rest, seed=4)
    flights.put(x, np.zeros_like(x))
    record, h, m = flights.state.bodies[0], flights.h, Match(flights)
    torque = np.array([5e-3, -3e-3, 2e-3])  # that what its turn does to the inertia is small
    record['has_wrench'], record['wrench'][0, 1] = True, torque
    assert flights.fly() == 0
    expected = exponential(h * h / 2 * inverse_inertia(m.w, m.r) @ torque)
    assert record['turn'] == pytest.approx(expected, abs=1e-11)
    assert np.abs(expected - np.eye(3)).max() > 1e-6
    assert flights.flown()[0] == pytest.approx(m.w @ x + m.r @ expected.T, abs=1e-11)


# ---------------------------------------------------------------------------------------- rotation
def test_the_rotation_by_a_vector_is_that_of_scipy():
    random = np.random.default_rng(0)
    vectors = random.normal(size=(200, 3)) * 10.0 ** random.uniform(-9, 2, size=(200, 1))
    found = np.empty((200, 3, 3))
    all_rotations(vectors, found)
    assert found == pytest.approx(exponential(vectors), abs=2e-13)
    assert found @ found.swapaxes(1, 2) == pytest.approx(
        np.tile(np.eye(3), (200, 1, 1)), abs=1e-15
    )
    huge = np.empty((2, 3, 3))
    all_rotations(np.array([[1e9, -2e8, 3.0], [1e150, 0.0, 0.0]]), huge)
    assert huge @ huge.swapaxes(1, 2) == pytest.approx(np.tile(np.eye(3), (2, 1, 1)), abs=1e-15)


@kernel
def all_rotations(vectors, result):
    for k in range(len(vectors)):
        put_matrix(result[k], free_rotation.rotation_by(vector_of(vectors[k])))


def brick():
    """Return a box with sides 0.6, 0.8 and 1: three different principal inertias."""
    surface = make_surface('box', 0.5, 1)
    return Surface(surface.vertices * (0.6, 0.8, 1.0), surface.faces)


def euler(principal, omega, times):
    """Return the angular velocity of the free rigid body in its own axes, (t, 3)."""
    a, b, c = principal

    def rate(_, w):
        return [(b - c) / a * w[1] * w[2], (c - a) / b * w[2] * w[0], (a - b) / c * w[0] * w[1]]

    return solve_ivp(rate, (0.0, times[-1]), omega, t_eval=times, rtol=1e-10, atol=1e-10).y.T


def tumbling(mode, h, seconds, hertz, **values):
    """Return Ω about the middle axis over time, times, and the principal inertias."""
    config = body(brick(), mode=mode, stiffness=1.0, deformation=0.0, **values)
    # cos(ω h₀) = 1 − 1 / 2
    flights = Flights(config, h=h, reference=1.0 / (6.0 * hertz))
    rest = flights.bodies[0].rest
    q = rest.scale * rest.q.T
    principal = np.diag(inertia(rest.weights, q))
    omega = np.array([5.0, 49.5, 5.0])
    assert sorted(principal)[1] == principal[1]
    flights.put(q, np.cross(omega, q))
    found = [omega]
    for _ in range(round(seconds / h)):
        flights.step()
        now = Match(flights)
        rate = inverse_inertia(now.w, now.r) @ flights.momenta()[1]
        found.append(now.turn.T @ rate)
    return np.array(found), np.arange(len(found)) * h, principal


def times_of(seconds):
    """Return close times."""
    return np.linspace(0.0, seconds, round(1e4 * seconds) + 1)


def flips(omega, times):
    """Return the times at which Ω about the middle axis changes sign."""
    middle = omega[:, 1]
    before = np.flatnonzero(middle[:-1] * middle[1:] < 0)
    share = middle[before] / (middle[before] - middle[before + 1])
    return times[before] + share * (times[before + 1] - times[before])


@pytest.mark.skipif(not is_compiled(), reason='thousands of ticks')
@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('bounciness', [0.5, 1.0])
def test_a_stiff_box_tumbles_about_its_middle_axis_with_the_period_of_euler(mode, bounciness):
    omega, times, principal = tumbling(mode, 1 / 240, 6.0, 300.0, bounciness=bounciness)
    wanted = flips(euler(principal, omega[0], times_of(6.0)), times_of(6.0))
    found = flips(omega, times)
    assert len(wanted) >= 3
    assert np.diff(found)[: len(wanted) - 1] == pytest.approx(
        np.diff(wanted)[: len(found) - 1], rel=0.02
    )


@pytest.mark.skipif(not is_compiled(), reason='hundreds of ticks')
def test_a_rigid_box_does_so_at_almost_a_radian_in_a_tick():
    omega, times, principal = tumbling('rigid', 1 / 60, 6.0, 300.0)
    wanted = flips(euler(principal, omega[0], times_of(6.0)), times_of(6.0))
    found = flips(omega, times)
    assert len(found) == len(wanted) >= 8
    assert np.diff(found) == pytest.approx(np.diff(wanted), rel=1e-3)
    energy = (omega**2 * principal).sum(axis=1)
    assert energy == pytest.approx(energy[0], rel=1e-6)


@kernel
def split(inverse, spin, h, result):
    put_matrix(result, free_rotation.split_rotation(matrix_of(inverse), vector_of(spin), h[0]))


@pytest.mark.parametrize('omega', [(0.3, 50.0, 0.1), (10.0, 30.0, -20.0), (200.0, 1.0, 2.0)])
@pytest.mark.parametrize(
    'principal', [(0.05, 0.03, 0.02), (1e-4, 0.05, 0.0501), (0.02, 0.05, 0.02)]
)
def test_rotations_about_axes_in_turn_are_that_of_a_free_body(principal, omega):
    inertia, omega = np.diag(principal), np.array(omega)
    inverse, momentum, h = np.linalg.inv(inertia), inertia @ omega, 1 / 60

    def rate(_, flat):
        turn = flat.reshape(3, 3)
        x, y, z = turn @ inverse @ turn.T @ momentum
        return (np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ turn).ravel()

    exact = solve_ivp(rate, (0.0, h), np.eye(3).ravel(), rtol=1e-11, atol=1e-12).y[:, -1]
    found = np.empty((3, 3))
    split(inverse, momentum, np.array([h]), found)
    assert found == pytest.approx(exact.reshape(3, 3), abs=1e-6)


# ---------------------------------------------------------------------------- any tick, as written
CASES = {
    'soft': {},
    'damped': {'damping': 0.3, 'volume_conservation': 0.0},
    'follows': {'deformation': 0.9, 'volume_conservation': 0.6, 'bounciness': 0.1},
    'stiff': {'stiffness': 1.0, 'deformation': 0.0, 'bounciness': 0.9},
    'free': {'stiffness': 0.0},
    'dented': {'plasticity_creep': 40.0, 'plasticity_yield': 0.0},
}


@pytest.mark.parametrize('case', CASES)
@pytest.mark.parametrize('mode', SOFT)
@pytest.mark.parametrize('spinning', [False, True])
def test_a_tick_is_what_the_formulas_say(mode, case, spinning):
    flights = Flights(body(pebble(), mode=mode, **CASES[case]), gravity=GRAVITY)
    disturb(flights, seed=7, shape=0.03)
    flights.step(2)  # what is dented has flowed then
    m, h, record = Match(flights), flights.h, flights.state.bodies[0]
    w, r, f = m.w, m.r, m.f
    velocity, spin = flights.momenta()
    if not spinning:
        m.v = m.v - np.cross(inverse_inertia(w, r) @ spin, r)
        spin = np.zeros(3)
        flights.put(m.x, m.v)
    omega = inverse_inertia(w, r) @ spin
    u = record['kept_velocity'] * (m.v - velocity - np.cross(omega, r))
    U = m.fitted(u)

    config = flights.bodies[0].config
    gains = record['responses'][0]
    followed, residual, breathing = gains
    a = m.volume_direction()
    P, Y = m.undeformed, m.fit - m.undeformed
    T = P + followed[0] * Y + followed[1] * U
    S = followed[2] * Y + followed[3] * U
    # along a, springs to P and to the rest volume
    soft, stiff = record['stiffnesses'][FOLLOWED], record['stiffnesses'][BREATHING]
    if stiff > 0.0:
        rest = m.product(a, P) + (1.0 - soft / stiff) * m.product(a, m.kept - P)
        at, speed = m.product(a, m.fit) - rest, m.product(a, U)
        T = T + a * (rest + breathing[0] * at + breathing[1] * speed - m.product(a, T))
        S = S + a * (breathing[2] * at + breathing[3] * speed - m.product(a, S))
    y, z = m.residual, u - (U @ f).T
    p = (T @ f).T + residual[0] * y + residual[1] * z
    s = (S @ f).T + residual[2] * y + residual[3] * z
    centre, velocity = w @ m.x + h * velocity + h * h / 2 * GRAVITY, velocity + h * GRAVITY

    assert flights.fly() == 0
    assert record['degeneracy'] == 0.0
    x, v = flights.flown()
    E = record['turn']
    if spinning:
        # by the midpoint rule to third order, and but for the centrifugal acceleration
        middle = inverse_inertia(np.tile(w / 2, 2), np.vstack([r, p]))
        half = exponential(h / 2 * middle @ spin)
        expected = exponential(h * half @ middle @ half.T @ spin)
        assert expected == pytest.approx(E, abs=3e-5)
        assert np.abs(expected - np.eye(3)).max() > 1e-3
        assert x == pytest.approx(centre + p @ E.T, abs=h * h * omega @ omega * m.rest.scale)
    else:
        assert np.abs(E - np.eye(3)).max() < EXACT
        assert x == pytest.approx(centre + p, abs=EXACT)
        rate = inverse_inertia(w, p) @ (-(w @ np.cross(p, s)))
        assert v == pytest.approx(velocity + s + np.cross(rate, p), abs=1e3 * EXACT)
    arms = x - w @ x
    assert w @ np.cross(arms, v) == pytest.approx(spin, abs=10 * EXACT)
    assert (config.plasticity_creep > 0.0) == bool(record['is_plastic'])


@pytest.mark.parametrize('mode', MODES)
def test_a_rigid_motion_is_one_of_the_free_rigid_body(mode):
    """Undeformed bodies turn by the midpoint rule; soft ones widen as the square of the spin."""
    flights = Flights(body(brick(), mode=mode))
    rest, h = flights.bodies[0].rest, flights.h
    x, v = rigid_state(rest, seed=3)
    flights.put(x, v)
    velocity, spin = flights.momenta()
    r = x - rest.weights @ x
    inverse = inverse_inertia(rest.weights, r)
    rate = inverse @ spin
    for _ in range(20):
        half = exponential(h / 2 * rate)
        rate = half @ inverse @ half.T @ spin
    flights.step()
    wide = h * h * rate @ rate * rest.scale
    expected = rest.weights @ x + h * velocity + r @ exponential(h * rate).T
    assert flights.positions() == pytest.approx(expected, abs=1e-11 if mode == 'rigid' else wide)
    assert wide < 1e-4


@pytest.mark.skipif(not is_compiled(), reason='thousands of ticks')
def test_a_disc_that_spins_is_as_wide_as_the_centrifugal_force_makes_it():
    config = body('cylinder', mode='linear', volume_conservation=0.0, bounciness=0.1)
    found = []
    for h in (1 / 60, 1 / 240):
        flights = Flights(config, h=h)
        rest = flights.bodies[0].rest
        q = rest.scale * rest.q.T
        flights.put(q, np.cross((0.0, 0.0, 20.0), q))
        flights.step(round(2.0 / h))
        m = Match(flights)
        rate = np.linalg.norm(inverse_inertia(m.w, m.r) @ flights.momenta()[1])
        stretches = np.linalg.svd(m.fit / rest.scale)[1]
        widened = 1.0 / (1.0 - rate**2 / flights.state.bodies[0]['stiffnesses'][FOLLOWED])
        assert stretches[:2] == pytest.approx([widened] * 2, rel=2e-3)
        found.append(stretches[0])
    assert found[0] > 1.02
    assert found[0] == pytest.approx(found[1], rel=1e-3)


# ------------------------------------------------------------------------------------------- modes
def history(config, h, deviation, seconds, kappa=KAPPA):
    """Return the amplitudes over time of a small deviation from the rest shape."""
    flights = Flights(config, h=h, kappa=kappa)
    rest = flights.bodies[0].rest
    q = rest.scale * rest.q.T
    shape = deviation(q, rest.weights)
    flights.put(q + 1e-4 * shape, np.zeros_like(q))
    amplitudes = [1.0]
    for _ in range(round(seconds / h)):
        flights.step()
        projection = np.einsum('n,ni,ni->', rest.weights, flights.positions() - q, shape)
        amplitudes.append(projection / np.einsum('n,ni,ni->', rest.weights, shape, shape) / 1e-4)
    return np.array(amplitudes)


@pytest.mark.skipif(not is_compiled(), reason='thousands of ticks')
@pytest.mark.parametrize(
    ('deviation', 'kind', 'volume_conservation'),
    [
        (stretch, FOLLOWED, 0.0),
        (stretch, FOLLOWED, 1.0),
        (breathing, FOLLOWED, 0.0),
        (breathing, BREATHING, 0.2),
        (breathing, BREATHING, 0.5),
        (wrinkle, RESIDUAL, 1.0),
    ],
)
@pytest.mark.parametrize('mode', SOFT)
@pytest.mark.parametrize(
    ('alpha', 'bounciness', 'beta'),
    [(0.5, 0.5, 0.5), (0.1, 0.9, 0.3), (0.9, 0.2, 0.8), (0.5, 1.0, 0.0)],
)
def test_frequency_and_decay_are_those_of_the_parameters_at_any_step(
    mode, deviation, kind, volume_conservation, alpha, bounciness, beta
):
    config = body(
        'box',
        subdivisions=2,
        mode=mode,
        stiffness=alpha,
        bounciness=bounciness,
        deformation=beta,
        volume_conservation=volume_conservation,
    )
    omega, zeta = natural_frequency(alpha, REFERENCE), damping_ratio(bounciness)
    followed = natural_frequency((1.0 - beta) * alpha, REFERENCE)
    if kind == FOLLOWED:
        omega = followed
    elif kind == BREATHING:
        ratio = volume_conservation / (1.0 - volume_conservation)
        omega = np.sqrt(followed**2 + ratio * (omega**2 - followed**2))
    kappa = 3.0
    if kind == RESIDUAL:
        # so slow that even at 1/60 a period has samples; κ multiplies the frequency
        kappa = 0.5
        omega, zeta = kappa * omega, max(zeta, 0.7)
    for h in (1 / 60, 1 / 240, 1 / 960):
        seconds = max(0.1, 3 / (zeta * omega + 10)) if kind != RESIDUAL else 0.1
        frequency, decay = frequency_and_decay(history(config, h, deviation, seconds, kappa), h)
        assert frequency == pytest.approx(omega * np.sqrt(1 - zeta**2), rel=0.005)
        assert decay == pytest.approx(omega * zeta, rel=0.005, abs=1e-3 * omega)


def symmetric_ball():
    """Return a closed surface that is its own mirror image at x = 0, y = 0 and z = 0."""
    ball = make_surface('icosphere', 0.5, 1)
    bumps = 1.0 + np.sum(ball.vertices**2 * (0.4, -0.3, 0.0), axis=1)
    return Surface(ball.vertices * bumps[:, None] * (1.2, 1.0, 0.8), ball.faces)


def symmetric_state(flights, seed, size=0.05):
    """
    Return a deformation of the rest shape and velocities that turn nothing.

    Both are mirror images of themselves at y = 0 and z = 0, in all kinds of modes.
    """
    rest, random = flights.bodies[0].rest, np.random.default_rng(seed)
    x, y, z = q = rest.q
    even = np.stack([x, x * x, y * y, z * z, x**3, x * y * y, x * z * z, x * y * y * z * z])
    fields = []
    for _ in range(2):
        a, b, c = size * random.normal(size=(3, len(even)))
        field = np.stack([a @ even, y * (b @ even + b[0]), z * (c @ even + c[0])])
        field -= (field @ rest.weights)[:, None]
        fields.append(rest.scale * field.T)
    return rest.scale * q.T + fields[0], 30.0 * fields[1]


@pytest.mark.parametrize('mode', SOFT)
@pytest.mark.parametrize('volume_conservation', [0.0, 0.5, 1.0])
@pytest.mark.parametrize('h', [1 / 1000, 1 / 240, 1 / 60, 1 / 20])
def test_a_force_that_balances_a_deformed_state_holds_it_at_any_step(mode, volume_conservation, h):
    """In each mode f = m ω² times its displacement: by Γ₁ and Γ₂ of the record, nothing moves."""
    flights = Flights(
        body(symmetric_ball(), mode=mode, volume_conservation=volume_conservation), h=h
    )
    x, _ = symmetric_state(flights, seed=2)
    flights.put(x, np.zeros_like(x))
    m, record = Match(flights), flights.state.bodies[0]
    assert flights.fly() == 0
    after, velocity = flights.flown()
    followed, residual, breathing = record['response']
    soft, rough, stiff = record['stiffnesses']

    # displacements and forces of the modes, in whitened features
    rest = m.rest
    W = rest.whitening_linear if mode == 'linear' else rest.whitening_quadratic
    psi = W @ m.f
    Y = (psi * m.w) @ (m.r - (m.undeformed @ m.f).T)
    a = W @ record['volume_moment'][: len(psi)]
    assert np.sum(a * a) == pytest.approx(1.0, rel=1e-9)
    lacking = record['volume_share'] * m.product(m.volume_direction(), m.kept - m.undeformed)
    lacking *= np.sign(np.sum(a * ((psi * m.w) @ (m.kept @ m.f).T - (psi * m.w) @ m.r)))
    lacking *= np.sign(m.product(m.volume_direction(), m.kept - m.fit))
    along = np.sum(a * Y)
    moved = followed[:1] * soft * Y + a * (
        breathing[0] * stiff * (along - lacking) - followed[0] * soft * along
    )
    sped = followed[1] * soft * Y + a * (
        breathing[1] * stiff * (along - lacking) - followed[1] * soft * along
    )
    assert after + psi.T @ moved + residual[0] * rough * m.residual == pytest.approx(x, abs=1e-11)
    speed = velocity + psi.T @ sped + residual[1] * rough * m.residual
    assert np.abs(speed).max() < 1e-9 * max(1.0, np.abs(velocity).max())
    assert np.abs(after - x).max() > 1e-5


@pytest.mark.parametrize('beta', [0.0, 0.5, 0.9])
@pytest.mark.parametrize('mode', SOFT)
def test_without_damping_at_the_reference_step_positions_are_those_of_the_published_scheme(
    mode, beta
):
    """
    Eq. 9–10 of Müller et al. 2005, for states that do not turn.

    Both obey x₊ − 2 x + x₋ = α (g − x). With φ = ω h₀ of a mode, the published velocity is
    v* = (x − x₋) / h, ours sin φ v = φ (v* + v*₊) / 2.
    """
    alpha = 0.4
    config = body(
        symmetric_ball(),
        mode=mode,
        stiffness=alpha,
        bounciness=1.0,
        deformation=beta,
        volume_conservation=0.0,
    )
    flights = Flights(config, h=REFERENCE, kappa=1.0)
    for kind in range(2):
        # the residual is always damped, but for this comparison
        omega = natural_frequency(alpha, REFERENCE)
        flights.state.bodies[0]['responses'][kind, RESIDUAL] = oscillator_response(
            omega, 0.0, REFERENCE
        )
    flights.put(*symmetric_state(flights, seed=3))
    before, start = flights.positions(), flights.velocities()
    flights.step()
    x = flights.positions()
    v = (x - before) / REFERENCE
    published = Flights(config)
    for _ in range(ticks(300)):
        published.put(x, v)
        m = Match(published)
        # rounding of 300 ticks, summed up twice: of a unit 300² 2⁻⁵² = 2e-11
        assert flights.positions() == pytest.approx(x, abs=1e-10)
        goal = (beta * m.fit + (1 - beta) * m.undeformed) @ m.f
        v = v + alpha * (goal.T - m.r) / REFERENCE
        x = x + REFERENCE * v
        flights.step()
    assert np.abs(m.r - (m.undeformed @ m.f).T).max() > 0.01
    assert np.abs(start).max() > 0.1


# ------------------------------------------------------------------------------------------ energy
@pytest.mark.skipif(not is_compiled(), reason='thousands of ticks')
@pytest.mark.parametrize('mode', SOFT)
@pytest.mark.parametrize(
    'h', [1 / 20, 1 / 60, 1 / 240, pytest.param(1 / 960, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    ('values', 'spin', 'rounding'),
    [
        ({'volume_conservation': 0.4}, 0.0, 1e-12),
        ({'volume_conservation': 0.0, 'bounciness': 1.0}, 0.0, 1e-12),
        ({'bounciness': 1.0}, 0.0, None),
        ({'deformation': 0.9, 'bounciness': 0.9}, 0.0, None),
        ({'volume_conservation': 0.4}, 5.0, 1e-12),
        ({}, 0.0, None),
        ({}, 5.0, None),
        ({'bounciness': 1.0}, 5.0, None),
        ({}, 20.0, None),
        ({'stiffness': 1.0, 'bounciness': 1.0}, 20.0, None),
    ],
)
def test_energy_never_grows(mode, h, values, spin, rounding):
    """At each tick; and undamped, where the direction of volume turns or a body spins, in all."""
    flights = Flights(body(pebble(), mode=mode, **values), h=h)
    disturb(flights, seed=8, shape=0.05, speed=0.5)
    m = Match(flights)
    lacking = inverse_inertia(m.w, m.r) @ flights.momenta()[1]
    flights.put(m.x, m.v + np.cross(spin * np.array([0.6, 0.0, 0.8]) - lacking, m.r))
    energies = [Match(flights).energy()]
    for _ in range(round(1.0 / h)):
        flights.step()
        energies.append(Match(flights).energy())
    energies = np.array(energies) / energies[0]
    assert energies.max() <= 1.0 + 1e-12
    if rounding is not None:
        assert np.diff(energies).max() < rounding


# --------------------------------------------------------------------------------------- any state
STATES = {
    'inverted': lambda q, random: -q,
    'mirrored': lambda q, random: q * (-1.0, 1.0, 1.0),
    'its own plane': lambda q, random: q * (1.0, 1.0, 0.0),
    'a line': lambda q, random: q * (1.0, 0.0, 0.0),
    'a point': lambda q, random: 0.0 * q,
    'random': lambda q, random: np.sqrt(np.mean(q**2)) * random.normal(size=q.shape),
    'shuffled': lambda q, random: random.permutation(q),
    'scaled 100 times': lambda q, random: 100.0 * q,
    'scaled to 1 %': lambda q, random: 0.01 * q,
    'stretched 100 times': lambda q, random: q * (100.0, 1.0, 1.0),
}
MATERIALS = {
    'default': {},
    'soft': {'stiffness': 0.05, 'deformation': 0.7, 'volume_conservation': 0.5},
    'bouncing': {'bounciness': 0.9, 'deformation': 0.9},
    'stiff': {'stiffness': 1.0, 'bounciness': 0.0, 'deformation': 0.0, 'damping': 0.05},
    'plastic': {'plasticity_creep': 50.0, 'plasticity_yield': 0.05, 'plasticity_max': 0.2},
}


@pytest.mark.skipif(not is_compiled(), reason='thousands of ticks')
@pytest.mark.parametrize('material', MATERIALS)
@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('h', [1 / 30, 1 / 240])
@pytest.mark.parametrize('moving', [False, True])
def test_any_state_comes_back(mode, material, h, moving):
    config = body(pebble(), mode=mode, **MATERIALS[material])
    flights = Flights(*[config] * len(STATES), h=h)
    random, rest = np.random.default_rng(1), flights.bodies[0].rest
    for index, state in enumerate(STATES.values()):
        q = rest.scale * rest.q.T @ random_rotation(index).T
        x, v, w = state(q, random), np.zeros_like(q), rest.weights
        if moving:
            # but for their angular momentum: what spins is wide
            v, arms = random.normal(size=q.shape), x - w @ x
            v -= w @ v
            v -= np.cross(inverse_inertia(w, arms) @ (w @ np.cross(arms, v)), arms)
        flights.put(x + index, v + (1.0, 0.0, -2.0), index)
    softest = natural_frequency((1.0 - config.deformation) * config.stiffness, REFERENCE)
    seconds = 20.0 / (damping_ratio(config.bounciness) * softest)
    for _ in range(round(seconds / h)):
        assert flights.fly() == 0
        flights.accept()
    for index, state in enumerate(STATES):
        if material == 'plastic':
            plastic = flights.state.plastic_state(index)
            assert plastic is None or largest_permanent_strain(plastic) <= 0.2 + 1e-12
        else:
            assert flights.distortion(index) < 0.01, state


@pytest.mark.skipif(not is_compiled(), reason='thousands of ticks')
@pytest.mark.parametrize('material', ['default', 'bouncing', 'soft'])
@pytest.mark.parametrize('mode', SOFT)
@pytest.mark.parametrize('h', [1 / 30, pytest.param(1 / 240, marks=pytest.mark.slow)])
def test_any_state_that_spins_is_wide_but_bounded(mode, material, h):
    """Up to 1e5 rad/s, which is left of the angular momentum of a body 100 times its size."""
    flights = Flights(*[body(pebble(), mode=mode, **MATERIALS[material])] * len(STATES), h=h)
    random, rest = np.random.default_rng(2), flights.bodies[0].rest
    for index, state in enumerate(STATES.values()):
        x = state(rest.scale * rest.q.T @ random_rotation(index).T, random)
        v = random.normal(size=x.shape) + np.cross([3.0, -8.0, 5.0], x)
        flights.put(x + index, v, index)
    before = [flights.momenta(index)[1] for index in range(len(STATES))]
    flights.step(round(5.0 / h))
    for index, state in enumerate(STATES):
        assert flights.distortion(index) < 1.0, state
        spin = flights.momenta(index)[1]
        if state not in ('a point', 'scaled to 1 %'):
            # rounding, where it turns by up to 1000 rad in a tick
            assert np.linalg.norm(spin - before[index]) < 1e-8 * np.linalg.norm(spin)


# ------------------------------------------------------------------------------- degenerate shapes
@pytest.mark.parametrize('name', rank_deficient_shapes())
@pytest.mark.parametrize('mode', MODES)
def test_degenerate_shapes_at_rest_stay_and_moving_ones_keep_their_momentum(mode, name):
    values = {'mode': mode, 'plasticity_creep': 10.0}
    surface = rank_deficient_shapes()[name]
    flights = Flights(*[body(surface, **values)] * 3)
    x, v = rigid_state(flights.bodies[0].rest, seed=2)
    flights.put(x, np.zeros_like(x), 0)
    flights.put(x, v, 1)
    disturb(flights, 2, seed=3, shape=0.05)
    if mode == 'rigid':
        # a rod has no spin about itself
        flights.step()
        flights.put(x, np.zeros_like(x), 0)
    before = [flights.momenta(index) for index in (1, 2)]
    flights.step(3)
    assert flights.positions(0) == pytest.approx(x, abs=EXACT)
    assert np.abs(flights.velocities(0)).max() < 100 * EXACT
    for index, (linear, spin), tolerance in zip((1, 2), before, (1.0, 1e3), strict=True):
        after = flights.momenta(index)
        assert after[0] == pytest.approx(linear, abs=tolerance * EXACT)
        assert after[1] == pytest.approx(spin, abs=10 * tolerance * EXACT)
    flights.step(ticks(1000))
    for index in range(3):
        assert np.isfinite(flights.positions(index)).all()
        if mode != 'rigid' and is_compiled():
            assert largest_permanent_strain(flights.state.stretch) <= 0.3 + 1e-12


# -------------------------------------------------------------------------------------- plasticity
@pytest.mark.parametrize('mode', SOFT)
def test_what_yields_keeps_its_strain_and_what_does_not_comes_back(mode):
    values = {'mode': mode, 'plasticity_yield': 0.1, 'plasticity_creep': 5.0}
    configs = [
        body(pebble(), **values),
        body(pebble(), **values | {'plasticity_yield': 0.3}),
        body(pebble(), **values | {'plasticity_creep': 0.0}),
        body(pebble(), **values | {'plasticity_creep': 500.0, 'plasticity_max': 0.05}),
        body(pebble(), **values | {'mode': 'rigid'}),
    ]
    flights = Flights(*configs)
    rest = flights.bodies[0].rest
    strained = rest.scale * rest.q.T * (1.2, 0.95, 1.0 / (1.2 * 0.95))
    for index in range(len(configs)):
        flights.put(strained, np.zeros_like(strained), index)
    flights.step(ticks(480))
    strains = [
        0.0 if each is None else largest_permanent_strain(each)
        for each in map(flights.state.plastic_state, range(len(configs)))
    ]
    assert strains[1] == strains[2] == strains[4] == 0.0
    assert 0.005 < strains[0] < 0.2
    assert strains[3] == pytest.approx(0.05, abs=1e-12)
    if is_compiled():
        for index in (1, 2):
            assert flights.distortion(index) < 1e-3
        for index in (0, 3):
            assert flights.distortion(index) > 0.3 * strains[index]
            m = Match(flights, index)
            assert np.abs(m.fit - m.undeformed).max() < 1e-3 * rest.scale


# ------------------------------------------------------------------------- what contacts will need
@kernel
def start_shape(bodies, index, x, v, result, flown, h, bounds):
    bounds[0], bounds[1] = flight_map.put_start_shape(bodies[index], x, v, result, flown, h)


@pytest.mark.parametrize('mode', SOFT)
def test_the_start_shape_of_a_body_that_moves_rigidly_is_its_flight_wherever_it_is(mode):
    flights = Flights(body(pebble(), mode=mode))
    rest, record = flights.bodies[0].rest, flights.state.bodies[0]
    assert len(rest.weights) % LANES, 'some lanes of the last particles have none'
    x = rigid_state(rest, seed=3)[0]
    flights.put(x + (100.0, -50.0, 20.0), np.cross((1e-3, 0.0, 0.0), x) + (3.0, 0.0, 0.0))
    assert flights.fly() == 0
    now, bounds = record['now'], np.ones(2)
    result = flights.state.x[1 - now].copy()
    before, flown = (flights.state.x[now], flights.state.v[now]), np.empty_like(result)
    start_shape(flights.state.bodies, 0, *before, result, flown, flights.h, bounds)
    assert bounds == pytest.approx(0.0, abs=1e-8)
    assert pytest.approx(flights.flown()[0], abs=1e-8) == result.T


@kernel
def whiten_both(body, shape, result):
    flight_map.whiten(body, shape, body['shape_moment'], result[0])
    flight_map.whiten(body, shape, body['volume_moment'], result[1])


@pytest.mark.parametrize('mode', MODES)
def test_the_record_says_where_particles_are_and_how_the_body_responds(mode):
    flights = Flights(body(pebble()), body(pebble(), mode=mode, damping=0.1), gravity=GRAVITY)
    disturb(flights, 0, seed=1)
    disturb(flights, 1, seed=9)
    flights.step(2)
    m, state = Match(flights, 1), flights.state
    record = state.bodies[1]
    assert flights.fly() == 0
    x, v = flights.flown(1)
    start, now = state.x[1 - record['now']].copy(), record['now']
    shape, flown = state.shapes[record['shape']], np.full_like(start, np.nan)
    before, bounds = (state.x[now], state.v[now]), np.zeros(2)
    start_shape(state.bodies, 1, *before, start, flown, flights.h, bounds)
    own = slice(record['first'], record['first'] + record['count'])
    assert (flown.T[own] == x).all() and np.isnan(flown.T[: own.start]).all()
    start = start[:, own]
    for bound, moved in zip(bounds, (x, m.x + flights.h * m.v), strict=True):
        largest = np.linalg.norm(moved - start.T, axis=1).max()
        assert largest <= bound < len(x) ** 0.125 * largest + 1e-3

    turn, w = record['turn'], m.w
    assert np.abs(turn @ turn.T - np.eye(3)).max() < 1e-15
    assert record['start_centre'] == pytest.approx(w @ m.x, abs=EXACT)
    assert record['centre'] == pytest.approx(w @ x, abs=EXACT)
    assert record['velocity'] == pytest.approx(w @ v, abs=1e2 * EXACT)
    turned = record['centre'] + m.r @ turn.T
    assert pytest.approx(turned, abs=EXACT) == start.T
    arms = x - w @ x
    assert record['angular_momentum'] == pytest.approx(w @ np.cross(arms, v), abs=1e2 * EXACT)
    assert record['inverse_inertia'] == pytest.approx(inverse_inertia(w, arms), rel=1e-9)
    assert record['start_inverse_inertia'] == pytest.approx(
        inverse_inertia(w, m.r @ turn.T), rel=1e-9
    )
    W = m.rest.whitening_quadratic if mode == 'quadratic' else m.rest.whitening_linear
    psi = W @ m.f
    moments = np.zeros((2, 9, 3))
    whiten_both(record, shape, moments)
    moments = moments[:, : len(psi)]
    assert record['shape_moment'][: len(psi)] == pytest.approx(
        (m.f * w) @ (m.r @ turn.T), abs=1e-12
    )
    assert moments[0] == pytest.approx((psi * w) @ (m.r @ turn.T), abs=1e-12)
    if mode == 'rigid':
        assert not record['response'].any()
    else:
        assert np.array_equal(record['response'], record['responses'][0][:, 4:6])
        a = moments[1]
        way = (psi * w) @ ((m.kept - m.fit) @ m.f).T @ turn.T
        assert abs(np.sum(a * way)) == pytest.approx(np.linalg.norm(way), rel=1e-9)
        assert np.sum(a * a) == pytest.approx(1.0, rel=1e-9)


# -------------------------------------------------------------------------------------- the arrays
def several():
    """Return bodies of all kinds side by side."""
    values = [{'mode': mode} for mode in MODES]
    values += [{'damping': 0.1}, {'plasticity_creep': 9.0, 'plasticity_yield': 0.0}]
    flights = Flights(*[body(pebble(), **each) for each in values], gravity=GRAVITY)
    for index in range(len(values)):
        disturb(flights, index, seed=index)
    return flights


def test_bodies_fly_side_by_side_as_alone_to_the_last_bit():
    assert_as_alone(several(), lambda config: Flights(config, gravity=GRAVITY), ticks=5)


def test_a_tick_writes_the_other_half_of_those_that_are_awake_and_nothing_else():
    flights = several()
    flights.step()
    assert_writes_the_other_half(flights, [0, 3])


@pytest.mark.parametrize('mode', MODES)
def test_numbers_that_are_not_finite_are_refused(mode):
    assert_refuses_what_is_not_finite(lambda: Flights(*[body(pebble(), mode=mode)] * 3))


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('part', [0, 1])
def test_a_wrench_that_is_not_finite_is_refused(mode, part):
    flights = Flights(body(pebble(), mode=mode))
    disturb(flights)
    flights.state.bodies['has_wrench'] = True
    flights.state.bodies['wrench'][0, 0, part, 0] = np.inf
    with np.errstate(all='ignore'):
        assert flights.fly() == 1


# --------------------------------------------------------------------------------------- the loops
@kernel
def sum_up(x, v, w, bodies, shapes, result):
    zero = (0.0, 0.0, 0.0)
    second = modal_flight.second_moments(
        x, v, bodies[0], shapes[0], w, zero, zero, (zero, zero, zero)
    )
    put_matrix(result[0], second.rv)
    put_matrix(result[1], second.vv)


@kernel
def write_down(x, v, q, bodies, shapes, new_x, new_v):
    flight_map.write(x, v, bodies[0], shapes[0], q, new_x, new_v)


@pytest.mark.skipif(not is_compiled(), reason='plain Python has no instructions')
def test_the_loops_over_particles_are_of_vector_instructions():
    bodies, shapes, field = np.zeros(1, BODY), np.zeros(1, SHAPE), np.ones((3, 512))
    bodies['count'] = 512
    sum_up(field, field, np.ones(512), bodies, shapes, np.empty((2, 3, 3)))
    # 6 differences, 6 products with weights, 15 products and sums
    assert vector_instructions(sum_up) >= 42
    write_down(field, field, field, bodies, shapes, field.copy(), field.copy())
    # 6 of features, 18 products of matrices of 3 × 3, but for those that are fused
    assert vector_instructions(write_down) >= 150


@pytest.mark.parametrize('count', [1, 2, 3, 4, 5, 41])
def test_second_moments_are_sums_over_all_particles_whatever_their_number(count):
    random = np.random.default_rng(count)
    x, v = random.normal(size=(2, 3, count + 2))
    w, result = random.uniform(size=count + 3), np.empty((2, 3, 3))
    bodies, shapes = np.zeros(1, BODY), np.zeros(1, SHAPE)
    bodies['first'], bodies['count'], shapes['first'] = 1, count, 2
    sum_up(x, v, w, bodies, shapes, result)
    own, x, v = w[2 : 2 + count], x[:, 1 : 1 + count], v[:, 1 : 1 + count]
    assert result[0] == pytest.approx((x * own) @ v.T, rel=1e-13, abs=1e-14)
    assert result[1] == pytest.approx((v * own) @ v.T, rel=1e-13, abs=1e-14)
