# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The topics by which others act on the world: real rclpy, end to end."""

import math
import os
import random
import subprocess
import sys

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, Vector3Stamped, WrenchStamped
import numpy as np
import pytest
from rcl_interfaces.msg import Log
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2, PointField
from simulated_clock import SECOND, ClockSource
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker, MarkerArray

from softbody_ros.ros.messages import POINT_TYPE

pytestmark = pytest.mark.oldest

SIM = '/softbody_sim'
SMALL = {'ball__subdivisions': 1}
INPUTS = {
    'obstacles': MarkerArray,
    'obstacle_points': PointCloud2,
    'wrench': WrenchStamped,
    'poke': PointStamped,
    'gravity': Vector3Stamped,
}


def publisher(graph, topic, qos=10):
    """Return a publisher of an input that the node has found."""
    result = graph.node.create_publisher(INPUTS[topic], f'{SIM}/{topic}', qos)
    graph.spin_until(result.get_subscription_count, f'a subscriber of {topic}')
    return result


def send(graph, topic, message):
    """Send one message of which the node knows when it returns."""
    sender = publisher(graph, topic)
    sender.publish(message)
    sender.wait_for_all_acked()
    graph.node.destroy_publisher(sender)


def fill(target, names, values):
    for name, value in zip(names, values, strict=True):
        setattr(target, name, float(value))


def in_frame(kind, frame_id='world'):
    message = kind()
    message.header.frame_id = frame_id
    return message


def marker(position, scale=(1.0, 1.0, 1.0), kind=Marker.CUBE, **values):
    result = Marker(ns='test', type=kind, **values)
    result.header.frame_id = 'world'
    fill(result.pose.position, 'xyz', position)
    result.pose.orientation.w = 1.0
    fill(result.scale, 'xyz', scale)
    return result


def stamped(message, nanoseconds):
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(nanoseconds, SECOND)
    return message


def array_of(*markers):
    return MarkerArray(markers=list(markers))


def cloud_of(points, frame_id='world'):
    points = np.asarray(points, dtype='<f4')
    message = PointCloud2(height=1, width=len(points), point_step=12, row_step=12 * len(points))
    message.header.frame_id = frame_id
    message.fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
        for i, name in enumerate('xyz')
    ]
    message.data.frombytes(points.tobytes())
    return message


def wrench_of(frame_id, force=(0.0, 0.0, 0.0), torque=(0.0, 0.0, 0.0)):
    message = in_frame(WrenchStamped, frame_id)
    fill(message.wrench.force, 'xyz', force)
    fill(message.wrench.torque, 'xyz', torque)
    return message


def poke_of(point):
    message = in_frame(PointStamped)
    fill(message.point, 'xyz', point)
    return message


def gravity_of(vector):
    message = in_frame(Vector3Stamped)
    fill(message.vector, 'xyz', vector)
    return message


def paused(graph):
    assert graph.call(SetBool, f'{SIM}/pause', data=True).success


def step(graph, ticks):
    assert graph.set_parameter(SIM, 'step_count', ticks).successful
    answer = graph.call(Trigger, f'{SIM}/step')
    assert answer.success, answer.message


def momentum(sim, name='ball'):
    return sim._world.rest_shape(name).weights @ sim._world.velocities(name)


def warnings(graph):
    qos = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    return graph.collect(Log, '/rosout', qos)


def said(log, *words):
    return [item.msg for item in log if all(word in item.msg for word in words)]


# --------------------------------------------------------------------------------------- obstacles
def test_markers_are_in_the_way_until_they_are_deleted(graph):
    sim = graph.sim_node(**SMALL)
    send(graph, 'obstacles', array_of(marker((0.0, 0.0, 0.4), (4.0, 4.0, 0.4))))
    graph.spin_until(lambda: len(sim._world.obstacles) == 2, 'the box')
    graph.spin_until(lambda: 0.59 < sim._world.positions('ball')[:, 2].min() < 0.7)
    send(graph, 'obstacles', array_of(Marker(ns='test', action=Marker.DELETE)))
    graph.spin_until(lambda: len(sim._world.obstacles) == 1, 'the box to go')
    graph.spin_until(lambda: sim._world.positions('ball')[:, 2].min() < 0.1)


def test_every_kind_of_marker_and_a_lifetime(graph):
    sim = graph.sim_node(**SMALL)
    paused(graph)
    short = marker((5.0, 0.0, 0.0), kind=Marker.SPHERE, id=1)
    short.lifetime.nanosec = 100_000_000
    send(
        graph,
        'obstacles',
        array_of(
            marker((5.0, 0.0, 0.0)), short, marker((5.0, 0.0, 0.0), kind=Marker.CYLINDER, id=2)
        ),
    )
    graph.spin_until(lambda: len(sim._world.obstacles) == 4)
    step(graph, 23)
    assert len(sim._world.obstacles) == 4
    step(graph, 1)
    assert list(sim._world.external_inputs.dynamic_obstacles) == [('test', 0), ('test', 2)]
    clear = Marker(action=Marker.DELETEALL)
    log = warnings(graph)
    send(graph, 'obstacles', array_of(marker((5.0, 0.0, 0.0), id=3), clear))
    graph.spin_until(lambda: len(sim._world.obstacles) == 1)
    send(graph, 'wrench', wrench_of('nobody'))  # said after what it might have said of the markers
    graph.spin_until(lambda: said(log, 'nobody'))
    assert not said(log, '~/obstacles')


def test_a_marker_that_moves_moves_on_until_the_timeout(graph):
    sim = graph.sim_node(**SMALL, input_timeout=0.25)
    paused(graph)
    begin = 1_700_000_000 * SECOND
    send(graph, 'obstacles', array_of(stamped(marker((5.0, 0.0, 1.0)), begin)))
    send(graph, 'obstacles', array_of(stamped(marker((5.1, 0.0, 1.0)), begin + SECOND // 10)))
    graph.spin_until(lambda: len(sim._world.obstacles) == 2 and sim._world.obstacles[1].moves)
    step(graph, 240)
    np.testing.assert_allclose(sim._world.obstacles[1].position, [5.1 + 0.25, 0.0, 1.0])


def test_good_markers_of_an_array_with_bad_ones_are_used(graph):
    sim = graph.sim_node(**SMALL)
    log = warnings(graph)
    bad = marker((5.0, 0.0, 0.0), (1.0, math.nan, 1.0), id=7)
    send(graph, 'obstacles', array_of(bad, bad, marker((5.0, 0.0, 0.0))))
    graph.spin_until(lambda: len(sim._world.obstacles) == 2)
    (sentence,) = graph.spin_until(lambda: said(log, "marker 'test'/7 is ignored"))
    assert 'scale is [1, nan, 1]' in sentence
    assert '(and 1 more like this)' in sentence


def test_too_many_markers_are_said(graph):
    sim = graph.sim_node(**SMALL)
    paused(graph)
    log = warnings(graph)
    send(graph, 'obstacles', array_of(*(marker((5.0, 0.0, 0.0), id=i) for i in range(1001))))
    graph.spin_until(lambda: len(sim._world.obstacles) == 1001)
    graph.spin_until(lambda: said(log, 'there are 1000 obstacles already, which is the most'))


# ------------------------------------------------------------------------------------------ points
@pytest.mark.parametrize('reliability', list(ReliabilityPolicy)[1:3])
def test_points_come_from_both_kinds_of_publisher(graph, reliability):
    assert reliability.name in ('RELIABLE', 'BEST_EFFORT')
    sim = graph.sim_node(**SMALL, obstacle_points__radius=0.1, obstacle_points__self_filter=0.0)
    sender = publisher(graph, 'obstacle_points', QoSProfile(depth=1, reliability=reliability))
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    sender.publish(cloud_of(points))
    graph.spin_until(lambda: len(sim._world.point_obstacles) == 50)
    np.testing.assert_array_equal(sim._world.point_obstacles.points, points)
    assert sim._world.point_obstacles.radius == 0.1
    sender.publish(cloud_of(points[:0]))
    graph.spin_until(lambda: len(sim._world.point_obstacles) == 0)


def test_the_points_of_another_node_are_in_the_way(graph):
    sim = graph.sim_node(**SMALL)
    graph.sim_node(namespace='/other', **SMALL, ball__position=[0.0, 0.0, 9.0])
    relay = publisher(graph, 'obstacle_points')
    clouds = []

    def pass_on(cloud):
        clouds.append(cloud)
        relay.publish(cloud)

    graph.node.create_subscription(PointCloud2, '/other/softbody_sim/points', pass_on, 5)
    graph.spin_until(lambda: len(sim._world.point_obstacles) == 42)
    shown = {np.frombuffer(cloud.data, POINT_TYPE)['z'].tobytes() for cloud in clouds}
    assert sim._world.point_obstacles.points[:, 2].astype(np.float32).tobytes() in shown


def test_points_on_the_body_are_ignored_and_counted(graph):
    sim = graph.sim_node(**SMALL, gravity__magnitude=0.0)
    reports = graph.collect(DiagnosticArray, '/diagnostics')
    points = np.concatenate([sim._world.positions('ball') + [0.005, 0.0, 0.0], [[5.0, 0.0, 0.0]]])
    send(graph, 'obstacle_points', cloud_of(points))
    graph.spin_until(lambda: len(sim._world.point_obstacles) == 1)

    def counted():
        values = {item.key: item.value for item in reports[-1].status[0].values} if reports else {}
        return values.get('ignored obstacle points, on bodies') == '42'

    graph.spin_until(counted)


def test_a_huge_cloud_is_thinned_and_that_is_said(graph):
    sim = graph.sim_node(**SMALL)
    paused(graph)
    log = warnings(graph)
    points = np.random.default_rng(0).uniform(-9.0, 9.0, size=(30_000, 3))
    send(graph, 'obstacle_points', cloud_of(points))
    graph.spin_until(lambda: len(sim._world.point_obstacles) == 20_000)
    graph.spin_until(lambda: said(log, '30000 points are thinned to 20000', '0.02 m'))


# ------------------------------------------------------------------------------------------ forces
def test_a_wrench_on_a_body_and_one_on_all(graph):
    sim = graph.sim_node(
        bodies=['one', 'two'], one__subdivisions=1, two__subdivisions=1, one__mass=2.0,
        one__orientation=[0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)],
        two__position=[5.0, 0.0, 1.5], gravity__magnitude=0.0, input_timeout=0.1,
    )  # fmt: skip
    paused(graph)
    send(graph, 'wrench', wrench_of('one', (4.0, 0.0, 0.0)))
    send(graph, 'wrench', wrench_of('world', (0.0, 3.0, 0.0)))
    graph.spin_until(lambda: len(sim._world.external_inputs.wrenches) == 2)
    step(graph, 100)  # they act for 24 ticks
    np.testing.assert_allclose(momentum(sim, 'one'), [0.0, 0.2 + 0.15, 0.0], atol=1e-12)
    np.testing.assert_allclose(momentum(sim, 'two'), [0.0, 0.3, 0.0], atol=1e-12)
    send(graph, 'wrench', wrench_of('one', (4.0, 0.0, 0.0)))
    graph.spin_until(lambda: sim._world.external_inputs.wrenches)
    send(graph, 'wrench', wrench_of('one'))  # zero ends it
    graph.spin_until(lambda: not sim._world.external_inputs.wrenches)


def test_a_poke_moves_the_ball_and_one_into_the_air_is_said(graph):
    sim = graph.sim_node(gravity__magnitude=0.0)
    paused(graph)
    log = warnings(graph)
    send(graph, 'poke', poke_of((0.0, 0.0, 9.0)))
    (sentence,) = graph.spin_until(lambda: said(log, 'nothing is within 0.15 m'))
    assert 'the nearest vertex is 7 m away, on ball' in sentence
    assert (momentum(sim) == 0.0).all()
    send(graph, 'poke', poke_of((0.5, 0.0, 1.5)))
    graph.spin_until(lambda: momentum(sim).any())
    speed = np.linalg.norm(momentum(sim))
    assert speed == pytest.approx(1.5)
    step(graph, 120)
    assert sim._world.rigid_fit('ball').position[0] == pytest.approx(-0.75, abs=0.02)


def diagnostics(graph, sim):
    """Return a list that grows with the values of each report."""
    reports = []

    def take(message):
        if message.status[0].name == SIM:
            reports.append({item.key: item.value for item in message.status[0].values})

    graph.node.create_subscription(DiagnosticArray, '/diagnostics', take, 10)
    return reports


def test_gravity_while_it_is_published(graph):
    sim = graph.sim_node(**SMALL)
    paused(graph)
    log, reports = warnings(graph), diagnostics(graph, sim)
    graph.spin_until(lambda: reports)
    assert reports[-1]['gravity (m/s²)'] == '[0, 0, -9.81]'
    assert reports[-1]['gravity source'] == 'parameters'
    send(graph, 'gravity', gravity_of((1.5, 0.0, 0.0)))
    graph.spin_until(lambda: reports[-1]['gravity (m/s²)'] == '[1.5, 0, 0]')
    assert reports[-1]['gravity source'] == '~/gravity, 0.50 s left'
    graph.spin_until(lambda: said(log, 'gravity is now [1.5, 0, 0] m/s², from ~/gravity'))
    step(graph, 120)
    np.testing.assert_allclose(momentum(sim), [0.75, 0.0, 0.0], atol=1e-12)
    graph.spin_until(lambda: said(log, 'gravity is now [0, 0, -9.81] m/s², from parameters'))


def test_diagnostics_count_what_acts(graph):
    sim = graph.sim_node(**SMALL)
    paused(graph)
    reports = diagnostics(graph, sim)
    send(graph, 'obstacles', array_of(marker((5.0, 0.0, 0.0))))
    send(graph, 'obstacle_points', cloud_of(np.ones((3, 3))))
    send(graph, 'wrench', wrench_of('ball', (1.0, 0.0, 0.0)))
    wanted = {'obstacles': '1', 'obstacle points': '3', 'wrenches': '1'}.items()
    graph.spin_until(
        lambda: reports and all(reports[-1][f'received {key}'] == value for key, value in wanted)
    )


# ----------------------------------------------------------------------------------- what is wrong
def test_another_frame_is_refused_with_a_warning(graph):
    sim = graph.sim_node(**SMALL)
    paused(graph)
    log = warnings(graph)
    elsewhere = marker((0.0, 0.0, 1.0))
    elsewhere.header.frame_id = 'map'
    for topic, message in (
        ('obstacles', array_of(elsewhere)),
        ('obstacle_points', cloud_of(np.ones((3, 3)), 'map')),
        ('wrench', wrench_of('map', (1.0, 0.0, 0.0))),
        ('poke', in_frame(PointStamped, 'map')),
        ('gravity', in_frame(Vector3Stamped, 'map')),
    ):
        send(graph, topic, message)
        graph.spin_until(lambda: said(log, f'~/{topic}: ', "'map'", "'world'"), topic)  # noqa: B023
    assert sim._world.external_inputs.obstacles == ()
    assert not sim._world.external_inputs.wrenches and sim._world.external_inputs.gravity is None
    assert len(sim._world.point_obstacles) == 0


def test_warnings_are_few(graph):
    sim = graph.sim_node(**SMALL)
    log = warnings(graph)
    sender = publisher(graph, 'wrench')
    for _ in range(50):
        sender.publish(wrench_of('nobody', (1.0, 0.0, 0.0)))
    send(graph, 'wrench', wrench_of('ball', (0.0, 0.0, 1.0)))
    graph.spin_until(lambda: said(log, "'nobody'") and sim._world.external_inputs.wrenches)
    assert len(said(log, "'nobody'")) == 1


NUMBERS = [0.0, 1.0, -1.0, 0.5, math.nan, math.inf, -math.inf, 1e300, -1e300, 5e-324, 1e6]


def anything(kind, draw):
    """Return a message with anything in its numbers, and names that are often right."""

    def filled(message):
        for name, type_name in message.get_fields_and_field_types().items():
            value = getattr(message, name)
            if type_name == 'string':
                value = draw.choice(['world', 'world', 'ball', 'x', 'y', 'z', ''])
            elif type_name in ('double', 'float'):
                value = draw.choice(NUMBERS[:7] if type_name == 'float' else NUMBERS)
            elif type_name == 'boolean':
                value = draw.random() < 0.5
            elif type_name == 'uint8':
                value = draw.choice([7, 7, 8, 0, 255])
            elif type_name in ('int32', 'uint32'):
                least = -(2**31) if type_name == 'int32' else 2**32 - 1
                value = draw.choice([0, 0, 1, 1, 2, 3, 4, 8, 12, least])
            elif hasattr(value, 'get_fields_and_field_types'):
                filled(value)
                continue
            else:
                continue
            setattr(message, name, value)
        return message

    message = filled(kind())
    if kind is MarkerArray:
        message.markers = [filled(Marker()) for _ in range(draw.randrange(4))]
    if kind is PointCloud2:
        message.fields = [filled(PointField()) for _ in range(draw.randrange(5))]
        message.data.frombytes(draw.randbytes(draw.randrange(100)))
    return message


def test_nothing_that_is_sent_ends_the_node(graph):
    """A process of its own that checks the fields of what it publishes itself."""
    process = graph.process(
        '--ros-args', '-p', 'ball.subdivisions:=1', environment={'ROS_PYTHON_CHECK_FIELDS': '1'}
    )
    draw = random.Random(1)
    clouds = graph.collect(PointCloud2, f'{SIM}/points', 5)
    graph.collect(WrenchStamped, f'{SIM}/contacts')
    log = warnings(graph)
    graph.spin_until(lambda: clouds)
    for topic, kind in INPUTS.items():
        sender = publisher(graph, topic)
        for _ in range(100):
            sender.publish(anything(kind, draw))
        sender.wait_for_all_acked()
    send(graph, 'obstacles', array_of(marker((5.0, 0.0, 0.0))))  # the node still listens
    assert graph.call(Trigger, f'{SIM}/reset').success
    seen = len(clouds)
    graph.spin_until(lambda: len(clouds) > seen + 5)
    assert process.poll() is None
    assert not said(log, 'a callback failed')


# ----------------------------------------------------------------------------- quality of service
@pytest.mark.parametrize(
    ('topic', 'message', 'acts'),
    [
        ('obstacles', lambda: array_of(marker((5.0, 0.0, 0.0))), lambda w: len(w.obstacles) > 1),
        ('obstacle_points', lambda: cloud_of([[5.0, 0.0, 0.0]]), lambda w: len(w.point_obstacles)),
        (
            'wrench',
            lambda: wrench_of('ball', (1.0, 0.0, 0.0)),
            lambda w: w.external_inputs.wrenches,
        ),
        ('gravity', lambda: gravity_of((1.0, 0.0, 0.0)), lambda w: w.gravity[0] == 1.0),
        (
            'poke',
            lambda: poke_of((0.5, 0.0, 1.0)),
            lambda w: abs(w.velocities('ball')[:, 0]).max(),
        ),
    ],
)
def test_best_effort_publishers_are_heard(graph, topic, message, acts):
    sim = graph.sim_node(**SMALL, ball__position=[0.0, 0.0, 1.0], gravity__magnitude=0.0)
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    sender = graph.node.create_publisher(INPUTS[topic], f'{SIM}/{topic}', qos)

    def heard():
        sender.publish(message())
        return acts(sim._world)

    graph.spin_until(heard)


@pytest.mark.parametrize('topic', ['obstacles', 'obstacle_points'])
def test_what_was_latched_before_the_node_started_is_in_the_way(graph, topic):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    sender = graph.node.create_publisher(INPUTS[topic], f'{SIM}/{topic}', latched)
    position = (5.0, 0.0, 0.0)
    sender.publish(array_of(marker(position)) if topic == 'obstacles' else cloud_of([position]))
    sim = graph.sim_node(**SMALL)
    graph.spin_until(lambda: len(sim._world.obstacles) > 1 or len(sim._world.point_obstacles))


def test_what_two_subscriptions_receive_acts_once(graph):
    sim = graph.sim_node(**SMALL, ball__position=[0.0, 0.0, 1.0], gravity__magnitude=0.0)
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    latched = QoSProfile(depth=5, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    others = [
        graph.node.create_publisher(PointStamped, f'{SIM}/poke', each) for each in (qos, latched)
    ]
    topic = next(each for each in sim._inputs._topics if each.name == '~/poke')
    graph.spin_until(lambda: len(topic.heard) == 3)
    # of the three, two are enough to receive it twice: once, a middleware never matched one
    graph.spin_until(lambda: others[1].get_subscription_count() >= 2)
    paused(graph)
    tick = sim._world.tick
    others[1].publish(poke_of((0.5, 0.0, 1.0)))
    impulse = sim._scene.node.poke_impulse
    step(graph, 5)
    graph.spin_until(lambda: momentum(sim)[0] != 0.0 and sim._world.tick >= tick + 5)
    step(graph, 5)
    assert momentum(sim)[0] == pytest.approx(-impulse, rel=1e-9)


def test_another_type_on_an_input_topic_is_said(graph):
    """Of another process: within one, the middleware does not let topics have two types."""
    log = warnings(graph)
    graph.sim_node(**SMALL)
    code = (
        'import rclpy; from geometry_msgs.msg import Vector3Stamped; rclpy.init(); '
        'node = rclpy.create_node("stranger"); '
        f'node.create_publisher(Vector3Stamped, "{SIM}/wrench", 10); rclpy.spin(node)'
    )
    environment = os.environ | {'ROS_DOMAIN_ID': str(graph.domain)}
    stranger = subprocess.Popen([sys.executable, '-c', code], env=environment)
    try:
        graph.spin_until(
            lambda: said(
                log,
                '~/wrench: stranger publishes geometry_msgs/msg/Vector3Stamped there',
                'send geometry_msgs/msg/WrenchStamped',
            )
        )
    finally:
        stranger.kill()
        stranger.wait()


# ------------------------------------------------------------------------------------------- clock
class Ticker(ClockSource):
    """Shows the times of ticks, and waits until the world is there."""

    def go(self, tick):
        self.reach(7 * SECOND + math.ceil(tick * SECOND / 240))
        assert self.sim._world.tick == tick


def test_everything_acts_again_when_the_clock_goes_back(graph):
    sim = graph.sim_node(**SMALL, use_sim_time=True, input_timeout=0.2)
    ticker = Ticker(graph, sim)
    senders = {topic: publisher(graph, topic) for topic in INPUTS}
    points = np.random.default_rng(0).normal(size=(50, 3))
    what = {
        10: ('obstacles', array_of(stamped(marker((0.4, 0.0, 0.5)), SECOND))),
        30: ('obstacles', array_of(stamped(marker((0.45, 0.0, 0.5)), SECOND + SECOND // 10))),
        50: ('obstacle_points', cloud_of(points)),
        70: ('wrench', wrench_of('ball', (0.0, 5.0, 0.0), (0.0, 0.0, 1.0))),
        80: ('gravity', gravity_of((0.0, 1.0, -3.0))),
        90: ('poke', None),
        150: ('obstacles', array_of(Marker(action=Marker.DELETEALL))),
        160: ('obstacle_points', cloud_of(points[:7])),
    }
    ticker.go(0)

    def state():
        world = sim._world
        outside = world.external_inputs
        return (
            world.positions('ball').tobytes(),
            world.velocities('ball').tobytes(),
            [item.position.tobytes() + item.rotation.tobytes() for item in world.obstacles],
            world.point_obstacles.points.tobytes(),
            world.gravity.tolist(),
            list(outside.wrenches),
        )

    log = {}
    for tick in range(10, 241, 10):
        ticker.go(tick)
        log[tick] = state()
        if tick in what:
            topic, message = what[tick]
            noted = len(sim._stepper.history._actions)
            if topic == 'poke':
                message = poke_of(sim._world.positions('ball')[5])
            senders[topic].publish(message)
            graph.spin_until(lambda: len(sim._stepper.history._actions) > noted, topic)  # noqa: B023
    assert len({str(value) for value in log.values()}) == len(log)
    for tick in (230, 170, 160, 140, 90, 50, 20):
        ticker.go(tick)
        assert state() == log[tick], tick


def test_reset_keeps_obstacles_and_ends_forces(graph):
    sim = graph.sim_node(**SMALL)
    send(graph, 'obstacles', array_of(marker((5.0, 0.0, 0.0))))
    send(graph, 'gravity', gravity_of((0.0, 0.0, 0.0)))
    send(graph, 'wrench', wrench_of('ball', (1.0, 0.0, 0.0)))
    graph.spin_until(
        lambda: sim._world.external_inputs.wrenches and len(sim._world.obstacles) == 2
    )
    paused(graph)
    assert graph.call(Trigger, f'{SIM}/reset').success
    assert not sim._world.external_inputs.wrenches and sim._world.external_inputs.gravity is None
    assert len(sim._world.obstacles) == 2
