# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The node, in this process: real rclpy, real topics, services, parameters and /clock."""

import math
import re

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh
from simulated_clock import SECOND, ClockSource
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker

from softbody_ros.core import World
from softbody_ros.ros import simulation_interfaces_node
from softbody_ros.ros.messages import POINT_TYPE, points_array
from softbody_ros.ros.simulation_interfaces import FEATURES
from softbody_ros.scene import parameters

SIM = '/softbody_sim'
SMALL = {'ball__subdivisions': 1}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TABLE = parameters.table(parameters.SceneLists())


def records(cloud):
    assert cloud.width * cloud.height * cloud.point_step == len(cloud.data)
    return np.frombuffer(cloud.data, POINT_TYPE)


def stamp_of(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def paused(graph):
    answer = graph.call(SetBool, f'{SIM}/pause', data=True)
    assert answer.success


def step_to(graph, ticks):
    assert graph.set_parameter(SIM, 'step_count', ticks).successful
    answer = graph.call(Trigger, f'{SIM}/step')
    assert answer.success, answer.message


@pytest.mark.oldest
# ------------------------------------------------------------------------------------------ topics
@pytest.mark.parametrize('distribution', ['surface', 'volume'])
def test_points_have_every_vertex_and_fall(graph, distribution):
    # by a clock: wall time that a busy machine drops would be in the stamps
    sim = graph.sim_node(use_sim_time=True, **SMALL, ball__mass_distribution=distribution)
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    clock = ClockSource(graph, sim)
    for frame in range(60, 84):
        clock.reach(frame * SECOND // 60)
    graph.spin_until(lambda: len(clouds) > 20)
    cloud = clouds[0]
    names = [field.name for field in cloud.fields]
    fields = ['x', 'y', 'z', 'displacement', 'body', 'pressure', 'permanent_strain']
    assert names == fields
    assert (cloud.header.frame_id, cloud.height, cloud.width) == ('world', 1, 42)
    assert cloud.is_dense and not cloud.is_bigendian
    heights = [records(cloud)['z'].mean() for cloud in clouds]
    assert all(np.diff(heights) < 0.0)
    stamps = np.array([stamp_of(cloud) for cloud in clouds])
    steps = np.diff(stamps) / (1e9 / 240)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)


@pytest.mark.parametrize('reliability', list(ReliabilityPolicy)[1:3])
def test_both_kinds_of_subscriber_receive(graph, reliability):
    assert reliability.name in ('RELIABLE', 'BEST_EFFORT')
    graph.sim_node(**SMALL)
    qos = QoSProfile(depth=5, reliability=reliability)
    clouds = graph.collect(PointCloud2, f'{SIM}/points', qos)
    markers = graph.collect(Marker, f'{SIM}/mesh', qos)
    odometry = graph.collect(Odometry, f'{SIM}/odometry', qos)
    graph.spin_until(lambda: len(clouds) > 3 and len(markers) > 3 and len(odometry) > 3)


@pytest.mark.oldest
def test_points_markers_and_rest_mesh_agree(graph):
    graph.sim_node(
        bodies=['one', 'two'], one__subdivisions=1, two__mesh='box', two__subdivisions=1,
        two__position=[2.0, 0.0, 1.0], frame_id='map', two__color=[0.0, 1.0, 0.0, 0.5],
    )  # fmt: skip
    paused(graph)
    step_to(graph, 130)  # both have hit the ground
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    markers = graph.collect(Marker, f'{SIM}/mesh')
    meshes = graph.collect(Mesh, f'{SIM}/rest_mesh', LATCHED)
    shown = {}

    def are_shown():
        shown.update((marker.ns, marker) for marker in markers)
        return len(shown) == 2

    graph.spin_until(lambda: clouds and meshes and are_shown())
    one, two = shown['one'], shown['two']
    points = records(clouds[-1])
    np.testing.assert_array_equal(points['body'], [0] * 42 + [1] * 26)
    assert points['displacement'].max() > 1e-3

    corners = [i for face in meshes[0].triangles for i in face.vertex_indices]
    assert len(meshes[0].vertices) == len(points)
    drawn = np.concatenate([[[p.x, p.y, p.z] for p in marker.points] for marker in (one, two)])
    expected = np.stack([points[axis][corners] for axis in 'xyz'], axis=1)
    np.testing.assert_array_equal(drawn.astype(np.float32), expected)

    for marker in (one, two):
        assert (marker.type, marker.action, marker.id) == (Marker.TRIANGLE_LIST, Marker.ADD, 0)
        assert (marker.header.frame_id, marker.pose.orientation.w) == ('map', 1.0)
        assert (marker.scale.x, marker.scale.y, marker.scale.z) == (1.0, 1.0, 1.0)
        assert stamp_of(marker) == stamp_of(clouds[-1])
    assert (two.color.r, two.color.g, two.color.b, two.color.a) == (0.0, 1.0, 0.0, 0.5)


def test_late_joiner_gets_the_rest_mesh_at_the_start_pose(graph):
    graph.sim_node(**SMALL, ball__position=[1.0, 2.0, 3.0])
    running = graph.collect(PointCloud2, f'{SIM}/points')
    graph.spin_until(lambda: len(running) > 5)
    meshes = graph.collect(Mesh, f'{SIM}/rest_mesh', LATCHED)
    graph.spin_until(lambda: meshes)
    vertices = np.array([[p.x, p.y, p.z] for p in meshes[0].vertices])
    assert (len(vertices), len(meshes[0].triangles)) == (42, 80)
    np.testing.assert_allclose(vertices.mean(axis=0), [1.0, 2.0, 3.0], atol=1e-12)


def test_late_joiner_sees_a_paused_body_at_once(graph):
    graph.sim_node(**SMALL)
    paused(graph)
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    markers = graph.collect(Marker, f'{SIM}/mesh')
    graph.spin_until(lambda: clouds and markers)


def test_who_leaves_makes_nobody_get_a_paused_body_again(graph):
    sim = graph.sim_node(**SMALL)
    paused(graph)
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    reports = graph.collect(DiagnosticArray, '/diagnostics')

    def settled():
        """Wait for two reports of the node: what it was to publish has come."""
        seen = len(reports)
        graph.spin_until(lambda: len(reports) > seen + 1)
        return len(clouds)

    graph.spin_until(lambda: clouds)
    before = settled()
    other = graph.node.create_subscription(PointCloud2, f'{SIM}/points', lambda _: None, 10)
    graph.spin_until(lambda: len(clouds) > before)
    before = settled()
    graph.node.destroy_subscription(other)
    graph.spin_until(lambda: sim._points.get_subscription_count() == 1)
    assert settled() == before


@pytest.mark.oldest
def test_odometry_is_the_pose_and_twist_of_a_spinning_throw(graph):
    turned = [0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4)]
    graph.sim_node(
        **SMALL, ball__orientation=turned, ball__initial_velocity__linear=[0.0, 2.0, 0.0],
        ball__initial_velocity__angular=[0.0, 0.0, 1.0], ball__mode='rigid',
        gravity__magnitude=0.0,
    )  # fmt: skip
    paused(graph)
    assert graph.call(Trigger, f'{SIM}/reset').success
    odometry = graph.collect(Odometry, f'{SIM}/odometry')
    graph.spin_until(lambda: odometry)
    message = odometry[-1]
    assert (message.header.frame_id, message.child_frame_id) == ('world', 'ball')
    pose, twist = message.pose.pose, message.twist.twist
    assert pose.position.z == pytest.approx(1.5)
    assert abs(pose.orientation.z) == pytest.approx(turned[2])
    assert twist.linear.x == pytest.approx(2.0)  # world +y is the body's own +x
    assert twist.linear.y == pytest.approx(0.0, abs=1e-9)
    assert twist.angular.z == pytest.approx(1.0)


def test_diagnostics_say_what_the_simulation_does(graph):
    graph.sim_node(**SMALL)
    reports = graph.collect(DiagnosticArray, '/diagnostics')
    # on a busy machine others come before it, of time that was dropped
    graph.spin_until(lambda: any(report.status[0].message == 'running' for report in reports[1:]))
    statuses = [report.status[0] for report in reports[1:]]
    status = next(status for status in statuses if status.message == 'running')
    values = {item.key: item.value for item in status.values}
    assert (status.name, status.level) == (SIM, DiagnosticStatus.OK)
    assert float(values['real-time factor']) > 0.0
    assert float(values['step time (ms)']) > 0.0
    assert float(values['dropped time (s)']) >= 0.0
    assert float(values['contact solver sweeps (1/tick)']) >= 0.0
    assert values['contact problems not solved to tolerance'] == '0'
    frequency = math.acos(1 - 0.5 / 2) * 120 / (2 * math.pi)
    assert float(values['ball frequency (Hz)']) == pytest.approx(frequency, rel=1e-3)
    assert re.fullmatch(
        r'13\.8 Hz, as 1\.14 kPa, as stiffness 0\.5; 1 kg, \d\.\d+ kg/m³', values['ball material']
    )
    assert float(values['ball damping ratio']) == pytest.approx(0.2155, abs=1e-3)


def test_rates_of_zero_switch_topics_off(graph):
    graph.sim_node(**SMALL, mesh_rate=0.0)
    markers = graph.collect(Marker, f'{SIM}/mesh')
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    graph.spin_until(lambda: len(clouds) > 5)
    del markers[:]
    seen = len(clouds)
    graph.spin_until(lambda: len(clouds) > seen + 30)
    assert not markers


# ---------------------------------------------------------------------------------------- services
def test_reset_is_bit_identical_to_a_fresh_start(graph):
    sim = graph.sim_node(ball__initial_velocity__angular=[1.0, 2.0, 3.0])
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    graph.spin_until(lambda: sim._world.tick > 150)
    paused(graph)
    assert graph.call(Trigger, f'{SIM}/reset').success
    step_to(graph, 200)
    graph.spin_until(lambda: stamp_of(clouds[-1]) == sim._stepper.time_of(200))

    fresh = World(sim._scene.world)
    fresh.step(200)
    fit = fresh.rigid_fit('ball')
    ball = fresh.positions('ball'), fit.displacement, fresh.pressure('ball'), 0.0
    expected = points_array([ball])
    assert bytes(clouds[-1].data) == expected.tobytes()


@pytest.mark.oldest
def test_points_say_what_has_become_permanent(graph):
    sim = graph.sim_node(ball__plasticity__creep=20.0, ball__plasticity__yield=0.02)
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    graph.spin_until(lambda: clouds)
    assert not records(clouds[0])['permanent_strain'].any()
    graph.spin_until(lambda: records(clouds[-1])['permanent_strain'].min() > 0.01)
    paused(graph)
    graph.spin_until(lambda: stamp_of(clouds[-1]) == sim._stamp())
    expected = np.float32(sim._world.permanent_strain('ball'))
    assert set(records(clouds[-1])['permanent_strain']) == {expected}


def test_step_needs_pause_and_counts_ticks(graph):
    sim = graph.sim_node(**SMALL)
    answer = graph.call(Trigger, f'{SIM}/step')
    assert not answer.success
    assert 'pause' in answer.message
    paused(graph)
    tick = sim._world.tick
    step_to(graph, 7)
    assert sim._world.tick == tick + 7
    assert graph.call(SetBool, f'{SIM}/pause', data=False).success
    graph.spin_until(lambda: sim._world.tick > tick + 50)


def test_apply_initial_velocity_keeps_the_shape(graph):
    sim = graph.sim_node(**SMALL)
    paused(graph)
    step_to(graph, 120)
    before = sim._world.positions('ball')
    assert graph.set_parameter(SIM, 'ball.initial_velocity.linear', [0.0, 0.0, 3.0]).successful
    assert graph.call(Trigger, f'{SIM}/apply_initial_velocity').success
    np.testing.assert_array_equal(sim._world.positions('ball'), before)
    np.testing.assert_array_equal(sim._world.velocities('ball'), [[0.0, 0.0, 3.0]] * 42)


def test_failure_stops_with_the_last_good_state_until_reset(graph):
    sim = graph.sim_node(**SMALL)
    graph.spin_until(lambda: sim._world.tick > 5)
    sim._world.set_state('ball', velocities=np.full((42, 3), 1e300))
    reports = graph.collect(DiagnosticArray, '/diagnostics')
    graph.spin_until(lambda: any(r.status[0].level == DiagnosticStatus.ERROR for r in reports))
    assert np.isfinite(sim._world.positions('ball')).all()
    assert not graph.call(SetBool, f'{SIM}/pause', data=False).success
    tick = sim._world.tick
    sim._world.set_state('ball', velocities=np.zeros((42, 3)))
    answer = graph.call(Trigger, f'{SIM}/step')
    assert not answer.success and answer.message.endswith('call ~/reset')
    assert sim._world.tick == tick
    assert graph.call(Trigger, f'{SIM}/reset').success
    graph.spin_until(lambda: sim._world.tick > 5)  # it ran before, so it runs
    paused(graph)
    sim._world.set_state('ball', velocities=np.full((42, 3), 1e300))
    answer = graph.call(Trigger, f'{SIM}/step')
    assert not answer.success and '0 of 1 steps' in answer.message
    assert graph.call(Trigger, f'{SIM}/reset').success
    assert sim._stepper.paused  # it was paused before


# -------------------------------------------------------------------------------------- parameters
CHANGED = {
    bool: lambda facts: not facts.default,
    int: lambda facts: facts.default + 1,
    float: lambda facts: facts.default * 0.5 + 0.01,
    str: lambda facts: facts.choices[0] if facts.choices else 'other',
    tuple: lambda facts: [0.5] * len(facts.default) or [0, 3],
}
INSIDE = [-1.0, -1.0, 0.0, 1.0, 1.0, 1.0]
"""A box with some vertices: pins.box refuses one without."""


def wrong_values(facts):
    """Return values that must be refused: out of range, of the wrong type, not finite."""
    if isinstance(facts.default, str):
        return ['nonsense', 1.5]
    if isinstance(facts.default, tuple):
        if facts.items is int:
            return [[0.5], [-2], [10**9], [math.nan], 'text', 0.5, 3]
        if facts.items is str:
            return [[0.5], [3], 'text', 0.5, 3]
        length = len(facts.default)
        return [[math.nan] * length, [0.5] * (length + 1), [1e9] * length, 'text', 0.5]
    if isinstance(facts.default, int):
        return [0, -1, 1.5, 'text']
    return [facts.minimum - 1.0, 1e13, math.nan, math.inf, 'text', [0.5]]


@pytest.mark.oldest
def test_every_parameter_at_run_time(graph):
    sim = graph.sim_node(**SMALL)
    paused(graph)
    for name, facts in TABLE.items():
        if facts.read_only:
            result = graph.set_parameter(SIM, name, parameters.as_parameter(facts.default, facts))
            assert not result.successful and 'read-only' in result.reason, name
            continue
        before = sim.get_parameter(name).value
        for value in wrong_values(facts):
            result = graph.set_parameter(SIM, name, value)
            assert not result.successful, (name, value)
            assert len(result.reason) > 10, (name, value)
            assert sim.get_parameter(name).value == before, (name, value)
        good = INSIDE if name == 'ball.pins.box' else CHANGED[type(facts.default)](facts)
        good = '' if name == 'ball.attach.to' else good  # pins hold it already
        good = [*facts.default, f'other_{name.split(".")[-1]}'] if facts.items is str else good
        result = graph.set_parameter(SIM, name, good)
        assert result.successful, (name, result.reason)
        (value,) = graph.get_parameters(SIM, [name])
        is_text = isinstance(good, str) or facts.items is str
        assert value == good if is_text else value == pytest.approx(good)
    # all of it has reached the core
    world = parameters.make_scene({n: sim.get_parameter(n).value for n in TABLE}).world
    assert sim._world.config == world
    assert world != parameters.make_scene({}).world


@pytest.mark.oldest
@pytest.mark.parametrize(
    ('name', 'value', 'sentence'),
    [
        (
            'ball.pins.indices',
            [0, 42],
            'ball.pins.indices has 42: the mesh has the vertices 0 to 41',
        ),
        ('ball.pins.box', [2.0, 2.0, 2.0, 3.0, 3.0, 3.0], 'no vertex is inside'),
    ],
)
def test_pins_that_no_vertex_fits_are_refused(graph, name, value, sentence):
    sim = graph.sim_node(**SMALL)
    result = graph.set_parameter(SIM, name, value)
    assert not result.successful
    assert sentence in result.reason
    assert sim._world.config == parameters.make_scene(sim._parameters_of_scene.values).world


def test_pins_hold_and_let_go(graph):
    sim = graph.sim_node(**SMALL)
    paused(graph)
    assert graph.set_parameter(SIM, 'ball.pins.indices', [0, 5]).successful
    before = sim._world.positions('ball')
    step_to(graph, 60)
    held = sim._world.positions('ball')
    np.testing.assert_array_equal(held[[0, 5]], before[[0, 5]])
    assert graph.set_parameter(SIM, 'ball.pins.indices', [-1]).successful
    step_to(graph, 120)
    assert (sim._world.positions('ball')[:, 2] < held[:, 2] - 0.2).all()


@pytest.mark.oldest
@pytest.mark.parametrize(
    ('name', 'value', 'expected'),
    [('ball.mass', 2, 2.0), ('ball.position', [0, 0, 3], [0.0, 0.0, 3.0]), ('time_scale', 2, 2.0)],
)
def test_integers_are_taken_for_doubles(graph, name, value, expected):
    sim = graph.sim_node(**SMALL)
    assert graph.set_parameter(SIM, name, value).successful
    assert sim.get_parameter(name).value == expected


@pytest.mark.oldest
def test_integers_are_taken_for_doubles_at_start(graph):
    sim = graph.sim_node(**SMALL, ball__mass=3, gravity__direction=[0, 0, -2], bodies=['ball'])
    assert sim.get_parameter('ball.mass').value == 3.0
    np.testing.assert_allclose(sim._world.config.gravity, [0.0, 0.0, -9.81])


def test_refusals_across_parameters_name_the_remedy(graph):
    graph.sim_node(**SMALL)
    assert graph.set_parameter(SIM, 'ball.friction_model', 'viscous').successful
    result = graph.set_parameter(SIM, 'ball.friction', 3.0)
    assert not result.successful
    assert 'coulomb' in result.reason
    assert graph.set_parameter(SIM, 'ball.friction_model', 'coulomb').successful
    assert graph.set_parameter(SIM, 'ball.friction', 3.0).successful
    assert not graph.set_parameter(SIM, 'ball.friction_model', 'viscous').successful


def test_a_change_of_parameters_moves_nothing(graph):
    sim = graph.sim_node(**SMALL)
    paused(graph)
    step_to(graph, 115)
    positions, velocities = sim._world.positions('ball'), sim._world.velocities('ball')
    for name, value in [
        ('ball.mode', 'linear'), ('ball.stiffness', 0.1), ('ball.deformation', 0.9),
        ('ball.mass', 5.0), ('ball.bounciness', 1.0), ('ball.volume_conservation', 0.0),
        ('gravity.magnitude', 1.0), ('ball.position', [5.0, 5.0, 5.0]),
    ]:  # fmt: skip
        assert graph.set_parameter(SIM, name, value).successful
    np.testing.assert_array_equal(sim._world.positions('ball'), positions)
    np.testing.assert_array_equal(sim._world.velocities('ball'), velocities)


def test_gravity_and_obstacles_change_live(graph):
    sim = graph.sim_node(**SMALL)
    assert graph.set_parameter(SIM, 'gravity.direction', [0.0, 0.0, 1.0]).successful
    graph.spin_until(lambda: sim._world.positions('ball')[:, 2].min() > 1.5, 'the ball to rise')
    assert graph.set_parameter(SIM, 'ground.position', [0.0, 0.0, 10.0]).successful
    graph.spin_until(lambda: sim._world.positions('ball')[:, 2].min() >= 10.0)


@pytest.mark.oldest
def test_descriptors_reach_the_tools(graph):
    graph.sim_node(**SMALL)
    mass, mode = graph.describe_parameters(SIM, ['ball.mass', 'ball.mode'])
    assert '[kg]' in mass.description
    assert mass.floating_point_range[0].to_value == 1e6
    assert mode.additional_constraints == 'rigid | linear | quadratic'


def test_declared_parameters_are_the_table(graph):
    graph.sim_node(**SMALL)
    foreign = {'use_sim_time', 'start_type_description_service'}
    declared = {n for n in graph.list_parameters(SIM) if not n.startswith('qos_overrides')}
    assert declared - foreign == set(TABLE)


# ------------------------------------------------------------------------------------------- clock
def test_ticks_and_stamps_follow_clock(graph):
    sim = graph.sim_node(**SMALL, use_sim_time=True)
    clock = ClockSource(graph, sim)
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    clock.show(100 * SECOND)
    graph.spin_until(lambda: clouds)
    assert (sim._world.tick, stamp_of(clouds[0])) == (0, 100_000_000_000)
    clock.show(100.25 * SECOND)
    graph.spin_until(lambda: sim._world.tick == 60)
    graph.spin_until(lambda: stamp_of(clouds[-1]) == 100_250_000_000)
    # the clock pauses: so does the body
    seen = len(clouds)
    reports = graph.collect(DiagnosticArray, '/diagnostics')
    graph.spin_until(lambda: reports)
    assert (sim._world.tick, len(clouds)) == (60, seen)


def test_forward_jump_is_simulated_through(graph):
    sim = graph.sim_node(**SMALL, use_sim_time=True)
    clock = ClockSource(graph, sim)
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    clock.show(5 * SECOND)
    graph.spin_until(lambda: clouds)
    clock.show(25 * SECOND)
    graph.spin_until(lambda: sim._world.tick == 20 * 240)
    graph.spin_until(lambda: stamp_of(clouds[-1]) == 25_000_000_000)
    fresh = World(sim._scene.world)
    fresh.step(20 * 240)
    assert fresh.positions('ball').tobytes() == sim._world.positions('ball').tobytes()


def test_backward_jump_shows_the_earlier_state_again(graph):
    sim = graph.sim_node(**SMALL, use_sim_time=True)
    clock = ClockSource(graph, sim)
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    clock.show(10 * SECOND)
    graph.spin_until(lambda: clouds)
    clock.show(10.5 * SECOND)
    graph.spin_until(lambda: clouds and stamp_of(clouds[-1]) == 10_500_000_000)
    first = bytes(clouds[-1].data)
    clock.show(11 * SECOND)
    graph.spin_until(lambda: stamp_of(clouds[-1]) == 11_000_000_000)
    clock.show(10.5 * SECOND)
    graph.spin_until(lambda: stamp_of(clouds[-1]) == 10_500_000_000)
    assert bytes(clouds[-1].data) == first
    clock.show(2 * SECOND)  # before the start: the initial state
    graph.spin_until(lambda: sim._world.tick == 0)


def test_without_clock_nothing_moves_and_diagnostics_warn(graph):
    sim = graph.sim_node(**SMALL, use_sim_time=True)
    reports = graph.collect(DiagnosticArray, '/diagnostics')
    graph.spin_until(lambda: reports)
    assert reports[0].status[0].message == 'waiting for /clock'
    assert reports[0].status[0].level == DiagnosticStatus.WARN
    assert graph.call(Trigger, f'{SIM}/reset').success
    assert graph.call(SetBool, f'{SIM}/pause', data=True).success
    assert graph.call(SetBool, f'{SIM}/pause', data=False).success
    assert sim._world.tick == 0
    clock = ClockSource(graph, sim)
    clock.show(1000 * SECOND)
    graph.spin_until(lambda: sim._stepper.started)
    clock.show(1000.5 * SECOND)
    graph.spin_until(lambda: sim._world.tick == 120)


def test_clock_source_can_be_switched_at_run_time(graph):
    sim = graph.sim_node(**SMALL)
    graph.spin_until(lambda: sim._world.tick > 20)
    assert graph.set_parameter(SIM, 'use_sim_time', True).successful
    clock = ClockSource(graph, sim)
    clock.show(50 * SECOND)
    graph.spin_until(lambda: sim._stepper.time_of(sim._world.tick) == 50_000_000_000)
    tick = sim._world.tick
    clock.show(50.5 * SECOND)
    graph.spin_until(lambda: sim._world.tick == tick + 120)
    assert sim._stepper.time_of(tick + 120) == 50_500_000_000
    assert graph.set_parameter(SIM, 'use_sim_time', False).successful
    graph.spin_until(lambda: sim._world.tick > tick + 150)


def step_client(graph):
    """Return a client of ~/step, to call it without waiting."""
    client = graph.node.create_client(Trigger, f'{SIM}/step')
    graph.spin_until(client.service_is_ready)
    return client


def test_the_node_answers_while_it_takes_many_steps(graph):
    sim = graph.sim_node(**SMALL, step_count=1_000_000)
    paused(graph)
    client = step_client(graph)
    future = client.call_async(Trigger.Request())
    graph.spin_until(lambda: sim._world.tick > 10)
    assert graph.set_parameter(SIM, 'step_count', 3).successful
    assert not future.done()
    assert graph.call(Trigger, f'{SIM}/reset').success
    graph.spin_until(future.done)
    assert sim._world.tick == 0
    assert not future.result().success
    assert re.fullmatch(
        r'\d+ of 1000000 steps were taken, to tick \d+: the simulation was reset; step again',
        future.result().message,
    )
    answer = graph.call(Trigger, f'{SIM}/step')
    assert answer.message == 'now at tick 3'


@pytest.mark.parametrize('end', ['reset', 'pause'])
def test_steps_that_end_before_the_first_are_answered_too(graph, end):
    sim = graph.sim_node(**SMALL)
    paused(graph)
    client = step_client(graph)
    (timer,) = (timer for timer in sim.timers if timer.timer_period_ns < SECOND)
    timer.cancel()  # else the step may be taken first
    tick, future = sim._world.tick, client.call_async(Trigger.Request())
    graph.spin_until(lambda: sim._stepper.stepping)
    if end == 'reset':
        assert graph.call(Trigger, f'{SIM}/reset').success
    else:
        assert graph.call(SetBool, f'{SIM}/pause', data=False).success
    timer.reset()
    graph.spin_until(future.done)
    assert not future.result().success
    assert f'0 of 1 steps were taken, to tick {tick}: ' in future.result().message


def test_calls_of_step_add_up_to_a_limit(graph):
    sim = graph.sim_node(**SMALL, step_count=600_000)
    paused(graph)
    client = step_client(graph)
    first = client.call_async(Trigger.Request())
    graph.spin_until(lambda: sim._stepper.stepping)
    answer = graph.call(Trigger, f'{SIM}/step')
    assert not answer.success
    assert 'are still to be taken, and 600000 more would be above 1000000' in answer.message
    assert graph.call(Trigger, f'{SIM}/reset').success
    graph.spin_until(first.done)
    assert graph.set_parameter(SIM, 'step_count', 1).successful
    futures = [client.call_async(Trigger.Request()) for _ in range(3)]
    graph.spin_until(lambda: all(future.done() for future in futures))
    assert all(future.result().success for future in futures)
    assert sim._world.tick == 3


# ------------------------------------------------------------------------------------------- graph
def test_standard_services_are_offered_where_their_package_is_installed(graph):
    graph.sim_node(**SMALL)

    def names():
        return {name for name, _ in graph.node.get_service_names_and_types()}

    graph.spin_until(lambda: f'{SIM}/step' in names())  # it is created just before them
    services = names()
    offered = {name for name in FEATURES if f'{SIM}/{name}' in services}
    assert offered == set(simulation_interfaces_node.interfaces(graph.node))


def test_two_nodes_in_two_namespaces_do_not_meet(graph):
    left = graph.sim_node(namespace='/left', **SMALL)
    right = graph.sim_node(namespace='/right', **SMALL, ball__position=[0.0, 0.0, 9.0])
    clouds = graph.collect(PointCloud2, '/right/softbody_sim/points')
    graph.spin_until(lambda: len(clouds) > 3)
    assert records(clouds[0])['z'].mean() > 8.0
    assert graph.call(SetBool, '/left/softbody_sim/pause', data=True).success
    assert left._stepper.paused and not right._stepper.paused
    assert graph.set_parameter('/right/softbody_sim', 'ball.mass', 4.0).successful
    assert left.get_parameter('ball.mass').value == 1.0


def test_unknown_parameters_of_a_body_are_refused_and_others_reported(graph):
    from softbody_ros.core import ConfigError

    with pytest.raises(ConfigError, match=r'unknown parameter ball\.mas: did you mean ball\.mass'):
        graph.sim_node(ball__mas=1.0)
    graph.sim_node(**SMALL, somebody__elses=1.0)


def test_nothing_is_packed_without_subscribers(graph, monkeypatch):
    from softbody_ros.ros import messages

    packed = []
    for where, name in [
        (messages, 'serialized_cloud'),
        (messages, 'serialized_marker'),
        (messages, 'odometry'),
        (World, 'contact_wrench'),
    ]:
        original = getattr(where, name)
        monkeypatch.setattr(
            where, name, lambda *a, _f=original, _n=name: packed.append(_n) or _f(*a)
        )
    sim = graph.sim_node(**SMALL, ball__position=[0.0, 0.0, 0.5])
    graph.spin_until(lambda: sim._world.tick > 60)
    assert not packed
    graph.collect(Odometry, f'{SIM}/odometry')
    graph.spin_until(lambda: packed)
    assert set(packed) == {'odometry'}
    contacts = graph.collect(WrenchStamped, f'{SIM}/contacts/ball')
    graph.spin_until(lambda: contacts)
    assert set(packed) == {'odometry', 'contact_wrench'}


def test_an_empty_list_of_obstacles_lets_the_ball_fall_on(graph):
    sim = graph.sim_node(**SMALL, obstacles=[''], ball__initial_velocity__linear=[0.0, 0.0, -20.0])
    graph.spin_until(lambda: sim._world.positions('ball')[:, 2].max() < -1.0)
    assert Parameter('obstacles', value=['']).value == sim.get_parameter('obstacles').value
