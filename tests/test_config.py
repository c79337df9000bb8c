# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Every setting: what it accepts, what it refuses, and with which sentence."""

from array import array
import dataclasses
import math
import re
import sys

from core_helpers import sheet
import numpy as np
import pytest

from softbody_ros.core import BodyConfig, ConfigError, ObstacleConfig, World, WorldConfig
from softbody_ros.core.config import Setting, checked, settings, shown

pytestmark = pytest.mark.oldest

CLASSES = (BodyConfig, ObstacleConfig, WorldConfig)
EVERY = [
    (config_class, field, dotted, facts)
    for config_class in CLASSES
    for field, dotted, facts in settings(config_class)
]
"""Of each setting its class, field, dotted name and facts. All are checked by one function, which
knows the facts: so values of a wrong kind are tried with one setting of each kind."""


def the(config_class, field):
    return next(case for case in EVERY if case[:2] == (config_class, field))


FLOAT = the(BodyConfig, 'mass')
INTEGER = the(BodyConfig, 'subdivisions')
VECTOR = the(ObstacleConfig, 'size')
INDICES = the(BodyConfig, 'pins_indices')
TEXT = the(ObstacleConfig, 'mesh')
CHOICE = the(BodyConfig, 'mode')


def of_each(*kinds):
    return pytest.mark.parametrize(
        ('config_class', 'field', 'dotted', 'facts'), [pytest.param(*k, id=k[2]) for k in kinds]
    )


def is_scalar(facts):
    return type(facts.default) in (int, float)


def made(config_class, field, value):
    """Return a config with one field set."""
    return config_class(**{field: value})


def refusal(config_class, field, value):
    """Return the message with which a value is refused."""
    with pytest.raises(ConfigError) as caught:
        made(config_class, field, value)
    return str(caught.value)


def assert_one_sentence(message, config_class, dotted):
    name = getattr(config_class, 'name', '')
    assert message.startswith(f'{name}.{dotted} is ' if name else f'{dotted} is ')
    assert '\n' not in message
    assert len(message) < 600


def elementwise(facts, number):
    """Return the number, or a vector or list with it as its last element."""
    return number if is_scalar(facts) else (*facts.default[:-1], number)


# ---------------------------------------------------------------------------------- every setting
@pytest.mark.parametrize('config_class', CLASSES)
def test_defaults_are_valid_and_stored_as_stated(config_class):
    config = config_class()
    for field, _, facts in settings(config_class):
        value = getattr(config, field)
        assert value == facts.default
        assert type(value) is type(facts.default)


@pytest.mark.parametrize('config_class', CLASSES)
def test_every_field_but_names_and_parts_is_a_setting(config_class):
    known = {field for field, _, _ in settings(config_class)}
    others = {field.name for field in dataclasses.fields(config_class)} - known
    assert others <= {'name', 'bodies', 'obstacles'}


@pytest.mark.parametrize('config_class', CLASSES)
def test_configs_cannot_be_changed_behind_the_validation(config_class):
    field = settings(config_class)[0][0]
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(config_class(), field, 0)


def test_every_setting_is_described_and_of_a_kind_that_is_tried_here():
    for _, _, dotted, facts in EVERY:
        assert facts.description, dotted
        assert isinstance(facts.default, (int, float, str, tuple)), dotted
        assert facts.items in (None, int), dotted
        if isinstance(facts.default, str):
            assert facts.range_text.split(' | ') == list(facts.choices or ['']), dotted
            assert not facts.choices or facts.default in facts.choices, dotted
        else:
            assert facts.minimum < facts.maximum, dotted
            assert f'{facts.maximum:g}' in facts.range_text, dotted


def test_the_whole_range_of_every_setting_is_allowed_and_no_number_outside():
    for config_class, field, dotted, facts in EVERY:
        if isinstance(facts.default, str):
            continue
        for end in (facts.minimum, facts.maximum):
            value = end if is_scalar(facts) else (end,) * (facts.length or 1)
            kept = getattr(made(config_class, field, value), field)
            # an empty list has no type in ROS: -1 stands for none
            assert kept == (() if facts.items and end == -1 else value), dotted
        for outside in (facts.minimum - 1, facts.maximum + 1):
            message = refusal(config_class, field, elementwise(facts, outside))
            assert_one_sentence(message, config_class, dotted)
            assert f'from {facts.minimum:g} to {facts.maximum:g}' in message
            assert facts.unit in message
            assert 'each element' in message or is_scalar(facts), dotted


def test_only_the_listed_choices_are_allowed():
    for config_class, field, dotted, facts in EVERY:
        for choice in facts.choices:
            assert getattr(made(config_class, field, choice), field) == choice, dotted
        if facts.choices:
            message = refusal(config_class, field, 'cubic')
            assert_one_sentence(message, config_class, dotted)
            assert "'cubic'" in message
            assert all(choice in message for choice in facts.choices)


def test_a_direction_and_a_quaternion_need_a_length():
    cases = [case for case in EVERY if case[1].endswith(('direction', 'orientation'))]
    assert len(cases) == 3
    for config_class, field, dotted, facts in cases:
        message = refusal(config_class, field, (0.0,) * facts.length)
        assert_one_sentence(message, config_class, dotted)
        assert 'zero' in message
        assert made(config_class, field, (0.0,) * (facts.length - 1) + (0.5,))


# ------------------------------------------------------------------------------- one of each kind
def test_the_message_tells_a_value_from_the_bound_that_it_just_exceeds():
    assert '1.0000000000000002' in refusal(BodyConfig, 'stiffness', math.nextafter(1.0, 2.0))


@of_each(FLOAT, INTEGER, VECTOR, INDICES)
def test_an_integer_beyond_any_float_is_out_of_range_too(config_class, field, dotted, facts):
    for number in (10**400, -(10**400)):
        message = refusal(config_class, field, elementwise(facts, number))
        assert_one_sentence(message, config_class, dotted)


@of_each(FLOAT, INTEGER, VECTOR, INDICES)
def test_an_array_without_dimensions_is_no_value(config_class, field, dotted, facts):
    assert_one_sentence(refusal(config_class, field, np.array(0.5)), config_class, dotted)


@pytest.mark.parametrize('number', [math.nan, math.inf, -math.inf, np.float32('nan')])
@of_each(FLOAT, INTEGER, VECTOR, INDICES)
def test_numbers_that_are_not_finite_are_refused(config_class, field, dotted, facts, number):
    message = refusal(config_class, field, elementwise(facts, number))
    assert_one_sentence(message, config_class, dotted)
    assert str(float(number)) in message


@pytest.mark.parametrize('value', ['0.5', None, True, np.True_, [0.5], 1j, {}])
@of_each(FLOAT, INTEGER)
def test_a_number_must_be_one(config_class, field, dotted, facts, value):
    message = refusal(config_class, field, value)
    assert_one_sentence(message, config_class, dotted)
    assert 'number' in message


@pytest.mark.parametrize('value', [True, '0.5', None, [0.5]])
def test_the_message_shows_the_value_as_it_was_given(value):
    assert repr(value) in refusal(BodyConfig, 'mass', value)


@of_each(INTEGER, INDICES)
def test_a_whole_number_is_not_a_float(config_class, field, dotted, facts):
    for value in (0.5, 1.0):
        message = refusal(config_class, field, elementwise(facts, value))
        assert 'whole number' in message
        assert repr(value) in message


@pytest.mark.parametrize('kind', [int, np.int64, np.float32])
def test_a_whole_number_becomes_a_float(kind):
    value = BodyConfig(mass=kind(2)).mass
    assert type(value) is float
    assert value == 2.0


@pytest.mark.parametrize('kind', [list, tuple, np.array, lambda given: array('l', given)])
@of_each(VECTOR, INDICES)
def test_any_sequence_of_numbers_becomes_a_tuple(config_class, field, dotted, facts, kind):
    given = (1, 0, 0) if field == 'pins_indices' else (1, 1, 1)  # indices are kept once each
    value = getattr(made(config_class, field, kind(list(given))), field)
    assert value == tuple(dict.fromkeys(given) if field == 'pins_indices' else given)
    assert all(type(item) is (facts.items or float) for item in value)


def test_a_vector_must_be_one_of_the_right_length():
    for value in ((), [1.0, 1.0], [1.0] * 4, 1.0, 'xyz', None):
        message = refusal(ObstacleConfig, 'size', value)
        assert_one_sentence(message, ObstacleConfig, 'size')
        assert '3 numbers' in message


@pytest.mark.parametrize('value', [1, 'xyz', None, {}])
def test_a_list_must_be_one(value):
    message = refusal(BodyConfig, 'pins_indices', value)
    assert_one_sentence(message, BodyConfig, 'pins.indices')
    assert 'a list of whole numbers' in message
    names = Setting((), 'names', items=str)
    assert checked('names', ['a', 'b'], names) == ('a', 'b')
    for wrong in (value, [value]):
        if wrong != ['xyz']:
            with pytest.raises(ConfigError, match=r'^names is .*: it must be a list of names$'):
                checked('names', wrong, names)


@pytest.mark.parametrize('kind', [list, tuple, np.array, lambda given: array('q', given)])
def test_a_long_list_is_checked_as_a_whole(kind):
    """Not by a call for each number: the node waits meanwhile."""

    def calls(count):
        made, value = [], kind(list(range(count)))
        sys.setprofile(lambda frame, event, _: made.append(frame.f_code.co_name))
        try:
            config = BodyConfig(pins_indices=value)
        finally:
            sys.setprofile(None)
        assert config.pins_indices == tuple(range(count))
        return len(made)

    assert calls(3000) == calls(3)


@pytest.mark.parametrize('item', ['1', None, True, 1.0, math.nan, -2, 10**400])
def test_a_wrong_number_in_a_long_list_is_refused_as_in_a_short_one(item):
    for count in (0, 3, 3000):
        value = [*range(count), item]
        message = refusal(BodyConfig, 'pins_indices', value)
        assert_one_sentence(message, BodyConfig, 'pins.indices')
        assert message.replace(shown(value), '') == refusal(
            BodyConfig, 'pins_indices', [item]
        ).replace(shown([item]), '')


@pytest.mark.parametrize('item', ['1', None, True, [1.0]])
@of_each(VECTOR, INDICES)
def test_each_element_must_be_a_number(config_class, field, dotted, facts, item):
    message = refusal(config_class, field, elementwise(facts, item))
    assert_one_sentence(message, config_class, dotted)
    assert 'number' in message


@pytest.mark.parametrize('value', [3, None, True, ['linear']])
@of_each(TEXT, CHOICE)
def test_a_text_must_be_one(config_class, field, dotted, facts, value):
    assert_one_sentence(refusal(config_class, field, value), config_class, dotted)


@pytest.mark.parametrize('value', [0, 1.0, 'true', None, [True]])
def test_true_or_false_must_be_one(value):
    facts = Setting(False, 'a switch')
    assert checked('on', np.True_, facts) is True
    with pytest.raises(ConfigError, match=r'^on is .*: it must be true or false$'):
        checked('on', value, facts)


# ------------------------------------------------------------------------------- across settings
@pytest.mark.parametrize(
    'name', ['', '1ball', 'a ball', 'ball.x', '_ball', 'bäll', 3, None, 'b-b']
)
@pytest.mark.parametrize('config_class', [BodyConfig, ObstacleConfig])
def test_a_name_must_be_usable_in_a_parameter_name(config_class, name):
    with pytest.raises(ConfigError, match='letters, digits and underscores') as caught:
        config_class(name=name)
    assert repr(name) in str(caught.value)


@pytest.mark.parametrize('name', ['b', 'Ball_2', 'ball__'])
def test_usual_names_are_usable(name):
    assert BodyConfig(name=name).name == name


def test_two_things_cannot_share_a_name():
    ball, ground = BodyConfig(name='ball'), ObstacleConfig(name='ground')
    for parts in (
        {'bodies': (ball, ball)},
        {'obstacles': (ground, ground)},
        {'bodies': (BodyConfig(name='ground'),), 'obstacles': (ground,)},
    ):
        with pytest.raises(ConfigError, match='used twice'):
            WorldConfig(**parts)


def test_a_viscous_fraction_cannot_exceed_one_but_a_coefficient_can():
    assert BodyConfig(friction=1.5).friction == 1.5
    assert BodyConfig(friction_model='viscous').friction <= 1.0
    with pytest.raises(ConfigError, match=r'ball\.friction is 1\.5: .* from 0 to 1.*coulomb'):
        BodyConfig(name='ball', friction=1.5, friction_model='viscous')


def test_messages_carry_the_name_of_the_thing():
    with pytest.raises(ConfigError, match=r'^left_ball\.initial_velocity\.linear is '):
        BodyConfig(name='left_ball', initial_velocity_linear=(0.0, 0.0, 1e9))


def test_a_surface_stands_for_a_mesh_name():
    surface = sheet()
    assert BodyConfig(mesh=surface).mesh is surface


def test_gravity_has_the_magnitude_whatever_the_length_of_its_direction():
    config = WorldConfig(gravity_magnitude=3.0, gravity_direction=(0.0, 30.0, -40.0))
    assert config.gravity == pytest.approx([0.0, 1.8, -2.4])


def test_a_world_of_nothing_can_be_stepped():
    world = World(WorldConfig(bodies=(), obstacles=()))
    world.step(3)
    assert world.tick == 3


def test_an_obstacle_is_moved_with_what_is_checked_only():
    box = ObstacleConfig(name='box', type='box', size=(0.1, 0.2, 0.3), velocity_linear=(1, 0, 0))
    there = box.moved(position=np.array([1, 2, 3]), orientation=[0, 0, 1, 0])
    same = dataclasses.replace(box, position=(1.0, 2.0, 3.0), orientation=(0.0, 0.0, 1.0, 0.0))
    assert there == same and hash(there) == hash(same) and box.position == (0.0, 0.0, 0.0)
    for values, message in (
        ({'position': (0, 0, math.inf)}, 'box.position is [0, 0, inf]'),
        ({'orientation': (0, 0, 0, 0)}, 'its length must not be zero'),
        ({'velocity_linear': (1, 2)}, 'it must be 3 numbers'),
    ):
        with pytest.raises(ConfigError, match=re.escape(message)):
            box.moved(**values)
