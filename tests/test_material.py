# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Materials in physical units: Young's modulus, natural frequency, density."""

import dataclasses
import math

import numpy as np
import pytest
from scene_files import world_of
from squeezing import RADIUS, forces_of_plates, hertz

from softbody_ros.core import (
    BodyConfig,
    ConfigError,
    ObstacleConfig,
    Surface,
    World,
    WorldConfig,
    make_surface,
)
from softbody_ros.core.shape_matching.gains import unresolved_restitution
from softbody_ros.core.shape_matching.material import make_material, natural_frequency
from softbody_ros.core.shape_matching.rest_shape import make_rest_shape

SOFT = ('linear', 'quadratic')
STRAINS = (0.05, 0.1, 0.2)


def body(name='thing', **values):
    return BodyConfig(name=name, **{'subdivisions': 2} | values)


GROUND = ObstacleConfig(name='ground')


def world_with(*bodies, h=1 / 240, obstacles=(GROUND,), **values):
    return World(WorldConfig(time_step=h, bodies=bodies, obstacles=obstacles, **values))


def change(world, **values):
    (now,) = world.config.bodies
    now = dataclasses.replace(now, **values)
    world.configure(dataclasses.replace(world.config, bodies=(now,)))


# ------------------------------------------------------------------------------------ squeezed
@pytest.mark.parametrize('mode', SOFT)
@pytest.mark.parametrize('modulus', [3e3, 1e5, 1e7])
def test_plates_feel_the_force_of_an_elastic_cube(mode, modulus):
    analytic = modulus * (2 * RADIUS) ** 2 * np.array(STRAINS)  # E A ε
    forces = forces_of_plates(STRAINS, 1 / 60, mode=mode, mesh='box', young_modulus=modulus)
    assert forces[:, 0] == pytest.approx(analytic, rel=0.25)
    assert forces[:, 1] == pytest.approx(forces[:, 0], rel=1e-6)


SOLID = {'mass_distribution': 'volume'}


@pytest.mark.parametrize('values', [{'regions_count': 6}, {'deformation': 0.0}, SOLID], ids=str)
def test_so_they_do_with_regions_and_whatever_the_goal_follows(values):
    analytic = 1e4 * (2 * RADIUS) ** 2 * np.array(STRAINS)
    forces = forces_of_plates(STRAINS, 1 / 120, mesh='box', young_modulus=1e4, **values)
    assert forces[:, 0] == pytest.approx(analytic, rel=0.25)


@pytest.mark.parametrize('values', [{'mode': 'linear'}, {}, {'regions_count': 6}, SOLID], ids=str)
def test_a_ball_is_within_a_factor_of_two_of_hertz(values):
    values = values | {'young_modulus': 1e4, 'subdivisions': 3}
    forces = forces_of_plates(STRAINS, 1 / 60, **values)[:, 1]
    analytic = hertz(1e4, np.array(STRAINS))
    assert (0.5 * analytic < forces).all() and (forces < 2.0 * analytic).all()


@pytest.mark.parametrize('values', [{}, {'regions_count': 6}], ids=['whole', 'regions'])
def test_static_forces_do_not_depend_on_the_step(values):
    found = [
        forces_of_plates(STRAINS, h, mode='linear', mesh='box', young_modulus=2e5, **values)
        for h in (1 / 60, 1 / 240, 1 / 1000)
    ]
    assert found[1] == pytest.approx(found[0], rel=1e-4)
    assert found[2] == pytest.approx(found[0], rel=1e-4)


# ------------------------------------------------------------------------------ one of the three
def material_of(config, has_goals=False, mesh=None):
    rest = make_rest_shape(mesh or make_surface(config.mesh, config.size, config.subdivisions))
    return make_material(config, rest, 1 / 120, has_goals)


@pytest.mark.parametrize('has_goals', [False, True])
@pytest.mark.parametrize('conservation', [0.0, 0.5, 1.0])
@pytest.mark.parametrize('modulus', [1.0, 1e3, 1e6, 1e12])
def test_modulus_and_frequency_say_the_same(modulus, conservation, has_goals):
    by_modulus = material_of(
        body(young_modulus=modulus, volume_conservation=conservation), has_goals
    )
    assert by_modulus.young_modulus == pytest.approx(modulus, rel=1e-9)
    by_frequency = material_of(
        body(
            natural_frequency=by_modulus.frequency / (2 * math.pi),
            volume_conservation=conservation,
        ),
        has_goals,
    ) if by_modulus.frequency < 2 * math.pi * 1e6 else by_modulus  # fmt: skip
    assert by_frequency.young_modulus == pytest.approx(modulus, rel=1e-9)


def test_frequency_falls_with_size_and_grows_with_stiffness():
    def frequency(**values):
        return material_of(body(density=1000.0, **values)).frequency

    assert frequency(young_modulus=1e4, size=0.05) == pytest.approx(
        10 * frequency(young_modulus=1e4, size=0.5), rel=0.02
    )
    assert frequency(young_modulus=4e6, size=0.05) == pytest.approx(
        2 * frequency(young_modulus=1e6, size=0.05), rel=0.02
    )


def test_each_speaks_in_place_of_the_stiffness():
    by_stiffness = material_of(body(stiffness=0.3))
    assert by_stiffness.frequency == natural_frequency(0.3, 1 / 120)
    given = body(stiffness=0.3, natural_frequency=100.0)
    assert material_of(given).frequency == 2 * math.pi * 100.0
    assert material_of(body(stiffness=0.9, natural_frequency=100.0)) == material_of(given)
    by_modulus = material_of(body(young_modulus=1e4))
    assert material_of(body(stiffness=0.9, natural_frequency=5.0, young_modulus=1e4)) == by_modulus


def test_what_has_no_answer_is_refused():
    with pytest.raises(ConfigError, match='deformation 1 goals follow any deformation'):
        body(young_modulus=1e4, deformation=1.0)
    sheet = Surface(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]), np.array([[0, 1, 2]]))
    for name in ('young_modulus', 'density'):
        with pytest.raises(ConfigError, match=f'{name} is 10, but its mesh encloses no volume'):
            world_with(body(mesh=sheet, **{name: 10.0}))
        world = world_with(body(mesh=sheet, mode='linear'))
        with pytest.raises(ConfigError, match='encloses no volume: close it, or set 0'):
            change(world, **{name: 10.0})
        assert getattr(world.config.bodies[0], name) == 0.0
        world.step(5)


def test_a_density_says_what_it_weighs():
    world = world_with(body(mesh='box', size=0.1, density=500.0, position=(0, 0, 0.1)))
    assert world.material('thing').mass == pytest.approx(500.0 * 0.2**3, rel=1e-12)
    world.step(480)
    assert -world.obstacle_wrench('ground')[0][2] == pytest.approx(4.0 * 9.81, rel=1e-3)
    change(world, density=1000.0)
    world.step(480)
    assert -world.obstacle_wrench('ground')[0][2] == pytest.approx(8.0 * 9.81, rel=1e-3)
    change(world, density=0.0)
    assert world.material('thing').mass == 1.0


def test_a_sleeping_body_sags_when_it_becomes_softer():
    world = world_with(body(size=0.1, young_modulus=1e5, position=(0, 0, 0.1)))
    world.step(960)
    before = world.positions('thing')[:, 2].max()
    change(world, young_modulus=1e3)
    world.step(240)
    assert world.positions('thing')[:, 2].max() < before - 0.005


# ---------------------------------------------------------------------------- at any frequency
KINDS = {
    'plain': {}, 'linear': {'mode': 'linear'}, 'lively': {'bounciness': 0.95, 'elasticity': 0.95},
    'sponge': {'volume_conservation': 0.3}, 'regions': {'regions_count': 6},
    'pins': {'pins_box': (-1.0, -1.0, 0.02, 1.0, 1.0, 1.0)},
    'plastic': {'plasticity_creep': 10.0, 'plasticity_yield': 0.02},
}  # fmt: skip


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('h', [1 / 60, 1 / 240])
def test_any_frequency_is_stable_at_any_step(kind, h):
    weights = make_rest_shape(make_surface('icosphere', RADIUS, 1)).weights
    for frequency in (10.0, 50.0, 300.0, 1e4, 1e6):
        values = KINDS[kind] | {'natural_frequency': frequency, 'subdivisions': 1}
        world = world_with(body(size=RADIUS, position=(0, 0, 0.25), **values), h=h)
        most = 9.81 * 0.25
        for _ in range(round(1.0 / h)):
            world.step()
            x, v = world.positions('thing'), world.velocities('thing')
            assert x[:, 2].min() > -1e-4 * RADIUS
            energy = (weights * (9.81 * x[:, 2] + 0.5 * (v * v).sum(axis=1))).sum()
            # what approaches at the end of a tick has been accelerated for all of it
            assert energy < 1.02 * most, frequency
            assert np.linalg.norm(x.mean(axis=0)[:2]) < 0.5


@pytest.mark.parametrize('h', [1 / 60, 1 / 240])
def test_an_impact_too_short_for_the_tick_rebounds(h):
    """As a damped spring does that is let go when it would pull, but for its lowest particle."""
    for bounciness, restitution in ((0.95, 0.952), (0.5, 0.550), (0.0, math.exp(-2.0))):
        ball = body(
            size=RADIUS, young_modulus=1e8, bounciness=bounciness, elasticity=1.0,
            position=(0, 0, 0.55),
        )  # fmt: skip
        world = world_with(ball, h=h)
        highest = 0.0
        while world.time < 0.9:
            world.step()
            if world.time > 0.35:
                highest = max(highest, world.positions('thing')[:, 2].min())
        assert highest == pytest.approx(restitution**2 * 0.5, rel=0.2, abs=0.005)


def test_a_slow_impact_rebounds_by_its_deformation_alone():
    assert unresolved_restitution(60.0, 0.2, 1 / 60) == 0.0
    assert unresolved_restitution(1e4, 0.0, 1 / 60) == pytest.approx(1.0, rel=1e-3)
    found = [unresolved_restitution(1e4, zeta, 1 / 60) for zeta in np.linspace(0.0, 1.0, 200)]
    assert (np.diff(found) < 0.0).all()


# ------------------------------------------------------------------------------- small things
def test_small_things_behave():
    world = world_of('small_things')
    dents = dict.fromkeys(world.names, 0.0)
    jumps = dict.fromkeys(world.names, 0.0)
    while world.time < 1.0:
        world.step(2)
        for name in world.names:
            x, fit = world.positions(name), world.rigid_fit(name)
            rest = world.rest_shape(name).surface.vertices @ fit.rotation.T + fit.position
            dent = np.sqrt(((x - rest) ** 2).sum(axis=1).mean()) / world.body_config(name).size
            dents[name] = max(dents[name], dent)
            assert x[:, 2].min() > -1e-3 * world.body_config(name).size
            if world.time > 0.25:
                jumps[name] = max(jumps[name], x[:, 2].min())
    assert max(dents.values()) < 0.05
    assert jumps.pop('bouncy') > 0.1
    assert max(jumps.values()) < 0.03
    world.step(round(14.0 / world.config.time_step))
    for name in world.names:
        assert np.abs(world.velocities(name)).max() < 1e-3, name


@pytest.mark.parametrize(('setting', 'least'), [('density', 1e-6), ('young_modulus', 1e-3)])
def test_values_from_which_no_frequency_follows_are_refused(setting, least):
    for value in (5e-324, 1e-200, 0.9 * least):
        with pytest.raises(ConfigError) as refusal:
            BodyConfig(**{setting: value})
        assert f'{setting} is {value:g}: it must be at least {least:g}, or 0, which is off' in str(
            refusal.value
        )
    other = {'density': 'young_modulus', 'young_modulus': 'density'}[setting]
    for value in (least, 1e5):
        for beside in (0.0, 1e-3, 1e5):
            body = BodyConfig(subdivisions=1, **{setting: value, other: beside})
            world = World(WorldConfig(bodies=(body,), obstacles=()))
            world.step(20)
            assert world.material(body.name).frequency > 0.0
