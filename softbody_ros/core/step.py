# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""One tick of all awake bodies, as a sequence of its stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softbody_ros.core.collision import narrow_phase
from softbody_ros.core.collision.body_contacts import find_body_contacts, find_candidates
from softbody_ros.core.collision.collision_surface import CollisionSurfaces
from softbody_ros.core.collision.fixed_points import FixedPoints
from softbody_ros.core.collision.obstacle_contacts import CONTACT
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.collision.point_obstacles import PointObstacles
from softbody_ros.core.compiled import kernel
from softbody_ros.core.contact import resolution
from softbody_ros.core.contact.exchange import accept_exchange, accept_holding, add_up
from softbody_ros.core.contact.members import MEMBER
from softbody_ros.core.contact.rows import MEMORY, NO_MEMORY, ROW
from softbody_ros.core.geometry.bvh import Trees
from softbody_ros.core.shape_matching import goal_flight, modal_flight, pins
from softbody_ros.core.state import Body, State

CONTACTS_PER_PARTICLE = 3
"""Capacity for contacts of a rigid body, per particle."""
NO_CONTACTS = np.zeros(0, narrow_phase.CONTACT)


class SimulationError(ArithmeticError):
    """A tick with a result that is not finite; the state before it is kept."""


@dataclass(frozen=True)
class Environment:
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
    points : PointObstacles
    surfaces : CollisionSurfaces
        of all rest shapes

    """

    gravity: np.ndarray
    obstacles: Sequence[Obstacle]
    records: np.ndarray
    trees: Trees
    points: PointObstacles
    surfaces: CollisionSurfaces


class SolverWork(NamedTuple):
    """What the solution of contacts has taken so far."""

    sweeps: int
    """of Gauss–Seidel over the contacts of an island"""
    newton_steps: int
    unsolved: int
    """problems, of an island's positions or velocities, not solved to tolerance in time"""


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
        most = int(state.bodies['count'].max(initial=0))
        self._contacts = np.empty(CONTACTS_PER_PARTICLE * most, CONTACT)
        self._rows, self._memory = np.zeros(64, ROW), np.zeros(64, MEMORY)
        self._places = np.full(state.x.shape[2], -1)
        self._flown = np.empty(state.x.shape[1:])
        self._environment: Environment | None = None
        self._point_table, self._fixed_points = FixedPoints(), (np.zeros((0, 3)),) * 2
        self.work = np.zeros(3, np.int64)
        self.update()

    def update(self) -> None:
        """Update what depends on the modes and pins of the bodies, after they change."""
        bodies = self._state.bodies
        self._to_goals = (bodies['pins'] > 0) | bodies['follows_goals']
        # whether self-collisions, and others between bodies, are possible
        self._any_regions = bool((bodies['regions'] > 1).any())
        self._any_pairs = len(bodies) > 1 or self._any_regions

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
        held = awake[state.bodies['pins'][awake] > 0]
        pinned = state.bodies, held, state.pinned, state.pin_offset, obstacles
        if len(held):
            pins.follow_obstacles(*pinned, state.x, h)
        self.fly(awake, environment.gravity, h)
        memory = self.resolve_contacts(awake, environment, h)
        if len(held):
            pins.hold(*pinned, state.x, state.v, h)
        accept(
            state.bodies, awake, state.shapes, state.weights, state.x, state.v, h, obstacles,
            state.reaction, state.normal_impulse, state.obstacle_impulse, state.holding,
            state.holder_impulse, state.obstacle_total,
        )  # fmt: skip
        state.contact_memory = memory

    def fly(self, chosen: np.ndarray, gravity: np.ndarray, h: float) -> None:
        """Move bodies (c,) as they fly without contacts."""
        state, to_goals = self._state, self._to_goals[chosen]
        shapes = state.shapes, state.weights, state.q, state.x, state.v
        matches = state.stretch, state.match_centre, state.match_posture, state.regions
        others, failed = chosen[to_goals], 0
        if len(others) < len(chosen):
            failed = modal_flight.fly(
                state.bodies, chosen[~to_goals], *shapes, *matches, state.member,
                state.weighted_features, state.faces, gravity, h,
            )  # fmt: skip
        if len(others) and not failed:
            failed = goal_flight.fly_to_goals(
                state.bodies, others, *shapes, *matches, state.member, state.features,
                state.weighted_features, state.pinned, gravity, h,
            )  # fmt: skip
        if failed:
            self._fail(failed)

    def _fail(self, failed: int) -> None:
        body = self._bodies[failed - 1].config.name
        raise SimulationError('a position or velocity is not finite any more', body)

    def resolve_contacts(
        self, chosen: np.ndarray, environment: Environment, h: float
    ) -> np.ndarray:
        """Resolve all contacts of bodies (m,), and return the forces to remember."""
        members, found = self.find_rows(chosen, environment, h)
        return self.resolve_rows(members, found, environment, h)

    def find_rows(
        self, chosen: np.ndarray, environment: Environment, h: float
    ) -> tuple[np.ndarray, int]:
        """Find all contacts of bodies (m,); return these as MEMBERs, and the number of rows."""
        state, bodies, memory = self._state, self._state.bodies, self._state.contact_memory
        members = np.zeros(len(chosen), MEMBER)
        others = self._any_pairs or len(self._points_of(environment)[1]) > 0
        resolution.begin_members(
            bodies, chosen, state.shapes, state.x, state.v, self._flown, environment.records, h,
            others, len(memory) > 0, state.reaction, members,
        )  # fmt: skip
        # at most three times: then all have their widest margins
        for at_once in (False, True, True):
            found = self._find_obstacle_rows(environment, h, members)
            if others:
                found = self._find_face_rows(chosen, environment, h, members, found)
            rows = self._rows[:found]
            if not resolution.confirm_steady(bodies, members, rows, memory, at_once):
                break
        return members, found

    def _find_obstacle_rows(self, environment: Environment, h: float, members: np.ndarray) -> int:
        state, bodies, memory = self._state, self._state.bodies, self._state.contact_memory
        while True:
            found = resolution.find_obstacle_rows(
                bodies, state.shapes, state.weights, state.x, state.v, self._flown,
                environment.records, environment.trees, h, memory, members, self._contacts,
                self._rows, state.is_pinned,
            )  # fmt: skip
            if found <= len(self._rows):
                return found
            self._rows = np.zeros(2 * found, ROW)

    def resolve_rows(
        self, members: np.ndarray, found: int, environment: Environment, h: float
    ) -> np.ndarray:
        """Resolve the contacts (found,) of MEMBERs, and return the forces to remember."""
        state, bodies = self._state, self._state.bodies
        if len(self._memory) < found:
            self._memory = np.zeros(len(self._rows), MEMORY)
        kept = resolution.resolve(
            bodies, state.shapes, state.weights, state.q, state.x, state.v, self._flown,
            environment.records, environment.trees, h, members, self._rows[:found], self._places,
            state.contact_memory, self._memory, state.obstacle_impulse, state.normal_impulse,
            self.work, state.is_pinned,
        )  # fmt: skip
        if kept == 0:
            return NO_MEMORY
        order = np.argsort(self._memory['key'][:kept], kind='stable')
        return self._memory[order]

    def _points_of(self, environment: Environment) -> tuple[np.ndarray, np.ndarray]:
        """Return the points that no force moves, and their sets, see `FixedPoints.refresh`."""
        if environment is not self._environment:
            self._environment = environment
            self._fixed_points = self._point_table.refresh(
                environment.points, environment.obstacles, environment.records
            )
        return self._fixed_points

    def _find_face_rows(
        self,
        chosen: np.ndarray,
        environment: Environment,
        h: float,
        members: np.ndarray,
        found: int,
    ) -> int:
        state, (points, sets) = self._state, self._points_of(environment)
        # bodies are thicker meanwhile: what is within their margins may touch in this tick
        thickness = state.bodies['thickness']
        own, contacts = thickness[chosen], NO_CONTACTS
        thickness[chosen] += members['margin']
        try:
            candidates = find_candidates(
                state, chosen, environment.surfaces, points, sets, self._any_regions
            )  # fmt: skip
            if candidates is not None:
                numbers = np.arange(len(chosen) + len(sets))
                first = np.empty(len(chosen) + 1, np.int64)
                first[:-1], first[-1] = state.bodies['first'][chosen], state.x.shape[2]
                contacts = find_body_contacts(
                    state, chosen, environment.surfaces, candidates, numbers, first
                )
        finally:
            thickness[chosen] = own
        if found + len(contacts) > len(self._rows):
            rows = np.zeros(2 * (found + len(contacts)), ROW)
            rows[:found] = self._rows[:found]
            self._rows = rows
        return resolution.find_face_rows(
            state.bodies, contacts, sets, state.shapes, state.weights, state.x,
            state.v, self._flown, h, state.contact_memory, members, self._rows, found,
            state.is_pinned,
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
