# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the services of simulation_interfaces do, without the package."""

import asyncio
import math
import sys
from types import SimpleNamespace

from core_helpers import bytes_of
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
import trimesh

from softbody_ros.core import World
from softbody_ros.ros.simulation_interfaces import (
    ALREADY_IN_TARGET_STATE,
    ENTITIES_SPAWN_FAILED,
    FEATURE_UNSUPPORTED,
    FEATURES,
    INVALID_POSE,
    INVALID_SPAWN_POSE,
    MISSING_ASSETS,
    NAME_INVALID,
    NAME_NOT_UNIQUE,
    NAMESPACE_INVALID,
    NO_RESOURCE,
    NOT_FOUND,
    OK,
    OPERATION_FAILED,
    PAUSED,
    PLAYING,
    QUITTING,
    RESOURCE_PARSE_ERROR,
    SCOPE_ALL,
    SCOPE_DEFAULT,
    SCOPE_SPAWNED,
    SCOPE_STATE,
    SPHERE,
    STATE_TRANSITION_ERROR,
    STOPPED,
    UNSUPPORTED_ASSETS,
    UNSUPPORTED_FORMAT,
    Outcome,
    Simulation,
    features,
)
from softbody_ros.ros.simulation_interfaces_node import _Server
from softbody_ros.scene import parameters, resources
from softbody_ros.timeline.stepper import Stepper

pytestmark = pytest.mark.oldest

HERE = np.array([1.0, -2.0, 3.0])
TURNED = Rotation.from_euler('xyz', [0.3, -0.7, 1.9])


class Scene:
    """Two bodies, 0.1 s after their start, as a simulation that can be paused and reset."""

    def __init__(self, failure=''):
        self.values = {'bodies': ['left', 'right'], 'obstacles': ['ground']}
        for name, x in (('left', -1.0), ('right', 2.0)):
            own = {'subdivisions': 1, 'position': [x, 0.0, 1.0], 'stiffness': 0.2}
            self.values |= {f'{name}.{key}': value for key, value in own.items()}
        self.start = dict(self.values)
        self.world = World(parameters.make_scene(self.values).world)
        self.stepper = Stepper(self.world, {})
        self.failure = failure
        self.simulation = Simulation(
            self.stepper, self, self.pause, lambda: self.stepper.reset(0), self.step
        )
        self.world.step(24)

    @property
    def taken(self):
        return {'world', *self.values['bodies'], *self.values['obstacles']}

    def request(self, values):
        """Set parameters as the node does."""
        values = self.values | values
        table = parameters.table(parameters.scene_lists(values))
        values = {name: value for name, value in values.items() if name in table}
        self.stepper.configure(parameters.make_scene(values).world)
        self.values = values

    def pause(self, paused):
        if self.failure:
            return self.failure
        self.stepper.pause(paused, 0)
        return ''

    async def step(self, ticks):
        if self.failure:
            return self.failure
        request = self.stepper.single_step(ticks)
        while request.waits:
            self.stepper.take_steps(0)
        return request.failure


@pytest.fixture
def scene():
    return Scene()


def test_exactly_the_features_of_the_registered_services_are_advertised():
    assert features(FEATURES) == [0, 1, 9, 10, 11, 20, 22, 23, 24, 25, 26, 31, 32, 50]
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
    assert asyncio.run(scene.simulation.step(5)).code == OK
    assert (scene.world.tick, scene.simulation.state) == (29, PAUSED)


def test_while_playing_or_stopped_nothing_is_stepped(scene):
    assert asyncio.run(scene.simulation.step(1)).code == OPERATION_FAILED
    scene.simulation.set_state(STOPPED)
    assert asyncio.run(scene.simulation.step(1)).code == OPERATION_FAILED
    assert scene.world.tick == 0


def test_steps_that_are_not_taken_are_a_failure(scene, server):
    scene.simulation.set_state(PAUSED)
    scene.failure = 'the simulation has stopped'
    answer = asyncio.run(server.step_simulation(filled(steps=1), response()))
    assert (answer.result.result, scene.world.tick) == (OPERATION_FAILED, 24)
    assert answer.result.error_message == 'the simulation has stopped'


@pytest.mark.parametrize('steps', [0, 10**7, 2**64 - 1])
def test_a_number_of_steps_out_of_range_is_refused(scene, steps):
    scene.simulation.set_state(PAUSED)
    outcome = asyncio.run(scene.simulation.step(steps))
    assert (outcome.code, scene.world.tick) == (OPERATION_FAILED, 24)
    assert str(steps) in outcome.message


# ------------------------------------------------------------------------------------------- reset
@pytest.mark.parametrize('scope', [SCOPE_DEFAULT, SCOPE_STATE, SCOPE_ALL])
def test_a_reset_puts_the_bodies_back(scene, scope):
    assert scene.simulation.reset(scope).code == OK
    assert bytes_of(scene.world) == bytes_of(World(scene.world.config))


@pytest.mark.parametrize('scope', [1, 3, 5, 7, 8, 254])
def test_time_cannot_be_reset(scene, scope):
    outcome = scene.simulation.reset(scope)
    assert (outcome.code, scene.world.tick) == (FEATURE_UNSUPPORTED, 24)


def test_a_reset_of_what_was_spawned_removes_it(scene):
    assert scene.simulation.spawn('cube', uri='box')[0].code == OK
    assert scene.simulation.delete('left').code == OK
    assert scene.simulation.reset(SCOPE_SPAWNED).code == OK
    assert (scene.world.names, scene.world.tick) == (('right',), 24)
    assert scene.simulation.delete('cube').code == NOT_FOUND
    assert scene.simulation.spawn('cube', uri='box')[0].code == OK
    assert scene.simulation.reset(SCOPE_SPAWNED | SCOPE_STATE).code == OK
    assert (scene.world.names, scene.world.tick) == (('right',), 0)


def test_a_reset_of_everything_is_the_start_again(scene):
    fresh = World(scene.world.config)
    assert scene.simulation.spawn('cube', uri='box')[0].code == OK
    outcome = scene.simulation.delete('grounds')
    assert outcome.code == NOT_FOUND and 'did you mean ground?' in outcome.message
    assert scene.simulation.delete('left').code == OK
    assert scene.simulation.delete('ground').code == OK
    scene.world.step(7)
    assert scene.simulation.reset(SCOPE_ALL).code == OK
    assert (set(scene.world.names), scene.world.tick) == ({'left', 'right'}, 0)
    for each in (fresh, scene.world):
        each.step(200)
    for name in fresh.names:
        assert np.array_equal(scene.world.positions(name), fresh.positions(name))


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
    scene.request({'left.mode': 'rigid'})  # a soft ball of 42 vertices rolls for long
    scene.world.step(480)
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


# -------------------------------------------------------------------------------- they come and go
TABLE = """
/**:
  ros__parameters:
    bodies: [apple]
    obstacles: [plate, fork]
    apple:
      mesh: icosphere
      subdivisions: 1
      size: 0.05
      position: [0.0, 0.0, 0.2]
      initial_velocity: {linear: [1.0, 0.0, 0.0]}
      mass: 0.2
      color: [0.0, 1.0, 0.0, 1.0]
    plate: {type: cylinder, size: [0.3, 0.3, 0.02], position: [1.0, 0.0, 0.0]}
    fork: {type: box, size: [0.2, 0.01, 0.01], velocity: {linear: [0.0, 0.5, 0.0]}}
    gravity.magnitude: 1.0
"""
FRUIT = """
softbody_sim:
  ros__parameters:
    bodies: [apple, pear]
    apple.position: [0.0, 0.0, 1.0]
    pear.position: [0.0, 2.0, 1.0]
"""
QUARTER = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))


def test_a_mesh_is_spawned_as_a_body_at_a_pose(scene, tmp_path):
    outcome, name = scene.simulation.spawn('cube', uri='box', pose=(HERE, 2.0 * TURNED.as_quat()))
    assert (outcome.code, name) == (OK, 'cube')
    assert scene.world.names == ('left', 'right', 'cube')
    fit = scene.world.rigid_fit('cube')
    assert fit.position == pytest.approx(HERE)
    assert fit.rotation == pytest.approx(TURNED.as_matrix(), abs=1e-6)
    file = tmp_path / 'a part-2.stl'
    make_box(file)
    for uri in (str(file), f'file://{file}'):
        outcome, name = scene.simulation.spawn('', may_rename=True, uri=uri)
        assert outcome.code == OK
    assert scene.world.names[3:] == ('a_part_2', 'a_part_2_2')
    uri = 'package://softbody_ros/config/duck.obj'
    assert scene.simulation.spawn('duck', uri=uri)[0].code == OK
    assert scene.values['duck.mesh'] == uri


def test_a_scene_is_spawned_as_one_entity(scene, tmp_path):
    file = tmp_path / 'table.yaml'
    file.write_text(TABLE)
    pose = ((5.0, 0.0, 1.0), QUARTER)
    outcome, name = scene.simulation.spawn('lunch', uri=str(file), pose=pose)
    assert (outcome.code, name) == (OK, 'lunch')
    assert scene.world.names == ('left', 'right', 'lunch')
    assert [item.name for item in scene.world.config.obstacles] == [
        'ground', 'lunch_plate', 'lunch_fork'
    ]  # fmt: skip
    lunch = scene.world.body_config('lunch')
    assert (lunch.mass, lunch.size) == (0.2, 0.05)
    assert lunch.position == pytest.approx((5.0, 0.0, 1.2))
    assert lunch.initial_velocity_linear == pytest.approx((0.0, 1.0, 0.0))
    _, plate, fork = scene.world.config.obstacles
    assert plate.position == pytest.approx((5.0, 1.0, 1.0))
    assert fork.velocity_linear == pytest.approx((-0.5, 0.0, 0.0))
    assert scene.values['lunch.color'] == [0.0, 1.0, 0.0, 1.0]
    assert scene.world.config.gravity_magnitude == 9.81  # what is not of them stays
    assert scene.simulation.delete('lunch').code == OK
    assert scene.world.names == ('left', 'right')
    assert [item.name for item in scene.world.config.obstacles] == ['ground']


def test_what_holds_a_body_is_that_of_the_same_resource(scene):
    text = (
        '/**: {ros__parameters: {bodies: [a, b], obstacles: [cup], cup.type: box, '
        'a.attach: {to: cup, radius: 9.0}, b.attach: {to: ground, radius: 9.0}}}'
    )
    assert scene.simulation.spawn('two', text=text) == (Outcome(), 'two')
    assert scene.world.body_config('two_a').attach_to == 'two_cup'
    assert scene.world.body_config('two_b').attach_to == 'ground'


def test_a_scene_is_spawned_from_a_text(scene):
    assert scene.simulation.spawn('', text=TABLE) == (Outcome(), 'apple')
    outcome, name = scene.simulation.spawn('', text=FRUIT)
    assert outcome.code == NAME_NOT_UNIQUE and 'apple' in outcome.message
    outcome, name = scene.simulation.spawn('', True, text=FRUIT)
    assert (outcome.code, name) == (OK, 'scene')
    assert scene.world.names[3:] == ('scene_apple', 'scene_pear')
    assert scene.simulation.spawn('bowl', True, text=FRUIT) == (Outcome(), 'bowl')
    assert scene.simulation.spawn('bowl', True, text=FRUIT) == (Outcome(), 'bowl_2')
    assert scene.simulation.delete('bowl_apple').code == OK
    assert scene.simulation.delete('bowl').code == OK
    assert scene.world.names[5:] == ('bowl_2_apple', 'bowl_2_pear')


def make_box(file):
    trimesh.creation.box().export(file)


MESH = '/**: {ros__parameters: {bodies: [a], a: {mesh: %s}}}'


@pytest.mark.parametrize(
    ('arguments', 'code', 'sentence'),
    [
        ({'name': 'left', 'uri': 'box'}, NAME_NOT_UNIQUE, 'the name left is that of'),
        ({'name': 'ground', 'uri': 'box'}, NAME_NOT_UNIQUE, 'ground'),
        ({'name': '', 'uri': 'box'}, NAME_INVALID, 'a mesh has no name'),
        ({'name': '1st', 'uri': 'box'}, NAME_INVALID, "'1st' is not usable"),
        ({'name': 'a/b', 'uri': 'box', 'may_rename': True}, NAME_INVALID, "'a/b' is not usable"),
        ({'name': 'a'}, NO_RESOURCE, 'neither a URI nor a text'),
        ({'name': 'a', 'text': '  '}, NO_RESOURCE, 'neither a URI nor a text'),
        ({'name': 'a', 'uri': 'a.sdf'}, UNSUPPORTED_FORMAT, "'a.sdf' is neither a primitive"),
        ({'name': 'a', 'uri': 'ball'}, UNSUPPORTED_FORMAT, "'ball' is neither a primitive"),
        ({'name': 'a', 'text': '<sdf/>'}, UNSUPPORTED_FORMAT, 'the text is XML'),
        ({'name': 'a', 'uri': '/no.stl'}, MISSING_ASSETS, '/no.stl does not exist'),
        ({'name': 'a', 'uri': '/no.yaml'}, MISSING_ASSETS, '/no.yaml does not exist'),
        ({'name': 'a', 'uri': 'package://no_such/a.stl'}, MISSING_ASSETS, "'no_such' is not inst"),
        ({'name': 'a', 'text': MESH % '/no.stl'}, MISSING_ASSETS, '/no.stl does not exist'),
        ({'name': 'a', 'text': MESH % '/no.fbx'}, UNSUPPORTED_ASSETS, "a.mesh '/no.fbx' is neit"),
        ({'name': 'a', 'text': 'bodies: ['}, RESOURCE_PARSE_ERROR, 'is not YAML'),
        ({'name': 'a', 'text': 'bodies: [a]'}, RESOURCE_PARSE_ERROR, 'below the name of a node'),
        ({'name': 'a', 'text': MESH % 'box, mas: 1'}, RESOURCE_PARSE_ERROR, 'parameter a.mas'),
        ({'name': 'a', 'text': MESH % 'box, mass: -1'}, RESOURCE_PARSE_ERROR, 'a.mass is -1'),
        ({'name': 'a', 'uri': 'box', 'namespace': 'left'}, NAMESPACE_INVALID, "is 'left'"),
        ({'name': 'a', 'uri': 'box', 'pose': (HERE, (0.0,) * 4)}, INVALID_SPAWN_POSE, 'direction'),
        (
            {'name': 'a', 'uri': 'box', 'pose': ((math.nan, 0.0, 0.0), QUARTER)},
            INVALID_SPAWN_POSE, 'is not within',
        ),
        (
            {'name': 'a', 'uri': 'box', 'pose': ((2e6, 0.0, 0.0), QUARTER)},
            INVALID_SPAWN_POSE, 'is not within 1e+06 m',
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_spawned_is_refused_without_effect(scene, arguments, code, sentence):
    before = bytes_of(scene.world), scene.world.config
    outcome, name = scene.simulation.spawn(**arguments)
    assert (outcome.code, name) == (code, ''), outcome
    assert sentence in outcome.message
    assert '\n' not in outcome.message
    assert (bytes_of(scene.world), scene.world.config) == before


def test_files_that_cannot_be_read_are_refused(scene, tmp_path):
    file = tmp_path / 'bad.stl'
    file.write_text('solid nothing')
    outcome, _ = scene.simulation.spawn('a', uri=str(file))
    assert outcome.code == RESOURCE_PARSE_ERROR and 'bad.stl' in outcome.message
    outcome, _ = scene.simulation.spawn('a', text=MESH % file)
    assert outcome.code == UNSUPPORTED_ASSETS and 'bad.stl' in outcome.message
    binary = tmp_path / 'bad.yaml'
    binary.write_bytes(b'\xff\xfe')
    outcome, _ = scene.simulation.spawn('a', uri=str(binary))
    assert outcome.code == RESOURCE_PARSE_ERROR and 'UTF-8' in outcome.message


def test_bodies_and_obstacles_are_deleted(scene):
    outcome = scene.simulation.delete('grounds')
    assert outcome.code == NOT_FOUND and 'did you mean ground?' in outcome.message
    assert scene.simulation.delete('left').code == OK
    assert scene.simulation.delete('ground').code == OK
    assert (scene.world.names, scene.world.obstacles) == (('right',), ())
    outcome = scene.simulation.delete('left')
    assert outcome.code == NOT_FOUND and 'known are right' in outcome.message
    assert scene.simulation.delete('').code == NOT_FOUND
    assert scene.simulation.delete('right').code == OK
    assert scene.simulation.delete('right').message.endswith('there are none')


def test_what_has_been_removed_by_parameters_is_no_member_any_more(scene):
    duck = '/**: {ros__parameters: {bodies: [a, b], obstacles: [pond]}}'
    assert scene.simulation.spawn('duck', text=duck)[0].code == OK
    own = {'bodies': ['left', 'right'], 'obstacles': ['ground']}
    scene.request(own | {'bodies': ['left', 'right', 'duck_b']})
    # what there is of it is one entity still
    assert scene.simulation.spawn('duck', uri='box')[0].code == NAME_NOT_UNIQUE
    scene.request(own)
    assert scene.simulation.delete('duck').code == NOT_FOUND
    assert scene.simulation.spawn('duck', uri='box') == (Outcome(), 'duck')
    # of the same name as a member that is gone, but not one
    scene.request({'bodies': ['left', 'right', 'duck', 'duck_a']})
    assert scene.simulation.delete('duck').code == OK
    assert scene.world.names == ('left', 'right', 'duck_a')


def test_every_ending_that_is_advertised_is_read(tmp_path):
    for ending in resources.FORMATS:
        file = tmp_path / f'thing.{ending}'
        file.write_text(TABLE) if ending in resources.SCENE_TYPES else make_box(file)
        assert resources.read_resource(str(file)).bodies


# ---------------------------------------------------------------------------------- the messages
def filled(**fields):
    """Return an object with fields, as messages have them."""
    return SimpleNamespace(**fields)


def spawn_request(name, uri, version, frame_id=''):
    x, y, z = HERE
    pose = filled(position=filled(x=x, y=y, z=z), orientation=filled(x=0.0, y=0.0, z=0.0, w=1.0))
    resource = {'uri': uri, 'resource_string': ''}
    if version > 1:
        resource = {'entity_resource': filled(**resource)}
    return filled(
        name=name, allow_renaming=False, entity_namespace='', **resource,
        initial_pose=filled(header=filled(frame_id=frame_id), pose=pose),
    )  # fmt: skip


def response(**fields):
    return filled(result=filled(result=-1, error_message=''), **fields)


@pytest.fixture
def server(scene, monkeypatch):
    module = SimpleNamespace(SpawnResult=lambda entity_name: response(entity_name=entity_name))
    monkeypatch.setitem(sys.modules, 'simulation_interfaces', SimpleNamespace(msg=module))
    monkeypatch.setitem(sys.modules, 'simulation_interfaces.msg', module)
    names = list(FEATURES)
    return _Server(scene.simulation, 'world', lambda: 0, names)


@pytest.mark.parametrize('version', [1, 2])
def test_requests_of_both_versions_spawn_an_entity(scene, server, version):
    request = spawn_request('cube', 'box', version, 'world')
    answer = server.answer('spawn_entity')(request, response(entity_name=''))
    assert (answer.result.result, answer.entity_name) == (OK, 'cube')
    assert scene.world.rigid_fit('cube').position == pytest.approx(HERE)
    answer = server.answer('delete_entity')(filled(entity='cube'), response())
    assert answer.result.result == OK
    assert scene.world.names == ('left', 'right')
    answer = server.answer('delete_entity')(filled(entity='cube'), response())
    assert answer.result.result == NOT_FOUND
    request = spawn_request('cube', 'box', version, 'left')
    answer = server.answer('spawn_entity')(request, response(entity_name=''))
    assert answer.result.result == OPERATION_FAILED
    assert "poses are given in 'world'" in answer.result.error_message


def test_several_entities_are_spawned_each_with_its_result(scene, server):
    requests = [spawn_request(name, 'box', 2) for name in ('a', 'left', 'b')]
    answer = server.answer('spawn_entities')(filled(spawn_requests=requests), response(results=[]))
    assert answer.result.result == ENTITIES_SPAWN_FAILED
    assert answer.result.error_message.startswith('1 of 3 are not there: the name left is')
    assert [each.result.result for each in answer.results] == [OK, NAME_NOT_UNIQUE, OK]
    assert [each.entity_name for each in answer.results] == ['a', '', 'b']
    assert scene.world.names == ('left', 'right', 'a', 'b')
    answer = server.answer('spawn_entities')(
        filled(spawn_requests=requests[:0]), response(results=[])
    )
    assert answer.result.result == OK


def test_features_are_those_of_the_services_that_there_are(scene):
    server = _Server(scene.simulation, 'world', lambda: 0, ['spawn_entity'])
    answer = server.get_simulator_features(None, filled(features=filled()))
    assert answer.features.features == [0, 9]
    assert answer.features.spawn_formats == list(resources.FORMATS)
