# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Regions: their shares and moments, goals, conservation, local bending, awkward meshes."""

import dataclasses
import itertools
import math

from core_helpers import (
    angular_momentum,
    apart,
    assert_as_if_alone,
    assert_goes_on_bit_by_bit,
    body,
    cloud,
    disturbed,
    floating,
    frequency_and_decay,
    momentum,
    random_rotation,
    rank_deficient_shapes,
    rms_displacement,
    sheared_box,
    sheet,
)
from kernels import goals_at, match_regions
import numpy as np
import pytest

from softbody_ros.core import (
    BodyConfig,
    ConfigError,
    Surface,
    World,
    WorldConfig,
    make_surface,
)
from softbody_ros.core.shape_matching.regions import farthest_points, make_regions
from softbody_ros.core.shape_matching.rest_shape import make_rest_shape

MODES = ('rigid', 'linear', 'quadratic')
SOFT = ('linear', 'quadratic')
REFERENCE = 1 / 120


def bar():
    """Return a closed box of 10 : 1 : 1 with 1538 vertices."""
    surface = make_surface('box', 0.5, 4)
    return Surface(surface.vertices * (10.0, 1.0, 1.0), surface.faces)


def with_loose_vertices(surface=None):
    """Return a ball beside vertices that belong to no face: they weigh nothing."""
    surface = surface or make_surface('icosphere', 0.5, 1)
    loose = [(3.0, 0.0, 0.0), (3.1, 0.0, 0.0), (0.0, 0.0, 5.0)]
    return Surface(np.vstack([surface.vertices, loose]), surface.faces)


def unwelded(surface=None):
    """Return a ball of triangles that share no vertices: 240 of them at 42 places."""
    surface = surface or make_surface('icosphere', 0.5, 1)
    corners = surface.vertices[surface.faces].reshape(-1, 3)
    return Surface(corners, np.arange(len(corners)).reshape(-1, 3))


STRUCTURES = {
    'ball': (make_surface('icosphere', 0.5, 3), 64, 3),
    'box': (sheared_box(), 12, 3),
    'all vertices': (sheared_box(), 98, 4),
    'one region each': (sheared_box(), 20, 1),
    'sheet': (sheet(), 9, 2),
    'loose vertices': (with_loose_vertices(), 12, 3),
    'more overlap than regions': (sheared_box(), 3, 16),
    'one region': (sheared_box(), 1, 3),
}


@pytest.fixture(params=STRUCTURES)
def covered(request):
    """Return a rest shape, its regions, and how many regions each particle belongs to."""
    surface, count, overlap = STRUCTURES[request.param]
    rest = make_rest_shape(surface)
    return rest, make_regions(rest, count, overlap), min(count, overlap)


def shares(regions):
    """Return (n, K): the share that each particle has in each region."""
    result = np.zeros((len(regions.main_region), regions.count))
    region = np.repeat(np.arange(regions.count), np.diff(regions.first))
    result[regions.particle, region] = regions.features[0]
    return result


def goal_of_each_mode(config, x, h=REFERENCE):
    """Return the goals for velocities (B, 3, n) of bodies at x (B, 3, n) that have a config."""
    world = floating(config, h=h, reference_step=REFERENCE)
    return np.stack([goals_at(world, 0, each) for each in x])


# ---------------------------------------------------------------------------------------- shares
def distances_to_seeds(rest, regions):
    """Return (n, K): how far each particle is from the seed of each region."""
    points = (rest.surface.vertices - rest.centre) / rest.scale
    seeds = points[farthest_points(points, regions.count)]
    return np.linalg.norm(points[:, None] - seeds, axis=2)


def test_each_particle_shares_all_of_itself_among_its_regions(covered):
    rest, regions, overlap = covered
    share = shares(regions)
    assert share.sum(axis=1) == pytest.approx(np.ones(len(share)), abs=1e-12)
    assert share.min() >= 0.0
    # as many as asked for, fewer only where the next seed is just as near as one of them
    near = np.sort(distances_to_seeds(rest, regions), axis=1)
    next_one = near[:, overlap, None] if overlap < regions.count else np.inf
    nearer = np.count_nonzero(near[:, :overlap] < next_one - 1e-9, axis=1)
    assert np.array_equal(np.count_nonzero(share > 1e-15, axis=1), np.maximum(nearer, 1))


def test_the_nearer_the_seed_the_larger_the_share(covered):
    rest, regions, _ = covered
    order = np.argsort(distances_to_seeds(rest, regions), axis=1, kind='stable')
    in_order = np.take_along_axis(shares(regions), order, axis=1)
    assert np.all(in_order[:, 1:] <= in_order[:, :-1] + 1e-12)


def test_seeds_are_as_far_from_each_other_as_can_be():
    points = np.random.default_rng(1).normal(size=(200, 3))
    chosen = farthest_points(points, 200)
    assert sorted(chosen) == list(range(200))
    assert chosen[0] == np.argmax(np.linalg.norm(points, axis=1))
    for count in range(1, 200):
        away = np.linalg.norm(points[:, None] - points[chosen[:count]], axis=2).min(axis=1)
        assert away[chosen[count]] == away.max()


def test_places_where_vertices_coincide_are_chosen_once():
    points = np.repeat(np.random.default_rng(1).normal(size=(7, 3)), 5, axis=0)
    chosen = farthest_points(points, 35)
    assert len(np.unique(points[chosen], axis=0)) == len(chosen) == 7


def test_shares_change_continuously_along_a_line():
    """Where the next seed comes nearer, the share of the one that is left has vanished."""
    along = np.linspace(0.0, 1.0, 4001)
    rod = cloud(np.stack([along, 0.3 * along, 0.1 * np.sin(9.0 * along)], axis=1))
    for overlap in (2, 3):
        share = shares(make_regions(make_rest_shape(rod), 9, overlap))
        assert np.all(share.max(axis=0) > 0.5)
        assert np.all(share.min(axis=0) == 0.0)
        assert np.abs(np.diff(share, axis=0)).max() < 0.004


# --------------------------------------------------------------------------------------- moments
def test_masses_are_the_sums_of_what_gathers_the_moments(covered):
    rest, regions, _ = covered
    mass = np.add.reduceat(regions.weighted_features[0], regions.first[:-1])
    assert mass == pytest.approx(regions.mass, abs=1e-15)
    assert regions.mass.sum() == pytest.approx(1.0, abs=1e-11)
    assert regions.mass.min() > 0.0
    assert regions.mass == pytest.approx(
        shares(regions).T @ np.maximum(rest.weights, 1e-12), rel=1e-12
    )


def brute_force(rest, regions, x):
    """Return centres (K, 3), moments (K, 3, 3) and goals (3, n), one particle after the other."""
    points, weights = rest.features[1:4].T, np.maximum(rest.weights, 1e-12)
    share, place = shares(regions), np.zeros_like(x)
    centres, moments = [], []
    for k in range(regions.count):
        mass, rest_centre, centre = 0.0, np.zeros(3), np.zeros(3)
        for i in range(len(points)):
            mass += share[i, k] * weights[i]
            rest_centre += share[i, k] * weights[i] * points[i]
            centre += share[i, k] * weights[i] * x[:, i]
        rest_centre /= mass
        centre /= mass
        moment = np.zeros((3, 3))
        for i in range(len(points)):
            arm = (x[:, i] - centre) / rest.scale
            moment += share[i, k] * weights[i] * np.outer(arm, points[i] - rest_centre)
        u, _, vt = np.linalg.svd(moment)
        turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
        for i in range(len(points)):
            goal = centre + rest.scale * turn @ (points[i] - rest_centre)
            place[:, i] += share[i, k] * goal
        centres.append(centre)
        moments.append(moment)
    return np.array(centres), np.array(moments), place


@pytest.mark.parametrize('name', ['box', 'one region each', 'more overlap than regions'])
def test_moments_and_goals_are_those_of_a_loop_over_regions_and_particles(name):
    surface, count, overlap = STRUCTURES[name]
    rest = make_rest_shape(surface)
    regions = make_regions(rest, count, overlap)
    random = np.random.default_rng(3)
    q = surface.vertices.T
    x = np.stack([random_rotation(i) @ q + 0.2 * random.normal(size=q.shape) for i in range(2)])
    for each in x:
        centre, moment, place = match_regions(each, regions, rest)
        centres, moments, expected = brute_force(rest, regions, each)
        assert centre == pytest.approx(centres, abs=1e-12)
        assert moment == pytest.approx(moments, abs=1e-12)
        assert place == pytest.approx(expected, abs=1e-9)


def test_a_body_at_rest_or_moved_rigidly_is_at_its_goal(covered):
    rest, regions, _ = covered
    x = random_rotation(5) @ rest.surface.vertices.T + np.array([[0.3], [-2.0], [1.0]])
    assert match_regions(x, regions, rest)[2] == pytest.approx(x, abs=1e-11)


@pytest.mark.parametrize('whole', [0.0, 0.3, 1.0])
def test_the_goal_is_shared_by_the_whole_body_and_its_regions(whole):
    config = body(sheared_box(), mode='quadratic', regions_count=9, bounciness=1.0)
    x = config.mesh.vertices.T[None] * np.array([1.2, 0.9, 1.0])[:, None]
    x = x + 0.1 * np.sin(3.0 * x[:, [1, 2, 0]])

    def goal(**values):
        return goal_of_each_mode(dataclasses.replace(config, **values), x)

    of_whole = goal(regions_whole_body_weight=1.0)
    of_regions = goal(regions_whole_body_weight=0.0)
    assert np.abs(of_whole - of_regions).max() > 0.01
    assert goal(regions_whole_body_weight=whole) == pytest.approx(
        whole * of_whole + (1.0 - whole) * of_regions, abs=1e-12
    )


# ---------------------------------------------------------------------------------- conservation
@pytest.mark.parametrize('count', [1, 12, 98])
@pytest.mark.parametrize('mode', MODES)
def test_free_flight_keeps_momentum_and_angular_momentum(mode, count):
    world = floating(body(sheared_box(), mode=mode, regions_count=count), h=1 / 240)
    disturbed(world, seed=4, shape=0.1, speed=2.0)
    linear, spin = momentum(world), angular_momentum(world)
    for _ in range(20):
        world.step(10)
        assert np.linalg.norm(momentum(world) - linear) < 1e-12 * np.linalg.norm(linear)
        assert np.linalg.norm(angular_momentum(world) - spin) < 1e-12 * np.linalg.norm(spin)


@pytest.mark.parametrize(
    ('whole', 'volume_conservation', 'tolerance'),
    # two steps to the rest volume are not the nearest shape to the last digit
    [(0.0, 1.0, 1e-6), (0.3, 0.0, 1e-6), (0.3, 1.0, 1e-3)],
)
@pytest.mark.parametrize('mode', SOFT)
def test_the_pull_has_a_potential(mode, whole, volume_conservation, tolerance):
    """The derivative of a force that has one is symmetric, at any deformation."""
    config = body(
        mode=mode,
        bounciness=1.0,
        volume_conservation=volume_conservation,
        regions_count=8,
        regions_whole_body_weight=whole,
    )
    world = floating(config)
    disturbed(world, seed=2, shape=0.1)
    x, weights = world.positions('body').T[None], world.rest_shape('body').weights
    step, size = 1e-5, x.size
    near = x.reshape(1, size) + step * np.vstack([np.eye(size), -np.eye(size)])
    near = near.reshape(-1, *x.shape[1:])
    # at the reference step without damping the pull is the distance from the goal
    goal = goal_of_each_mode(config, near)
    pull = (weights * (goal - near)).reshape(2, size, size)
    derivative = (pull[0] - pull[1]) / (2.0 * step)
    assert np.abs(derivative - derivative.T).max() < tolerance * np.abs(derivative).max()


def test_undamped_oscillations_do_not_grow():
    bodies = [
        body(
            name=f'b{i}',
            mode=mode,
            bounciness=1.0,
            deformation=deformation,
            regions_count=12,
            regions_whole_body_weight=whole,
        )
        for i, (mode, deformation, whole) in enumerate(
            itertools.product(SOFT, (0.0, 0.5, 0.9), (0.0, 0.3))
        )
    ]
    world = floating(*apart(bodies), h=1 / 60)
    for name in world.names:
        disturbed(world, name, seed=3, shape=0.1, speed=0.1)

    def root_mean_square(seconds):
        squares = []
        for _ in range(round(60 * seconds / 2)):
            world.step(2)
            squares.append([rms_displacement(world, name) ** 2 for name in world.names])
        return np.sqrt(np.mean(squares, axis=0))

    first = root_mean_square(1.0)
    world.step(18 * 60)
    last = root_mean_square(1.0)
    assert first.min() > 0.1
    assert np.all(last <= 1.1 * first)
    assert np.all(last > 0.5 * first)


# ------------------------------------------------------------------------------- step independence
def softest_bends(config, count):
    """Return a body's `count` slowest deformations (3, n) and the share of the pull each feels."""
    world = floating(config)
    weights, x = world.rest_shape('body').weights, world.positions('body').T[None]
    step, size = 1e-6, x.size
    near = (x.reshape(1, size) + step * np.eye(size)).reshape(-1, *x.shape[1:])
    undamped = dataclasses.replace(config, bounciness=1.0)
    pull = (near - goal_of_each_mode(undamped, near)).reshape(size, size) / step
    root = np.sqrt(np.tile(weights, 3))
    matrix = root * pull / root[:, None]
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2.0)
    slow = np.flatnonzero(values > 1e-3)[:count]  # the others are rigid motions
    return vectors.T[slow].reshape(-1, *x.shape[1:]) / np.sqrt(weights), values[slow]


def frequency_and_decay_of(config, shape, h, seconds=0.3):
    world = floating(config, h=h, reference_step=REFERENCE)
    weights, start = world.rest_shape('body').weights, world.positions('body')
    world.set_state('body', start + 1e-4 * shape.T)
    amplitudes = [1.0]
    for _ in range(round(seconds / h)):
        world.step()
        offset = (world.positions('body') - start).T
        amplitudes.append(np.sum(weights * offset * shape) / np.sum(weights * shape**2) / 1e-4)
    return frequency_and_decay(np.array(amplitudes), h)


@pytest.mark.parametrize('mode', SOFT)
def test_regions_bend_at_the_same_frequency_at_any_step(mode):
    config = body('box', subdivisions=2, mode=mode, regions_count=12, bounciness=1.0)
    shapes, felt = softest_bends(config, 9)
    for shape, share in zip(shapes[::4], felt[::4], strict=True):
        omega = math.acos(1 - share * 0.5 / 2) / REFERENCE
        coarse, fine = (frequency_and_decay_of(config, shape, h) for h in (1 / 240, 1 / 960))
        assert share < 0.6
        assert coarse[0] == pytest.approx(fine[0], rel=0.005)
        assert fine[0] == pytest.approx(omega, rel=0.015)
        assert abs(fine[1]) < 1e-3 * omega


@pytest.mark.parametrize('mode', SOFT)
def test_damped_regions_bend_nearly_alike_at_any_step(mode):
    """Only nearly: the gains are exact for what no goal follows."""
    config = body('box', subdivisions=2, mode=mode, regions_count=12)
    shapes, _ = softest_bends(config, 9)
    for shape in shapes[::4]:
        coarse, fine = (frequency_and_decay_of(config, shape, h) for h in (1 / 240, 1 / 960))
        assert coarse[0] == pytest.approx(fine[0], rel=0.025)
        # that of the goals' velocity, relative to which it is damped, is taken before
        assert coarse[1] == pytest.approx(fine[1], rel=0.09)


# ----------------------------------------------------------------------------------- what they do
def bent_into_an_s(surface, height):
    """Return positions (n, 3) of a bar whose sections follow a full sine and stay normal to it."""
    x, y, z = surface.vertices.T
    phase = np.pi * x / x.max()
    slope = height * np.pi / x.max() * np.cos(phase)
    cosine = 1.0 / np.sqrt(1.0 + slope**2)
    return np.stack([x - z * slope * cosine, y, height * np.sin(phase) + z * cosine], axis=1)


@pytest.mark.parametrize('height', [0.1, 0.5])
@pytest.mark.parametrize('mode', SOFT)
def test_a_bar_bends_into_an_s_which_no_single_match_can_hold(mode, height):
    surface = bar()
    bent = bent_into_an_s(surface, height).T[None]

    def distance(count):
        config = body(surface, mode=mode, regions_count=max(count, 1), bounciness=1.0,
                      regions_whole_body_weight=0.3 if count else 1.0)  # fmt: skip
        weights = make_rest_shape(surface).weights
        offsets = goal_of_each_mode(config, bent)[0] - bent[0]
        return np.sqrt(np.sum(weights * offsets**2))

    assert distance(12) < 0.4 * distance(0)


@pytest.mark.parametrize('subdivisions', [3, 4])
def test_a_hollow_ball_of_regions_keeps_its_shape(subdivisions):
    config = BodyConfig(name='ball', subdivisions=subdivisions, regions_count=64)
    world = World(WorldConfig(bodies=(config,)))
    impact = 0.0
    for _ in range(48):
        world.step(20)
        impact = max(impact, rms_displacement(world, 'ball'))
    assert impact > 0.1
    # it lies on the floor as it would at any step: as the goals of its regions follow the dent,
    # that is deeper than that of a body without
    assert rms_displacement(world, 'ball') <= 0.045
    world.configure(dataclasses.replace(world.config, gravity_magnitude=0.0))
    world.step(480)
    assert rms_displacement(world, 'ball') <= 0.01


def test_without_the_weight_of_the_whole_body_a_hollow_ball_caves_in():
    config = BodyConfig(
        name='ball', subdivisions=2, regions_count=64, regions_whole_body_weight=0.0
    )
    world = World(WorldConfig(bodies=(config,)))
    world.step(480)
    assert rms_displacement(world, 'ball') > 0.2


def test_a_rigid_body_has_no_use_for_regions():
    worlds = [
        World(
            WorldConfig(
                bodies=(
                    body(
                        sheared_box(),
                        mode='rigid',
                        regions_count=count,
                        position=(0.0, 0.0, 1.2),
                        initial_velocity_angular=(1.0, 2.0, 3.0),
                    ),
                )
            )
        )
        for count in (0, 12)
    ]
    for world in worlds:
        world.step(400)
    assert worlds[0].positions('body') == pytest.approx(worlds[1].positions('body'), abs=1e-9)


# ------------------------------------------------------------------------------------------ batch
def bodies_of_one_shape():
    surface = sheared_box()
    return [
        BodyConfig(
            name=f'b{i}',
            mesh=surface,
            mode=mode,
            position=(4.0 * i, 0.0, 1.2 + 0.1 * i),
            stiffness=0.3 + 0.2 * i,
            regions_count=12,
            regions_whole_body_weight=0.2 * i,
            initial_velocity_angular=(1.0, 2.0, float(i)),
        )
        for i, mode in enumerate(('quadratic', 'linear', 'rigid', 'quadratic'))
    ]


def test_bodies_of_one_batch_move_as_if_alone():
    assert_as_if_alone(bodies_of_one_shape(), 120)


def test_bodies_with_other_regions_keep_theirs():
    bodies = [
        dataclasses.replace(config, regions_count=count, regions_overlap=overlap)
        for config, count, overlap in zip(
            bodies_of_one_shape(), (0, 5, 5, 5), (3, 3, 3, 2), strict=True
        )
    ]
    together = World(WorldConfig(bodies=tuple(bodies)))
    together.step(60)
    for config in bodies:
        alone = World(WorldConfig(bodies=(config,)))
        alone.step(60)
        assert together.positions(config.name) == pytest.approx(
            alone.positions(config.name), abs=1e-12
        )


def test_a_restored_snapshot_continues_bit_by_bit():
    world = World(WorldConfig(bodies=tuple(bodies_of_one_shape())))
    world.step(60)
    assert_goes_on_bit_by_bit(world, 100)


# --------------------------------------------------------------------------------- awkward meshes
def test_more_regions_than_vertices_are_refused():
    config = WorldConfig(bodies=(BodyConfig(name='cube', mesh='box', subdivisions=0,
                                            regions_count=9),))  # fmt: skip
    with pytest.raises(ConfigError) as caught:
        World(config)
    assert str(caught.value) == 'cube.regions.count is 9: the mesh has only 8 vertices'


AWKWARD = rank_deficient_shapes() | {
    'loose vertices': with_loose_vertices(),
    'unwelded triangles': unwelded(),
}


@pytest.mark.parametrize('name', AWKWARD)
def test_awkward_meshes_keep_their_momentum_and_find_their_shape_again(name):
    surface = AWKWARD[name]
    most = len(surface.vertices)
    covers = {(1, 3), (2, 1), (min(5, most), 16), (most, 1), (most, 3)}
    bodies = [
        BodyConfig(
            name=f'{mode}_{count}_{overlap}',
            mesh=surface,
            mode=mode,
            regions_count=count,
            regions_overlap=overlap,
        )
        for count, overlap in sorted(covers)
        for mode in SOFT
    ]
    world = floating(*apart(bodies), h=1 / 60)
    before = {}
    for seed, body_name in enumerate(world.names):
        disturbed(world, body_name, seed=seed, shape=0.05, speed=0.3)
        before[body_name] = momentum(world, body_name), angular_momentum(world, body_name)
    world.step(100)
    for body_name, (linear, spin) in before.items():
        assert np.isfinite(world.positions(body_name)).all()
        # far from the origin, where the bodies are put apart, rounding is larger
        assert momentum(world, body_name) == pytest.approx(linear, abs=1e-11)
        assert angular_momentum(world, body_name) == pytest.approx(spin, rel=1e-6, abs=1e-9)
        # spinning stretches the slender ones
        assert rms_displacement(world, body_name) < 0.04


@pytest.mark.parametrize('name', AWKWARD)
def test_an_awkward_mesh_stays_at_rest(name):
    surface = AWKWARD[name]
    config = body(surface, regions_count=len(surface.vertices), plasticity_creep=10.0)
    world = floating(config, h=1 / 240)
    before = world.positions('body')
    world.step(100)
    assert world.positions('body') == pytest.approx(before, abs=1e-9)
    assert world.permanent_strain('body') == 0.0
