# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Every setting: what it accepts, what it refuses, and with which sentence."""

from array import array
import dataclasses
import math
import re

from core_helpers import sheet
import numpy as np
import pytest

from softbody_ros.core import BodyConfig, ConfigError, ObstacleConfig, World, WorldConfig
from softbody_ros.core.config import settings

CLASSES = (BodyConfig, ObstacleConfig, WorldConfig)


def every_setting(condition):
    """Return pytest parameters (class, field, dotted name, Setting) of the settings chosen."""
    return [
        pytest.param(config_class, field, dotted, facts, id=f'{config_class.__name__}-{dotted}')
        for config_class in CLASSES
        for field, dotted, facts in settings(config_class)
        if condition(facts)
    ]


def is_scalar(facts):
    return type(facts.default) in (int, float)


def is_float(facts):
    return type(facts.default) is float


def is_vector(facts):
    return facts.length is not None


def is_text(facts):
    return isinstance(facts.default, str)


def has_whole_number_in_range(facts):
    return is_float(facts) and math.ceil(facts.minimum) <= facts.maximum


EVERY = every_setting(lambda facts: True)
SCALARS = every_setting(is_scalar)
VECTORS = every_setting(is_vector)
TEXTS = every_setting(is_text)
NUMERIC = SCALARS + VECTORS


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
    """Return the number, or a vector with it as its last element."""
    return number if is_scalar(facts) else (*facts.default[:-1], number)


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


@pytest.mark.parametrize(('config_class', 'field', 'dotted', 'facts'), EVERY)
def test_every_setting_is_described(config_class, field, dotted, facts):
    assert facts.description
    if not is_text(facts):
        assert facts.minimum is not None
        assert facts.maximum is not None
        assert facts.minimum < facts.maximum
        assert f'{facts.maximum:g}' in facts.range_text
    if facts.choices:
        assert facts.range_text.split(' | ') == list(facts.choices)


@pytest.mark.parametrize(('config_class', 'field', 'dotted', 'facts'), NUMERIC)
def test_both_ends_of_the_range_are_allowed(config_class, field, dotted, facts):
    for end in (facts.minimum, facts.maximum):
        value = end if is_scalar(facts) else (end,) * facts.length
        kept = getattr(made(config_class, field, type(facts.default)(value)), field)
        assert kept == value


@pytest.mark.parametrize(('config_class', 'field', 'dotted', 'facts'), NUMERIC)
def test_a_number_outside_the_range_is_refused(config_class, field, dotted, facts):
    for outside in (facts.minimum - 1, facts.maximum + 1):
        message = refusal(config_class, field, elementwise(facts, outside))
        assert_one_sentence(message, config_class, dotted)
        assert f'from {facts.minimum:g} to {facts.maximum:g}' in message
        assert facts.unit in message
        assert 'each element' in message or is_scalar(facts)


def test_the_message_tells_a_value_from_the_bound_that_it_just_exceeds():
    assert '1.0000000000000002' in refusal(BodyConfig, 'stiffness', math.nextafter(1.0, 2.0))


def test_an_integer_beyond_any_float_is_out_of_range_too():
    for number in (10**400, -(10**400)):
        for field, value in (('mass', number), ('position', (0, 0, number))):
            assert_one_sentence(refusal(BodyConfig, field, value), BodyConfig, field)


def test_an_array_without_dimensions_is_no_value():
    for field in ('mass', 'position'):
        assert_one_sentence(refusal(BodyConfig, field, np.array(0.5)), BodyConfig, field)


@pytest.mark.parametrize('number', [math.nan, math.inf, -math.inf, np.float32('nan')])
@pytest.mark.parametrize(('config_class', 'field', 'dotted', 'facts'), NUMERIC)
def test_numbers_that_are_not_finite_are_refused(config_class, field, dotted, facts, number):
    message = refusal(config_class, field, elementwise(facts, number))
    assert_one_sentence(message, config_class, dotted)
    assert str(float(number)) in message


@pytest.mark.parametrize('value', ['0.5', None, True, np.True_, [0.5], 1j, {}])
@pytest.mark.parametrize(('config_class', 'field', 'dotted', 'facts'), SCALARS)
def test_a_number_must_be_one(config_class, field, dotted, facts, value):
    message = refusal(config_class, field, value)
    assert_one_sentence(message, config_class, dotted)
    assert 'number' in message


@pytest.mark.parametrize('value', [True, '0.5', None, [0.5]])
def test_the_message_shows_the_value_as_it_was_given(value):
    assert repr(value) in refusal(BodyConfig, 'mass', value)


@pytest.mark.parametrize(
    ('config_class', 'field', 'dotted', 'facts'),
    every_setting(lambda facts: type(facts.default) is int),
)
def test_a_whole_number_is_not_a_float(config_class, field, dotted, facts):
    for value in (facts.default + 0.5, float(facts.default)):
        message = refusal(config_class, field, value)
        assert 'whole number' in message
        assert repr(value) in message


@pytest.mark.parametrize(
    ('config_class', 'field', 'dotted', 'facts'), every_setting(has_whole_number_in_range)
)
def test_a_whole_number_becomes_a_float(config_class, field, dotted, facts):
    for kind in (int, np.int64, np.float32):
        number = kind(math.ceil(facts.minimum))
        value = getattr(made(config_class, field, number), field)
        assert type(value) is float
        assert value == number


@pytest.mark.parametrize(('config_class', 'field', 'dotted', 'facts'), VECTORS)
@pytest.mark.parametrize('kind', [list, tuple, np.array, lambda ones: array('d', ones)])
def test_any_sequence_of_numbers_becomes_a_tuple_of_floats(
    config_class, field, dotted, facts, kind
):
    value = getattr(config_class(**{field: kind([1] * facts.length)}), field)
    assert value == (1.0,) * facts.length
    assert all(type(item) is float for item in value)


@pytest.mark.parametrize(('config_class', 'field', 'dotted', 'facts'), VECTORS)
def test_a_vector_must_be_one_of_the_right_length(config_class, field, dotted, facts):
    ones = [1.0] * facts.length
    for value in ((), ones[:-1], [*ones, 1.0], 1.0, 'xyz', None):
        message = refusal(config_class, field, value)
        assert_one_sentence(message, config_class, dotted)
        assert f'{facts.length} numbers' in message


@pytest.mark.parametrize('item', ['1', None, True, [1.0]])
@pytest.mark.parametrize(('config_class', 'field', 'dotted', 'facts'), VECTORS)
def test_each_element_of_a_vector_must_be_a_number(config_class, field, dotted, facts, item):
    message = refusal(config_class, field, elementwise(facts, item))
    assert_one_sentence(message, config_class, dotted)
    assert 'a number' in message


@pytest.mark.parametrize(
    ('config_class', 'field', 'dotted', 'facts'),
    [case for case in VECTORS if case.values[1].endswith(('direction', 'orientation'))],
)
def test_a_direction_and_a_quaternion_need_a_length(config_class, field, dotted, facts):
    message = refusal(config_class, field, (0.0,) * facts.length)
    assert_one_sentence(message, config_class, dotted)
    assert 'zero' in message
    assert config_class(**{field: (0.0,) * (facts.length - 1) + (0.5,)})


@pytest.mark.parametrize(('config_class', 'field', 'dotted', 'facts'), TEXTS)
def test_a_text_must_be_one(config_class, field, dotted, facts):
    for value in (3, None, True, ['linear']):
        assert_one_sentence(refusal(config_class, field, value), config_class, dotted)


@pytest.mark.parametrize(
    ('config_class', 'field', 'dotted', 'facts'), every_setting(lambda facts: facts.choices)
)
def test_only_the_listed_choices_are_allowed(config_class, field, dotted, facts):
    for choice in facts.choices:
        assert getattr(config_class(**{field: choice}), field) == choice
    message = refusal(config_class, field, 'cubic')
    assert_one_sentence(message, config_class, dotted)
    assert "'cubic'" in message
    assert all(choice in message for choice in facts.choices)


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
