# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameter files are read without ROS as a real node reads them."""

import pathlib

import pytest
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from softbody_ros.core import ConfigError
from softbody_ros.scene import parameters
from softbody_ros.scene.scene_file import read_scene

pytestmark = pytest.mark.oldest

ROOT = pathlib.Path(__file__).parent.parent
SCENES = sorted((ROOT / 'config').glob('*.yaml'))
ODDITIES = """
other:
  ros__parameters: {a: 0}
/softbody_sim:
  ros__parameters: {first: 1, second: 1}
/**:
  ros__parameters:
    whole: [8, +5, -3, 0, 010, 0x1F]
    doubles: [1e-3, .5, 1., 1E3, 08, -.inf, .NaN]
    large: 99999999999999999999
    larger: LARGER
    beyond: 1e999
    beyond_digits: BEYOND
    texts: [~, null, 1_000, yEs, 2001-01-01, '3', "4", +, e5]
    time: 1:30
    flags: [yes, Y, on, TRUE, n, Off]
    block: |
      5
    none: []
    ball.mass: 2
    ball:
      mass: 3
      pins.velocity: {linear: [0.0, 1.0, 2.0]}
    a: 1
    b: 1
    first: 2
softbody_sim:
  ros__parameters: {a: 2, mine: 1}
/*:
  ros__parameters: {b: 3}
/*/softbody_sim:
  ros__parameters: {a: 4}
/**/softbody_sim:
  ros__parameters: {c: 5}
space:
  softbody_sim:
    ros__parameters: {a: 6}
/softbody_sim:
  ros__parameters: {first: 4, second: 4}
"""


def plain(value):
    return list(value) if hasattr(value, '__len__') and not isinstance(value, str) else value


def test_what_rcl_reads_is_read_likewise(graph, tmp_path):
    path = tmp_path / 'odd.yaml'
    path.write_text(
        ODDITIES.replace('LARGER', '1' + 300 * '0').replace('BEYOND', '1' + 5000 * '0')
    )
    assignments = ['d:=1e-3', 'e:=[1, 2]', "g:='x'", 'a:=off', 'first:=3', 'h:=[]', 'i:=b:=c']
    arguments = [part for each in assignments for part in ('-p', each)]
    arguments = ['--ros-args', '--params-file', str(path), *arguments]
    node = graph.add(Node('softbody_sim', context=graph.context, cli_args=arguments))
    any_type = ParameterDescriptor(dynamic_typing=True)
    values = read_scene(str(path), assignments)
    assert len(values) == 24
    # as texts: NaN is not equal to itself, 1 and True are
    for name, value in values.items():
        parameter = node.declare_parameter(name, descriptor=any_type)
        assert repr(value) == repr(plain(parameter.value)), name


@pytest.mark.parametrize('path', SCENES, ids=lambda path: path.stem)
def test_shipped_scenes_are_those_of_the_node(graph, path):
    from softbody_ros.ros.node import SimNode

    node = graph.add(
        SimNode(context=graph.context, cli_args=['--ros-args', '--params-file', str(path)])
    )
    values, unknown = parameters.known_values(read_scene(str(path)))
    assert not unknown
    assert len(values) > 5
    for name, facts in parameters.table(parameters.scene_lists(values)).items():
        expected = parameters.as_parameter(values.get(name, facts.default), facts)
        assert repr(expected) == repr(plain(node.get_parameter(name).value)), name


def test_an_empty_file_is_the_default_scene(tmp_path):
    path = tmp_path / 'empty.yaml'
    path.write_text('# nothing\n')
    assert read_scene(str(path)) == {}


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('a: 1', 'line 1: parameters stand below the name of a node and ros__parameters'),
        ('- a', 'line 1: parameters stand below the name of a node and ros__parameters'),
        ('/**: {ros__parameters: 5}', 'line 1: ros__parameters is not a map'),
        ('/**:\n  ros__parameters:\n    a:\n', 'line 3: a has no value'),
        ('/**: {ros__parameters: {a: [1, 2.0]}}', 'a must be a list of one type'),
        ('/**: {ros__parameters: {a: [[1]]}}', 'a must be a list of one type'),
        ('/**: {ros__parameters: {a: &x 1, b: *x}}', 'has an alias (*)'),
        ('/**: {ros__parameters: {? [a] : 1}}', 'line 1: a name must be a text'),
        ('/**: {ros__parameters: {a: 1', 'is not YAML: '),
        (
            '/**:\n  ros__parameters:\n\ta: 1\n',
            r"line 3: found character '\t' that cannot start any",
        ),
        ('"foo[": {ros__parameters: {a: 1}}', "'foo[' is no name of a node, nor a pattern"),
        ('"a{1,99999999999}": {ros__parameters: {a: 1}}', 'use /softbody_sim, or /** for every'),
        ('{a: ' * 2000 + '1' + '}' * 2000, 'is nested too deeply'),
    ],
)
def test_refusals_of_files(tmp_path, text, sentence):
    path = tmp_path / 'wrong.yaml'
    path.write_text(text)
    with pytest.raises(ConfigError) as refusal:
        read_scene(str(path))
    assert sentence in str(refusal.value)
    assert '\n' not in str(refusal.value)


def test_refusals_of_paths(tmp_path):
    with pytest.raises(ConfigError, match=r'no\.yaml cannot be read: No such file'):
        read_scene(str(tmp_path / 'no.yaml'))
    with pytest.raises(ConfigError, match='cannot be read: Is a directory'):
        read_scene(str(tmp_path))
    (tmp_path / 'bytes.yaml').write_bytes(b'\xff\xfe\xfa')
    with pytest.raises(ConfigError, match='it is not UTF-8 text'):
        read_scene(str(tmp_path / 'bytes.yaml'))


@pytest.mark.parametrize('assignment', ['a', ':=1', 'a:=', 'a:={b: 1}', 'a:=x: y', 'a:=[1'])
def test_refusals_of_assignments(tmp_path, assignment):
    path = tmp_path / 'empty.yaml'
    path.touch()
    with pytest.raises(ConfigError, match=r'^-p ') as refusal:
        read_scene(str(path), [assignment])
    assert '\n' not in str(refusal.value)
