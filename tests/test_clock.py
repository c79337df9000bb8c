# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The node on /clock: whatever comes, the same bits at the same ticks."""

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2
from simulated_clock import SECOND, ClockSource
from std_srvs.srv import SetBool, Trigger

from softbody_ros.core import World
from softbody_ros.ros.messages import POINT_TYPE
from softbody_ros.scene import parameters

SIM = '/softbody_sim'
SMALL = {'ball__subdivisions': 1}
MILLISECOND = 1_000_000
BEGIN = 7 * SECOND
"""Time of the clock at the first tick."""


def stamp_of(message):
    return message.header.stamp.sec * SECOND + message.header.stamp.nanosec


def collected_points(cloud):
    """Return the positions (n, 3) float32 of a cloud."""
    records = np.frombuffer(cloud.data, POINT_TYPE)
    return np.stack([records[axis] for axis in 'xyz'], axis=1)


def times(pattern, end=BEGIN + SECOND):
    """Return times of the clock from BEGIN to the end, in ns."""
    random = np.random.default_rng(3)
    if pattern == '10 Hz':
        return [*range(BEGIN, end + 1, 100 * MILLISECOND)]
    if pattern == '1 kHz':
        return [*range(BEGIN, end + 1, MILLISECOND)]
    if pattern == 'irregular':
        return [BEGIN, *np.sort(random.integers(BEGIN, end, 60)).tolist(), end]
    if pattern == 'duplicated':
        return [time for time in times('10 Hz', end) for _ in range(3)]
    return [BEGIN, end]  # one jump


@pytest.fixture(scope='module')
def expected():
    """Return the state of the core at each tick."""
    world = World(parameters.make_scene({'ball.subdivisions': 1}).world)
    states = []
    for _ in range(241):
        states.append(world.positions('ball').astype(np.float32).tobytes())
        world.step()
    return states


@pytest.mark.parametrize('pattern', ['10 Hz', '1 kHz', 'irregular', 'duplicated', 'one jump'])
def test_clouds_depend_on_their_tick_only(graph, expected, pattern):
    sim = graph.sim_node(**SMALL, use_sim_time=True)
    ticker = ClockSource(graph, sim)
    clouds = graph.collect(PointCloud2, f'{SIM}/points', 1000)
    for time in times(pattern):
        ticker.show(time)
        ticker.settle()
    graph.spin_until(lambda: clouds and stamp_of(clouds[-1]) == BEGIN + SECOND)
    assert clouds
    for cloud in clouds:
        tick = round((stamp_of(cloud) - BEGIN) * 240 / SECOND)
        assert stamp_of(cloud) == BEGIN + round(tick * SECOND / 240)
        assert collected_points(cloud).tobytes() == expected[tick], tick
    if pattern != 'one jump':
        assert len(clouds) >= 61  # 60 Hz: every due state, however the clock came


def test_a_burst_of_clock_messages_is_as_good_as_the_last_of_them(graph, expected):
    sim = graph.sim_node(**SMALL, use_sim_time=True)
    ticker = ClockSource(graph, sim)
    ticker.show(BEGIN)
    ticker.settle()
    for time in times('1 kHz'):
        ticker.send(time)
    graph.spin_until(lambda: sim.get_clock().now().nanoseconds == BEGIN + SECOND)
    ticker.settle()
    assert sim._world.positions('ball').astype(np.float32).tobytes() == expected[240]


def test_scrubbing_shows_at_each_time_what_was_shown_first(graph, expected):
    sim = graph.sim_node(**SMALL, use_sim_time=True)
    ticker = ClockSource(graph, sim)
    clouds = graph.collect(PointCloud2, f'{SIM}/points', 1000)
    ticker.show(BEGIN)
    random = np.random.default_rng(5)
    for time in random.integers(BEGIN, BEGIN + SECOND, 25).tolist():
        ticker.show(time)
        ticker.settle()
        stamp = sim._stepper.time_of(sim._world.tick)
        assert stamp <= time < stamp + SECOND // 240 + 1
    graph.spin_until(lambda: len(clouds) > 25)
    for cloud in clouds:
        tick = round((stamp_of(cloud) - BEGIN) * 240 / SECOND)
        assert collected_points(cloud).tobytes() == expected[tick], tick


def test_services_are_answered_in_the_middle_of_a_long_jump(graph):
    sim = graph.sim_node(**SMALL, use_sim_time=True)
    ticker = ClockSource(graph, sim)
    ticker.show(BEGIN)
    ticker.settle()
    ticker.send(BEGIN + 10_000 * SECOND)
    graph.spin_until(lambda: sim._world.tick > 0)
    assert graph.set_parameter(SIM, 'ball.stiffness', 0.9).successful
    assert graph.call(SetBool, f'{SIM}/pause', data=True).success
    assert sim._world.tick < 10_000 * 240
    assert graph.call(Trigger, f'{SIM}/reset').success
    assert (sim._world.tick, sim._stepper.paused) == (0, True)


@pytest.mark.parametrize('use_sim_time', [False, True])
def test_pause_step_and_reset_do_the_same_under_both_drivers(graph, expected, use_sim_time):
    sim = graph.sim_node(**SMALL, use_sim_time=use_sim_time, step_count=30)
    if use_sim_time:
        ticker = ClockSource(graph, sim)
        ticker.show(BEGIN)
        ticker.show(BEGIN + SECOND // 3)
    graph.spin_until(lambda: sim._world.tick > 20)
    assert graph.call(SetBool, f'{SIM}/pause', data=True).success
    assert graph.call(Trigger, f'{SIM}/reset').success
    assert graph.call(Trigger, f'{SIM}/reset').success
    assert sim._world.tick == 0
    for count in range(1, 4):
        answer = graph.call(Trigger, f'{SIM}/step')
        assert answer.success
        assert answer.message == f'now at tick {30 * count}'
        state = sim._world.positions('ball').astype(np.float32).tobytes()
        assert state == expected[30 * count]
    assert graph.call(SetBool, f'{SIM}/pause', data=False).success
    if use_sim_time:
        ticker.show(BEGIN + SECOND)
    graph.spin_until(lambda: sim._world.tick > 91)


def test_a_clock_that_stands_still_lets_the_bodies_stand_still(graph):
    sim = graph.sim_node(**SMALL, use_sim_time=True)
    ticker = ClockSource(graph, sim)
    ticker.show(BEGIN)
    ticker.show(BEGIN + SECOND // 4)
    ticker.settle()
    before = sim._world.positions('ball')
    for _ in range(50):
        ticker.show(BEGIN + SECOND // 4)
    assert np.array_equal(sim._world.positions('ball'), before)
    ticker.show(BEGIN + 60 * SECOND)  # … and when it goes on, so do they, through all of it
    ticker.settle()
    assert sim._world.tick == 60 * 240


def test_services_before_the_first_clock_take_effect_when_it_comes(graph, expected):
    sim = graph.sim_node(**SMALL, use_sim_time=True)
    assert graph.call(Trigger, f'{SIM}/apply_initial_velocity').success
    assert graph.call(SetBool, f'{SIM}/pause', data=True).success
    assert graph.call(Trigger, f'{SIM}/step').success
    assert graph.call(Trigger, f'{SIM}/reset').success
    assert graph.call(SetBool, f'{SIM}/pause', data=False).success
    ticker = ClockSource(graph, sim)
    ticker.show(BEGIN)
    ticker.show(BEGIN + SECOND // 2)
    ticker.settle()
    assert sim._world.positions('ball').astype(np.float32).tobytes() == expected[120]
