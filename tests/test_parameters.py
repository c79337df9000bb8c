# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parameter table, and the scenes that values make of it."""

import math
import re
import sys

import pytest
from scene_files import ROOT, scene_values

from softbody_ros import installed_files
from softbody_ros.core import ConfigError, MeshError, World
from softbody_ros.core.config import checked
from softbody_ros.scene import parameters
from softbody_ros.scene.groups import GROUPS
from softbody_ros.scene.parameters import SceneLists

pytestmark = pytest.mark.oldest

TABLE = parameters.table(SceneLists())


def test_every_default_is_valid():
    for name, facts in TABLE.items():
        assert checked(name, facts.default, facts) == facts.default


def test_every_parameter_has_a_description_and_bounds_where_it_is_a_number():
    for name, facts in TABLE.items():
        assert facts.description, name
        if isinstance(facts.default, float) or facts.length:
            assert facts.minimum is not None and facts.maximum is not None, name


def test_descriptions_are_phrases_that_stand_alone():
    for name, facts in TABLE.items():
        text = facts.description
        assert text[0].isupper() or text.startswith('/'), name
        assert len(text.split()) >= 3 and not text.endswith(('.', ';', ']')), name
        assert not re.search(r'\b(likewise|ditto|the same|too)\b|\[-1\]|\|', text), name


def test_every_parameter_is_in_one_group():
    grouped = [name for group in GROUPS for name in group.members(TABLE)]
    assert sorted(grouped) == sorted(TABLE)
    for group in GROUPS:
        for first in group.full_names:
            assert any(name == first or name.startswith(f'{first}.') for name in TABLE), first


def test_default_yaml_lists_every_parameter_with_its_default():
    values = scene_values('default')
    assert {name: parameters.promoted(value, TABLE[name]) for name, value in values.items()} == {
        name: list(facts.default) if isinstance(facts.default, tuple) else facts.default
        for name, facts in TABLE.items()
    }
    assert parameters.make_scene(values) == parameters.make_scene({})


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        ({'ball.stifness': 0.1}, 'unknown parameter ball.stifness: did you mean ball.stiffness?'),
        ({'bodies': ['a', 'a']}, 'the name a is used twice'),
        ({'bodies': ['ground']}, 'the name ground is used twice'),
        ({'bodies': ['1st']}, "the name '1st' is not usable"),
        ({'bodies': 'ball'}, "bodies is 'ball': it must be a list of names"),
        ({'ball.mass': 0.0}, 'ball.mass is 0.0: it must be from 1e-06 to 1e+06 kg'),
        ({'ball.color': [1.0, 0.0, 0.0]}, 'ball.color is [1.0, 0.0, 0.0]: it must be 4 numbers'),
        ({'ball.mode': 'soft'}, "ball.mode is 'soft': choose one of rigid, linear, quadratic"),
        ({'frame_id': ''}, "frame_id is '': give the name of a frame"),
        (
            {'ball.friction': 2.0, 'ball.friction_model': 'viscous'},
            'larger coefficients need friction_model coulomb',
        ),
        (
            {'obstacle_points.self_filter': 0.02},
            'self_filter is 0.02: it must be less than obstacle_points.radius, 0.02 m',
        ),
        (
            {'gravity.direction': [0.0, 0.0, 0.0]},
            'gravity.direction is [0.0, 0.0, 0.0]: its length must not be zero',
        ),
        (
            {'ball.mesh': 'package://no_such_package/ball.stl'},
            "mesh package://no_such_package/ball.stl: package 'no_such_package' is not installed",
        ),
    ],
)
def test_refusals_are_one_helpful_sentence(values, sentence):
    with pytest.raises(ConfigError) as refusal:
        parameters.make_scene(values)
    assert sentence in str(refusal.value)
    assert '\n' not in str(refusal.value)


LONG = ['x' * 100_000, [0.5] * 20_000, [math.nan] * 20_000, ['y' * 50_000] * 3, 10**400, 1e400]


def refusal_of(values):
    """Return why values are refused, '' if they are not."""
    try:
        World(parameters.make_scene(values).world)
    except (ConfigError, MeshError) as refusal:
        return str(refusal)
    return ''


@pytest.mark.parametrize('name', TABLE)
def test_a_refusal_of_something_long_is_short(name):
    for value in LONG:
        if name in ('bodies', 'obstacles', 'robot.links') and value == LONG[3]:
            continue  # names that are used twice are said elsewhere
        assert len(refusal_of({name: value})) < 500
    assert refusal_of({name: LONG[1]})


def test_a_group_is_no_parameter_but_its_parts_are_named():
    for values, hint in (
        ({'gravity': 9.81}, 'gravity: it is a group, set one of gravity.magnitude, gravity.dir'),
        ({'ball': 3}, 'ball: it is a group, set one of ball.mesh, ball.size, ball.mesh_scale and'),
    ):
        with pytest.raises(ConfigError, match=f'^unknown parameter {hint}'):
            parameters.make_scene(values)


def test_unknown_names_are_short_and_only_some_of_the_known_ones_are_listed():
    with pytest.raises(ConfigError) as refusal:
        parameters.make_scene({'x' * 100_000: 1.0})
    assert len(str(refusal.value)) < 500
    assert str(refusal.value).startswith('unknown parameter xxx')
    assert ' and ' in str(refusal.value) and str(refusal.value).endswith(' more')


def test_package_uri_is_found_through_the_ament_index(tmp_path, monkeypatch):
    index = tmp_path / 'share' / 'ament_index' / 'resource_index' / 'packages'
    index.mkdir(parents=True)
    (index / 'meshes').touch()
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    path = parameters.mesh_path('package://meshes/part.stl')
    assert path == str(tmp_path / 'share' / 'meshes' / 'part.stl')
    assert parameters.mesh_path('file:///tmp/part.stl') == '/tmp/part.stl'
    assert parameters.mesh_path('icosphere') == 'icosphere'


def test_own_files_are_found_in_a_checkout_and_where_pip_puts_them(tmp_path, monkeypatch):
    uri = 'package://softbody_ros/config/duck.obj'
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    assert parameters.mesh_path(uri) == str(ROOT / 'config' / 'duck.obj')

    installed = tmp_path / 'lib/softbody_ros/installed_files.py'
    monkeypatch.setattr(installed_files, '__file__', str(installed))
    monkeypatch.setattr(sys, 'prefix', str(tmp_path))
    with pytest.raises(ConfigError, match="package 'softbody_ros' is not installed"):
        parameters.mesh_path(uri)
    share = tmp_path / 'share' / 'softbody_ros'
    share.mkdir(parents=True)
    assert parameters.mesh_path(uri) == str(share / 'config' / 'duck.obj')


@pytest.mark.parametrize(
    ('name', 'value', 'expected'),
    [
        ('ball.mass', 2, 2.0),
        ('ball.mass', True, True),
        ('ball.position', [0, 0, 2], [0.0, 0.0, 2.0]),
        ('ball.position', [0.0, 0.0, 2.0], [0.0, 0.0, 2.0]),
        ('step_count', 2, 2),
        ('ball.mode', 'linear', 'linear'),
        ('ball.position', 'here', 'here'),
    ],
)
def test_integers_become_floats_where_floats_are_meant(name, value, expected):
    result = parameters.promoted(value, TABLE[name])
    assert result == expected
    assert type(result) is type(expected)
    if isinstance(expected, list):
        assert all(isinstance(item, float) for item in result)
