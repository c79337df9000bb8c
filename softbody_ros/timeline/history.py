# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
History of a world, from which any earlier tick can be recomputed: pure Python, no ROS.

Snapshots at regular ticks, thinned out with age to stay within a budget of memory, and all actions
on the world in between. Stepping on from a restored snapshot with the same actions at the same
ticks reproduces the same bits.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from softbody_ros.core import Snapshot, World, WorldConfig

INTERVAL = 0.25
"""Simulated seconds between two snapshots before they are thinned out."""
MOST_ACTIONS = 100_000
"""Beyond that the oldest are dropped, and replay of earlier times lacks them."""
LEAST_ACTION_BYTES = 8 * 2**20
"""Actions may always take this much: without them a replay would give other states."""

Action = Callable[[World], None]


@dataclass(frozen=True)
class LoggedAction:
    """An action on the world, and the tick at which it took place."""

    tick: int
    action: Action
    nbytes: int = 0


@dataclass(frozen=True)
class Checkpoint:
    """The state of a world at a tick, and the parameters in force."""

    snapshot: Snapshot
    config: WorldConfig

    @property
    def tick(self) -> int:
        """The tick of the snapshot."""
        return self.snapshot.tick

    @cached_property
    def nbytes(self) -> int:
        """Bytes of memory that only this takes."""
        return self.snapshot.nbytes

    @cached_property
    def settings_nbytes(self) -> dict[int, int]:
        """Bytes of what it may share with others, by `id`: see `Snapshot`."""
        return self.snapshot.settings_nbytes


class History:
    """
    Snapshots of one world and the actions on it.

    Parameters
    ----------
    world : World
        its present state is the beginning, which is never dropped
    memory : float
        budget of bytes for snapshots and actions, half of it for actions; the beginning is always
        kept

    """

    def __init__(self, world: World, memory: float) -> None:
        self.memory = memory
        self.begin(world)

    def begin(self, world: World) -> None:
        """Drop everything: the present state is the beginning."""
        self._checkpoints = [Checkpoint(world.snapshot(), world.config)]
        self._actions: deque[LoggedAction] = deque()
        self._action_bytes = 0

    @property
    def beginning(self) -> Checkpoint:
        """The first checkpoint."""
        return self._checkpoints[0]

    @property
    def ticks(self) -> list[int]:
        """Ticks of the snapshots, in order."""
        return [checkpoint.tick for checkpoint in self._checkpoints]

    @property
    def nbytes(self) -> int:
        """Bytes that the snapshots and the actions take."""
        return self._checkpoint_bytes + self._action_bytes

    @property
    def _checkpoint_bytes(self) -> int:
        own = sum(checkpoint.nbytes for checkpoint in self._checkpoints)
        shared: dict[int, int] = {}
        for checkpoint in self._checkpoints:
            shared |= checkpoint.settings_nbytes
        return own + sum(shared.values())

    @property
    def most_for_actions(self) -> float:
        """Budget of bytes for actions."""
        return max(0.5 * self.memory, LEAST_ACTION_BYTES)

    def log(self, tick: int, action: Action, nbytes: int = 0) -> None:
        """Record an action at a tick, and the memory that it takes."""
        self._actions.append(LoggedAction(tick, action, nbytes))
        self._action_bytes += nbytes
        while len(self._actions) > MOST_ACTIONS or self._action_bytes > self.most_for_actions:
            self._action_bytes -= self._actions.popleft().nbytes

    def record(self, world: World) -> None:
        """Take a snapshot if one is due at the tick of the world."""
        every = max(round(INTERVAL / world.config.time_step), 1)
        if world.tick % every or world.tick <= self._checkpoints[-1].tick:
            return
        if self.memory <= self._checkpoints[0].nbytes:
            return
        self._checkpoints.append(Checkpoint(world.snapshot(), world.config))
        self._thin_out()

    def _thin_out(self) -> None:
        """Drop the snapshots whose removal leaves the smallest gap relative to its age."""
        free = self.memory - min(self._action_bytes, 0.5 * self.memory)
        now = self._checkpoints[-1].tick
        while len(self._checkpoints) > 2 and self._checkpoint_bytes > free:
            gaps = [
                (after.tick - before.tick) / (now - before.tick)
                for before, after in zip(self._checkpoints, self._checkpoints[2:], strict=False)
            ]
            self._checkpoints.pop(1 + gaps.index(min(gaps)))

    def rewind(self, world: World, tick: int) -> deque[LoggedAction]:
        """
        Restore the newest snapshot at or before a tick, and drop what is later.

        Returns
        -------
        deque of LoggedAction
            actions to repeat between the snapshot and `tick`

        """
        while len(self._checkpoints) > 1 and self._checkpoints[-1].tick > tick:
            self._checkpoints.pop()
        checkpoint = self._checkpoints[-1]
        while self._actions and self._actions[-1].tick >= tick:
            self._action_bytes -= self._actions.pop().nbytes
        # first, for bodies added or removed since: the config has those of the snapshot
        world.restore(checkpoint.snapshot)
        world.configure(checkpoint.config, lenient=True)
        world.restore(checkpoint.snapshot)  # another config wakes bodies
        return deque(logged for logged in self._actions if logged.tick >= checkpoint.tick)
