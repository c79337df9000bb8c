# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What others can read of contacts: wrenches on bodies and obstacles, and pressure."""

from geometry_msgs.msg import WrenchStamped
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2
from simulated_clock import SECOND, ClockSource
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from softbody_ros.core.external_inputs import MOST_DYNAMIC_OBSTACLES
from softbody_ros.ros.messages import POINT_TYPE

SIM = '/softbody_sim'
G = 9.81


def stamp_of(message):
    """Return the time of a message, s."""
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def force_of(message):
    """Return the force (3,), N."""
    force = message.wrench.force
    return np.array([force.x, force.y, force.z])


def torque_of(message):
    """Return the torque (3,), N m."""
    torque = message.wrench.torque
    return np.array([torque.x, torque.y, torque.z])


def impulse_of(messages, clouds, start):
    """Return the sum (3,) of forces times the time since the output before, N s."""
    outputs, total = [stamp_of(cloud) for cloud in clouds], np.zeros(3)
    for message in messages:
        end = stamp_of(message)
        begin = max((stamp for stamp in outputs if stamp < end), default=start)
        total += force_of(message) * (end - begin)
    return total


@pytest.mark.oldest
def test_contacts_of_each_body_and_one_zero_when_they_end(graph):
    node = graph.sim_node(
        bodies=['one', 'two'], one__subdivisions=1, two__subdivisions=1, two__mass=3.0,
        one__position=[0.0, 0.0, 0.5], two__position=[5.0, 0.0, 1.5], frame_id='map',
    )  # fmt: skip
    total = graph.collect(WrenchStamped, f'{SIM}/contacts')
    one = graph.collect(WrenchStamped, f'{SIM}/contacts/one')
    two = graph.collect(WrenchStamped, f'{SIM}/contacts/two')
    graph.spin_until(lambda: len(total) > 3 and len(one) > 3)
    assert not two  # it still falls

    def settled() -> bool:
        forces = sorted(item.wrench.force.z for item in total[-4:])
        return bool(two) and forces == pytest.approx([9.81, 9.81, 29.43, 29.43], rel=0.02)

    graph.spin_until(settled)
    assert {item.header.frame_id for item in one + two + total} == {'map'}
    assert not [item for item in one if item.wrench.force.z == 0.0]

    graph.set_parameter(SIM, 'gravity.direction', [0.0, 0.0, 1.0])
    graph.spin_until(lambda: one[-1].wrench.force.z == 0.0 and two[-1].wrench.force.z == 0.0)
    counts, tick = (len(one), len(two)), node._world.tick
    graph.spin_until(lambda: node._world.tick > tick + 60)
    assert (len(one), len(two)) == counts


def test_a_turned_obstacle_feels_in_its_own_axes_what_the_body_does(graph):
    quaternion = [0.0, 0.0, 0.6, 0.8]
    sim = graph.sim_node(
        obstacles=['scale'], ball__subdivisions=1, scale__type='box', scale__size=[1.0, 1.0, 0.1],
        scale__position=[0.3, 0.2, -0.1], scale__orientation=quaternion, ball__mass=2.0,
        ball__position=[0.0, 0.0, 0.6],
    )  # fmt: skip
    turn = Rotation.from_quat(quaternion)
    graph.spin_until(lambda: sim._world.is_asleep('ball'))
    felt = graph.collect(WrenchStamped, f'{SIM}/obstacle_contacts/scale')
    every = graph.collect(WrenchStamped, f'{SIM}/obstacle_contacts')
    reaction = graph.collect(WrenchStamped, f'{SIM}/contacts/ball')
    graph.spin_until(lambda: len(felt) > 5 and len(every) > 5 and len(reaction) > 5)
    assert {message.header.frame_id for message in felt + every} == {'scale'}
    force, torque = turn.apply(force_of(felt[-1])), turn.apply(torque_of(felt[-1]))
    assert force == pytest.approx(-force_of(reaction[-1]), abs=1e-9 * G)
    assert force == pytest.approx([0.0, 0.0, -2.0 * G], rel=1e-3, abs=1e-3)
    # the weight acts at the centre of the ball, seen from the origin of the box
    centre = sim._world.rigid_fit('ball').position
    arm = centre - [0.3, 0.2, -0.1]
    about_origin = np.cross(arm, force) - torque_of(reaction[-1])
    assert torque == pytest.approx(about_origin, abs=1e-9)


def test_nothing_of_an_impact_is_lost_between_messages(graph):
    """The ball falls and comes to rest: the ground has given it all of g m t, at any rate."""
    # by a clock: wall time that a busy machine drops would be in the stamps
    sim = graph.sim_node(use_sim_time=True, ball__subdivisions=1, ball__mass=3.0, points_rate=7.0)
    clock = ClockSource(graph, sim)
    clouds = graph.collect(PointCloud2, f'{SIM}/points', 500)
    body = graph.collect(WrenchStamped, f'{SIM}/contacts/ball', 500)
    ground = graph.collect(WrenchStamped, f'{SIM}/obstacle_contacts/ground', 500)
    for tenth in range(10, 120):
        clock.reach(tenth * SECOND // 10)
    assert sim._world.is_asleep('ball')
    graph.spin_until(lambda: len(clouds) > 70 and len(ground) > 60 and len(body) > 60)
    start = sim._stepper.time_of(0) * 1e-9
    for messages, sign in ((body, 1.0), (ground, -1.0)):
        impulse = sign * impulse_of(messages, clouds, start)[2]
        assert impulse == pytest.approx(3.0 * G * (stamp_of(messages[-1]) - start), rel=1e-4)


STAND = """<robot name="stand"><link name="table"><collision><origin xyz="0 0 0.5"/>
<geometry><box size="2 2 0.2"/></geometry></collision></link></robot>"""


@pytest.mark.parametrize('plate', ['marker', 'link', 'deleted', 'expired'])
def test_nothing_of_an_impact_on_what_comes_between_messages_is_lost(graph, plate):
    """A plate comes right under the ball, which has bounced off, before the next output."""
    sim = graph.sim_node(
        use_sim_time=True, points_rate=5.0, gravity__magnitude=0.0, obstacles=[''],
        ball__mode='rigid', ball__elasticity=1.0, ball__subdivisions=1, ball__mass=2.0,
        ball__position=[0.0, 0.0, 3.8], ball__initial_velocity__linear=[0.0, 0.0, -10.0],
        robot__links=['*'],
    )  # fmt: skip
    clock = ClockSource(graph, sim)
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    felt = graph.collect(WrenchStamped, f'{SIM}/obstacle_contacts')
    graph.spin_until(sim._contacts._obstacles.get_subscription_count)
    for hundredths in (100, 120, 125):
        clock.reach(hundredths * SECOND // 100)
    if plate != 'link':
        marker = Marker(ns='plate', type=Marker.CUBE)
        marker.header.frame_id = 'world'
        marker.pose.position.z, marker.pose.orientation.w = 0.5, 1.0
        marker.scale.x, marker.scale.y, marker.scale.z = 2.0, 2.0, 0.2
        marker.lifetime.nanosec = 50_000_000 if plate == 'expired' else 0
        sender = graph.node.create_publisher(MarkerArray, f'{SIM}/obstacles', 10)
        graph.spin_until(sender.get_subscription_count)
        sender.publish(MarkerArray(markers=[marker]))
    else:
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        graph.node.create_publisher(String, '/robot_description', qos).publish(String(data=STAND))
    graph.spin_until(lambda: sim._world.obstacles)
    assert sim._world.velocities('ball')[0] == pytest.approx([0.0, 0.0, -10.0], abs=1e-9)
    clock.reach(133 * SECOND // 100)
    if plate == 'deleted':
        marker.action = Marker.DELETE
        sender.publish(MarkerArray(markers=[marker]))
        graph.spin_until(lambda: not sim._world.obstacles)
    assert bool(sim._world.obstacles) == (plate in ('marker', 'link'))
    for hundredths in (140, 160, 180):
        clock.reach(hundredths * SECOND // 100)
    graph.spin_until(lambda: felt and not force_of(felt[-1]).any())
    change = 2.0 * (sim._world.velocities('ball')[0] - [0.0, 0.0, -10.0])
    assert change == pytest.approx([0.0, 0.0, 40.0], rel=1e-3, abs=1e-3)
    assert -impulse_of(felt, clouds, 1.0) == pytest.approx(change, abs=1e-6)
    if plate in ('deleted', 'expired'):
        assert {message.header.frame_id for message in felt} == {'plate/0'}
        known = {*sim._contacts._was_in_contact, *sim._contacts._means._obstacles}
        assert known == {None}


def test_what_an_obstacle_holds_is_on_the_topics_of_both(graph):
    sim = graph.sim_node(
        obstacles=['hand'], ball__subdivisions=1, ball__mass=2.0, ball__position=[0.0, 0.0, 0.0],
        hand__type='box', hand__size=[0.1, 0.1, 0.1], hand__position=[0.3, 0.0, 0.6],
        gravity__magnitude=0.0,
    )  # fmt: skip
    refused = graph.set_parameter(SIM, 'ball.attach.to', 'hand')
    assert not refused.successful
    assert 'set attach.radius, attach.indices or attach.box first' in refused.reason
    assert graph.set_parameter(SIM, 'ball.attach.radius', 0.01).successful
    refused = graph.set_parameter(SIM, 'ball.attach.to', 'hand')
    assert 'no vertex is so near to hand, the nearest one is 0.' in refused.reason
    assert graph.set_parameter(SIM, 'ball.attach.radius', 0.3).successful
    assert graph.set_parameter(SIM, 'ball.attach.to', 'hand').successful
    assert graph.set_parameter(SIM, 'gravity.magnitude', G).successful
    graph.spin_until(lambda: sim._world.is_asleep('ball'))
    pins = graph.collect(WrenchStamped, f'{SIM}/pins')
    own = graph.collect(WrenchStamped, f'{SIM}/pins/ball')
    felt = graph.collect(WrenchStamped, f'{SIM}/obstacle_contacts/hand')
    graph.spin_until(lambda: len(pins) > 3 and len(own) > 3 and len(felt) > 3)
    assert force_of(own[-1]) == pytest.approx([0.0, 0.0, 2.0 * G], abs=1e-9)
    assert force_of(pins[-1]) == pytest.approx(force_of(own[-1]), abs=1e-9)
    assert force_of(felt[-1]) == pytest.approx(-force_of(own[-1]), abs=1e-9)
    arm = sim._world.rigid_fit('ball').position - [0.3, 0.0, 0.6]
    assert torque_of(felt[-1]) == pytest.approx(np.cross(arm, force_of(felt[-1])), abs=1e-3)
    # gone with the hand's grip, after one message of zeros
    assert graph.set_parameter(SIM, 'ball.attach.to', '').successful
    graph.spin_until(lambda: not force_of(own[-1]).any() and not force_of(felt[-1]).any())


def test_obstacles_and_points_of_others_are_felt_too(graph):
    graph.sim_node(obstacles=[''], ball__subdivisions=1, ball__mass=2.0)
    felt = graph.collect(WrenchStamped, f'{SIM}/obstacle_contacts')
    sender = graph.node.create_publisher(MarkerArray, f'{SIM}/obstacles', 10)
    graph.spin_until(sender.get_subscription_count)
    table = Marker(ns='table', id=7, type=Marker.CUBE)
    table.header.frame_id = 'world'
    table.pose.orientation.w = 1.0
    table.pose.position.z = -0.1
    table.scale.x = table.scale.y = 4.0
    table.scale.z = 0.2
    sender.publish(MarkerArray(markers=[table]))
    graph.spin_until(
        lambda: felt and force_of(felt[-1]) == pytest.approx([0, 0, -2 * G], rel=1e-3, abs=1e-3)
    )
    assert felt[-1].header.frame_id == 'table/7'


@pytest.mark.parametrize('end', ['delete', 'lifetime'])
def test_obstacles_of_others_that_go_feel_nothing_any_more_and_are_forgotten(graph, end):
    sim = graph.sim_node(
        ball__subdivisions=1, ball__size=0.5, ball__position=[0.0, 0.0, 0.5], ball__mode='rigid'
    )
    felt = graph.collect(WrenchStamped, f'{SIM}/obstacle_contacts', 1000)
    sender = graph.node.create_publisher(MarkerArray, f'{SIM}/obstacles', 10)
    graph.spin_until(sender.get_subscription_count)
    for number in range(3):
        press = Marker(ns='press', id=number, type=Marker.CUBE)
        press.header.frame_id = 'world'
        press.pose.orientation.w = 1.0
        # a plate that squeezes the ball as long as it is there, and lets it go without a jump
        press.pose.position.z = 1.09
        press.scale.x, press.scale.y, press.scale.z = 3.0, 3.0, 0.2
        press.lifetime.nanosec = 300_000_000 if end == 'lifetime' else 0
        sender.publish(MarkerArray(markers=[press]))
        frame = f'press/{number}'

        def forces(frame=frame):
            return [force_of(each) for each in felt if each.header.frame_id == frame]

        # it may have expired before anybody looks
        graph.spin_until(lambda forces=forces: any(each.any() for each in forces()))
        if end == 'delete':
            press.action = Marker.DELETE
            sender.publish(MarkerArray(markers=[press]))
        graph.spin_until(lambda forces=forces: not forces()[-1].any(), 'a message of zeros')
    for known in (sim._contacts._was_in_contact, sim._contacts._means._obstacles):
        graph.spin_until(lambda known=known: set(known) == {'ground', None}, 'it to be forgotten')


def test_as_many_as_there_can_be_find_room_in_the_queue_of_all(graph):
    sim = graph.sim_node(ball__subdivisions=1)
    queue = sim._contacts._obstacles
    assert queue.qos_profile.depth >= 2 * (MOST_DYNAMIC_OBSTACLES + 2)
    names = ['ground', 'one', 'two', 'three']
    assert graph.set_parameter(SIM, 'obstacles', names).successful
    graph.spin_until(lambda: 'three' in sim._contacts._obstacle)
    assert sim._contacts._obstacles is queue  # subscribers lose nothing


def test_points_have_the_pressure_of_what_touches(graph):
    sim = graph.sim_node(ball__subdivisions=2, ball__mass=2.0)
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    graph.spin_until(lambda: clouds)
    assert not np.frombuffer(clouds[0].data, POINT_TYPE)['pressure'].any()
    graph.spin_until(lambda: sim._world.is_asleep('ball'))
    seen = len(clouds)
    graph.spin_until(lambda: len(clouds) > seen + 1)
    points = np.frombuffer(clouds[-1].data, POINT_TYPE)
    areas = sim._world.rest_shape('ball').areas
    assert (points['pressure'] * areas).sum() == pytest.approx(2.0 * G, rel=1e-3)
    assert (points['z'][points['pressure'] > 0.0] < 0.01).all()
