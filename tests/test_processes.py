# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The node as users run it: a process of its own, real mesh files, signals, the installed tree."""

from importlib import resources
import math
import os
import pathlib
import shutil
import signal
import subprocess
import sys

from ament_index_python.packages import get_package_prefix
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker

from softbody_ros.ros.messages import POINT_TYPE
from softbody_ros.scene import parameters

ROOT = pathlib.Path(__file__).parent.parent
SIM = '/softbody_sim'
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
CAD_MESH = resources.files('cookie_description') / 'meshes' / 'knee_bumper.stl'


def heights(cloud):
    return np.frombuffer(cloud.data, POINT_TYPE)['z']


def finish(process, signal_number):
    process.send_signal(signal_number)
    output, errors = process.communicate(timeout=30)
    return process.returncode, output, errors


# ---------------------------------------------------------------------------------------- the node
def test_ball_falls_bounces_and_settles_for_a_subscriber_elsewhere(graph):
    # a soft ball takes seconds to settle: ten times as fast, at the same ticks
    process = graph.process('--ros-args', '-p', 'time_scale:=10.0', '-p', 'points_rate:=600.0')
    clouds = graph.collect(PointCloud2, f'{SIM}/points', 5000)
    graph.spin_until(lambda: clouds)
    assert graph.call(Trigger, f'{SIM}/reset').success
    del clouds[:]
    graph.spin_until(lambda: len(clouds) > 600)
    lowest = np.array([heights(cloud).min() for cloud in clouds])
    centre = np.array([heights(cloud).mean() for cloud in clouds])
    begin = np.flatnonzero(lowest > 0.99)[0]  # what was sent before the reset may come after it
    lowest, centre = lowest[begin:], centre[begin:]
    assert lowest.min() > -1e-6  # the ground holds
    fallen = np.flatnonzero(lowest < 1e-3)[0]
    assert centre[fallen] < 0.6  # it fell the whole metre …
    rebound = lowest[fallen:].max()
    assert 0.05 < rebound < 0.9  # … bounced, lower than it started
    assert np.ptp(centre[-60:]) < 0.05  # … and came to rest
    code, _, errors = finish(process, signal.SIGINT)
    assert code == 0, errors


@pytest.mark.parametrize(
    ('clock', 'signal_number'),
    [
        ('wall', signal.SIGINT),
        ('sim', signal.SIGTERM),
        pytest.param('wall', signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param('sim', signal.SIGINT, marks=pytest.mark.slow),
    ],
)
def test_signals_end_it_with_exit_0_and_no_traceback(graph, signal_number, clock):
    arguments = ['--ros-args', '-p', 'use_sim_time:=true'] if clock == 'sim' else []
    process = graph.process(*arguments)
    markers = graph.collect(Marker, f'{SIM}/mesh')
    graph.spin_until(lambda: markers or graph.node.count_publishers(f'{SIM}/mesh'))
    code, output, errors = finish(process, signal_number)
    assert code == 0, errors
    assert 'Traceback' not in output + errors


def test_a_real_cad_mesh_of_more_than_10000_triangles_is_simulated(graph):
    graph.process(
        '--ros-args', '-p', f'ball.mesh:={CAD_MESH}', '-p', 'ball.size:=0.5',
        '-p', 'ball.position:=[0.0, 0.0, 0.6]',
    )  # fmt: skip
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    markers = graph.collect(Marker, f'{SIM}/mesh')
    meshes = graph.collect(Mesh, f'{SIM}/rest_mesh', LATCHED)
    graph.spin_until(lambda: clouds and heights(clouds[-1]).mean() < 0.5, 'it falls from 0.6 m')
    graph.spin_until(lambda: markers and meshes)
    assert len(meshes[0].triangles) == 11632
    assert len(meshes[0].vertices) == clouds[0].width == 4950
    assert all(len(marker.points) == 3 * 11632 for marker in markers)
    assert heights(clouds[-1]).min() > -1e-6


def test_reset_of_another_process_is_bit_identical(graph):
    graph.process('--ros-args', '-p', 'use_sim_time:=false')
    clouds = graph.collect(PointCloud2, f'{SIM}/points', 500)
    graph.spin_until(lambda: len(clouds) > 30)

    def after_reset():
        assert graph.call(Trigger, f'{SIM}/reset').success
        del clouds[:]
        graph.spin_until(lambda: len(clouds) > 60)
        start = max(range(len(clouds)), key=lambda index: heights(clouds[index]).min())
        return [bytes(cloud.data) for cloud in clouds[start : start + 30]]

    first, second = after_reset(), after_reset()
    # the first frame after a reset may be missed, so compare from a frame that both have
    common = set(first) & set(second)
    assert len(common) >= 28


def test_field_checks_of_rclpy_find_nothing(graph):
    process = graph.process(environment={'ROS_PYTHON_CHECK_FIELDS': '1'})
    received = [
        graph.collect(kind, f'{SIM}/{topic}', qos)
        for kind, topic, qos in [
            (PointCloud2, 'points', 5),
            (Marker, 'mesh', 5),
            (Odometry, 'odometry', 5),
            (Mesh, 'rest_mesh', LATCHED),
        ]
    ]
    graph.spin_until(lambda: all(received))
    assert process.poll() is None


def test_malformed_requests_do_not_end_it(graph):
    process = graph.process('--ros-args', '-p', 'ball.subdivisions:=1')
    random = np.random.default_rng(0)
    client = graph.node.create_client(SetParameters, f'{SIM}/set_parameters')
    graph.spin_until(client.service_is_ready)
    names = [*parameters.table(parameters.SceneLists()), 'nope', '', 'ball', 'use_sim_time']
    for _ in range(300):
        value = ParameterValue(
            type=int(random.integers(0, 12)),  # there are only ten types
            integer_value=int(random.choice([0, -1, 2**62])),
            double_value=float(random.choice([0.5, math.nan, math.inf, 1e308])),
            string_value=str(random.choice(['', 'rigid', 'x' * 10000, 'package://'])),
            byte_array_value=[b'a'],
            bool_array_value=[True],
            integer_array_value=[2**62] * 3,
            double_array_value=[math.nan, 1e300, 0.0],
            string_array_value=['a', ''],
        )
        parameter = Parameter(name=str(random.choice(names)), value=value)
        if parameter.name == 'use_sim_time':
            value.bool_value = False
        future = client.call_async(SetParameters.Request(parameters=[parameter]))
        graph.spin_until(future.done)
    assert graph.call(Trigger, f'{SIM}/reset').success
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    graph.spin_until(lambda: clouds)
    assert process.poll() is None
    code, _, errors = finish(process, signal.SIGINT)
    assert code == 0
    assert 'failed' not in errors


FAILING = """
import threading
import rclpy
from softbody_ros.ros.spinning import spin

rclpy.init()
node, stop, calls = rclpy.create_node('failing'), threading.Event(), []

def fail():
    calls.append(None)
    if len(calls) == 3:
        stop.set()
    raise RuntimeError('on purpose')

node.create_timer(0.01, fail)
spin(node, stop)
print(len(calls))
"""


def test_a_callback_that_fails_does_not_end_a_command(graph):
    environment = os.environ | {'ROS_DOMAIN_ID': str(graph.domain)}
    run = subprocess.run(
        [sys.executable, '-c', FAILING], env=environment, capture_output=True, text=True
    )
    assert (run.returncode, run.stdout) == (0, '3\n'), run.stderr
    assert 'a callback failed and is ignored: RuntimeError: on purpose' in run.stderr
    assert 'Traceback' not in run.stderr


# --------------------------------------------------------------------------------------- bad start
@pytest.mark.parametrize(
    ('yaml', 'sentence'),
    [
        ('ball: {mesh: missing.stl}', 'ball.mesh file missing.stl does not exist: check the path'),
        ('ball: {mass: heavy}', "ball.mass is 'heavy': it must be a number"),
        ('ball: {position: [0.0, 0, 1.5]}', 'ball.position must be a list of one type'),
        # of the same kinds: the sentences are those of test_parameters and test_config
        *(
            pytest.param(*bad, marks=pytest.mark.slow)
            for bad in [
                ('ball: {mass: -2}', 'ball.mass is -2.0: it must be from 1e-06 to 1e+06 kg'),
                ('ball: {stifness: 0.5}', 'ball.stifness: did you mean ball.stiffness?'),
                ('ball: {mesh: ball.step}', "ball.mesh 'ball.step' is neither a primitive"),
                ('ball: {position: [0.0, .nan, 0.0]}', 'ball.position is [0.0, nan, 0.0]'),
                ('gravity: {direction: [0, 0, 0]}', 'gravity.direction is [0.0, 0.0, 0.0]'),
                ('bodies: [two words]', "the name 'two words' is not usable"),
                ('time_step: 0', 'time_step is 0.0: it must be from 1e-05 to 0.1 s'),
            ]
        ),
    ],
)
def test_bad_start_is_one_sentence_and_exit_1(graph, tmp_path, yaml, sentence):
    path = tmp_path / 'bad.yaml'
    path.write_text(f'/**:\n  ros__parameters:\n    {yaml}\n')
    process = graph.process('--ros-args', '--params-file', str(path))
    output, errors = process.communicate(timeout=30)
    assert process.returncode == 1, output + errors
    own = [line for line in errors.splitlines() if line.startswith('softbody_sim: ')]
    assert len(own) == 1
    assert sentence in own[0]
    assert 'Traceback' not in errors


# --------------------------------------------------------------------------------- installed trees
@pytest.fixture(scope='module')
def workspace(tmp_path_factory):
    """A workspace with this package, built by colcon."""
    base = tmp_path_factory.mktemp('workspace')
    tracked = subprocess.run(
        ['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard'],
        cwd=ROOT, check=True, capture_output=True, text=True,
    ).stdout.split('\0')  # fmt: skip
    for name in filter(None, tracked):
        target = base / 'src' / 'softbody_ros' / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, target)
    build = subprocess.run(
        [sys.executable, '-m', 'colcon', 'build'], cwd=base, capture_output=True, text=True
    )
    assert build.returncode == 0, build.stdout + build.stderr
    return base


def test_colcon_installs_the_commands_where_ros2_run_looks(graph, workspace, monkeypatch):
    prefix = workspace / 'install' / 'softbody_ros'
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(prefix))
    # as `ros2 run softbody_ros sim_node` does: ament index → lib/<package>/<executable>
    executable = pathlib.Path(get_package_prefix('softbody_ros')) / 'lib/softbody_ros/sim_node'
    assert os.access(executable, os.X_OK)
    share = prefix / 'share' / 'softbody_ros'
    assert (share / 'package.xml').is_file()
    for name in ('default.yaml', 'gripper.urdf', 'softbody.rviz', 'fastdds_large_meshes.xml'):
        assert (share / 'config' / name).is_file()

    setup = workspace / 'install' / 'setup.bash'
    for name in ('bake', 'fit', 'viewer'):
        ask = ['bash', '-c', f'source {setup} && exec {executable.with_name(name)} --help']
        said = subprocess.run(ask, capture_output=True, text=True, check=True).stdout
        assert f'usage: {name}' in said
    command = f'source {setup} && exec {executable} --ros-args --params-file {share}/config/'
    process = subprocess.Popen(
        ['bash', '-c', command + 'mesh_file.yaml'],
        cwd=workspace, env=os.environ | {'ROS_DOMAIN_ID': str(graph.domain)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        clouds = graph.collect(PointCloud2, f'{SIM}/points')
        graph.spin_until(lambda: clouds, 'a cloud of the installed node')
        assert clouds[0].width == 2010, 'the mesh file has been found'
        code, _, errors = finish(process, signal.SIGTERM)
        assert code == 0, errors
    finally:
        process.kill()
        process.communicate()
