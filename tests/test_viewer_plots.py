# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Curves of a body in the viewer: what was when, without a browser."""

import numpy as np
import pytest

from softbody_ros.viewer.plots import FINEST, SPAN, Track

SECOND = 1_000_000_000


def track(times, **options):
    """Return the curves of a body that rises by 1 m/s, with a force of 1 N per s of its stamps."""
    result = Track()
    for time in times:
        result.add_state(round(time * SECOND), time, 1.0, **options)
        result.add_force(round(time * SECOND), time)
    return result


def test_curves_are_of_the_last_seconds_however_many_messages():
    hours = track(np.arange(0.0, 60.0, 1 / 960))
    times, heights, _, forces = hours.curves()
    assert len(times) <= SPAN / FINEST + 1
    assert times[0] == pytest.approx(-SPAN, abs=FINEST) and times[-1] == pytest.approx(
        0, abs=0.011
    )
    np.testing.assert_allclose(np.diff(heights), np.diff(times), atol=1e-6)
    # what is between two points of a curve is in their mean
    np.testing.assert_allclose(forces[1:-1], heights[1:-1] - FINEST / 2, atol=FINEST / 2)
    assert len(hours._forces) < 12_000


def test_times_are_simulated_ones():
    slow = track(np.arange(0.0, 4.0, 1 / 60), time_scale=0.25)
    assert slow.curves()[0][0] == pytest.approx(-1.0, abs=0.02)
    # a pause takes no time of the simulation
    paused = track([*np.arange(0.0, 1.0, 1 / 60), *np.arange(500.0, 501.0, 1 / 60)])
    times = paused.curves()[0]
    assert len(times) == 120
    np.testing.assert_allclose(np.diff(times), 1 / 60, atol=1e-6)
    # but a message each second is no pause
    rare = track(np.arange(0.0, 5.0))
    np.testing.assert_allclose(rare.curves()[0], [-4.0, -3.0, -2.0, -1.0, 0.0])


def test_what_was_later_than_a_clock_that_goes_back_is_forgotten():
    curve = track(np.arange(0.0, 5.0, 1 / 60))
    for time in np.arange(2.0, 3.0, 1 / 60):
        curve.add_state(round(time * SECOND), -1.0, 0.0)
    times, heights, _, forces = curve.curves()
    np.testing.assert_allclose(np.diff(times), 1 / 60, atol=1e-6)
    assert times[0] == pytest.approx(-3.0, abs=0.02)
    assert (heights[:120] >= 0.0).all() and (heights[120:] == -1.0).all()
    assert forces[119] > 0.0 and not forces[120:].any()  # it touches nothing any more
    # to before the first one
    curve.add_state(0, 7.0, 0.0)
    assert [each.tolist() for each in curve.curves()] == [[0.0], [7.0], [0.0], [0.0]]


def test_without_a_message_nothing_was_touched():
    curve = Track()
    for time in (1, 2, 3, 4):
        curve.add_state(time * SECOND, 0.0, 0.0)
        if time in (2, 3):
            curve.add_force(time * SECOND, 5.0 if time == 2 else 0.0)
    assert curve.curves()[3].tolist() == [0.0, 5.0, 0.0, 0.0]
    assert [len(each) for each in Track().curves()] == [0, 0, 0, 0]
