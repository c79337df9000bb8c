# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the services of simulation_interfaces do, without the package."""

import math

from core_helpers import bytes_of
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softbody_ros.core import BodyConfig, World, WorldConfig
from softbody_ros.ros.simulation_interfaces import (
    ALREADY_IN_TARGET_STATE,
    FEATURE_UNSUPPORTED,
    FEATURES,
    INVALID_POSE,
    NOT_FOUND,
    OK,
    OPERATION_FAILED,
    PAUSED,
    PLAYING,
    QUITTING,
    SCOPE_ALL,
    SCOPE_DEFAULT,
    SCOPE_STATE,
    SPHERE,
    STATE_TRANSITION_ERROR,
    STOPPED,
    Simulation,
    features,
)
from softbody_ros.timeline.stepper import Stepper

HERE = np.array([1.0, -2.0, 3.0])
TURNED = Rotation.from_euler('xyz', [0.3, -0.7, 1.9])


class Scene:
    """Two bodies, 0.1 s after their start, as a simulation that can be paused and reset."""

    def __init__(self, failure=''):
        bodies = tuple(
            BodyConfig(name=name, subdivisions=1, position=(x, 0.0, 1.0), stiffness=0.2)
            for name, x in (('left', -1.0), ('right', 2.0))
        )
        self.world = World(WorldConfig(bodies=bodies))
        self.stepper = Stepper(self.world, {})
        self.failure = failure
        self.simulation = Simulation(self.stepper, self.pause, lambda: self.stepper.reset(0))
        self.world.step(24)

    def pause(self, paused):
        if self.failure:
            return self.failure
        self.stepper.pause(paused, 0)
        return ''


@pytest.fixture
def scene():
    return Scene()


def test_exactly_the_features_of_the_registered_services_are_advertised():
    assert features(FEATURES) == [10, 11, 20, 22, 24, 25, 26, 31, 32]
    assert features(['get_simulator_features', 'step_simulation']) == [31, 32]
    assert features([]) == []


# ------------------------------------------------------------------------------------------ states
def test_a_simulation_plays_pauses_and_stops(scene):
    simulation = scene.simulation
    assert simulation.state == PLAYING
    assert simulation.set_state(PAUSED).code == OK
    assert (simulation.state, scene.world.tick) == (PAUSED, 24)
    assert simulation.set_state(STOPPED).code == OK
    assert (simulation.state, scene.world.tick) == (STOPPED, 0)
    assert simulation.set_state(PAUSED).code == OK
    assert (simulation.state, scene.world.tick) == (PAUSED, 0)
    assert simulation.set_state(PLAYING).code == OK
    assert simulation.state == PLAYING


@pytest.mark.parametrize('state', [STOPPED, PLAYING, PAUSED])
def test_the_state_that_it_is_in_already_is_said(scene, state):
    scene.simulation.set_state(state)
    outcome = scene.simulation.set_state(state)
    assert outcome.code == ALREADY_IN_TARGET_STATE
    assert 'already' in outcome.message


@pytest.mark.parametrize('state', [QUITTING, 4, 5, 77])
def test_other_states_are_not_supported(scene, state):
    outcome = scene.simulation.set_state(state)
    assert (outcome.code, scene.simulation.state) == (FEATURE_UNSUPPORTED, PLAYING)
    assert str(state) in outcome.message


def test_a_transition_that_fails_says_why():
    scene = Scene(failure='the simulation has failed')
    outcome = scene.simulation.set_state(PAUSED)
    assert (outcome.code, outcome.message) == (STATE_TRANSITION_ERROR, 'the simulation has failed')


def test_pausing_by_another_service_is_seen(scene):
    scene.stepper.pause(True, 0)
    assert scene.simulation.state == PAUSED
    scene.stepper.reset(0)
    assert scene.simulation.state == PAUSED
    scene.simulation.set_state(STOPPED)
    assert scene.simulation.state == STOPPED
    scene.stepper.reset(0)  # not the state that it has been stopped in
    assert scene.simulation.state == PAUSED


# ------------------------------------------------------------------------------------------- steps
def test_steps_are_taken_while_paused(scene):
    scene.simulation.set_state(PAUSED)
    assert scene.simulation.step(5).code == OK
    while scene.stepper.stepping:
        scene.stepper.take_steps(0)
    assert (scene.world.tick, scene.simulation.state) == (29, PAUSED)


def test_while_playing_or_stopped_nothing_is_stepped(scene):
    assert scene.simulation.step(1).code == OPERATION_FAILED
    scene.simulation.set_state(STOPPED)
    assert scene.simulation.step(1).code == OPERATION_FAILED
    assert scene.world.tick == 0


@pytest.mark.parametrize('steps', [0, 10**7, 2**64 - 1])
def test_a_number_of_steps_out_of_range_is_refused(scene, steps):
    scene.simulation.set_state(PAUSED)
    outcome = scene.simulation.step(steps)
    assert (outcome.code, scene.world.tick) == (OPERATION_FAILED, 24)
    assert str(steps) in outcome.message


# ------------------------------------------------------------------------------------------- reset
@pytest.mark.parametrize('scope', [SCOPE_DEFAULT, SCOPE_STATE, SCOPE_ALL])
def test_a_reset_puts_the_bodies_back(scene, scope):
    assert scene.simulation.reset(scope).code == OK
    assert bytes_of(scene.world) == bytes_of(World(scene.world.config))


@pytest.mark.parametrize('scope', [1, 3, 4, 5, 6, 254])
def test_time_and_spawned_entities_alone_cannot_be_reset(scene, scope):
    outcome = scene.simulation.reset(scope)
    assert (outcome.code, scene.world.tick) == (FEATURE_UNSUPPORTED, 24)


# ---------------------------------------------------------------------------------------- entities
@pytest.mark.parametrize(
    ('pattern', 'names'),
    [('', ['left', 'right']), ('l.*', ['left']), ('^right$', ['right']), ('x', []),
     ('.*t', ['left', 'right']), ('eft', []), ('[[:alpha:]]+', ['left', 'right']),
     ('[[:digit:]]*', [])],
)  # fmt: skip
def test_entities_are_filtered_by_a_pattern(scene, pattern, names):
    outcome, found = scene.simulation.entities(pattern)
    assert (outcome.code, found) == (OK, names)


@pytest.mark.parametrize('wrong', ['(', '[', '*', 'a{1,99999999999}', '(' * 5000 + ')' * 5000])
def test_a_pattern_that_is_none_is_refused(scene, wrong):
    outcome, found = scene.simulation.entities(wrong)
    assert (outcome.code, found) == (OPERATION_FAILED, [])
    assert wrong[:10] in outcome.message
    assert len(outcome.message) < 300


@pytest.mark.parametrize(
    ('centre', 'radius', 'names'),
    [
        ((2.0, 0.0, 1.0), 0.01, ['right']),  # inside
        ((2.0, 0.0, 2.0), 0.6, ['right']),
        ((2.0, 0.0, 2.0), 0.5, []),  # the body has fallen a little
        ((0.5, 0.0, 1.0), 1.1, ['left', 'right']),
        ((0.5, 0.0, 1.0), -1.0, []),
    ],
)
def test_a_sphere_is_near_a_body_that_it_touches(scene, centre, radius, names):
    points = [centre, (radius, math.nan, math.nan)]
    assert scene.simulation.entities(bounds=SPHERE, points=points)[1] == names


def test_entities_are_filtered_by_a_sphere(scene):
    near = [(2.0, 0.0, 1.0), (0.8, 0.0, 0.0)]
    assert scene.simulation.entities(bounds=SPHERE, points=near)[1] == ['right']
    assert scene.simulation.entities('l.*', bounds=SPHERE, points=near)[1] == []
    for wrong in ([], near[:1], [(math.nan, 0.0, 0.0), (1.0, 0.0, 0.0)]):
        outcome, found = scene.simulation.entities(bounds=SPHERE, points=wrong)
        assert (outcome.code, found) == (OPERATION_FAILED, [])


@pytest.mark.parametrize('more', [{'categories': 1}, {'tags': 2}, {'bounds': 1}, {'bounds': 2}])
def test_other_filters_are_not_supported(scene, more):
    outcome, found = scene.simulation.entities(**more)
    assert (outcome.code, found) == (FEATURE_UNSUPPORTED, [])


# ----------------------------------------------------------------------------------- entity states
def test_the_state_of_an_entity_is_its_best_fit(scene):
    outcome, fit = scene.simulation.entity_state('left')
    assert outcome.code == OK
    assert fit.position == pytest.approx(scene.world.rigid_fit('left').position)
    outcome, fit = scene.simulation.entity_state('middle')
    assert (outcome.code, fit) == (NOT_FOUND, None)
    assert 'left, right' in outcome.message


def test_a_pose_moves_the_body_as_it_is(scene):
    world = scene.world
    world.step(100)  # it is squashed
    before, other = world.rigid_fit('left'), world.positions('right')
    outcome = scene.simulation.set_entity_state('left', pose=(HERE, 2.0 * TURNED.as_quat()))
    assert outcome.code == OK
    after = world.rigid_fit('left')
    assert after.position == pytest.approx(HERE, abs=1e-9)
    assert after.rotation == pytest.approx(TURNED.as_matrix(), abs=1e-9)
    assert after.displacement == pytest.approx(before.displacement, abs=1e-9)
    assert after.displacement.max() > 0.01
    assert after.linear_velocity == pytest.approx(before.linear_velocity, abs=1e-9)
    assert after.angular_velocity == pytest.approx(before.angular_velocity, abs=1e-9)
    assert np.array_equal(world.positions('right'), other)


def test_a_twist_lets_the_body_move_as_a_whole(scene):
    shape = scene.world.positions('left')
    linear, angular = (1.0, 2.0, 3.0), (-0.5, 0.2, 4.0)
    assert scene.simulation.set_entity_state('left', twist=(linear, angular)).code == OK
    fit = scene.world.rigid_fit('left')
    assert fit.linear_velocity == pytest.approx(linear)
    assert fit.angular_velocity == pytest.approx(angular)
    assert np.array_equal(scene.world.positions('left'), shape)


def test_a_sleeping_body_wakes_when_it_is_moved(scene):
    for _ in range(60):  # a ball of 42 vertices rolls for long
        scene.world.step(240)
        if scene.world.is_asleep('left'):
            break
    assert scene.world.is_asleep('left')
    scene.simulation.set_entity_state('left', pose=(HERE, (0.0, 0.0, 0.0, 1.0)))
    assert not scene.world.is_asleep('left')


@pytest.mark.parametrize(
    ('pose', 'code'),
    [
        ((HERE, (0.0, 0.0, 0.0, 0.0)), INVALID_POSE),
        ((HERE, (math.nan, 0.0, 0.0, 1.0)), INVALID_POSE),
        (((math.nan, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), INVALID_POSE),
        (((1e9, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), INVALID_POSE),
    ],
)
def test_a_pose_that_cannot_be_is_refused(scene, pose, code):
    before = bytes_of(scene.world)
    assert scene.simulation.set_entity_state('left', pose=pose).code == code
    assert bytes_of(scene.world) == before


@pytest.mark.parametrize('wrong', [math.nan, math.inf, 1e6])
def test_a_twist_that_cannot_be_is_refused_and_the_pose_with_it(scene, wrong):
    before = bytes_of(scene.world)
    outcome = scene.simulation.set_entity_state(
        'left', pose=(HERE, (0.0, 0.0, 0.0, 1.0)), twist=((0.0, 0.0, wrong), (0.0, 0.0, 0.0))
    )
    assert outcome.code == OPERATION_FAILED
    assert bytes_of(scene.world) == before


def test_an_unknown_entity_is_not_found(scene):
    assert scene.simulation.set_entity_state('middle').code == NOT_FOUND
