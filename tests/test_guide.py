# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a newcomer reads in the terminal is short and says everything."""

import re
import signal
import subprocess
import sys

import pytest
from sensor_msgs.msg import PointCloud2

from softbody_ros.ros import cli_help
from softbody_ros.ros.interfaces import PUBLISHED, RECEIVED, SERVICES
from softbody_ros.scene import parameters

SIM = '/softbody_sim'


def first_words(graph, *arguments):
    """Return what a real process says until it publishes, line by line."""
    process = graph.process(*arguments)
    clouds = graph.collect(PointCloud2, '/cloud')
    graph.spin_until(lambda: clouds)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=30)
    assert not output
    return errors.splitlines()


def test_start_says_where_to_look_in_a_few_lines(graph):
    lines = first_words(graph, '--ros-args', '-r', '~/points:=/cloud')
    assert len(lines) <= 6
    said = '\n'.join(lines)
    assert 'simulating ball (642 vertices) on wall time' in lines[0]
    assert 'viewer' in said
    assert 'rviz2 -d' in said
    (layout,) = re.findall(r'rviz2 -d (\S+)', said)
    assert (cli_help.config_folder() / 'softbody.rviz').is_file() and layout.startswith('/')
    assert '/cloud (PointCloud2), /softbody_sim/mesh (Marker)' in said
    assert 'ros2 param set /softbody_sim ball.stiffness' in said


def test_start_names_a_node_elsewhere_and_does_not_list_many_bodies(graph):
    names = [f'egg{index}' for index in range(20)]
    own = [part for name in names for part in ('-p', f'{name}.subdivisions:=0')]
    lines = first_words(
        graph, '--ros-args', '-r', '__ns:=/left', '-r', '~/points:=/cloud',
        '-p', f'bodies:=[{", ".join(names)}]', *own,
    )  # fmt: skip
    said = '\n'.join(lines)
    assert len(lines) <= 6
    assert '20 bodies (240 vertices)' in lines[0]
    assert 'viewer --node /left/softbody_sim' in said
    assert 'ros2 param set /left/softbody_sim egg0.stiffness' in said
    assert 'rviz2' not in said  # its layout has other topics


def test_help_names_every_parameter_topic_and_service():
    lines = cli_help.help_text().splitlines()
    assert len(lines) <= 45
    lists = lines[lines.index('topics that it publishes (~ is /softbody_sim):') :]
    assert max(map(len, lists)) <= cli_help.WIDTH
    text = '\n'.join(lists)
    for name in parameters.table(parameters.SceneLists()):
        known = name.removeprefix('ball.').removeprefix('ground.').split('.')[0]
        assert re.search(rf'\b{known}\b', text), name
    topics = [name for topic in (*PUBLISHED, *RECEIVED) for name in topic.names]
    for name in [*topics, *(service.name for service in SERVICES)]:
        assert re.search(rf'(?<![\w/]){name}(?![\w/])', text), name


def test_help_of_the_command_names_scenes_that_exist(graph):
    output, _ = graph.process('--help').communicate(timeout=30)
    assert output == cli_help.help_text() + '\n'
    (folder,) = re.findall(r'scenes, as .yaml in (.*):', output)
    assert folder == str(cli_help.config_folder())
    for path in cli_help.config_folder().glob('*.yaml'):
        assert re.search(rf'^  .*\b{path.stem}\b', output, re.M), path


def test_help_is_said_at_once():
    """It loads neither ROS nor the simulator, which take a second."""
    for module in ('', '.bake', '.ensemble.fit', '.ensemble.sweep', '.viewer'):
        run = subprocess.run(
            [sys.executable, '-X', 'importtime', '-m', f'softbody_ros{module}', '--help'],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert run.stdout.startswith('usage: ')
        loaded = {line.split('|')[-1].strip() for line in run.stderr.splitlines()}
        assert 'softbody_ros.signals' in loaded or 'argparse' in loaded
        assert not loaded & {'numpy', 'scipy', 'numba', 'rclpy', 'trimesh'}, module


def test_arguments_that_would_be_ignored_are_refused(graph):
    process = graph.process('--params-file', 'scene.yaml')  # without --ros-args
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 1
    assert 'the argument --params-file is unknown' in errors
    assert '--ros-args' in errors and len(errors.splitlines()) == 1


@pytest.mark.parametrize('installed', [False, True])
def test_the_viewer_is_offered_or_how_to_get_it(monkeypatch, installed):
    found = object() if installed else None
    monkeypatch.setattr(cli_help.importlib.util, 'find_spec', lambda name: found)
    said = cli_help.where_to_look(SIM, '/clock', {'ball': 3}, ('/a', '/b'))
    assert ('http://127.0.0.1:8080' in said) == installed
    assert ("pip install '.[viewer]'" in said) == (not installed)


@pytest.mark.parametrize(
    ('folder', 'on_path', 'viewer', 'pip'),
    [
        ('.venv/bin', False, '{}/viewer', '{}/pip'),
        ('.venv/bin', True, 'viewer', 'pip'),
        ('install/softbody_ros/lib/softbody_ros', False, 'ros2 run softbody_ros viewer', 'pip'),
    ],
)
def test_commands_are_said_as_they_must_be_typed(
    monkeypatch, tmp_path, folder, on_path, viewer, pip
):
    script = tmp_path / folder / 'sim_node'
    script.parent.mkdir(parents=True)
    script.touch(mode=0o755)
    monkeypatch.setattr(cli_help.sys, 'argv', [str(script)])
    monkeypatch.setenv('PATH', str(script.parent if on_path else tmp_path))
    monkeypatch.setattr(cli_help.importlib.util, 'find_spec', lambda name: None)
    said = cli_help.where_to_look(SIM, '/clock', {'ball': 3}, ('/a', '/b'))
    assert f'`{viewer.format(script.parent)}` in a browser' in said
    assert f"after {pip.format(script.parent)} install '.[viewer]'" in said
