# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which tick is due at which time of the driving clock; pure Python, knows nothing of ROS."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
import math
import time

from softbody_ros.core import World

SLICE = 0.02
"""Seconds of work after which the caller gets the control back, so that it stays responsive."""
LARGEST_LAG = 0.05
"""Seconds that a world driven by wall time may be behind before it drops the rest."""
CATCH_UP = 0.5
"""Further behind than this, one state per slice is published: progress instead of a flood."""


class Stepper:
    """
    Steps a world along a clock: a whole number of ticks, whatever the calls' timing.

    Times of the clock are integer nanoseconds. A tick's time is that of an anchor (tick, time)
    plus `time_step / time_scale` per tick; pausing, resetting and dropping move the anchor.

    Parameters
    ----------
    world : World
    rates : mapping of str to float
        outputs and how often each is due, Hz of the clock's time; 0 is never
    stopwatch : callable
        seconds that only grow, to bound the work of a slice

    """

    def __init__(
        self,
        world: World,
        rates: Mapping[str, float],
        stopwatch: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.world = world
        self.rates = dict(rates)
        self.time_scale = 1.0
        self.paused = False
        self.dropped = 0.0
        self.busy = 0.0
        self._stopwatch = stopwatch
        self._start: int | None = None
        self._anchor = (0, 0)
        self._publish_now = True

    # ------------------------------------------------------------------------------ tick and time
    @property
    def started(self) -> bool:
        """Whether the clock has been seen."""
        return self._start is not None

    def time_of(self, tick: int) -> int:
        """Return the clock's time of a tick, ns."""
        anchor_tick, anchor_time = self._anchor
        if self.time_scale == 0.0:
            return anchor_time
        return anchor_time + round((tick - anchor_tick) * self._nanoseconds_per_tick)

    def lag(self, now: int) -> float:
        """Return how far the world is behind the clock, s of the clock's time."""
        if self.paused or self.time_scale == 0.0 or not self.started:
            return 0.0
        return (now - self.time_of(self.world.tick)) * 1e-9

    @property
    def _nanoseconds_per_tick(self) -> float:
        return 1e9 * self.world.config.time_step / self.time_scale

    def _due_tick(self, now: int) -> int:
        if self.paused or self.time_scale == 0.0:
            return self.world.tick
        anchor_tick, anchor_time = self._anchor
        tick = anchor_tick + math.floor((now - anchor_time) / self._nanoseconds_per_tick)
        # the inverse of time_of, to the nanosecond
        return tick + 1 if self.time_of(tick + 1) <= now else tick

    # ----------------------------------------------------------------------------------- commands
    def reanchor(self, now: int) -> None:
        """Let the current tick be now: what lies between is neither simulated nor dropped."""
        self._anchor = (self.world.tick, now)

    def switch_clock(self, now: int) -> None:
        """Go on from the current tick by another clock."""
        if self.started:
            self._start = now - round(1e9 * self.world.time)
            self.reanchor(now)

    def publish_now(self) -> None:
        """Let the next `advance` begin with all outputs of the current state."""
        self._publish_now = True

    def set_time_scale(self, scale: float, now: int) -> None:
        """Go on at another speed from now."""
        if scale != self.time_scale:
            self.reanchor(now)
            self.time_scale = scale

    def pause(self, paused: bool, now: int) -> None:
        """Stop, or go on from the current tick."""
        if paused != self.paused:
            self.reanchor(now)
            self.paused = paused
            self.publish_now()

    def single_step(self, ticks: int, now: int) -> None:
        """Advance while paused; the tick reached is now."""
        self._timed_step(ticks)
        self.reanchor(now)
        self.publish_now()

    def reset(self, now: int) -> None:
        """Return to the initial state: tick 0 is now."""
        self.world.reset()
        if self.started:
            self._start = now
            self.reanchor(now)
        self.publish_now()

    def rewind(self, now: int) -> None:
        """
        Follow a clock that went back: the initial state, to be simulated up to `now` again.

        Before the start of the simulation the initial state is what there is.
        """
        if self._start is None or now >= self.time_of(self.world.tick):
            return
        self.world.reset()
        self._anchor = (0, self._start)
        self.publish_now()

    # ------------------------------------------------------------------------------------ advance
    def advance(self, now: int, drop_overload: bool) -> Iterator[set[str]]:
        """
        Step to the tick that is due, one slice of work at most.

        Yields the outputs that are due at the current tick, with the world in that state. An
        output is due at the ticks that its rate selects, so the same ones however the calls are
        timed; and at once after a start, a reset, a pause, a step or a jump.

        Parameters
        ----------
        now : int
            the clock's time, ns
        drop_overload : bool
            whether time that cannot be simulated in time is dropped (wall time) or kept (/clock)

        Raises
        ------
        SimulationError
            if a tick cannot be computed.

        """
        begin = self._stopwatch()
        if not self.started:
            self._start = now
            self.reanchor(now)
        if self._publish_now:
            self._publish_now = False
            yield set(self.rates)
        catching_up = self.lag(now) > CATCH_UP
        due_tick, first_tick = self._due_tick(now), self.world.tick
        while self.world.tick < due_tick and self._stopwatch() - begin < SLICE:
            self._timed_step(1)
            due = self._due_outputs()
            if due and not catching_up:
                yield due
        if catching_up and self.world.tick > first_tick:
            yield set(self.rates)
        if drop_overload and self.lag(now) > LARGEST_LAG:
            self.dropped += self.lag(now)
            self.reanchor(now)

    def _timed_step(self, ticks: int) -> None:
        begin = self._stopwatch()
        self.world.step(ticks)
        self.busy += self._stopwatch() - begin

    def _due_outputs(self) -> set[str]:
        tick, h = self.world.tick, self.world.config.time_step
        # multiples of the period of each output, counted from tick 0
        return {
            output
            for output, rate in self.rates.items()
            if rate > 0.0
            and math.floor(tick * h * rate / self.time_scale + 1e-6)
            > math.floor((tick - 1) * h * rate / self.time_scale + 1e-6)
        }
