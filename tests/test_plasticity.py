# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Plasticity: how a shape flows, what stays of an impact, how it is saved, restored and reset."""

import dataclasses

from core_helpers import (
    angular_momentum,
    apart,
    assert_goes_on_bit_by_bit,
    body,
    bytes_of,
    disturbed,
    enclosed_volume,
    floating,
    momentum,
    random_rotation,
    rank_deficient_shapes,
    rms_displacement,
    sheared_box,
)
from kernels import flowed, undeformed
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softbody_ros.core import BodyConfig, SimulationError, World, WorldConfig
from softbody_ros.core.shape_matching.plasticity import largest_permanent_strain

MODES = ('rigid', 'linear', 'quadratic')
SOFT = ('linear', 'quadratic')
REFERENCE = 1 / 120
EYE = np.eye(3)


# ---------------------------------------------------------------------------------------- one tick
def flow(stretch, strained, yield_strain=0.1, creeping=0.5, largest_strain=0.3):
    """Return what becomes of permanent stretches (k, 3, 3) under elastic fits (k, 3, F)."""
    return flowed(
        stretch,
        strained,
        *(np.full(len(stretch), value) for value in (yield_strain, creeping, largest_strain)),
    )


def random_states(count, spread, seed=0):
    """Return permanent stretches of determinant 1 and elastic fits (count, 3, 3), det > 0."""
    random = np.random.default_rng(seed)
    logarithms = 0.1 * random.normal(size=(count, 3))
    logarithms -= logarithms.mean(axis=1, keepdims=True)
    axes = np.stack([random_rotation(seed + i) for i in range(count)])
    stretch = np.einsum('kij,kj,klj->kil', axes, np.exp(logarithms), axes)
    sizes = np.exp(spread * random.normal(size=(count, 3)))
    left, right = axes[::-1], np.roll(axes, 7, axis=0)
    return stretch, np.einsum('kij,kj,klj->kil', left, sizes, right)


def deviations(stretch):
    """Return |σ − 1| of symmetric stretches, (k, 3)."""
    return np.abs(np.linalg.eigvalsh(stretch) - 1.0)


@pytest.mark.parametrize('spread', [0.05, 0.3, 2.0])
def test_what_has_flowed_is_a_symmetric_stretch_of_the_same_volume(spread):
    stretch, strained = random_states(300, spread)
    after = flow(stretch, strained)
    assert np.abs(after - after.swapaxes(1, 2)).max() < 1e-14
    assert np.linalg.det(after) == pytest.approx(np.ones(300), abs=1e-12)
    assert np.linalg.eigvalsh(after).min() > 0.0
    assert np.abs(after - stretch).max() > 0.01


@pytest.mark.parametrize('largest', [0.0, 0.05, 0.3, 0.9])
@pytest.mark.parametrize('spread', [0.05, 0.3, 2.0])
def test_no_strain_becomes_larger_than_the_largest(spread, largest):
    stretch, strained = np.tile(EYE, (300, 1, 1)), random_states(300, spread)[1]
    for _ in range(30):
        stretch = flow(stretch, strained, creeping=0.9, largest_strain=largest)
        assert deviations(stretch).max() <= largest + 1e-12
    if spread == 2.0:
        # one direction is at its limit: the others follow from it and from the volume
        assert deviations(stretch).max() == pytest.approx(largest, abs=1e-12)
        assert np.linalg.det(stretch) == pytest.approx(np.ones(300), abs=1e-12)


def test_up_to_the_yield_nothing_flows():
    stretch, strained = random_states(300, 0.2)
    largest = np.abs(np.linalg.svd(strained)[1] - 1.0).max(axis=1)
    for yield_strain in (0.0, 0.1, 0.2, 0.5):
        after = flow(stretch, strained, yield_strain=yield_strain)
        unchanged = np.all(after == stretch, axis=(1, 2))
        assert np.array_equal(unchanged, largest <= yield_strain)


def test_without_creep_nothing_flows():
    stretch, strained = random_states(50, 0.5)
    assert np.array_equal(flow(stretch, strained, creeping=0.0), stretch)


def test_an_inverted_or_flat_shape_does_not_flow():
    stretch, strained = random_states(50, 0.5)
    mirrored = strained * np.array([1.0, 1.0, -1.0])
    flat = strained * np.array([1.0, 1.0, 0.0])
    assert np.array_equal(flow(stretch, mirrored), stretch)
    assert np.array_equal(flow(stretch, flat), stretch)
    assert np.abs(flow(stretch, strained) - stretch).max() > 0.01


def test_a_turn_does_not_flow():
    stretch, _ = random_states(50, 0.5)
    turns = np.stack([random_rotation(i) for i in range(50)])
    assert np.array_equal(flow(stretch, turns, yield_strain=1e-9), stretch)
    assert flow(stretch, turns, yield_strain=0.0) == pytest.approx(stretch, abs=1e-14)


def test_a_turn_beside_a_strain_changes_nothing():
    """Only the symmetric part of the polar decomposition, that on the rest shape's side, flows."""
    stretch, strained = random_states(50, 0.3)
    turned = np.stack([random_rotation(i) for i in range(50)]) @ strained
    assert flow(stretch, turned) == pytest.approx(flow(stretch, strained), abs=1e-12)


@pytest.mark.parametrize('creeping', [0.01, 1.0])
def test_of_a_stretch_along_the_axes_the_share_flows(creeping):
    sizes = np.array([1.2, 1.1, 1.0 / (1.2 * 1.1)])
    after = flow(EYE[None], np.diag(sizes)[None], creeping=creeping)[0]
    expected = 1.0 + creeping * (sizes - 1.0)
    expected = np.clip(expected, 0.8, 1.2)
    assert after == pytest.approx(np.diag(expected / np.cbrt(expected.prod())), abs=1e-12)


def test_quadratic_fits_flow_like_their_linear_part():
    stretch, strained = random_states(50, 0.3)
    bend = np.random.default_rng(1).normal(size=(50, 3, 6))
    wide = np.concatenate([strained, bend], axis=2)
    assert np.array_equal(flow(stretch, wide), flow(stretch, strained))


def test_growth_in_one_tick_is_limited_however_large_the_strain():
    """To 0.8 … 1.2, and by what keeps the volume when the others are at the other end."""
    most = 1.2 / np.cbrt(1.2 * 0.8 * 0.8)
    least = 0.8 / np.cbrt(0.8 * 1.2 * 1.2)
    _, strained = random_states(500, 3.0)
    after = flow(np.tile(EYE, (500, 1, 1)), strained, creeping=1.0, largest_strain=0.9)
    sizes = np.linalg.eigvalsh(after)
    assert sizes.max() == pytest.approx(most, abs=1e-12)
    assert sizes.min() == pytest.approx(least, abs=1e-12)


@pytest.mark.parametrize('spread', [0.1, 0.5])
def test_the_goal_is_the_permanent_shape_turned_to_the_particles(spread):
    """As found by scipy for the vectors themselves; the rotation is not that of the rest shape."""
    random = np.random.default_rng(3)
    stretch, _ = random_states(20, 0.3)
    rest, weights = random.normal(size=(3, 30)), random.uniform(0.5, 1.5, size=30)
    for permanent in stretch:
        now = random_rotation(7) @ (np.eye(3) + spread * random.normal(size=(3, 3))) @ rest
        moment = (weights * now) @ rest.T
        expected = Rotation.align_vectors(now.T, (permanent @ rest).T, weights=weights)[0]
        found = undeformed(moment[None], permanent[None])[0]
        assert found == pytest.approx(expected.as_matrix() @ permanent, abs=1e-6)


# -------------------------------------------------------------------------------------- the world
def dropped(seconds=3.0, **values):
    """Return a world whose ball, with a strain of 9 to 12 % in the impact, has fallen."""
    values = {'name': 'ball', 'subdivisions': 2, 'plasticity_yield': 0.05} | values
    config = BodyConfig(**values)
    world = World(WorldConfig(bodies=(config,)))
    world.step(round(240 * seconds))
    return world


def configured(world, name=None, **values):
    """Change parameters of a body, or of all bodies, of a running world."""
    bodies = tuple(
        dataclasses.replace(config, **values) if name in (None, config.name) else config
        for config in world.config.bodies
    )
    world.configure(dataclasses.replace(world.config, bodies=bodies))


def floated(world, seconds=2.0):
    """Turn gravity off and wait."""
    world.configure(dataclasses.replace(world.config, gravity_magnitude=0.0))
    world.step(round(240 * seconds))


@pytest.mark.parametrize('count', [0, 12])
@pytest.mark.parametrize('mode', SOFT)
def test_an_impact_leaves_a_dent(mode, count):
    world = dropped(1.5, mode=mode, plasticity_creep=10.0, regions_count=count)
    floated(world)
    dent = rms_displacement(world, 'ball')
    assert dent > 0.01
    assert 0.01 < world.permanent_strain('ball') <= 0.3 + 1e-12
    world.step(120)
    assert rms_displacement(world, 'ball') == pytest.approx(dent, abs=1e-5)


@pytest.mark.parametrize('count', [0, 12])
def test_what_does_not_yield_keeps_no_dent(count):
    parameters = [
        {'plasticity_creep': 0.0},
        # a cap that is pressed flat has a strain of nearly 1 across itself
        {'plasticity_creep': 100.0, 'plasticity_yield': 1.5},
        {'plasticity_creep': 100.0, 'plasticity_max': 0.0},
        {'plasticity_creep': 100.0, 'mode': 'rigid'},
    ]
    bodies = tuple(
        BodyConfig(
            name=f'b{i}',
            subdivisions=2,
            position=(3.0 * i, 0.0, 1.5),
            regions_count=count,
            **values,
        )
        for i, values in enumerate(parameters)
    )
    world = World(WorldConfig(bodies=bodies))
    world.step(480)
    floated(world)
    for name in world.names:
        assert world.permanent_strain(name) == pytest.approx(0.0, abs=1e-12)
        assert rms_displacement(world, name) < 1e-4


@pytest.mark.parametrize('shape', [(100.0, 1.0, 1.0), (1.0, 1.0, 0.01), (-1.0, 1.0, 1.0)])
@pytest.mark.parametrize('mode', SOFT)
def test_what_no_goal_can_follow_comes_back_and_does_not_flow(mode, shape):
    world = floating(
        body(mode=mode, plasticity_creep=1e4, plasticity_yield=0.0, plasticity_max=0.9)
    )
    world.set_state('body', world.positions('body') * shape)
    world.step()
    assert world.permanent_strain('body') == 0.0


@pytest.mark.parametrize('mode', SOFT)
def test_a_dented_body_has_its_volume(mode):
    world = dropped(mode=mode, plasticity_creep=100.0)
    floated(world)
    surface = world.rest_shape('ball').surface
    assert rms_displacement(world, 'ball') > 0.03
    assert enclosed_volume(world.positions('ball'), surface.faces) == pytest.approx(
        enclosed_volume(surface.vertices, surface.faces), rel=1e-3
    )


def test_faster_creep_leaves_a_deeper_dent_and_max_bounds_it():
    strains = [dropped(1.0, plasticity_creep=c).permanent_strain('ball') for c in (0, 1, 10, 100)]
    assert strains[0] == 0.0
    assert np.all(np.diff(strains) > 0.0)
    bounded = dropped(1.0, plasticity_creep=100.0, plasticity_max=0.03).permanent_strain('ball')
    assert bounded == pytest.approx(0.03, abs=1e-12)


@pytest.mark.parametrize('count', [0, 12])
@pytest.mark.parametrize('mode', SOFT)
def test_no_parameters_let_a_body_flow_beyond_max(mode, count):
    bodies = [
        BodyConfig(
            name=f'b{i}',
            mode=mode,
            subdivisions=1,
            position=(3.0 * i, 0.0, 1.5),
            deformation=deformation,
            stiffness=0.1,
            plasticity_creep=creep,
            plasticity_yield=0.0,
            plasticity_max=largest,
            regions_count=count,
        )
        for i, (deformation, creep, largest) in enumerate(
            (deformation, creep, largest)
            for deformation in (0.0, 0.9)
            for creep in (3.0, 1e4)
            for largest in (0.0, 0.1, 0.9)
        )
    ]
    world = World(WorldConfig(bodies=tuple(bodies)))
    for _ in range(15):
        world.step(20)
        for config in bodies:
            assert world.permanent_strain(config.name) <= config.plasticity_max + 1e-12
            assert np.isfinite(world.positions(config.name)).all()
    assert world.permanent_strain('b4') == pytest.approx(0.1, abs=1e-12)


# ------------------------------------------------------------------------------ step independence
def permanent_strain_of_a_stretched_body(h, seconds=0.5, **values):
    """Return what becomes permanent of a body that is let go 1.4 times as long as it was."""
    config = body(subdivisions=1, **values)
    world = floating(config, h=h, reference_step=REFERENCE)
    world.set_state('body', world.positions('body') * (1.4, 1.4**-0.5, 1.4**-0.5))
    world.step(round(seconds / h))
    return world.permanent_strain('body')


@pytest.mark.parametrize('count', [0, 8])
@pytest.mark.parametrize('creep', [1.0, 3.0])
def test_a_strain_that_stays_flows_exponentially(creep, count):
    """Of a body without stiffness, whose strain stays: 1.4 − 0.4 exp(−creep · t) at first."""
    values = {'stiffness': 0.0, 'plasticity_creep': creep, 'regions_count': count}
    coarse, fine = (
        permanent_strain_of_a_stretched_body(1 / hertz, 0.2, **values) for hertz in (240, 960)
    )
    sizes = np.array([1.4, 1.4**-0.5, 1.4**-0.5])
    flown = sizes - (sizes - 1.0) * np.exp(-0.2 * creep)
    assert coarse == pytest.approx(fine, rel=1e-3)
    assert fine == pytest.approx(flown[0] / np.cbrt(flown.prod()) - 1.0, rel=0.02)


@pytest.mark.parametrize('count', [0, 8])
@pytest.mark.parametrize('values', [
    {'stiffness': 0.001, 'plasticity_creep': 3.0},
    {'stiffness': 0.01, 'plasticity_creep': 10.0},
    {'stiffness': 0.01, 'plasticity_creep': 10.0, 'bounciness': 0.0},
])  # fmt: skip
def test_what_becomes_permanent_hardly_depends_on_the_step(values, count):
    coarse, fine = (
        permanent_strain_of_a_stretched_body(1 / hertz, regions_count=count, **values)
        for hertz in (240, 960)
    )
    assert fine > 0.03
    assert coarse == pytest.approx(fine, rel=0.1)


@pytest.mark.parametrize('count', [0, 12])
def test_the_strain_of_a_vertex_is_that_of_what_it_belongs_to(count):
    world = dropped(1.5, plasticity_creep=10.0, plasticity_yield=0.05, regions_count=count)
    strains, largest = world.permanent_strains('ball'), world.permanent_strain('ball')
    if count:
        # the ground has dented it
        height = world.rest_shape('ball').surface.vertices[:, 2]
        assert largest > strains.max() > 1.5 * strains[height > 0.0].mean()
        assert height[strains.argmax()] < -0.3
    else:
        assert (strains == largest).all()
        assert largest > 0.01
    assert len(strains) == len(world.positions('ball'))
    world.reset()
    assert not world.permanent_strains('ball').any()


# ------------------------------------------------------------------------------------------ state
def plastic_bytes(world):
    """Return everything that is permanent as bytes; nothing permanent is no stretch at all."""
    states = world.snapshot().states
    return b''.join(b'' if each.stretch is None else each.stretch.tobytes() for each in states)


def falling_pair(**values):
    """Return a world of two bodies of one shape, one of them plastic, and a third of another."""
    common = {'subdivisions': 2, 'position': (0.0, 0.0, 1.0), 'plasticity_yield': 0.03} | values
    bodies = (
        BodyConfig(name='plastic', plasticity_creep=30.0, **common),
        BodyConfig(name='elastic', **common | {'position': (3.0, 0.0, 1.0)}),
        BodyConfig(
            name='other',
            mesh='box',
            plasticity_creep=30.0,
            **common | {'position': (6.0, 0.0, 1.0), 'orientation': (0.3, 0.2, 0.1, 0.9)},
        ),
    )
    return World(WorldConfig(bodies=bodies))


@pytest.mark.parametrize('count', [0, 12])
@pytest.mark.parametrize('before', [20, 100])
def test_a_restored_snapshot_continues_bit_by_bit(before, count):
    """Taken before anything has become permanent, and afterwards."""
    world = falling_pair(regions_count=count)
    world.step(before)
    assert (world.permanent_strain('plastic') > 0.0) == (before == 100)
    assert_goes_on_bit_by_bit(
        world, 100, lambda world: world.step(10),
        lambda world: (bytes_of(world), plastic_bytes(world)),
    )  # fmt: skip
    assert world.permanent_strain('plastic') > 0.0


def test_a_snapshot_does_not_flow_while_the_world_goes_on():
    world = falling_pair()
    world.step(85)
    saved = world.snapshot()
    assert world.permanent_strain('plastic') > 0.0
    before = [state.stretch.copy() for state in saved.states if state.stretch is not None]
    world.step(60)
    kept = [state.stretch for state in saved.states if state.stretch is not None]
    assert all(map(np.array_equal, before, kept))
    assert world.permanent_strain('plastic') > largest_permanent_strain(before[0])


@pytest.mark.parametrize('count', [0, 12])
def test_reset_clears_dents_to_the_last_bit(count):
    world, fresh = falling_pair(regions_count=count), falling_pair(regions_count=count)
    world.step(200)
    assert world.permanent_strain('plastic') > 0.0
    world.reset()
    assert world.permanent_strain('plastic') == 0.0
    assert bytes_of(world) == bytes_of(fresh)
    for each in (world, fresh):
        each.step(200)
    assert bytes_of(world) == bytes_of(fresh)
    assert plastic_bytes(world) == plastic_bytes(fresh)


def test_a_failing_tick_leaves_what_is_permanent():
    world, untroubled = falling_pair(), falling_pair()
    world.step(80)
    untroubled.step(80)
    flowing = 0
    for _ in range(20):
        good = world.snapshot()
        # the first batch can be computed, the second cannot
        world.set_state('other', velocities=np.full((len(world.positions('other')), 3), 1e200))
        before = bytes_of(world), plastic_bytes(world)
        with pytest.raises(SimulationError):
            world.step()
        assert (bytes_of(world), plastic_bytes(world)) == before
        world.restore(good)
        for each in (world, untroubled):
            each.step()
        assert bytes_of(world) == bytes_of(untroubled)
        assert plastic_bytes(world) == plastic_bytes(untroubled)
        flowing += plastic_bytes(world) != before[1]
    assert flowing > 3


@pytest.mark.parametrize('count', [0, 12])
@pytest.mark.parametrize('neighbour', [{'mode': 'rigid'}, {'plasticity_creep': 100.0}])
def test_bodies_of_one_batch_flow_as_if_alone(neighbour, count):
    common = {'subdivisions': 2, 'regions_count': count, 'plasticity_yield': 0.03}
    bodies = (
        BodyConfig(name='a', plasticity_creep=30.0, position=(0.0, 0.0, 1.0), **common),
        BodyConfig(name='b', position=(3.0, 0.0, 1.3), **common | neighbour),
    )
    together = World(WorldConfig(bodies=bodies))
    together.step(160)
    for config in bodies:
        alone = World(WorldConfig(bodies=(config,)))
        alone.step(160)
        assert together.positions(config.name) == pytest.approx(
            alone.positions(config.name), abs=1e-11
        )
        assert together.permanent_strain(config.name) == pytest.approx(
            alone.permanent_strain(config.name), abs=1e-11
        )
    assert together.permanent_strain('a') > 0.02


@pytest.mark.parametrize('dented', [False, True])
def test_a_sleeper_keeps_its_dent_while_another_body_of_its_batch_flows(dented):
    common = {
        'mesh': 'box',
        'subdivisions': 1,
        'plasticity_creep': 30.0,
        'plasticity_yield': 0.03,
    }
    bodies = (
        BodyConfig(name='sleeper', position=(0.0, 0.0, 1.5 if dented else 0.501), **common),
        BodyConfig(name='late', position=(3.0, 0.0, 60.0), **common),
    )
    world = World(WorldConfig(bodies=bodies))
    world.step(240 * 3)
    assert world.is_asleep('sleeper')
    assert (world.permanent_strain('sleeper') > 0.0) == dented
    assert world.permanent_strain('late') == 0.0
    place, kept = world.positions('sleeper'), world.permanent_strain('sleeper')
    world.step(180)
    assert world.permanent_strain('late') > 0.01
    assert world.is_asleep('sleeper')
    assert world.permanent_strain('sleeper') == kept
    assert np.array_equal(world.positions('sleeper'), place)


def test_a_body_that_becomes_rigid_keeps_its_dent_and_gets_no_other():
    world = dropped(plasticity_creep=100.0)
    floated(world)
    dent, kept = rms_displacement(world, 'ball'), world.permanent_strain('ball')
    assert dent > 0.03
    configured(world, mode='rigid')
    world.configure(dataclasses.replace(world.config, gravity_magnitude=9.81))
    world.set_state('ball', world.positions('ball') + (0.0, 0.0, 1.0))
    world.step(240)
    assert rms_displacement(world, 'ball') == pytest.approx(dent, rel=1e-6)
    assert world.permanent_strain('ball') == kept


def test_a_dent_stays_when_creep_is_turned_off():
    world = dropped(plasticity_creep=100.0)
    floated(world)
    dent, kept = rms_displacement(world, 'ball'), world.permanent_strain('ball')
    configured(world, plasticity_creep=0.0)
    world.step(240)
    assert rms_displacement(world, 'ball') == pytest.approx(dent, rel=1e-6)
    assert world.permanent_strain('ball') == kept


def test_turning_creep_on_moves_nothing_at_once():
    world = dropped(0.65)
    elastic = dropped(0.65)
    before = bytes_of(world)
    configured(world, plasticity_creep=100.0, plasticity_yield=0.0)
    assert bytes_of(world) == before
    assert world.permanent_strain('ball') == 0.0
    for each in (world, elastic):
        each.step()
    assert world.permanent_strain('ball') > 0.0
    # the goal of this tick is still the old one
    assert bytes_of(world) == bytes_of(elastic)


# ----------------------------------------------------------------------------------- conservation
@pytest.mark.parametrize('count', [0, 12])
@pytest.mark.parametrize('mode', MODES)
def test_flowing_keeps_momentum_and_angular_momentum(mode, count):
    world = floating(
        body(sheared_box(), mode=mode, plasticity_creep=10.0, plasticity_yield=0.0,
             regions_count=count), h=1 / 240,
    )  # fmt: skip
    disturbed(world, seed=4, shape=0.1, speed=2.0)
    linear, spin = momentum(world), angular_momentum(world)
    for _ in range(20):
        world.step(10)
        assert np.linalg.norm(momentum(world) - linear) < 1e-12 * np.linalg.norm(linear)
        assert np.linalg.norm(angular_momentum(world) - spin) < 1e-12 * np.linalg.norm(spin)
    assert (world.permanent_strain('body') > 0.005) == (mode != 'rigid')


@pytest.mark.parametrize('count', [0, 'all'])
@pytest.mark.parametrize('name', rank_deficient_shapes())
def test_shapes_that_span_little_flow_within_bounds(name, count):
    surface = rank_deficient_shapes()[name]
    regions = len(surface.vertices) if count else 0
    bodies = [
        BodyConfig(
            name=mode,
            mesh=surface,
            mode=mode,
            plasticity_creep=30.0,
            plasticity_yield=0.01,
            regions_count=regions,
        )
        for mode in SOFT
    ]
    world = floating(*apart(bodies), h=1 / 120)
    for mode in SOFT:
        disturbed(world, mode, seed=6, shape=0.1)
    world.step(60)
    for mode in SOFT:
        assert np.isfinite(world.positions(mode)).all()
        assert world.permanent_strain(mode) <= 0.3 + 1e-12
