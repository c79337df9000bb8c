# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steps a world along a clock: which tick is due at which time; pure Python, no ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Container, Iterator, Mapping
from contextlib import suppress
import dataclasses
from dataclasses import dataclass
import math
import time

from softbody_ros.core import ConfigError, PreparedConfig, World, WorldConfig
from softbody_ros.core.structure import same_structure, with_structure
from softbody_ros.timeline.history import Action, History, LoggedAction

SLICE = 0.02
"""Seconds of work after which control returns to the caller, which stays responsive."""
LARGEST_LAG = 0.05
"""Seconds that a world driven by wall time may lag before the lag is dropped."""
CATCH_UP = 0.5
"""Seconds of lag above which only one state per slice is published."""
MOST_SEGMENTS = 10_000
MEBIBYTE = 2.0**20


@dataclass(frozen=True)
class Segment:
    """
    A piece of the map from ticks to times, from `time` on: ticks at a fixed period.

    Attributes
    ----------
    time : int
        ns
    tick : int
        the tick of that time
    period : float
        ns per tick; infinite while paused

    """

    time: int
    tick: int
    period: float

    def time_of(self, tick: int) -> int:
        """Return the time of a tick, ns."""
        if tick == self.tick or math.isinf(self.period):
            return self.time
        return self.time + round((tick - self.tick) * self.period)

    def tick_at(self, now: int) -> int:
        """Return the last tick due at a time: the inverse of `time_of`, to the ns."""
        if math.isinf(self.period):
            return self.tick
        tick = self.tick + math.floor((now - self.time) / self.period)
        return tick + 1 if self.time_of(tick + 1) <= now else tick


@dataclass(eq=False)
class StepRequest:
    """
    Ticks that are requested while paused.

    Attributes
    ----------
    ticks, left : int
        how many, and how many of them are still to be taken
    failure : str
        why those that are left are not taken any more, or ''

    """

    ticks: int
    left: int
    failure: str = ''

    @property
    def waits(self) -> bool:
        """Whether some of them are still to be taken."""
        return self.left > 0 and not self.failure


@dataclass(frozen=True, eq=False)
class Adoption:
    """The action that a world uses a config, whose bodies and obstacles may be others."""

    prepared: PreparedConfig

    def __call__(self, world: World) -> None:
        """Act on a world."""
        world.adopt(self.prepared)


class Stepper:
    """
    Steps a world along a clock in whole ticks, however the calls are timed.

    Times of the clock are integer nanoseconds. Ticks map to times in segments: a pause, a reset,
    another speed and dropped time begin a new one. When the clock goes back, so does the world, to
    the state of the tick that belonged to that time, bit by bit, including all actions until then;
    later actions are undone. So bodies and obstacles are those of that time; what is there now as
    well has the parameters of now.

    Parameters
    ----------
    world : World
    rates : mapping of str to float
        rate of each output, Hz of the clock's time; 0 is never
    stopwatch : callable
        monotonic seconds, to bound the work of a slice

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
        self.history = History(world, 128 * MEBIBYTE)
        self._stopwatch = stopwatch
        self._segments: list[Segment] = []
        self._publish_now = True
        self._requests: deque[StepRequest] = deque()
        # replay queue; inputs deferred until the replay ends
        self._replay: deque[LoggedAction] = deque()
        self._replay_end = 0
        self._deferred: list[tuple[Action, int]] = []
        self._config = world.config

    # ------------------------------------------------------------------------------ tick and time
    @property
    def started(self) -> bool:
        """Whether a time of the clock has been received."""
        return bool(self._segments)

    def time_of(self, tick: int) -> int:
        """Return the clock's time of a tick, ns."""
        for segment in reversed(self._segments):
            if segment.tick <= tick:
                return segment.time_of(tick)
        return self._segments[0].time_of(tick) if self._segments else 0

    def lag(self, now: int) -> float:
        """Return the lag of the world behind the clock, s of the clock's time."""
        if not self._moves or not self.started:
            return 0.0
        return (now - self._segments[-1].time_of(self.world.tick)) * 1e-9

    @property
    def _moves(self) -> bool:
        return not self.paused and self.time_scale > 0.0

    @property
    def _period(self) -> float:
        return 1e9 * self.world.config.time_step / self.time_scale if self._moves else math.inf

    @property
    def replaying(self) -> bool:
        """Whether the world is repeating ticks after the clock went back."""
        return self.world.tick < self._replay_end

    def _due_tick(self, now: int) -> int:
        if not self.started:
            return self.world.tick
        return max(self._segments[-1].tick_at(now), self._replay_end)

    # ----------------------------------------------------------------------------------- commands
    def act(self, action: Action, nbytes: int = 0) -> None:
        """
        Apply an action to the world, and record it for replays of this tick.

        Parameters
        ----------
        action : callable
            immutable, like all that it refers to
        nbytes : int
            memory that it takes

        """
        if self.replaying:
            self._deferred.append((action, nbytes))
            # a replay may be long: of the clouds received meanwhile the last ones are enough
            while sum(size for _, size in self._deferred) > self.history.most_for_actions:
                self._deferred.pop(self._first_to_forget())
            return
        action(self.world)
        self._config = self.world.config
        self.history.log(self.world.tick, action, nbytes)

    def _first_to_forget(self) -> int:
        """Return the index of a deferred action: not of one that adds or removes."""
        acts = (not isinstance(action, Adoption) for action, _ in self._deferred)
        return next((index for index, is_input in enumerate(acts) if is_input), 0)

    @property
    def config(self) -> WorldConfig:
        """The config in force; during a replay that at its end, where inputs wait for it."""
        return self._config

    def prepare(self, config: WorldConfig, renewable: Container[str] = ()) -> PreparedConfig:
        """
        Check a config, whose bodies and obstacles may be others, and load what is new in it.

        Parameters
        ----------
        config : WorldConfig
        renewable : container of str
            names of those that may have other read-only settings: they begin anew then

        Raises
        ------
        ConfigError, MeshError
            if it cannot be used.

        """
        base = dataclasses.replace(
            self._config,
            bodies=tuple(item for item in self._config.bodies if item.name not in renewable),
            obstacles=tuple(item for item in self._config.obstacles if item.name not in renewable),
        )
        # where what is in reach of an attachment will be then, is not known
        return self.world.prepare(config, base, lenient=self.replaying)

    def adopt(self, prepared: PreparedConfig) -> None:
        """Use a config from the current tick on, see `prepare`."""
        is_change = not same_structure(prepared.config, self._config)
        self._config = prepared.config
        if is_change or not self.replaying:
            self.act(Adoption(prepared), prepared.nbytes)
        if is_change:
            self.publish_now()

    def configure(self, config: WorldConfig) -> None:
        """
        Use another config from the current tick on.

        Raises
        ------
        ConfigError, MeshError
            if it is invalid; nothing has changed then.

        """
        self.adopt(self.prepare(config))

    def reanchor(self, now: int) -> None:
        """Map the current tick to `now`; the time between is neither simulated nor dropped."""
        self._segments = [segment for segment in self._segments if segment.time < now]
        self._segments = self._segments[-MOST_SEGMENTS:]
        self._segments.append(Segment(now, max(self.world.tick, self._replay_end), self._period))

    def switch_clock(self, now: int) -> None:
        """Continue from the current tick on another clock."""
        if self.started:
            begin = now - round(1e9 * self.world.time)
            self._segments = [Segment(begin, 0, 1e9 * self.world.config.time_step)]
            self.reanchor(now)

    def publish_now(self) -> None:
        """Make all outputs due at the next `advance`, before it steps."""
        self._publish_now = True

    def set_time_scale(self, scale: float, now: int) -> None:
        """Continue at another speed from now."""
        if scale != self.time_scale:
            self.time_scale = scale
            self._reanchor_if_started(now)

    def pause(self, paused: bool, now: int) -> None:
        """Pause, or continue from the current tick."""
        if paused != self.paused:
            self.paused = paused
            self._end_steps('the simulation was resumed; pause it and step again')
            self._reanchor_if_started(now)
            self.publish_now()

    def _reanchor_if_started(self, now: int) -> None:
        if self.started:
            self.reanchor(now)

    def single_step(self, ticks: int) -> StepRequest:
        """Request ticks while paused, after those requested before; `take_steps` takes them."""
        request = StepRequest(ticks, ticks)
        self._requests.append(request)
        return request

    @property
    def stepping(self) -> bool:
        """Whether requested ticks remain to be taken."""
        return bool(self._requests)

    @property
    def steps_left(self) -> int:
        """How many requested ticks remain to be taken."""
        return sum(request.left for request in self._requests)

    def take_steps(self, now: int) -> None:
        """
        Take requested ticks, one slice of work at most; the tick reached maps to `now`.

        Raises
        ------
        SimulationError
            if a tick cannot be computed; no more are taken then.

        """
        begin = self._stopwatch()
        try:
            while self._requests and self._stopwatch() - begin < SLICE:
                replaying = self.replaying
                self._timed_step()
                self._requests[0].left -= not replaying
                if not self._requests[0].left:
                    self._requests.popleft()
        except Exception as error:
            self._end_steps(str(error) or type(error).__name__)
            raise
        self._reanchor_if_started(now)
        self.publish_now()

    def _end_steps(self, reason: str) -> None:
        """Take no more of the requested ticks."""
        for request in self._requests:
            taken = request.ticks - request.left
            request.failure = (
                f'{taken} of {request.ticks} steps were taken, to tick {self.world.tick}: {reason}'
            )
        self._requests.clear()

    def reset(self, now: int) -> None:
        """
        Return to the initial state: tick 0 maps to `now`, and the history begins anew.

        Obstacles received at run time stay, also those that a running replay has not reached yet.
        """
        actions = [logged.action for logged in self._replay]
        for action in actions + [item for item, _ in self._deferred]:
            _repeat(action, self.world)
        self._replay, self._replay_end, self._deferred = deque(), 0, []
        self._end_steps('the simulation was reset; step again')
        self.world.configure(self.world.adapted(self._config), lenient=True)
        self.world.reset()
        self._config = self.world.config
        self.history.begin(self.world)
        if self.started:
            self._segments = []
            self.reanchor(now)
        self.publish_now()

    def rewind(self, now: int) -> None:
        """
        Follow a clock that went back, to the tick that belonged to that time.

        `advance` replays the ticks from the snapshot before it. Before the beginning the initial
        state is used. While paused, the present state stays.
        """
        if not self.started:
            return
        if not self._moves:
            self.reanchor(now)
            return
        earlier = [segment for segment in self._segments if segment.time <= now]
        tick = max(earlier[-1].tick_at(now), 0) if earlier else 0
        if tick >= max(self.world.tick, self._replay_end):
            return
        self._replay = self.history.rewind(self.world, tick)
        self._replay_end = tick
        # what has been asked for on the way to a later tick is undone
        self._deferred = [item for item in self._deferred if not isinstance(item[0], Adoption)]
        self._config = self._config_after_replay()
        self._segments = earlier or self._segments[:1]
        if earlier and earlier[-1].period != self._period:
            self.reanchor(now)
        self.publish_now()
        if not self.replaying:
            self._end_replay()

    def _config_after_replay(self) -> WorldConfig:
        """Return the present parameters, of what will be there then."""
        adopted = [
            logged.action.prepared.config
            for logged in self._replay
            if isinstance(logged.action, Adoption)
        ]
        return with_structure(self._config, [self.world.config, *adopted][-1])

    def _end_replay(self) -> None:
        """Apply the present parameters, and the inputs deferred during the replay."""
        deferred, self._deferred = self._deferred, []
        wanted = self._config
        self._use_parameters(wanted)
        for action, nbytes in deferred:
            with suppress(ConfigError):  # it is about a body of another time
                self.act(action, nbytes)
        self._use_parameters(wanted)

    def _use_parameters(self, config: WorldConfig) -> None:
        """Let the bodies and obstacles that are there have the parameters of a config."""
        adapted = self.world.adapted(config)
        if self.world.config != adapted:
            # what was not there when it was checked may have another mesh than was thought
            with suppress(ConfigError):
                self.act(Adoption(self.world.prepare(adapted, lenient=True)))
        self._config = self.world.config

    # ------------------------------------------------------------------------------------ advance
    def advance(self, now: int, drop_overload: bool) -> Iterator[set[str]]:
        """
        Step to the tick that is due, one slice of work at most.

        Yields the outputs that are due, with the world at their tick. The ticks at which an output
        is due follow from its rate alone, not from the timing of calls; in addition all are due at
        once after a start, a reset, a pause, a step or a jump.

        Parameters
        ----------
        now : int
            the clock's time, ns
        drop_overload : bool
            whether a lag that cannot be caught up is dropped (wall time) or kept (/clock)

        Raises
        ------
        SimulationError
            if a tick cannot be computed.

        """
        begin = self._stopwatch()
        if not self.started:
            self.reanchor(now)
        if self._publish_now and not self.replaying:
            self._publish_now = False
            yield set(self.rates)
        catching_up = self.lag(now) > CATCH_UP
        due_tick, first_tick = self._due_tick(now), self.world.tick
        while self.world.tick < due_tick and self._stopwatch() - begin < SLICE:
            replaying = self.replaying
            self._timed_step()
            due = self._due_outputs()
            if self._publish_now and not self.replaying:
                self._publish_now = False
                yield set(self.rates)
            elif due and not catching_up and not replaying:
                yield due
        if catching_up and self.world.tick > first_tick:
            yield set(self.rates)
        if drop_overload and self.lag(now) > LARGEST_LAG:
            self.dropped += self.lag(now)
            self.reanchor(now)

    def _timed_step(self) -> None:
        begin = self._stopwatch()
        while self._replay and self._replay[0].tick == self.world.tick:
            _repeat(self._replay.popleft().action, self.world)
        replaying = self.replaying
        self.world.step()
        self.history.record(self.world)
        if replaying and not self.replaying:
            self._end_replay()
        self.busy += self._stopwatch() - begin

    def _due_outputs(self) -> set[str]:
        tick, h = self.world.tick, self.world.config.time_step
        # at multiples of its period since tick 0
        return {
            output
            for output, rate in self.rates.items()
            if rate > 0.0
            and math.floor(tick * h * rate / self.time_scale + 1e-6)
            > math.floor((tick - 1) * h * rate / self.time_scale + 1e-6)
        }


def _repeat(action: Action, world: World) -> None:
    """Repeat an action; older ones may be forgotten, and with them the body that it is about."""
    with suppress(ConfigError):
        action(world)
