# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""One tick of all awake bodies, as a sequence of its stages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from softbody_ros.core.collision.collision_surface import NO_SURFACES, CollisionSurfaces
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.collision.point_obstacles import PointObstacles
from softbody_ros.core.compiled import kernel
from softbody_ros.core.contact.detection import find_missed, find_rows
from softbody_ros.core.contact.exchange import (
    accept_exchange,
    accept_holding,
    add_up,
    forget_exchange,
)
from softbody_ros.core.contact.resolution import resolve
from softbody_ros.core.contact.workspace import MEMBERS, Workspace, enlarged, new_workspace
from softbody_ros.core.geometry.bvh import Trees
from softbody_ros.core.shape_matching import goal_flight, modal_flight, pins
from softbody_ros.core.state import Body, State

SEARCHES = 8
"""How often a tick is computed, at most: again where bodies have been pushed into third ones."""


class SimulationError(ArithmeticError):
    """A tick with a result that is not finite; the state before it is kept."""


class Environment(NamedTuple):
    """
    Gravity, obstacles and other surroundings of the bodies during a tick.

    Attributes
    ----------
    gravity : (3,) float
        m/s²
    obstacles : sequence of Obstacle
        at the end of the tick
    records : (O,) OBSTACLE
    trees : Trees
        the obstacles for kernels
    cloud : PointObstacles
    points, sets : (k, 3) float, (s,) POINT_SET
        those of the cloud and on edges of obstacles, see `FixedPoints`
    surfaces : CollisionSurfaces
        of all rest shapes

    """

    gravity: np.ndarray
    obstacles: Sequence[Obstacle]
    records: np.ndarray
    trees: Trees
    cloud: PointObstacles
    points: np.ndarray
    sets: np.ndarray
    surfaces: CollisionSurfaces


class SolverWork(NamedTuple):
    """What the solution of contacts has taken so far."""

    sweeps: int
    """of Gauss–Seidel over the contacts of an island"""
    newton_steps: int
    unsolved: int
    """problems, of an island's positions or velocities, not solved to tolerance in time"""


class Kinds(NamedTuple):
    """Indices of bodies: all, those with pins, those that fly to goals and the others."""

    all: np.ndarray
    held: np.ndarray
    to_goals: np.ndarray
    modal: np.ndarray


class Integrator:
    """
    Advances a state by ticks; owns their scratch memory.

    Parameters
    ----------
    state : State
    bodies : sequence of Body
        those of the state

    """

    def __init__(self, state: State, bodies: Sequence[Body]) -> None:
        self._state, self._bodies = state, bodies
        self._places = np.full(state.x.shape[2], -1)
        self._flown = np.empty(state.x.shape[1:])
        self._workspace, self._needed = new_workspace(), b''
        self.work = np.zeros(3, np.int64)
        self.update()

    def update(self) -> None:
        """Update what depends on the modes and pins of the bodies, after they change."""
        bodies = self._state.bodies
        self._kinds: Kinds | None = None
        # whether collisions between bodies, or of one with itself, are possible
        self._any_pairs = len(bodies) > 1 or bool((bodies['regions'] > 1).any())

    def _chosen(self, indices: np.ndarray) -> Kinds:
        """Return bodies (c,) by what a tick does with them, mostly the same as in the last one."""
        if self._kinds is None or self._kinds.all is not indices:
            bodies = self._state.bodies[indices]
            has_pins = bodies['pins'] > 0
            to_goals = has_pins | bodies['follows_goals']
            self._kinds = Kinds(indices, indices[has_pins], indices[to_goals], indices[~to_goals])
        return self._kinds

    def take_tick(self, awake: np.ndarray, environment: Environment, h: float) -> None:
        """
        Advance the awake bodies by a tick.

        Parameters
        ----------
        awake : (A,) int
            in order
        environment : Environment
        h : float
            s

        Raises
        ------
        SimulationError
            with the body as `args[1]`, if a position or velocity is not finite; the state is not
            changed then.

        """
        state, obstacles = self._state, environment.records
        held = self._chosen(awake).held
        pinned = state.bodies, held, state.pinned, state.pin_offset, obstacles
        if len(held):
            pins.follow_obstacles(*pinned, state.x, h)
        for search in range(SEARCHES):
            self.fly(awake, environment.gravity, h)
            members, rows, met = self.find_rows(awake, environment, h)
            memory, is_far = self.resolve_rows(members, rows, environment, h)
            if search == SEARCHES - 1 or not is_far or not self._misses(awake, environment, met):
                break
            forget_exchange(state.bodies, awake, state.obstacle_impulse, state.normal_impulse)
        if search > 0:
            state.bodies['pushed'] = 0.0
        if len(held):
            pins.hold(*pinned, state.x, state.v, h)
        accept(
            state.bodies, awake, state.shapes, state.weights, state.x, state.v, h, obstacles,
            state.reaction, state.normal_impulse, state.obstacle_impulse, state.holding,
            state.holder_impulse, state.obstacle_total,
        )  # fmt: skip
        state.contact_memory = memory

    def load_kernels(self, environment: Environment) -> None:
        """Run what a tick runs only where bodies have been pushed far."""
        if self._any_pairs:
            every = np.arange(len(self._state.bodies))
            self._misses(every, environment, np.empty(0, np.int64))
            self._state.bodies['pushed'] = 0.0

    def fly(self, chosen: np.ndarray, gravity: np.ndarray, h: float) -> None:
        """Move bodies (c,) as they fly without contacts."""
        state, kinds, failed = self._state, self._chosen(chosen), 0
        shapes = state.shapes, state.weights, state.q, state.x, state.v
        matches = state.stretch, state.match_centre, state.match_posture, state.regions
        if len(kinds.modal):
            failed = modal_flight.fly(
                state.bodies, kinds.modal, *shapes, *matches, state.member,
                state.weighted_features, state.faces, gravity, h,
            )  # fmt: skip
        if len(kinds.to_goals) and not failed:
            failed = goal_flight.fly_to_goals(
                state.bodies, kinds.to_goals, *shapes, *matches, state.member, state.features,
                state.weighted_features, state.pinned, gravity, h,
            )  # fmt: skip
        if failed:
            self._fail(failed)

    def _fail(self, failed: int) -> None:
        body = self._bodies[failed - 1].config.name
        raise SimulationError('a position or velocity is not finite any more', body)

    def find_rows(
        self, chosen: np.ndarray, environment: Environment, h: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Find all contacts of bodies (m,): see `detection.find_rows`."""
        state, sets, count = self._state, environment.sets, len(chosen)
        others = self._any_pairs or len(sets) > 0
        workspace = self._workspace_for(count)
        found, more, met = find_rows(
            state.bodies, chosen, state.shapes, state.weights, state.q, state.x, state.v,
            self._flown, state.match_centre, state.match_posture, environment.records,
            environment.trees, environment.surfaces.arrays if others else NO_SURFACES,
            environment.points, sets, h, others, state.contact_memory, state.reaction,
            state.is_pinned, tuple(workspace),
        )  # fmt: skip
        rows = more if len(more) else workspace.found[:found]
        return workspace.members[:count], rows, met

    def _workspace_for(self, members: int) -> Workspace:
        """Return the workspace, as large as was needed so far, with room for members."""
        needed, is_short = self._workspace.needed, members > len(self._workspace.members)
        if is_short:
            needed[MEMBERS] = members
        known = needed.tobytes()
        if is_short or known != self._needed:
            self._workspace, self._needed = enlarged(self._workspace), known
        return self._workspace

    def _misses(self, chosen: np.ndarray, environment: Environment, met: np.ndarray) -> bool:
        """Return whether bodies (m,) are within others that they had not met before."""
        state = self._state
        return find_missed(
            state.bodies, chosen, state.shapes, state.q, state.x, state.match_centre,
            state.match_posture, environment.surfaces.arrays, met, self._workspace.needed,
        )  # fmt: skip

    def resolve_rows(
        self, members: np.ndarray, rows: np.ndarray, environment: Environment, h: float
    ) -> tuple[np.ndarray, bool]:
        """Resolve the contacts (k,) ROW of MEMBERs (m,): see `resolution.resolve`."""
        state = self._state
        return resolve(
            state.bodies, state.shapes, state.weights, state.q, state.x, state.v, self._flown,
            environment.records, environment.trees, h, members, rows, self._places,
            state.obstacle_impulse, state.normal_impulse, self.work, state.is_pinned,
            tuple(self._workspace),
        )  # fmt: skip


@kernel
def accept(
    bodies: np.ndarray,
    awake: np.ndarray,
    shapes: np.ndarray,
    weights: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    h: float,
    obstacles: np.ndarray,
    reaction: np.ndarray,
    normal_impulse: np.ndarray,
    obstacle_impulse: np.ndarray,
    holding: np.ndarray,
    holder_impulse: np.ndarray,
    obstacle_total: np.ndarray,
) -> None:
    """
    Make the computed halves the state, and integrate the wrenches of contacts over time.

    Parameters
    ----------
    bodies, awake, shapes, weights, x, v, h
        see `modal_flight.fly`
    obstacles : (O,) OBSTACLE
    reaction, normal_impulse, obstacle_impulse, holding, holder_impulse, obstacle_total
        see `State`

    """
    for index in range(len(awake)):
        body, row = bodies[awake[index]], awake[index]
        shape = shapes[body['shape']]
        body['now'] = 1 - body['now']
        body['is_plastic'] = body['is_plastic'] or body['flowed']
        accept_exchange(
            body, shape, weights, x[body['now']], h, obstacle_impulse[row], normal_impulse,
            reaction[row],
        )  # fmt: skip
        if body['pins'] > 0:
            accept_holding(
                body, shape, weights, x, v, h, reaction[row], obstacles, holding[row],
                holder_impulse[row],
            )  # fmt: skip
    for index in range(len(bodies)):
        add_up(
            bodies[index], reaction[index], h, obstacle_impulse[index], holding[index],
            holder_impulse[index], obstacle_total,
        )  # fmt: skip
