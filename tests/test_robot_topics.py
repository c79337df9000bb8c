# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A robot of /robot_description and /joint_states in the node: real rclpy, end to end."""

import math
import pathlib

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3, WrenchStamped
import numpy as np
import pytest
from rcl_interfaces.msg import Log
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from scene_files import scene_values
from sensor_msgs.msg import JointState
from simulated_clock import SECOND, ClockSource
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker, MarkerArray

from softbody_ros.core.external_inputs import is_link
from softbody_ros.ros.robot import MOST_JOINTS

SIM = '/softbody_sim'
CONFIG = pathlib.Path(__file__).parent.parent / 'config'
GRIPPER = (CONFIG / 'gripper.urdf').read_text()
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SMALL = {'ball__subdivisions': 1, 'ball__position': [5.0, 0.0, 1.0]}
ALL = {'robot__links': ['*']}
STAND = """<robot name="stand"><link name="table"><collision><origin xyz="0 0 0.5"/>
<geometry><box size="2 2 0.2"/></geometry></collision></link></robot>"""


class Robot:
    """Publishers of a description and of joint states."""

    def __init__(self, graph, qos=10):
        self._graph = graph
        self._describes = graph.node.create_publisher(String, '/robot_description', LATCHED)
        self.states = graph.node.create_publisher(JointState, '/joint_states', qos)

    def describe(self, urdf=GRIPPER):
        self._describes.publish(String(data=urdf))

    def heard(self):
        self._graph.spin_until(self.states.get_subscription_count, 'who hears joint states')
        return self

    def send(self, stamp=0, velocities=None, **positions):
        message = JointState(name=list(positions), position=list(map(float, positions.values())))
        if velocities is not None:
            message.velocity = [float(value) for value in velocities]
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND)
        self.states.publish(message)


@pytest.fixture
def robot(graph):
    return Robot(graph)


def log_of(graph):
    qos = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    return graph.collect(Log, '/rosout', qos)


def said(log, *words):
    return [item.msg for item in log if all(word in item.msg for word in words)]


def links_of(sim):
    names = [obstacle.config.name for obstacle in sim._world.external_inputs.obstacles]
    return list(dict.fromkeys(names))


def at(sim, name, axis):
    found = [item for item in sim._world.external_inputs.obstacles if item.config.name == name]
    return found[0].position[axis] if found else math.nan


def height(sim, name='left_finger'):
    return at(sim, name, 2)


def step(graph, ticks):
    assert graph.set_parameter(SIM, 'step_count', ticks).successful
    assert graph.call(Trigger, f'{SIM}/step').success


def test_links_are_obstacles_as_joint_states_say(graph, robot):
    robot.describe()  # before the node is there
    sim = graph.sim_node(robot__links=['*finger', 'palm'], robot__friction=1.3, **SMALL)
    robot.heard()
    graph.spin_until(lambda: sim._robot._robot is not None)
    assert not links_of(sim)  # where they are is not known
    robot.send(grip=0.05, hoist=0.1)
    graph.spin_until(lambda: links_of(sim) == ['palm', 'left_finger', 'right_finger'])
    assert height(sim) == pytest.approx(0.16)
    palm, left, _, right, _ = sim._world.external_inputs.obstacles
    assert (palm.config.type, left.config.type) == ('mesh', 'box')
    assert left.position == pytest.approx([-0.06, 0.0, 0.16])
    assert right.position == pytest.approx([0.06, 0.0, 0.16])
    assert left.config.friction == 1.3
    robot.send(grip=0.05, hoist=0.2)
    graph.spin_until(lambda: height(sim) == pytest.approx(0.26))


def test_without_robot_links_nothing_listens(graph, robot):
    graph.sim_node(**SMALL)
    reports = graph.collect(DiagnosticArray, '/diagnostics')
    graph.spin_until(lambda: len(reports) > 1)
    assert not robot.states.get_subscription_count()
    assert not [item for item in reports[-1].status[0].values if 'robot' in item.key]


def test_velocities_are_stated_or_computed_also_negative_ones(graph, robot):
    robot.describe()
    sim = graph.sim_node(robot__links=['left_finger'], input_timeout=0.25, **SMALL)
    robot.heard()
    assert graph.call(SetBool, f'{SIM}/pause', data=True).success
    begin = 1_700_000_000 * SECOND
    robot.send(begin, grip=0.05, hoist=0.2)
    robot.send(begin + SECOND // 10, grip=0.05, hoist=0.15)
    graph.spin_until(lambda: sim._world.external_inputs.obstacles)
    graph.spin_until(lambda: height(sim) == pytest.approx(0.21))

    def velocity():
        return sim._world.external_inputs.obstacles[0].config.velocity_linear

    assert velocity() == pytest.approx((0.0, 0.0, -0.5), abs=1e-9) or velocity() == (0.0,) * 3
    robot.send(begin + SECOND // 5, [0.0, -0.3], grip=0.05, hoist=0.15)
    graph.spin_until(lambda: velocity() == pytest.approx((0.0, 0.0, -0.3)))
    robot.send(begin + 3 * SECOND // 10, grip=0.05, hoist=0.25)
    graph.spin_until(lambda: velocity() == pytest.approx((0.0, 0.0, 1.0)))
    robot.send(begin + 3 * SECOND // 10 + 1, [-0.2, math.nan], grip=0.05, hoist=0.25)
    graph.spin_until(lambda: velocity()[0] == pytest.approx(0.2))
    step(graph, 240)
    assert not sim._world.external_inputs.obstacles[0].moves
    assert height(sim, 'left_finger') == pytest.approx(0.31)


def test_states_of_several_publishers_are_one_state(graph, robot):
    robot.describe()
    sim = graph.sim_node(**ALL, **SMALL)
    robot.heard()
    other = Robot(graph, QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT))
    other.heard()
    robot.send(hoist=0.1, stranger=7.0)
    graph.spin_until(lambda: 'hoist' in sim._robot._joints)
    other.send(grip=0.03)
    graph.spin_until(lambda: links_of(sim))
    left = sim._world.external_inputs.obstacles[1]
    assert left.position == pytest.approx([-0.04, 0.0, 0.16])
    robot.send(hoist=0.2)
    graph.spin_until(lambda: height(sim) == pytest.approx(0.26))
    left = sim._world.external_inputs.obstacles[1]
    assert left.position[0] == pytest.approx(-0.04)


def test_missing_joints_are_said_once_and_count_as_0(graph, robot):
    robot.describe()
    sim = graph.sim_node(**ALL, **SMALL)
    log = log_of(graph)
    robot.heard()
    robot.send(hoist=0.1)
    graph.spin_until(lambda: links_of(sim), 'the links, after a second')
    assert sim._world.external_inputs.obstacles[1].position[0] == pytest.approx(-0.01)
    for hoist in (0.2, 0.3, 0.4):
        robot.send(hoist=hoist)
        graph.spin_until(lambda at=hoist: height(sim) == pytest.approx(0.06 + at))
    (sentence,) = graph.spin_until(lambda: said(log, '/joint_states: '))
    assert 'nobody sends joint grip of the robot: where that is unknown, 0 is taken' in sentence


def test_bad_joint_states_are_said_and_good_joints_of_them_used(graph, robot):
    robot.describe()
    sim = graph.sim_node(**ALL, **SMALL)
    log = log_of(graph)
    robot.heard()
    robot.send(grip=0.05, hoist=0.1)
    graph.spin_until(lambda: links_of(sim))
    robot.send(grip=math.nan, hoist=0.2)
    graph.spin_until(lambda: height(sim) == pytest.approx(0.26))
    assert sim._world.external_inputs.obstacles[1].position[0] == pytest.approx(-0.06)
    graph.spin_until(lambda: said(log, "position of 'grip' is nan, and is ignored"))


def test_joints_that_no_robot_has_are_not_remembered_without_end(graph, robot):
    sim = graph.sim_node(**ALL, **SMALL)
    log = log_of(graph)
    robot.heard()
    robot.send(**{f'joint_{number}': 0.0 for number in range(MOST_JOINTS)})
    robot.send(**{f'other_{number}': 0.0 for number in range(MOST_JOINTS)})
    (sentence,) = graph.spin_until(lambda: said(log, '/joint_states: '))
    assert f'more than {MOST_JOINTS} joints are named there' in sentence
    assert len(sim._robot._joints) == MOST_JOINTS
    robot.describe()
    graph.spin_until(lambda: sim._robot.names)
    assert not sim._robot._joints
    robot.send(**{f'joint_{number}': 0.0 for number in range(MOST_JOINTS)})
    robot.send(grip=0.05, hoist=0.1)
    graph.spin_until(lambda: links_of(sim) == ['palm', 'left_finger', 'right_finger'])
    assert height(sim) == pytest.approx(0.16)
    assert len(sim._robot._joints) == MOST_JOINTS + 2


@pytest.mark.parametrize(
    ('urdf', 'words'),
    [
        ('<robot', ('it is ignored: it is no XML',)),
        ('<robot name="r"/>', ('it is ignored: it has no links',)),
        (
            STAND.replace('<box size="2 2 0.2"/>', '<mesh filename="/nowhere.stl"/>'),
            ('collision shape 0 of link table is left out', '/nowhere.stl does not exist'),
        ),
    ],
)
def test_a_bad_description_is_one_sentence_and_the_node_goes_on(graph, robot, urdf, words):
    sim = graph.sim_node(**ALL, **SMALL)
    log = log_of(graph)
    robot.heard()
    robot.describe(urdf)
    (sentence,) = graph.spin_until(lambda: said(log, '/robot_description', *words))
    assert '\n' not in sentence
    robot.describe(STAND)
    graph.spin_until(lambda: links_of(sim) == ['table'], 'a good one')


def test_a_description_that_changes_brings_other_links_topics_and_markers(graph, robot):
    robot.describe()
    sim = graph.sim_node(**ALL, **SMALL)
    shown = graph.collect(MarkerArray, f'{SIM}/obstacle_markers', LATCHED)
    robot.heard()
    robot.send(grip=0.05, hoist=0.1)
    topic = f'{SIM}/obstacle_contacts/'
    graph.spin_until(lambda: graph.node.count_publishers(topic + 'left_finger'))

    def seen():
        return sorted((item.ns, item.id) for item in shown[-1].markers[1:]) if shown else []

    fingers = [(f'robot/{side}_finger', number) for side in ('left', 'right') for number in (0, 1)]
    graph.spin_until(
        lambda: seen() == [('ground', 0), *fingers[:2], ('robot/palm', 0), *fingers[2:]]
    )
    robot.describe(STAND)
    graph.spin_until(lambda: links_of(sim) == ['table'])
    graph.spin_until(lambda: seen() == [('ground', 0), ('robot/table', 0)])
    graph.spin_until(lambda: not graph.node.count_publishers(topic + 'left_finger'))
    graph.spin_until(lambda: graph.node.count_publishers(topic + 'table'))
    robot.describe()  # its joints are still known
    graph.spin_until(lambda: links_of(sim) == ['palm', 'left_finger', 'right_finger'])
    graph.spin_until(lambda: not graph.node.count_publishers(topic + 'table'))


def test_parameters_change_links_pose_and_friction_at_run_time(graph, robot):
    robot.describe(STAND)
    sim = graph.sim_node(**SMALL)
    assert graph.set_parameter(SIM, 'robot.links', ['tabel']).successful
    log = log_of(graph)
    graph.spin_until(lambda: said(log, "robot.links names 'tabel'", 'did you mean table?'))
    assert graph.set_parameter(SIM, 'robot.links', ['t*e']).successful
    graph.spin_until(lambda: links_of(sim) == ['table'])
    turned = [1.0, 2.0, 3.0, math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
    assert graph.set_parameter(SIM, 'robot.pose', turned).successful
    graph.spin_until(lambda: sim._world.obstacles[1].position == pytest.approx([1.0, 1.5, 3.0]))
    assert not sim._world.obstacles[1].moves
    assert graph.set_parameter(SIM, 'robot.friction', 2.0).successful
    graph.spin_until(lambda: sim._world.obstacles[1].config.friction == 2.0)
    refused = graph.set_parameter(SIM, 'robot.pose', [0.0] * 7)
    assert not refused.successful and 'quaternion' in refused.reason
    assert graph.set_parameter(SIM, 'robot.links', ['']).successful
    graph.spin_until(lambda: not links_of(sim))


def test_links_survive_what_others_delete_and_nobody_else_moves_them(graph, robot):
    robot.describe(STAND)
    sim = graph.sim_node(**ALL, **SMALL)
    log = log_of(graph)
    graph.spin_until(lambda: links_of(sim) == ['table'])
    sender = graph.node.create_publisher(MarkerArray, f'{SIM}/obstacles', 10)
    graph.spin_until(sender.get_subscription_count)
    box = Marker(ns='mine', type=Marker.CUBE)
    box.header.frame_id = 'world'
    box.pose.orientation.w = box.scale.x = box.scale.y = box.scale.z = 1.0
    foreign = Marker(ns='robot:table', action=Marker.DELETE)
    sender.publish(MarkerArray(markers=[box, foreign]))
    graph.spin_until(lambda: len(sim._world.obstacles) == 3)
    graph.spin_until(lambda: said(log, "marker 'robot:table'/0 is ignored: its ns begins with"))
    sender.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
    graph.spin_until(lambda: len(sim._world.obstacles) == 2)
    assert links_of(sim) == ['table']
    assert graph.call(Trigger, f'{SIM}/reset').success
    graph.spin_until(lambda: sim._world.tick > 10)
    assert links_of(sim) == ['table']


def test_a_flood_of_states_is_used_once_a_cycle(graph, robot):
    robot.describe()
    sim = graph.sim_node(**ALL, **SMALL)
    robot.heard()
    robot.send(grip=0.05, hoist=0.0)
    graph.spin_until(lambda: links_of(sim))
    sent = 500
    before = len(sim._stepper.history._actions)
    cycles, drive = [0], sim._robot.update

    def counted():
        cycles[0] += 1
        drive()

    sim._robot.update = counted
    for index in range(1, sent + 1):
        robot.send(SECOND + index * 1_000_000, grip=0.05, hoist=0.0005 * index)
        if index % 5 == 0:
            graph.executor.spin_once(timeout_sec=0.0)
    last = 0.06 + 0.0005 * sent
    robot.send(SECOND + (sent + 1) * 1_000_000, [0.0, 0.0], grip=0.05, hoist=last - 0.06)
    graph.spin_until(lambda: height(sim) == pytest.approx(last))
    used = len(sim._stepper.history._actions) - before
    assert 0 < used <= cycles[0]
    assert used < sent // 2
    # states that say the same again are no actions
    before = len(sim._stepper.history._actions)
    robot.send(5 * SECOND, [0.0, 0.0], grip=0.05, hoist=0.1)
    graph.spin_until(lambda: height(sim) == pytest.approx(0.16))
    for index in range(20):
        robot.send(6 * SECOND + index, [0.0, 0.0], grip=0.05, hoist=0.1)
    tick = sim._world.tick
    graph.spin_until(lambda: sim._world.tick > tick + 30)
    assert len(sim._stepper.history._actions) - before <= 2


def test_what_does_not_concern_a_moving_link_leaves_it_alone(graph, robot):
    robot.describe()
    sim = graph.sim_node(**ALL, input_timeout=100.0, **SMALL)
    robot.heard()
    robot.send(SECOND, [0.0, 0.01], grip=0.05, hoist=0.0)
    graph.spin_until(lambda: links_of(sim))
    used = []
    sim._stepper.act, act = lambda *action: (used.append(action), act(*action)), sim._stepper.act
    robot.send(2 * SECOND, [1.0], stranger=1.0)
    graph.spin_until(lambda: 'stranger' in sim._robot._joints)
    assert graph.set_parameter(SIM, 'poke.radius', 0.2).successful
    tick = sim._world.tick
    graph.spin_until(lambda: sim._world.tick > tick + 10)
    changes = [action for action, *_ in used if getattr(action, 'func', None)]
    assert not changes
    assert sim._world.external_inputs.obstacles[0].moves


def test_a_joint_whose_publisher_has_ended_stands_still(graph, robot):
    robot.describe()
    sim = graph.sim_node(**ALL, input_timeout=0.25, **SMALL)
    robot.heard()
    robot.send(SECOND, [0.1, 0.2], grip=0.0, hoist=0.0)
    graph.spin_until(lambda: links_of(sim))
    for tenth in range(1, 8):
        robot.send(SECOND + tenth * SECOND // 10, [0.0], hoist=0.0)
        graph.spin_until(lambda: not sim._robot._due)
        tick = sim._world.tick
        graph.spin_until(lambda at=tick: sim._world.tick > at + 2)
    left = sim._world.external_inputs.obstacles[1]
    tick = sim._world.tick
    graph.spin_until(lambda: sim._world.tick > tick + 80)
    left = sim._world.external_inputs.obstacles[1]
    assert not left.moves
    assert left.position[0] == pytest.approx(-0.01 - 0.1 * 0.25, abs=1e-6)


def test_old_links_go_even_if_where_the_new_ones_are_is_not_known(graph, robot):
    robot.describe(STAND)
    sim = graph.sim_node(**ALL, **SMALL)
    graph.spin_until(lambda: links_of(sim) == ['table'])
    robot.describe()
    graph.spin_until(lambda: not links_of(sim))
    robot.heard().send(grip=0.05, hoist=0.1)
    graph.spin_until(lambda: links_of(sim) == ['palm', 'left_finger', 'right_finger'])


def test_joint_states_are_history(graph, robot):
    robot.describe()
    values = {key.replace('.', '__'): value for key, value in scene_values('robot').items()}
    sim = graph.sim_node(use_sim_time=True, **values)
    clock = ClockSource(graph, sim)
    robot.heard()

    def until(seconds):
        clock.reach(round(seconds * SECOND))

    def bits():
        world = sim._world
        poses = b''.join(item.position.tobytes() for item in world.obstacles)
        return world.tick, world.positions('ball').tobytes(), poses

    until(1.0)
    seen, velocities = {}, [-0.05, 0.0]
    for index in range(60):
        at = 1.0 + 0.02 * index
        robot.send(round(at * SECOND), velocities, grip=0.07 - 0.001 * index / 2, hoist=0.0)
        noted = round(at * SECOND)
        graph.spin_until(lambda now=noted: sim._robot._joints['grip'].stamp == now
                         if 'grip' in sim._robot._joints else False)  # fmt: skip
        graph.spin_until(lambda: not sim._robot._due)
        until(at + 0.02)
        seen[sim._world.tick] = bits()
    assert np.abs(sim._world.contact_wrench('ball')[0]).max() > 1.0
    goal = sorted(seen)[40]
    until(1.0 + (goal + 0.5) / 240)
    graph.spin_until(lambda: sim._world.tick == goal and not sim._stepper.replaying)
    assert bits() == seen[goal]


def test_the_gripper_of_another_process_lifts_the_ball_and_its_links_feel_it(graph):
    """The parts of what they feel; test_pages has the program of docs/how_to/robot.md."""
    robot = Robot(graph)
    robot.describe()
    values = {key.replace('.', '__'): value for key, value in scene_values('robot').items()}
    sim = graph.sim_node(**values, time_scale=1.0)
    felt = {name: graph.collect(WrenchStamped, f'{SIM}/obstacle_contacts/{name}')
            for name in ('left_finger', 'right_finger')}  # fmt: skip
    every = graph.collect(WrenchStamped, f'{SIM}/obstacle_contacts')
    robot.heard()
    for grip in (0.0495, 0.048, 0.0465):
        # by so much at once it is symmetric; by more, friction may end in more ways than one
        robot.send(grip=grip, hoist=0.0)
        inside = pytest.approx(-0.01 - grip)
        graph.spin_until(lambda inside=inside: at(sim, 'left_finger', 0) == inside)
    # it may be asleep before it is squeezed, too
    graph.spin_until(lambda: all(each and abs(each[-1].wrench.force.x) > 5.0
                                 for each in felt.values()))  # fmt: skip
    graph.spin_until(lambda: sim._world.is_asleep('ball'))
    counts = {name: len(messages) for name, messages in felt.items()}
    # means of a time in which it was asleep
    graph.spin_until(lambda: all(len(felt[name]) > counts[name] + 2 for name in felt))
    last = {name: messages[-1] for name, messages in felt.items()}
    for name, message in last.items():
        assert message.header.frame_id == name
    left, right = (last[f'{side}_finger'].wrench for side in ('left', 'right'))
    assert left.force.x == pytest.approx(-right.force.x, rel=1e-3)
    assert left.torque.y == pytest.approx(-right.torque.y, rel=1e-3)
    assert right.force.x > 5.0
    # two shapes each, but one message an output
    stamps = [(item.header.frame_id, item.header.stamp.sec, item.header.stamp.nanosec)
              for item in every]  # fmt: skip
    assert len(set(stamps)) == len(stamps)
    assert {frame for frame, *_ in stamps} <= {'left_finger', 'right_finger', 'ground'}

    def ends():
        return {item.header.frame_id: item.wrench for item in every}

    assert graph.set_parameter(SIM, 'robot.links', []).successful
    graph.spin_until(
        lambda: all(ends()[name].force == Vector3() == ends()[name].torque for name in felt),
        'messages of zeros of links that have gone',
    )
    assert not any(map(is_link, sim._contacts._means._obstacles))
