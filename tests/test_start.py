# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The start of the commands: their arguments, and folders that cannot be written to."""

import os
import signal

from nav_msgs.msg import Odometry
import pytest

from softbody_ros.ros import command_line, start
from softbody_ros.ros.command_line import UsageError

SIM = '/softbody_sim'
NOWHERE = '/dev/null/x'
"""A folder that nobody can make."""


# ------------------------------------------------------------------------------------- arguments
@pytest.mark.parametrize(
    ('arguments', 'for_ros', 'for_viewer'),
    [
        ('', '', None),
        ('--viewer', '', ''),
        ('--ros-args -p a:=1', '--ros-args -p a:=1', None),
        ('--viewer --port 8000', '', '--port 8000'),
        ('--host ::1 --viewer --port=1', '', '--host ::1 --port 1'),
        ('--viewer --host localhost --ros-args -r a:=b', '--ros-args -r a:=b', '--host 127.0.0.1'),
        ('--ros-args -p a:=1 --viewer', '--ros-args -p a:=1', ''),
    ],
)
def test_arguments_are_for_the_viewer_or_for_ros(arguments, for_ros, for_viewer):
    command = command_line.read(arguments.split())
    assert ' '.join(command.for_ros) == for_ros
    assert (for_viewer is None) == (command.for_viewer is None)
    assert ' '.join(command.for_viewer or ()) == (for_viewer or '')


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        ('--viewer --port x', "--port: 'x' is no port: it must be from 1 to 65535"),
        ('--viewer --port 0', "'0' is no port"),
        ('--viewer --port -5', "'-5' is no port"),
        ('--viewer --port 65536', "'65536' is no port"),
        ('--viewer --port', '--port: expected one argument'),
        ('--viewer --host wlan0', "--host: 'wlan0' is no IP address: give one such as 127.0.0.1"),
        ('--port 8000', '--port is of the viewer: give --viewer, too'),
        ('--host 127.0.0.1 --ros-args -p a:=1', '--host is of the viewer: give --viewer, too'),
        ('--view', 'the argument --view is unknown'),
        ('scene.yaml', 'the argument scene.yaml is unknown: give --viewer, or --ros-args'),
        ('scene.yaml', 'as in sim_node --ros-args --params-file scene.yaml; see --help'),
        ('-p ball.mass:=2.0', 'as in sim_node --ros-args -p ball.mass:=2.0; see --help'),
    ],
)
def test_bad_arguments_are_one_sentence(arguments, sentence):
    with pytest.raises(UsageError) as refusal:
        command_line.read(arguments.split())
    assert sentence in str(refusal.value)
    assert '\n' not in str(refusal.value)


@pytest.mark.parametrize('module', ['softbody_ros', 'softbody_ros.viewer'])
def test_what_ros_does_not_know_is_refused_in_a_sentence(graph, module):
    process = graph.process('--ros-args', '--bad', module=module)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "ROS does not know '--bad' after --ros-args: leave it out, or see --help" in errors
    assert 'Traceback' not in output + errors


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        ('--params-file no.yaml', 'scene no.yaml cannot be read: No such file or directory'),
        ('--params-file .', 'scene . cannot be read: Is a directory'),
        ('--params-file', 'nothing follows --params-file: give the path of a parameter file'),
        ('--params-file bare.yaml', 'bare.yaml, line 1: parameters stand below the name of a'),
        ('--params-file tab.yaml', 'scene tab.yaml is not YAML: line 3: found character'),
        ('-p ball.mass=2', '-p ball.mass=2 is not NAME:=VALUE, such as ball.stiffness:=0.1'),
        ('-p a:=1 -p frame_id:=', '-p frame_id:= has no value: give a number, a text or a list'),
        ('-p', 'nothing follows -p: give NAME:=VALUE'),
        ('-r points', '-r points is not FROM:=TO, such as __ns:=/left'),
        ('-r __node:=a-b', '-r __node:=a-b gives no name that a node can have: letters, digits'),
        ('-r __ns:=left', '-r __ns:=left gives no namespace: one is such as /left'),
    ],
)
def test_what_ros_cannot_use_is_said_in_words_of_the_user(
    monkeypatch, tmp_path, arguments, sentence
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'bare.yaml').write_text('bodies: [ball]\n')
    (tmp_path / 'tab.yaml').write_text('/**:\n  ros__parameters:\n\tbodies: [ball]\n')
    with pytest.raises(RuntimeError) as refusal:
        start.start_ros(['--ros-args', *arguments.split()])
    assert sentence in str(refusal.value)
    assert '\n' not in str(refusal.value)


# ------------------------------------------------------------------------------------- log files
@pytest.fixture
def environment(monkeypatch, tmp_path):
    for name in ('ROS_LOG_DIR', 'ROS_HOME'):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv('HOME', str(tmp_path))
    return monkeypatch


def test_a_log_folder_is_that_of_rcl_and_made(environment, tmp_path):
    assert start._log_problem() == ''
    assert (tmp_path / '.ros' / 'log').is_dir()
    environment.setenv('ROS_HOME', str(tmp_path / 'home'))
    assert start._log_problem() == ''
    assert (tmp_path / 'home' / 'log').is_dir()
    environment.setenv('ROS_LOG_DIR', '~/logs')
    environment.setenv('ROS_HOME', NOWHERE)
    assert start._log_problem() == ''
    assert (tmp_path / 'logs').is_dir()


def test_a_folder_that_cannot_be_written_to_is_noticed(environment, tmp_path):
    folder = tmp_path / 'closed'
    folder.mkdir(mode=0o500)
    environment.setattr(os, 'access', lambda path, mode: path != str(folder))  # as for no root
    environment.setenv('ROS_LOG_DIR', str(folder))
    assert f'{folder} cannot be used (it cannot be written to)' in start._log_problem()


@pytest.mark.parametrize(
    ('module', 'changes', 'reason'),
    [
        ('softbody_ros', {'HOME': NOWHERE}, f'{NOWHERE}/.ros/log cannot be used (Not a dir'),
        ('softbody_ros.viewer', {'HOME': None}, '~/.ros/log cannot be used (HOME is not set)'),
        *(
            pytest.param('softbody_ros', changes, reason, marks=pytest.mark.slow)
            for changes, reason in [
                ({'HOME': None}, '~/.ros/log cannot be used (HOME is not set)'),
                ({'ROS_LOG_DIR': NOWHERE}, f'{NOWHERE} cannot be used (Not a directory)'),
                ({'ROS_HOME': NOWHERE}, f'{NOWHERE}/log cannot be used'),
            ]
        ),
    ],
)  # fmt: skip
def test_without_a_folder_for_logs_it_starts_and_says_so_once(
    graph, environment, module, changes, reason
):
    for name, value in changes.items():
        environment.delenv(name, raising=False)
        if value is not None:
            environment.setenv(name, value)
    process = graph.process('--ros-args', '-p', 'use_sim_time:=false', module=module)
    if module == 'softbody_ros':
        received = graph.collect(Odometry, f'{SIM}/odometry')
        graph.spin_until(lambda: received)
    else:
        graph.spin_until(lambda: 'softbody_viewer' in graph.node.get_node_names())
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    assert reason in errors
    assert errors.count('set ROS_LOG_DIR to one that can be written to') == 1
    assert 'Traceback' not in output + errors
    assert 'error_handling' not in output + errors
