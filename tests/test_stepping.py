# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Ticks follow a clock: same state and same outputs at the same ticks, however it is polled."""

import numpy as np
import pytest

from softbody_ros.core import BodyConfig, SimulationError, World, WorldConfig
from softbody_ros.timeline.stepper import CATCH_UP, LARGEST_LAG, SLICE, Stepper

START = 1_700_000_000_000_000_000
SECOND = 1_000_000_000
RATES = {'points': 60.0, 'mesh': 30.0}


class Stopwatch:
    """Time that passes only when told, so that no test depends on the machine."""

    def __init__(self, per_look=0.0):
        self.seconds, self.per_look = 0.0, per_look

    def __call__(self):
        self.seconds += self.per_look
        return self.seconds


def make_stepper(per_look=0.0, rates=RATES):
    world = World(WorldConfig(bodies=(BodyConfig(name='ball', subdivisions=1),)))
    return Stepper(world, rates, Stopwatch(per_look))


def outputs(stepper, now, drop_overload=False):
    return [(stepper.world.tick, sorted(due)) for due in stepper.advance(now, drop_overload)]


def state(stepper):
    return stepper.world.positions('ball').tobytes()


def test_first_state_is_an_output_and_its_time_is_the_start():
    stepper = make_stepper()
    assert outputs(stepper, START) == [(0, ['mesh', 'points'])]
    assert stepper.time_of(0) == START


def test_ticks_follow_the_clock_exactly():
    stepper = make_stepper()
    outputs(stepper, START)
    for tick in (1, 2, 7, 100):
        due = stepper.time_of(tick)
        outputs(stepper, due - 1)
        assert stepper.world.tick == tick - 1
        outputs(stepper, due)
        assert stepper.world.tick == tick


@pytest.mark.parametrize('seed', range(3))
def test_outputs_do_not_depend_on_when_the_clock_is_looked_at(seed):
    def run(times):
        stepper, log = make_stepper(), []
        for now in times:
            for due in stepper.advance(now, drop_overload=False):
                tick = stepper.world.tick
                log.append((tick, due, stepper.time_of(tick), state(stepper)))
        return log

    end = START + SECOND
    irregular = np.sort(np.random.default_rng(seed).integers(START, end, 150)).tolist()
    regular = range(START, end + 1, SECOND // 240)
    bursts = [START] + [START + k * SECOND // 10 for k in range(1, 11) for _ in range(3)]
    expected = run([*regular, end])
    assert run([START, *irregular, end]) == expected
    assert run(bursts) == expected
    assert len(expected) == 61


def test_rates_count_in_the_time_of_the_clock():
    stepper = make_stepper()
    stepper.set_time_scale(0.1, START)
    count = sum(len(outputs(stepper, START + k * SECOND // 100)) for k in range(101))
    assert stepper.world.tick == 24
    assert count == 1 + 24  # 60 Hz of the clock would be more than there are ticks

    stepper = make_stepper(rates={'points': 60.0})
    stepper.set_time_scale(10.0, START)
    count = sum(len(outputs(stepper, START + k * SECOND // 100)) for k in range(101))
    assert stepper.world.tick == 2400
    assert count == 1 + 60


def test_rate_zero_is_off_but_for_states_that_are_shown_at_once():
    stepper = make_stepper(rates={'points': 0.0})
    outputs(stepper, START)
    assert outputs(stepper, START + SECOND // 4) == []


def test_time_scale_zero_freezes_without_a_jump_afterwards():
    stepper = make_stepper()
    outputs(stepper, START)
    outputs(stepper, START + SECOND // 10)
    stepper.set_time_scale(0.0, START + SECOND // 10)
    outputs(stepper, START + 5 * SECOND)
    assert stepper.world.tick == 24
    stepper.set_time_scale(1.0, START + 5 * SECOND)
    outputs(stepper, START + 5 * SECOND + SECOND // 10)
    assert stepper.world.tick == 48


def test_pause_holds_the_state_and_resume_does_not_catch_up():
    stepper = make_stepper()
    outputs(stepper, START)
    outputs(stepper, START + SECOND // 4)
    stepper.pause(True, START + SECOND // 4)
    before = state(stepper)
    assert outputs(stepper, START + 100 * SECOND) == [(60, ['mesh', 'points'])]
    assert state(stepper) == before
    assert stepper.lag(START + 100 * SECOND) == 0.0
    stepper.pause(False, START + 100 * SECOND)
    outputs(stepper, START + 100 * SECOND + SECOND // 4)
    assert stepper.world.tick == 120


def test_single_steps_reach_the_state_of_running_through():
    running, stepping = make_stepper(), make_stepper()
    outputs(running, START)
    outputs(running, START + SECOND // 8)
    outputs(stepping, START)
    stepping.pause(True, START)
    for _ in range(10):
        stepping.single_step(3)
        stepping.take_steps(START)
    assert stepping.world.tick == running.world.tick == 30
    assert state(stepping) == state(running)


def test_many_steps_are_taken_in_slices():
    stepper = make_stepper(per_look=SLICE / 10)
    outputs(stepper, START)
    stepper.pause(True, START)
    stepper.single_step(100)
    ticks = []
    while stepper.stepping:
        stepper.take_steps(START)
        ticks.append(stepper.world.tick)
    assert len(ticks) > 10
    assert ticks[-1] == 100
    assert outputs(stepper, START) == [(100, ['mesh', 'points'])]


@pytest.mark.parametrize('end', ['pause', 'reset'])
def test_steps_end_when_the_simulation_goes_on_or_begins_anew(end):
    stepper = make_stepper(per_look=SLICE / 10)
    outputs(stepper, START)
    stepper.pause(True, START)
    first, second = stepper.single_step(1000), stepper.single_step(2)
    stepper.take_steps(START)
    assert stepper.stepping
    tick = stepper.world.tick
    if end == 'pause':
        stepper.pause(False, START)
    else:
        stepper.reset(START)
    assert not stepper.stepping
    assert not first.waits and not second.waits
    assert f'{tick} of 1000 steps were taken, to tick {tick}: ' in first.failure
    assert '0 of 2 steps' in second.failure and 'step again' in second.failure


def test_requests_of_steps_add_up_and_each_ends_with_its_own():
    stepper = make_stepper(per_look=SLICE / 10)
    outputs(stepper, START)
    stepper.pause(True, START)
    requests = [stepper.single_step(ticks) for ticks in (2, 30, 1)]
    assert stepper.steps_left == 33
    stepper.take_steps(START)
    assert [request.waits for request in requests] == [False, True, True]
    while stepper.stepping:
        stepper.take_steps(START)
    assert stepper.world.tick == 33
    assert [(request.left, request.failure) for request in requests] == [(0, '')] * 3


def test_a_step_that_fails_ends_all_requests():
    stepper = make_stepper()
    outputs(stepper, START)
    stepper.pause(True, START)
    stepper.world.set_state('ball', velocities=np.full((42, 3), 1e300))
    requests = [stepper.single_step(ticks) for ticks in (5, 1)]
    with pytest.raises(SimulationError) as error:
        stepper.take_steps(START)
    assert not stepper.stepping
    for request in requests:
        assert not request.waits and str(error.value) in request.failure


def test_reset_starts_again_at_tick_zero():
    stepper = make_stepper()
    outputs(stepper, START)
    first = state(stepper)
    outputs(stepper, START + SECOND // 2)
    stepper.reset(START + SECOND)
    assert outputs(stepper, START + SECOND) == [(0, ['mesh', 'points'])]
    assert state(stepper) == first
    assert stepper.time_of(0) == START + SECOND


def test_rewind_simulates_up_to_the_earlier_time_again():
    stepper = make_stepper()
    outputs(stepper, START)
    outputs(stepper, START + SECOND // 4)
    earlier = state(stepper)
    outputs(stepper, START + SECOND // 2)
    stepper.rewind(START + SECOND // 4)
    outputs(stepper, START + SECOND // 4)
    assert (stepper.world.tick, state(stepper)) == (60, earlier)
    stepper.rewind(START - SECOND)
    assert outputs(stepper, START - SECOND) == [(0, ['mesh', 'points'])]
    assert outputs(stepper, START - 1) == []


def test_overload_on_wall_time_is_dropped_and_counted():
    stepper = make_stepper(per_look=SLICE / 4)
    outputs(stepper, START, drop_overload=True)
    outputs(stepper, START + SECOND, drop_overload=True)
    done = stepper.world.tick
    assert 0 < done < 240
    assert stepper.dropped == pytest.approx(1 - done / 240)
    assert stepper.lag(START + SECOND) <= LARGEST_LAG
    assert stepper.busy > 0.0


def test_after_an_overload_the_rate_recovers():
    stepper = make_stepper(per_look=SLICE / 4)
    outputs(stepper, START, drop_overload=True)
    outputs(stepper, START + SECOND, drop_overload=True)
    dropped, tick = stepper.dropped, stepper.world.tick
    stepper._stopwatch.per_look = 0.0
    for k in range(1, 241):
        outputs(stepper, START + SECOND + k * SECOND // 240, drop_overload=True)
    assert stepper.dropped == dropped
    assert stepper.world.tick - tick >= 240


@pytest.mark.parametrize('scale', [0.1, 1.0, 10.0])
def test_wall_time_and_clock_give_the_same_bits_at_the_same_ticks(scale):
    def run(drop_overload, times):
        stepper, log = make_stepper(), {}
        stepper.set_time_scale(scale, START)
        for now in times:
            for _ in stepper.advance(now, drop_overload):
                log[stepper.world.tick] = state(stepper)
        return log

    end = START + round(SECOND / scale)
    wall = run(True, range(START, end + 1, (end - START) // 480))
    clock = run(False, np.linspace(START, end, 11).astype(np.int64).tolist())
    common = wall.keys() & clock.keys()
    assert len(common) > 5
    assert max(common) >= 190
    assert all(wall[tick] == clock[tick] for tick in common)


def test_overload_on_clock_time_is_worked_off_in_slices_with_progress():
    stepper = make_stepper(per_look=SLICE / 20)
    outputs(stepper, START)
    now = START + int(2 * CATCH_UP * SECOND)
    slices = []
    while stepper.world.tick < 240:
        slices.append(outputs(stepper, now))
        assert stepper.dropped == 0.0
    assert len(slices) > 5
    behind = [rows for rows in slices if rows and rows[-1][0] < 120]
    assert all(len(rows) == 1 for rows in behind)  # one state per slice, not one per frame
    assert slices[-1][-1][0] == 240


def test_new_clock_continues_from_the_current_tick():
    stepper = make_stepper()
    outputs(stepper, START)
    outputs(stepper, START + SECOND // 4)
    stepper.switch_clock(7 * SECOND)
    outputs(stepper, 7 * SECOND + SECOND // 4)
    assert stepper.world.tick == 120
    assert stepper.time_of(120) == 7 * SECOND + SECOND // 4
