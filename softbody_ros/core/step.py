# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""One tick of all awake bodies, as a sequence of its stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softbody_ros.core.collision import narrow_phase
from softbody_ros.core.collision.body_contacts import find_body_contacts, find_candidates
from softbody_ros.core.collision.collision_surface import CollisionSurfaces
from softbody_ros.core.collision.obstacle_contacts import CONTACT
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.collision.point_obstacles import PointObstacles
from softbody_ros.core.compiled import kernel
from softbody_ros.core.contact import body_body, resolution, rigid_obstacle, soft_obstacle
from softbody_ros.core.contact.contact_state import FixedPoints
from softbody_ros.core.contact.exchange import accept_exchange, add_up
from softbody_ros.core.contact.members import MEMBER
from softbody_ros.core.contact.rows import MEMORY, NO_MEMORY, POINT_SET, ROW
from softbody_ros.core.geometry.bounding_boxes import bound_bodies, overlapping
from softbody_ros.core.geometry.bvh import Trees
from softbody_ros.core.shape_matching import flight, modal_flight, pins
from softbody_ros.core.sleeping import NEAR, islands
from softbody_ros.core.state import Body, State

CONTACTS_PER_PARTICLE = 3
"""Capacity for contacts of a rigid body, per particle."""
NOBODY = np.zeros(0, np.int64)
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

    @cached_property
    def fixed_points(self) -> list[FixedPoints]:
        """Immovable points: those received, and those along edges of obstacles."""
        still = np.zeros(3)
        last = len(self.obstacles)
        sets = [(self.points, still, still, still, False, last)] if len(self.points) else []
        for row, obstacle in enumerate(self.obstacles):
            if obstacle.config.type != 'plane':
                linear = np.array(obstacle.config.velocity_linear)
                angular = np.array(obstacle.config.velocity_angular)
                sets.append((obstacle.edge_points, obstacle.position, linear, angular, True, row))
        return [
            FixedPoints(each.points_along_x, each.radius, centre, linear, angular, is_edge, row)
            for each, centre, linear, angular, is_edge, row in sets
        ]

    @cached_property
    def point_sets(self) -> np.ndarray:
        """The fixed points for kernels, (s,) POINT_SET."""
        sets = np.zeros(len(self.fixed_points), POINT_SET)
        for record, each in zip(sets, self.fixed_points, strict=True):
            record['obstacle'], record['centre'] = each.obstacle, each.centre
            record['linear'], record['angular'] = each.velocity, each.angular_velocity
        return sets


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
        self.work = np.zeros(3, np.int64)
        self._scratch = np.empty((7, len(self._contacts)))
        self.update()

    def update(self) -> None:
        """Update what depends on the modes and pins of the bodies, after they change."""
        mode = self._state.bodies['mode']
        pinned = np.flatnonzero(self._state.bodies['pins'])
        self._any_rigid, self._any_soft = bool((mode == 0).any()), bool((mode != 0).any())
        # those with pins or regions still follow the laws of release 0.1.0
        bodies = self._state.bodies
        self._by_laws = (bodies['pins'] > 0) | ((bodies['regions'] > 0) & (mode != 0))
        self._pinned_soft = pinned[mode[pinned] != 0]
        self._pinned_rigid = pinned[mode[pinned] == 0]
        # whether collisions between bodies, or self-collisions, are possible
        self._any_pairs = len(mode) > 1 or bool((self._state.bodies['regions'] > 1).any())

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
        state, gravity = self._state, environment.gravity
        modal, others = self._modal_islands(awake, gravity, h)
        memory = NO_MEMORY
        self._fly(modal, gravity, h)
        if len(others):
            self._predict_and_match(others, gravity, h)
            if self._any_pairs or environment.fixed_points:
                body_body.resolve_body_contacts(
                    state, others, environment.surfaces, environment.fixed_points,
                    lambda chosen: self.standing(chosen, environment), gravity, h,
                )  # fmt: skip
            if len(environment.records):
                self.resolve_obstacle_contacts(others, environment, h)
        if len(modal):
            memory = self.resolve_contacts(modal, environment, h)
        self._hold_pins(awake, h)
        accept(
            state.bodies, awake, state.shapes, state.weights, state.x, h, state.reaction,
            state.normal_impulse, state.obstacle_impulse, state.obstacle_total,
        )  # fmt: skip
        state.contact_memory = memory

    def _modal_islands(
        self, awake: np.ndarray, gravity: np.ndarray, h: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Divide awake bodies: those that touch no pins and regions, and the others."""
        by_laws = self._by_laws[awake]
        if by_laws.all():
            return NOBODY, awake
        if not by_laws.any():
            return awake, NOBODY
        bodies, count = self._state.bodies, len(awake)
        low, high = np.empty((count, 3)), np.empty((count, 3))
        # not by the velocity in the record: after a change of the state that is an old one
        velocities = (self._state.velocities(index) for index in awake.tolist())
        way = h * (np.array([np.abs(v).max() for v in velocities]) + h * np.abs(gravity).max())
        margin = bodies['thickness'][awake] + NEAR * self._state.scales[awake] + way
        bound_bodies(bodies, awake, self._state.x, 0, margin, low, high)
        island = islands(count, *overlapping(low, high))
        has_others = np.zeros(count, dtype=bool)
        has_others[island[by_laws]] = True
        others = has_others[island]
        return awake[~others], awake[others]

    def _fly(self, chosen: np.ndarray, gravity: np.ndarray, h: float) -> None:
        state = self._state
        failed = modal_flight.fly(
            state.bodies, chosen, state.shapes, state.weights, state.q, state.x, state.v,
            state.stretch, state.match_centre, state.match_posture, state.regions,
            state.member, state.weighted_features, state.faces, gravity, h,
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
        state, bodies = self._state, self._state.bodies
        members = np.zeros(len(chosen), MEMBER)
        memory, found = state.contact_memory, 0
        others = len(chosen) > 1 or bool(environment.fixed_points)
        while True:
            found = resolution.find_obstacle_rows(
                bodies, chosen, state.shapes, state.weights, state.q, state.x, state.v,
                environment.records, environment.trees, h, memory, others, members,
                self._contacts, self._rows,
            )  # fmt: skip
            if found <= len(self._rows):
                break
            self._rows = np.zeros(2 * found, ROW)
        if others:
            found = self._find_face_rows(chosen, environment, h, members, found)
        if len(self._memory) < found:
            self._memory = np.zeros(len(self._rows), MEMORY)
        kept = resolution.resolve(
            bodies, state.shapes, state.weights, state.q, state.x, state.v, environment.records,
            environment.trees, h, members, self._rows[:found], self._places, self._memory,
            state.obstacle_impulse, state.normal_impulse, self.work,
        )  # fmt: skip
        if kept == 0:
            return NO_MEMORY
        order = np.argsort(self._memory['key'][:kept], kind='stable')
        return self._memory[order]

    def _find_face_rows(
        self,
        chosen: np.ndarray,
        environment: Environment,
        h: float,
        members: np.ndarray,
        found: int,
    ) -> int:
        state, fixed = self._state, environment.fixed_points
        thick = state.bodies.copy()
        thick['thickness'][chosen] += members['margin']
        candidates = find_candidates(state, thick, chosen, environment.surfaces, fixed)
        contacts = NO_CONTACTS
        if candidates is not None:
            numbers = np.arange(len(chosen) + len(fixed))
            first = np.append(thick['first'][chosen], state.x.shape[2])
            contacts, _ = find_body_contacts(
                state, thick, chosen, environment.surfaces, candidates[0], numbers, first
            )
        if found + len(contacts) > len(self._rows):
            rows = np.zeros(2 * (found + len(contacts)), ROW)
            rows[:found] = self._rows[:found]
            self._rows = rows
        return resolution.find_face_rows(
            state.bodies, contacts, environment.point_sets, state.shapes, state.weights, state.q,
            state.x, state.v, h, state.contact_memory, members, self._rows, found,
        )  # fmt: skip

    def resolve_obstacle_contacts(
        self, awake: np.ndarray, environment: Environment, h: float
    ) -> None:
        """Resolve the contacts of bodies (A,) with obstacles, see `take_tick`."""
        state, gravity = self._state, environment.gravity
        if self._any_soft:
            soft_obstacle.resolve(
                state.bodies, awake, state.shapes, state.weights, state.q, state.x, state.v,
                state.region_goals, environment.records, environment.trees, gravity, h,
                self._contacts, self._scratch, state.obstacle_impulse, state.normal_impulse,
            )  # fmt: skip
        if self._any_rigid:
            rigid_obstacle.resolve(
                state.bodies, awake, state.x, state.v, environment.records, environment.trees,
                gravity, h, self._contacts, self._scratch, state.obstacle_impulse,
                state.normal_impulse,
            )  # fmt: skip

    def _predict_and_match(self, awake: np.ndarray, gravity: np.ndarray, h: float) -> None:
        state = self._state
        failed = flight.predict_and_match(
            state.bodies, awake, state.shapes, state.weights, state.q, state.regions,
            state.member, state.features, state.weighted_features, state.x, state.v,
            state.region_goals, state.stretch, state.match_centre, state.match_posture, gravity, h,
        )  # fmt: skip
        if failed:
            self._fail(failed)

    def standing(self, chosen: np.ndarray, environment: Environment) -> np.ndarray:
        """Return the contacts of bodies with obstacles before their resolution: (s,) STANDING."""
        state = self._state
        standing = np.empty(256, soft_obstacle.STANDING)
        while True:
            found = soft_obstacle.find_standing(
                state.bodies, chosen, state.shapes, state.q, state.x, state.region_goals,
                environment.records, environment.trees, self._contacts, standing,
            )  # fmt: skip
            if found <= len(standing):
                return standing[:found]
            standing = np.empty(found, soft_obstacle.STANDING)

    def _hold_pins(self, awake: np.ndarray, h: float) -> None:
        state = self._state
        if len(self._pinned_soft):
            pinned = np.intersect1d(self._pinned_soft, awake)
            pins.hold(state.bodies, pinned, state.pinned, state.x, state.v, h)
        if len(self._pinned_rigid):
            for index in np.intersect1d(self._pinned_rigid, awake).tolist():
                now, columns = state.bodies['now'][index], state.columns(index)
                body = self._bodies[index]
                assert body.pins is not None
                pins.hold_rigid_body(
                    state.x[now, :, columns], state.x[1 - now, :, columns],
                    state.v[1 - now, :, columns], body.pins, body.rest, h,
                )  # fmt: skip


@kernel
def accept(
    bodies: np.ndarray,
    awake: np.ndarray,
    shapes: np.ndarray,
    weights: np.ndarray,
    x: np.ndarray,
    h: float,
    reaction: np.ndarray,
    normal_impulse: np.ndarray,
    obstacle_impulse: np.ndarray,
    obstacle_total: np.ndarray,
) -> None:
    """
    Make the computed halves the state, and integrate the wrenches of contacts over time.

    Parameters
    ----------
    bodies, awake, shapes, weights, x, h
        see `flight.predict_and_match`
    reaction, normal_impulse, obstacle_impulse, obstacle_total
        see `State`

    """
    for index in range(len(awake)):
        body = bodies[awake[index]]
        body['now'] = 1 - body['now']
        body['is_plastic'] = body['is_plastic'] or body['flowed']
        accept_exchange(
            body, shapes[body['shape']], weights, x[body['now']], h,
            obstacle_impulse[awake[index]], normal_impulse, reaction[awake[index]],
        )  # fmt: skip
    for index in range(len(bodies)):
        add_up(bodies[index], reaction[index], h, obstacle_impulse[index], obstacle_total)
