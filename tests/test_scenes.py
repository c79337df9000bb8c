# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Each scene of `config` runs for some hundred ticks, and shows what it is for."""

import dataclasses

from core_helpers import rms_displacement
import numpy as np
import pytest
from scene_files import SCENES, world_of

from softbody_ros.core.shape_matching.material import natural_frequency


def run_to(world, seconds):
    world.step(round(seconds / world.config.time_step) - world.tick)


def assert_sound(world):
    for name in world.names:
        x = world.positions(name)
        assert np.isfinite(x).all()
        assert x[:, 2].min() > -1e-3, 'nothing is below the ground'
        assert np.linalg.norm(world.rigid_fit(name).position) < 5.0, 'it stays where one looks'


@pytest.mark.parametrize('name', SCENES)
def test_scene_runs(name):
    world = world_of(name)
    for _ in range(5):
        world.step(60)
        assert_sound(world)
    assert world.tick == 300


def test_whatever_tumbles_in_the_contact_scene_stays_in_its_tray():
    world = world_of('contact')
    run_to(world, 5.0)
    there = {name: world.rigid_fit(name).position for name in world.names}
    guest = there.pop('guest')
    ring = next(item for item in world.obstacles if item.config.name == 'ring')
    assert np.linalg.norm(guest[:2] - ring.position[:2]) < 0.1
    for name, (x, y, z) in there.items():
        assert (-0.8 < x < 1.7) and (-1.0 < y < 1.0) and (0.0 < z < 0.6), name
    world.move_obstacle('paddle', (0.9, 0.0, 0.15), angular=(0.0, 0.0, 1.0))
    pushed = 0.0
    while pushed < 1.0:
        assert world.time < 9.0, 'the paddle reaches nothing'
        world.step(6)
        pushed = np.linalg.norm(world.obstacle_wrench('paddle')[0])


def test_belts_carry_everything_into_the_bin():
    world = world_of('conveyor')
    run_to(world, 12.0)
    for name in world.names:
        x, y, z = world.rigid_fit(name).position
        assert (0.75 < x < 2.05) and (1.6 < y < 3.0) and z < 0.4, name
    assert world.is_asleep('jelly') and world.is_asleep('brick')


def test_a_suction_cup_lifts_a_packet_and_lets_go():
    world = world_of('suction_cup')
    run_to(world, 1.0)

    def configured(**values):
        (packet,) = world.config.bodies
        packet = dataclasses.replace(packet, **values)
        world.configure(dataclasses.replace(world.config, bodies=(packet,)))

    configured(attach_to='cup')
    cup = world.obstacles[1]
    world.move_obstacle('cup', cup.position, linear=(0.0, 0.0, 0.1))
    run_to(world, 3.0)
    world.move_obstacle('cup', world.obstacles[1].position)
    run_to(world, 5.0)
    assert world.rigid_fit('packet').position[2] == pytest.approx(0.26, abs=0.01)
    assert world.obstacle_wrench('cup')[0] == pytest.approx((0, 0, -0.3 * 9.81), abs=0.01)
    assert not world.obstacle_wrench('ground')[0].any()
    configured(attach_to='')
    run_to(world, 7.0)
    assert world.rigid_fit('packet').position[2] < 0.08
    assert world.obstacle_wrench('ground')[0] == pytest.approx((0, 0, -0.3 * 9.81), abs=0.01)


def test_sphere_is_an_egg_when_it_lands_and_a_sphere_when_it_lies():
    world = world_of('sphere')
    run_to(world, 0.55)
    assert rms_displacement(world, 'sphere') > 0.04
    run_to(world, 6.0)
    assert world.is_asleep('sphere')
    assert rms_displacement(world, 'sphere') < 0.01


def compliances(world):
    """Return g / ω² of each body: what its weight stretches a mode of unit shape by, m."""
    config = world.config
    frequencies = {
        each.name: natural_frequency(
            (1.0 - each.deformation) * each.stiffness, config.reference_step
        )
        for each in config.bodies
    }
    return {name: config.gravity_magnitude / value**2 for name, value in frequencies.items()}


def test_jelly_cube_is_squashed_where_the_stiff_one_is_not():
    world = world_of('cubes')
    largest = dict.fromkeys(world.names, 0.0)
    while world.time < 1.0:
        world.step(6)
        largest = {name: max(largest[name], rms_displacement(world, name)) for name in largest}
    assert largest['jelly'] > 0.2 and largest['stiff'] < 0.5 * largest['jelly']
    run_to(world, 5.0)
    per_compliance = []
    for name, compliance in compliances(world).items():
        assert world.rigid_fit(name).rotation[2, 2] > 0.9999, 'it lies flat'
        assert abs(world.positions(name)[:, 2].min()) < 1e-6
        sag = 0.4 - world.positions(name)[:, 2].mean()
        per_compliance.append((rms_displacement(world, name) / compliance, sag / compliance))
    jelly, stiff = per_compliance
    # of one shape, under its own weight: in proportion, but for the volume, which is not linear
    assert jelly[0] == pytest.approx(stiff[0], rel=0.03)
    assert jelly[1] == pytest.approx(stiff[1], rel=0.06)
    assert rms_displacement(world, 'stiff') < 0.003


def turn(world, name, height):
    """Return the angle by which a bar's vertices at a height are turned about z, degrees."""
    rest = world.rest_shape(name).surface.vertices
    level = np.isclose(rest[:, 2], height, atol=0.01)
    before, now = (x[level, :2] - x[level, :2].mean(axis=0) for x in (rest, world.positions(name)))
    cross = before[:, 0] * now[:, 1] - before[:, 1] * now[:, 0]
    return np.degrees(np.arctan2(cross.sum(), np.sum(before * now)))


def test_quadratic_bar_twists_and_the_linear_one_cannot():
    world = world_of('twisting_bar')
    run_to(world, 0.12)
    twists = {name: turn(world, name, 0.75) - turn(world, name, 0.0) for name in world.names}
    assert twists['quadratic'] > 20.0
    assert abs(twists['linear']) < 1.0
    for name in world.names:
        assert abs(turn(world, name, -0.75)) < 1e-3, 'its foot is held'
    run_to(world, 0.4)
    assert turn(world, 'quadratic', 0.75) < 0.0, 'it swings back'


def test_worm_hangs_over_the_log_on_both_sides():
    world = world_of('worm')
    run_to(world, 3.0)
    x = world.positions('worm')
    along = world.rest_shape('worm').surface.vertices[:, 2]
    head, middle, tail = x[along < -0.9, 2], x[abs(along) < 0.1, 2], x[along > 0.9, 2]
    assert middle.min() > 0.4 > 0.3 > max(head.max(), tail.max())
    assert world.rigid_fit('worm').displacement.max() > 0.25
    (log,) = (item for item in world.obstacles if item.config.name == 'log')
    beside = abs(x[:, 1]) < log.config.size[2] - 0.01
    from_axis = np.hypot(x[:, 0] - log.position[0], x[:, 2] - log.position[2])
    assert from_axis[beside].min() > log.config.size[0] - 1e-3, 'nothing is inside the log'


def test_duck_squats_and_stands_up_again():
    world = world_of('mesh_file')
    surface = world.rest_shape('duck').surface
    assert surface.closed and len(surface.vertices) == 2010
    run_to(world, 0.45)
    assert rms_displacement(world, 'duck') > 0.15
    run_to(world, 8.0)
    fit = world.rigid_fit('duck')
    assert fit.rotation[2, 2] > 0.98, 'it is upright'
    assert np.linalg.norm(fit.linear_velocity) < 0.02
    # its weight sits on a small base: 5.9 times g / ω² over the RMS radius of 1, measured
    sag = 5.9 * compliances(world)['duck']
    assert rms_displacement(world, 'duck') == pytest.approx(sag, rel=0.03)
