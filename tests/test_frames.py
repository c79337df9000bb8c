# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What comes in other frames, with a stand-in for tf2_ros, of which there is no wheel."""

import math
import pathlib
import shutil
import sys

from geometry_msgs.msg import PointStamped, TransformStamped, Vector3Stamped, WrenchStamped
import numpy as np
import pytest
from rcl_interfaces.msg import Log
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState, PointCloud2, PointField
from std_msgs.msg import String
from std_srvs.srv import SetBool
from visualization_msgs.msg import Marker, MarkerArray

pytestmark = pytest.mark.oldest

SIM = '/softbody_sim'
SMALL = {'ball__subdivisions': 1}
GRIPPER = (pathlib.Path(__file__).parent.parent / 'config' / 'gripper.urdf').read_text()
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SECOND = 1_000_000_000
# what the node uses of tf2_ros in Jazzy, with a topic of its own in place of /tf
STAND_IN = """
from geometry_msgs.msg import TransformStamped


class TransformException(Exception):
    pass


class Buffer:
    def __init__(self):
        self.known = {}

    def lookup_transform(self, target_frame, source_frame, time):
        found = self.known.get((target_frame, source_frame))
        stamp = found and found.header.stamp.sec * 10**9 + found.header.stamp.nanosec
        if found is None or time.nanoseconds > stamp:
            raise TransformException(f'{source_frame}: unknown, or only before')
        return found


class TransformListener:
    def __init__(self, buffer, node):
        self.buffer = buffer
        node.create_subscription(TransformStamped, '/some_tf', self.heard, 10)

    def heard(self, message):
        self.buffer.known[message.header.frame_id, message.child_frame_id] = message
"""


@pytest.fixture
def tf2_ros(tmp_path, monkeypatch):
    """Put a stand-in for tf2_ros where Python finds it; return that folder."""
    package = tmp_path / 'stand_in' / 'tf2_ros'
    package.mkdir(parents=True)
    (package / '__init__.py').write_text(STAND_IN)
    monkeypatch.syspath_prepend(package.parent)
    yield package.parent
    sys.modules.pop('tf2_ros', None)


def transform(frame, position, orientation=(0.0, 0.0, 0.0, 1.0), stamp=0):
    result = TransformStamped(child_frame_id=frame)
    result.header.frame_id = 'world'
    result.header.stamp.sec, result.header.stamp.nanosec = divmod(stamp, SECOND)
    for name, value in zip('xyz', position, strict=True):
        setattr(result.transform.translation, name, float(value))
    for name, value in zip('xyzw', orientation, strict=True):
        setattr(result.transform.rotation, name, float(value))
    return result


def in_camera(kind):
    message = kind()
    message.header.frame_id = 'camera'
    return message


def logged(graph):
    qos = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    return graph.collect(Log, '/rosout', qos)


QUARTER = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))  # x of the camera is y of the world


def send(graph, topic, message):
    sender = graph.node.create_publisher(type(message), topic, 10)
    graph.spin_until(sender.get_subscription_count, f'who hears {topic}')
    sender.publish(message)
    sender.wait_for_all_acked()


def test_every_input_in_another_frame_is_transformed(graph, tf2_ros):
    sim = graph.sim_node(gravity__magnitude=0.0, **SMALL)
    world, log = sim._world, logged(graph)
    point = in_camera(PointStamped)
    point.point.y = 1.0
    send(graph, f'{SIM}/poke', point)
    sentence = graph.spin_until(lambda: [each.msg for each in log if 'poke' in each.msg])[0]
    assert "frame_id is 'camera': /tf does not say where that is in 'world'" in sentence
    send(graph, '/some_tf', transform('camera', (5.0, 0.0, 1.0), QUARTER))
    graph.spin_until(lambda: sim._frames.lookup('camera') is not None)
    assert graph.call(SetBool, f'{SIM}/pause', data=True).success

    marker = in_camera(Marker)
    marker.ns, marker.type, marker.pose.position.x = 'mine', Marker.CUBE, 2.0
    marker.pose.orientation.w = marker.scale.y = marker.scale.z = 1.0
    marker.scale.x = 3.0
    stranger = Marker(ns='mine', id=2, type=Marker.CUBE)
    stranger.header.frame_id = 'nowhere'
    send(graph, f'{SIM}/obstacles', MarkerArray(markers=[marker, stranger]))
    graph.spin_until(lambda: len(world.obstacles) == 2)
    assert world.obstacles[1].position == pytest.approx([5.0, 2.0, 1.0])
    assert world.obstacles[1].rotation[:, 0] == pytest.approx([0.0, 1.0, 0.0])

    cloud = in_camera(PointCloud2)
    cloud.height, cloud.width, cloud.point_step, cloud.row_step = 1, 2, 12, 24
    cloud.fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
        for i, name in enumerate('xyz')
    ]
    cloud.data.frombytes(np.array([(3.0, 0.0, 0.5), (np.nan, 0.0, 0.0)], '<f4').tobytes())
    send(graph, f'{SIM}/obstacle_points', cloud)
    graph.spin_until(lambda: len(world.point_obstacles) == 1)
    assert world.point_obstacles.points[0] == pytest.approx([5.0, 3.0, 1.5])

    gravity = in_camera(Vector3Stamped)
    gravity.vector.x = 2.0
    send(graph, f'{SIM}/gravity', gravity)
    graph.spin_until(lambda: world.gravity == pytest.approx([0.0, 2.0, 0.0]))

    wrench = in_camera(WrenchStamped)
    wrench.wrench.force.x, wrench.wrench.torque.y = 3.0, 4.0
    send(graph, f'{SIM}/wrench', wrench)
    graph.spin_until(lambda: world.external_inputs.wrenches)
    (applied,) = world.external_inputs.wrenches.values()
    assert applied.force == pytest.approx([0.0, 3.0, 0.0])
    assert applied.torque == pytest.approx([-4.0, 0.0, 0.0])
    assert not applied.in_body_axes

    point.point.x, point.point.y, point.point.z = 0.0, 4.5, 0.5  # of the world: 0.5 0 1.5
    send(graph, f'{SIM}/poke', point)
    weights = world.rest_shape('ball').weights
    graph.spin_until(lambda: (weights @ world.velocities('ball'))[0] < -1.0)


def test_the_root_of_a_robot_is_where_tf_says_and_moves_with_it(graph, tf2_ros):
    sim = graph.sim_node(robot__links=['left_finger'], **SMALL)
    graph.node.create_publisher(String, '/robot_description', LATCHED).publish(
        String(data=GRIPPER)
    )
    graph.spin_until(lambda: sim._robot._robot is not None)
    state = JointState(name=['hoist', 'grip'], position=[0.1, 0.02])
    send(graph, '/joint_states', state)
    graph.spin_until(lambda: len(sim._world.obstacles) == 3)

    def finger():
        return sim._world.obstacles[1]

    assert finger().position == pytest.approx([-0.03, 0.0, 0.16])
    begin = 1_700_000_000 * SECOND
    send(graph, '/some_tf', transform('ceiling', (1.0, 0.0, 2.0), QUARTER, begin))
    graph.spin_until(lambda: finger().position == pytest.approx([1.0, -0.03, 2.16]))
    send(graph, '/some_tf', transform('ceiling', (1.1, 0.0, 2.0), QUARTER, begin + SECOND // 10))
    graph.spin_until(lambda: finger().config.velocity_linear == pytest.approx((1.0, 0.0, 0.0)))


def test_links_come_from_tf_alone_in_a_process_of_its_own(graph, tf2_ros):
    path = f'{tf2_ros}:{pathlib.Path(__file__).parent.parent}'
    process = graph.process(
        '--ros-args', '-p', "robot.links:=['*finger']", '-p', 'ball.subdivisions:=1',
        environment={'PYTHONPATH': path},
    )  # fmt: skip
    shown = graph.collect(MarkerArray, f'{SIM}/obstacle_markers', LATCHED)
    graph.node.create_publisher(String, '/robot_description', LATCHED).publish(
        String(data=GRIPPER)
    )
    send(graph, '/some_tf', transform('left_finger', (1.0, 0.0, 2.0), QUARTER))
    send(graph, '/some_tf', transform('right_finger', (3.0, 0.0, 2.0)))

    def places():
        return {
            (each.ns, each.id): each.pose.position
            for each in (shown[-1].markers if shown else [])
            if each.ns.startswith('robot/')
        }

    graph.spin_until(lambda: len(places()) == 4, 'the links')
    left, right = places()['robot/left_finger', 0], places()['robot/right_finger', 0]
    assert (left.x, left.y, left.z) == pytest.approx((1.0, -0.01, 1.945))
    assert (right.x, right.y, right.z) == pytest.approx((3.01, 0.0, 1.945))
    send(graph, '/some_tf', transform('right_finger', (4.0, 0.0, 2.0)))
    graph.spin_until(lambda: places()['robot/right_finger', 0].x == pytest.approx(4.01))
    assert process.poll() is None


def test_a_stamp_before_all_time_means_the_last_pose(graph, tf2_ros):
    sim = graph.sim_node(**SMALL)
    assert sim._frames.lookup('camera') is None  # from now on it listens
    send(graph, '/some_tf', transform('camera', (5.0, 0.0, 1.0)))
    graph.spin_until(lambda: sim._frames.lookup('camera') is not None)
    here, there = in_camera(Marker), Marker(id=1)
    there.header.frame_id = 'world'
    for marker in (here, there):
        marker.type, marker.pose.orientation.w = Marker.CUBE, 1.0
        marker.scale.x = marker.scale.y = marker.scale.z = 1.0
        marker.header.stamp.sec = -1
    send(graph, f'{SIM}/obstacles', MarkerArray(markers=[here, there]))
    graph.spin_until(lambda: len(sim._world.obstacles) == 3)
    assert sim._world.obstacles[1].position == pytest.approx([5.0, 0.0, 1.0])


@pytest.mark.parametrize(
    'broken', [None, "raise ImportError('no libtf2.so')", "raise RuntimeError('of another ROS')"]
)
def test_without_tf2_ros_other_frames_are_refused(graph, tf2_ros, broken):
    if broken is None:
        shutil.rmtree(tf2_ros / 'tf2_ros')
    else:
        (tf2_ros / 'tf2_ros' / '__init__.py').write_text(broken)
    graph.sim_node(**SMALL)
    log = logged(graph)
    send(graph, f'{SIM}/poke', in_camera(PointStamped))
    (sentence,) = graph.spin_until(lambda: [each.msg for each in log if 'poke' in each.msg])
    assert "frame_id is 'camera': it must be 'world'; transform the message first" in sentence
    assert "or publish 'camera' on /tf, with tf2_ros installed" in sentence
