# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What has happened to a world, so that it can go back to any earlier tick: pure Python, no ROS.

Snapshots at regular ticks, thinned out with age to stay within a budget of memory, and everything
that has acted on the world in between. A restored snapshot, stepped on with the same actions at
the same ticks, gives the same bits as the first time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from softbody_ros.core import Snapshot, World, WorldConfig

INTERVAL = 0.25
"""Simulated seconds between two snapshots while they are dense."""
MOST_ACTIONS = 100_000
"""Beyond so many the oldest are forgotten: times before them come back without them."""
LEAST_ACTION_BYTES = 8 * 2**20
"""What actions may take however little memory there is: without any the past would be another."""

Action = Callable[[World], None]


@dataclass(frozen=True)
class Note:
    """Something that has acted on the world when it was at a tick."""

    tick: int
    action: Action
    nbytes: int = 0


@dataclass(frozen=True)
class Page:
    """The state of a world at a tick, and the parameters that were in force."""

    snapshot: Snapshot
    config: WorldConfig

    @property
    def tick(self) -> int:
        """The tick of the snapshot."""
        return self.snapshot.tick


class History:
    """
    The past of one world.

    Parameters
    ----------
    world : World
        its present state is the beginning, which is never forgotten
    memory : float
        bytes that snapshots and what has acted on the world may take, the latter half of them; at
        least the beginning is kept

    """

    def __init__(self, world: World, memory: float) -> None:
        self.memory = memory
        self.begin(world)

    def begin(self, world: World) -> None:
        """Forget everything: the present state is the beginning."""
        self._pages = [Page(world.snapshot(), world.config)]
        self._notes: deque[Note] = deque()
        self._noted = 0

    @property
    def beginning(self) -> Page:
        """The state that everything began with."""
        return self._pages[0]

    @property
    def ticks(self) -> list[int]:
        """Ticks of the snapshots, in order."""
        return [page.tick for page in self._pages]

    @property
    def nbytes(self) -> int:
        """Memory that the snapshots take, and what has acted on the world."""
        return sum(page.snapshot.nbytes for page in self._pages) + self._noted

    @property
    def most_for_actions(self) -> float:
        """Bytes that what has acted on the world may take."""
        return max(0.5 * self.memory, LEAST_ACTION_BYTES)

    def note(self, tick: int, action: Action, nbytes: int = 0) -> None:
        """Remember what acts on the world at a tick, and how much memory it takes."""
        self._notes.append(Note(tick, action, nbytes))
        self._noted += nbytes
        while len(self._notes) > MOST_ACTIONS or self._noted > self.most_for_actions:
            self._noted -= self._notes.popleft().nbytes

    def record(self, world: World) -> None:
        """Take a snapshot if the tick of the world is one for it."""
        every = max(round(INTERVAL / world.config.time_step), 1)
        if world.tick % every or world.tick <= self._pages[-1].tick:
            return
        if self.memory <= self._pages[0].snapshot.nbytes:
            return
        self._pages.append(Page(world.snapshot(), world.config))
        self._thin_out()

    def _thin_out(self) -> None:
        """Forget those snapshots whose gap, once they are gone, is smallest for its age."""
        free = self.memory - min(self._noted, 0.5 * self.memory)
        excess, now = self.nbytes - self._noted - free, self._pages[-1].tick
        while excess > 0 and len(self._pages) > 2:
            gaps = [
                (after.tick - before.tick) / (now - before.tick)
                for before, after in zip(self._pages, self._pages[2:], strict=False)
            ]
            page = self._pages.pop(1 + gaps.index(min(gaps)))
            excess -= page.snapshot.nbytes

    def go_back(self, world: World, tick: int) -> deque[Note]:
        """
        Put the world into the newest snapshot at or before a tick, and forget what came later.

        Returns
        -------
        deque of Note
            what has to act again on the way from there to `tick`

        """
        while len(self._pages) > 1 and self._pages[-1].tick > tick:
            self._pages.pop()
        page = self._pages[-1]
        while self._notes and self._notes[-1].tick >= tick:
            self._noted -= self._notes.pop().nbytes
        world.configure(page.config)
        world.restore(page.snapshot)
        return deque(note for note in self._notes if note.tick >= page.tick)
